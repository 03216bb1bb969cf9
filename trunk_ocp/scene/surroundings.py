"""What surrounds the trunk in a plan besides solids: logs, the mass at the tip, and the targets.

Every figure, film and page takes its objects from here, so that all of them show the same ones.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..planning.plan import Plan
from ..problem.interpolation import interpolate
from ..problem.motion import LENGTH_OVER_RADIUS
from ..problem.targets import HeldDirection
from ..rod.shape import Shape
from .moments import TIME_TOL, Moment, phase_at

Places = Callable[[int, float], tuple[np.ndarray, np.ndarray]]
MASS_DENSITY = 1000.0  # kg/m^3; nothing states the size of a tip mass, so it is a ball of water


@dataclass(frozen=True, eq=False)
class Log:
    """A cylinder along e_Y that the trunk wraps around.

    radius and length in m; centers (H + 1, 3) in m, at the start and at each planned time step.
    """

    radius: float
    length: float
    centers: np.ndarray

    def center(self, plan: Plan, time: float) -> np.ndarray:
        """Center (3,) in m at a time in s; it follows each phase's interpolation, as the trunk."""
        return interpolate(plan.motion, self.centers, time)


@dataclass(frozen=True, eq=False)
class TipMass:
    """A ball that some phases hang on the tip: mass in kg, radius in m.

    It waits at `place` (3,) in m until the first of those phases begins, at `taken` in s; once
    released it is gone, because nothing says where it goes. `carried` has, phase by phase,
    whether it hangs on the tip.
    """

    mass: float
    radius: float
    place: np.ndarray
    taken: float
    carried: tuple[bool, ...]

    def center(self, plan: Plan, moment: Moment) -> np.ndarray | None:
        """Center (3,) in m at a moment; None where it is gone."""
        if self.carried[phase_at(plan.motion, moment.time, moment.after)]:
            return _ahead_of_tip(moment.shape, self.radius)
        return self.place if moment.time <= self.taken + TIME_TOL else None


@dataclass(frozen=True, eq=False)
class Mark:
    """A target of a time step: Z and position (3,) in m, where the trunk is, wanted directions.

    Of a target that asks for directions only, the position is where the trunk's point is, and
    `placed` is False. `directors` (0, 1, 2) are those that the directions are for, and `source` is
    the section of the problem file that asks, such as "phases[1].targets[2]".
    """

    Z: float
    target: np.ndarray
    reached: np.ndarray
    directions: tuple[np.ndarray, ...]
    placed: bool = True
    directors: tuple[int, ...] = ()
    source: str = ""


def logs(plan: Plan) -> list[Log]:
    """Logs that a plan's motion wraps the trunk around (eqs. 46-54), one for each radius.

    A log is there from the start to the end: before the trunk takes it and after it lets go, it
    lies where it was.
    """
    steps = [step.log for step in plan.motion.steps]
    placed = [log for log in steps if log is not None and log.center is not None]
    cylinders = []
    for radius in dict.fromkeys(log.radius for log in placed):
        lengths = (log.length for log in placed if log.radius == radius)
        length = next((length for length in lengths if length), LENGTH_OVER_RADIUS * radius)
        center = next(log.center for log in placed if log.radius == radius)
        centers = [center]
        for log in steps[: len(plan.x)]:
            if log is not None and log.radius == radius and log.center is not None:
                center = log.center
            centers.append(center)
        cylinders.append(Log(radius, length, np.array(centers)))
    return cylinders


def tip_mass(plan: Plan) -> TipMass | None:
    """The mass that phases hang on the tip; None if there is none, or the plan ends before."""
    phases = plan.motion.spec.phases
    mass = max(phase.loads.tip_mass for phase in phases)
    carried = tuple(phase.loads.tip_mass > 0 for phase in phases)
    numbers = [step.phase for step in plan.motion.steps[: len(plan.x)]]
    first = next((i for i, number in enumerate(numbers) if carried[number]), None)
    if mass <= 0 or first is None:
        return None
    radius = (3 * mass / (4 * math.pi * MASS_DENSITY)) ** (1 / 3)
    before = plan.part(first - 1, first) if first else Shape.stack([plan.sample(0.0).shape])
    taken = plan.motion.steps[first - 1].time if first else 0.0
    place = _ahead_of_tip(before, radius)
    return TipMass(mass, radius, place, taken, carried)


def _ahead_of_tip(shape: Shape, radius: float) -> np.ndarray:
    """Center (3,) of a ball that touches the tip along d3, in the first shape of a batch."""
    tip = np.array([shape.trunk.length])
    center: np.ndarray = shape.position(tip)[0, 0] + radius * shape.directors(tip)[0, 0, 2]
    return center


def marks(plan: Plan, number: int, at: Places | None = None) -> list[Mark]:
    """Targets of a planned time step (from 0) that have a weight, and where the trunk is.

    `at` gives position and directors of a point Z of a time step; by default those of the
    independent check.
    """
    at = at or plan.verification.at
    trunk, head = plan.motion.trunk, plan.head[number]
    step_marks = []
    for target in plan.motion.steps[number].targets:
        pairs = target.pairs()
        directions = tuple(
            at(wanted.step, wanted.Z)[1][wanted.director]
            if isinstance(wanted, HeldDirection)
            else target.direction_at(wanted, head)
            for _, wanted, _ in pairs
        )
        directors = tuple(director for director, _, _ in pairs)
        reached, _ = at(number, target.Z)
        placed = target.position is not None and target.position_weight > 0
        if placed or directions:
            place = target.position_at(trunk, head) if placed else reached
            step_marks.append(
                Mark(target.Z, place, reached, directions, placed, directors, target.source)
            )
    return step_marks

"""What surrounds the trunk in a plan: the head, logs, the mass at the tip, and the targets.

Every figure, film and page takes its objects from here, so that all of them show the same ones.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..model.anatomy import Trunk
from ..planning.plan import Plan
from ..problem.interpolation import interpolate
from ..problem.motion import Motion
from ..problem.problem_file import LogSpec, PhaseSpec
from ..problem.targets import HeldDirection
from ..rod.statics import Shape
from .moments import TIME_TOL, Moment, batch_of_one, phase_at

MASS_DENSITY = 1000.0  # kg/m^3; nothing states the size of a tip mass, so it is a ball of water
LENGTH_OVER_RADIUS = 12.0  # of a log of which only the radius is given; lift-log's own ratio


@dataclass(frozen=True, eq=False)
class Log:
    """A cylinder along e_Y that the trunk wraps around.

    radius and length in m; centers (H + 1, 3) in m, at rest and at each planned time step.
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
    `placed` is False.
    """

    Z: float
    target: np.ndarray
    reached: np.ndarray
    directions: tuple[np.ndarray, ...]
    placed: bool = True


def head_sphere(trunk: Trunk) -> tuple[np.ndarray, float] | None:
    """Center (3,) and radius in m of the sphere on which the head moves the base (eq. 35)."""
    head = trunk.head
    if head.pivot_radius == 0:
        return None
    tilt, turn = head.xi_y, head.xi_z
    # s of eq. (36), from the center to the base
    s = np.array([np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.cos(tilt)])
    return -head.pivot_radius * s, head.pivot_radius  # at rest the base is the origin


def logs(plan: Plan) -> list[Log]:
    """Logs that a plan's motion wraps the trunk around (eqs. 46-54), one for each radius.

    A log is there from rest to the end: before the trunk takes it and after it lets go, it lies
    where it was.
    """
    motion = plan.motion
    wraps = [phase.wrap for phase in motion.spec.phases if phase.wrap is not None]
    cylinders = []
    for radius in dict.fromkeys(wrap.log_radius for wrap in wraps):
        load = _load_of_log(motion.spec.phases, radius)
        length = load.length if load else LENGTH_OVER_RADIUS * radius
        # The couple -d W e_X of eq. (54) is that of a weight at a distance d toward -Y.
        middle = np.array([0.0, -load.offset if load else 0.0, 0.0])
        grips = _grips(motion, radius)[: len(plan.x) + 1]
        cylinders.append(Log(radius, length, grips + middle))
    return cylinders


def _load_of_log(phases: tuple[PhaseSpec, ...], radius: float) -> LogSpec | None:
    """The load that belongs to the log of a wrap; none if its weight is never taken."""
    fitting = (phase for phase in phases if phase.wrap is None or phase.wrap.log_radius == radius)
    return next((phase.loads.log for phase in fitting if phase.loads.log is not None), None)


def _grips(motion: Motion, radius: float) -> np.ndarray:
    """Where the trunk grips a log, (steps + 1, 3) m, at rest and at every time step."""
    grips = [_grip(motion, number, radius) for number in range(len(motion.steps))]
    last = next(grip for grip in grips if grip is not None)
    rows = [last]
    for grip in grips:
        last = last if grip is None else grip
        rows.append(last)
    return np.array(rows)


def _grip(motion: Motion, number: int, radius: float) -> np.ndarray | None:
    """Center of the arc of a time step (from 0), from the step's targets, which know the origin."""
    step = motion.steps[number]
    wrap = motion.spec.phases[step.phase].wrap
    if wrap is None or wrap.log_radius != radius:
        return None
    first = step.targets[-wrap.points]  # a phase's wrap follows its other targets
    assert first.position is not None
    angle = math.radians(wrap.angles_deg[0])
    distance = radius + float(motion.trunk.radius(first.Z))
    return np.asarray(first.position) - distance * np.array([math.sin(angle), 0, math.cos(angle)])


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
    before = plan.part(first - 1, first) if first else batch_of_one(plan.sample(0.0).shape)
    taken = plan.motion.steps[first - 1].time if first else 0.0
    place = _ahead_of_tip(before, radius)
    return TipMass(mass, radius, place, taken, carried)


def _ahead_of_tip(shape: Shape, radius: float) -> np.ndarray:
    """Center (3,) of a ball that touches the tip along d3, in the first shape of a batch."""
    tip = np.array([shape.trunk.length])
    center: np.ndarray = shape.position(tip)[0, 0] + radius * shape.directors(tip)[0, 0, 2]
    return center


def marks(plan: Plan, number: int) -> list[Mark]:
    """Targets of a planned time step (from 0) that have a weight, and where the trunk is."""
    at = plan.verification.at
    step_marks = []
    for target in plan.motion.steps[number].targets:
        directions = tuple(
            at(wanted.step, wanted.Z)[1][wanted.director]
            if isinstance(wanted, HeldDirection)
            else np.asarray(wanted)
            for _, wanted, _ in target.pairs()
        )
        reached, _ = at(number, target.Z)
        if target.position is not None and target.position_weight > 0:
            step_marks.append(Mark(target.Z, np.asarray(target.position), reached, directions))
        elif directions:
            step_marks.append(Mark(target.Z, reached, reached, directions, placed=False))
    return step_marks

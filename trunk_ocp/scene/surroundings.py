"""What a motion is about besides the trunk: the head, logs, what hangs at the tip, targets."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..model.anatomy import Trunk
from ..planning.plan import Plan
from ..problem.motion import Motion
from ..problem.problem_file import WrapSpec
from ..problem.targets import HeldDirection


@dataclass(frozen=True, eq=False)
class Log:
    """A cylinder about e_Y that the trunk wraps around: center (3,), radius and length in m."""

    center: np.ndarray
    radius: float
    length: float


@dataclass(frozen=True, eq=False)
class Mark:
    """A target position (3,) in m, where the trunk got instead, and the wanted directions.

    Of a target that asks for directions only, the position is where the trunk's point got and
    `placed` is False.
    """

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


def log_at(motion: Motion, step: int) -> Log | None:
    """The log at a time step (from 0), if its phase wraps around one (eqs. 46-53)."""
    wrap = motion.spec.phases[motion.steps[step].phase].wrap
    if wrap is None:
        return None
    length, offset = _size(motion, wrap)
    center = _wrap_center(motion, step, wrap)
    # The couple -d W e_X of eq. (54) is that of a weight at a distance d toward -Y.
    return Log(center - np.array([0.0, offset, 0]), wrap.log_radius, length)


def _wrap_center(motion: Motion, step: int, wrap: WrapSpec) -> np.ndarray:
    """From the targets themselves, which know the origin; the wrap's come last of a step's."""
    first = motion.steps[step].targets[-wrap.points]
    angle = np.radians(wrap.angles_deg[0])
    distance = wrap.log_radius + float(motion.trunk.radius(wrap.Z[0]))
    assert first.position is not None
    return np.asarray(first.position) - distance * np.array([np.sin(angle), 0, np.cos(angle)])


def _size(motion: Motion, wrap: WrapSpec) -> tuple[float, float]:
    """Length and offset of the log; it is the same one before its weight is taken."""
    for phase in motion.spec.phases:
        if phase.loads.log is not None and phase.loads.log.radius == wrap.log_radius:
            return phase.loads.log.length, phase.loads.log.offset
    return 4 * wrap.log_radius, 0.0  # nothing says how long it is


def marks(plan: Plan, step: int) -> list[Mark]:
    """Targets of a time step (from 0) that have a weight, and what was reached."""
    at = plan.verification.at
    found = []
    for target in plan.motion.steps[step].targets:
        directions = []
        for _, wanted, _ in target.pairs():
            if isinstance(wanted, HeldDirection):
                directions.append(at(wanted.step, wanted.Z)[1][wanted.director])
            else:
                directions.append(np.asarray(wanted))
        reached, _ = at(step, target.Z)
        if target.position is not None and target.position_weight > 0:
            found.append(Mark(np.asarray(target.position), reached, tuple(directions)))
        elif directions:
            found.append(Mark(reached, reached, tuple(directions), placed=False))
    return found


def steps_of(plan: Plan, number: int) -> list[int]:
    """Planned time steps (from 0) of a phase."""
    return [i for i, s in enumerate(plan.motion.steps[: len(plan.x)]) if s.phase == number]


def carried(motion: Motion, number: int) -> float:
    """Mass in kg that hangs at the tip during a phase."""
    return motion.spec.phases[number].loads.tip_mass

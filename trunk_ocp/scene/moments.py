"""Moments of a motion to draw: which times show it, and the trunk's shape at each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import TrunkError
from ..model.loads import Loads
from ..planning.plan import Plan
from ..problem.interpolation import interpolate
from ..problem.motion import Motion
from ..rod.shape import Shape
from ..rod.statics import solve_statics

TIME_TOL = 1e-9  # s; times closer than this are the same


@dataclass(frozen=True, eq=False)
class Moment:
    """The trunk at a time in s: activation (muscles,), head (2,) in rad, shape of batch (1,).

    `after` is set on the later side of a jump of the loads.
    """

    time: float
    activation: np.ndarray
    head: np.ndarray
    shape: Shape
    after: bool = False


def end_of(plan: Plan) -> float:
    """Time in s at which a plan ends; 0 if it has no time steps."""
    return plan.motion.steps[len(plan.x) - 1].time if len(plan.x) else 0.0


def moments_at(plan: Plan, times: np.ndarray, phase: int | None = None) -> list[Moment]:
    """Moments of a plan at times in s, sorted; those without an equilibrium are left out.

    Where loads jump there are two: before and after. With a phase, given by its number, only the
    side that belongs to it.
    """
    values = plan.trajectory
    moments = []
    for time in np.unique(times).tolist():
        x = values[0] if time == 0 else interpolate(plan.motion, values, time)
        for after in _sides(plan, time, phase):
            shape = _shape(plan, time, after)
            if shape is not None:
                moments.append(Moment(time, x[:-2], x[-2:], shape, after))
    return moments


def _sides(plan: Plan, time: float, phase: int | None) -> tuple[bool, ...]:
    """Before or after a jump of the loads, or both."""
    if not any(abs(jump - time) < TIME_TOL for jump in plan.jumps):
        return (False,)
    if phase is None:
        return False, True
    return (abs(_start(plan.motion, phase) - time) < TIME_TOL,)


def _start(motion: Motion, phase: int) -> float:
    return motion.phases[phase - 1].end if phase else 0.0


def _shape(plan: Plan, time: float, after: bool) -> Shape | None:
    """Shape (1,) at a time; None if the trunk has no equilibrium, as in a plan that failed."""
    steps = plan.motion.times[: len(plan.x)]
    same = np.flatnonzero(np.abs(steps - time) < TIME_TOL)
    if same.size and not after:  # the planned shape, not another solve
        return plan.part(int(same[0]), int(same[0]) + 1)
    try:
        if time == 0 and not after:
            x0, weight = plan.motion.start, Loads(plan.motion.gravity)
            start = solve_statics(plan.motion.trunk, x0[:-2], x0[-2:], loads=weight)
            return Shape.stack([start])
        at = float(steps[same[0]]) if same.size else time
        return Shape.stack([plan.sample(at, after=after).shape])
    except TrunkError:
        return None


def phase_at(motion: Motion, time: float, after: bool = False) -> int:
    """Number of the phase that leads to a time in s; `after` at a phase's end, of the next."""
    ends = [phase.end for phase in motion.phases[:-1]]
    return int(np.searchsorted(ends, time + (TIME_TOL if after else -TIME_TOL)))


def times_of_phase(plan: Plan, number: int, count: int = 4) -> np.ndarray:
    """Times in s that show a phase from start to end; its steps where nothing is in between."""
    start, end = _start(plan.motion, number), end_of(plan)
    phase = plan.motion.phases[number]
    if start >= end:
        return np.zeros(0)
    times = np.linspace(start, min(phase.end, end), count)
    if phase.interpolation == "none":
        steps = np.append(start, plan.motion.times[: len(plan.x)])
        return np.unique([steps[np.argmin(np.abs(steps - time))] for time in times])
    return times


def times_of_motion(plan: Plan, count: int = 5) -> np.ndarray:
    """Times in s that show a whole motion: the ends of its phases, and the middle of long ones."""
    end = end_of(plan)
    ends = [phase.end for phase in plan.motion.phases if phase.end < end - TIME_TOL] + [end]
    if len(ends) > count:
        return np.asarray(ends)[np.linspace(0, len(ends) - 1, count).round().astype(int)]
    times = [0.0, *ends]
    while len(times) - 1 < count and end > 0:
        longest = int(np.argmax(np.diff(times)))
        times.insert(longest + 1, (times[longest] + times[longest + 1]) / 2)
    return np.asarray(times[1:])


def curve_times(plan: Plan, count: int = 200) -> np.ndarray:
    """Times in s for smooth curves: even ones, all steps, and just before each for what jumps."""
    steps = plan.motion.times[: len(plan.x)]
    even = np.linspace(0, end_of(plan), count)
    return np.unique(np.concatenate([even, steps, steps - TIME_TOL]))


def curves(plan: Plan, times: np.ndarray) -> np.ndarray:
    """Activations and head angles (rad) at times in s: (times, muscles + 2)."""
    values = plan.trajectory
    if len(values) == 1:
        return np.repeat(values, len(times), axis=0)
    return np.array([interpolate(plan.motion, values, float(time)) for time in times])

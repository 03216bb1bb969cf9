"""Interpolation between time steps (section 5.2), and loads that jump where a phase starts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.interpolate import CubicHermiteSpline, PchipInterpolator

from .._support.arguments import real_array
from .._support.ranges import shown
from ..errors import InputError
from ..model.loads import Loads, vector
from .motion import Motion

TIME_ROUND_OFF = 1e-12  # of the planned time; times closer than this to a time step are at it
LOAD_TOL = 1e-6  # relative difference of loads, below which it is the solver's inaccuracy

# Columns of the table of loads, named as in a problem file.
PARTS = {
    "tip_force": slice(0, 3),
    "tip_mass": slice(3, 6),
    "pull": slice(6, 9),
    "contact": slice(9, 15),
}
GRAVITY = 15


def interpolate(motion: Motion, values: np.ndarray, t: float) -> np.ndarray:
    """Values at time t in s from those at time steps 0, 1, ...: (steps + 1, n) to (n,).

    "cosine" blends neighbors with zero rate at both; "none" holds the earlier one.
    "hermite" is a cubic Hermite spline over the phase. The paper does not give its slopes; here
    they are the monotone ones of Fritsch & Butland, so that no value leaves the interval of its
    neighbors, and zero at the ends of the phase, so that it joins the neighboring phases smoothly
    and the motion ends at rest. The extension of a segment, a sum over muscles with different
    rates, may exceed its bounds slightly between steps (by at most 0.0035 in the shipped motions);
    with "cosine" it cannot.

    Raises
    ------
    InputError
        If t is outside the planned time by more than rounding error.
    """
    t = planned_time(motion, len(values) - 1, t)
    return interpolate_all(motion, values, np.array([t]))[0]


def interpolate_all(motion: Motion, values: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Values (m, n) at times (m,) in s within the planned time; see `interpolate`."""
    knots = _times(motion, len(values) - 1)
    # Each time is in (knots[i - 1], knots[i]].
    intervals = np.clip(np.searchsorted(knots, times), 1, len(knots) - 1)
    result = np.empty((times.size, values.shape[1]))
    pieces = _pieces(motion, len(knots) - 1)[intervals]
    for piece in np.unique(pieces):
        inside = pieces == piece
        result[inside] = _in_piece(motion, values, knots, intervals[inside], times[inside])
    at_step = times == knots[intervals]
    result[at_step] = values[intervals[at_step]]
    result[times == 0] = values[0]
    return result


def _pieces(motion: Motion, count: int) -> np.ndarray:
    """First of the intervals that are interpolated together, of each (count + 1,), from 1.

    A spline is one over its phase; other interpolations know their two time steps only.
    """
    pieces = np.arange(count + 1)
    for i in range(2, count + 1):
        phase = motion.steps[i - 1].phase
        together = motion.phases[phase].interpolation == "hermite"
        if together and motion.steps[i - 2].phase == phase:
            pieces[i] = pieces[i - 1]
    return pieces


def _in_piece(
    motion: Motion, values: np.ndarray, times: np.ndarray, i: np.ndarray, t: np.ndarray
) -> np.ndarray:
    """Values (m, n) at times t (m,) in intervals i (m,) of one piece.

    Interval i is from time step i - 1, at `times`, to time step i.
    """
    phase = motion.steps[i[0] - 1].phase
    kind = motion.phases[phase].interpolation
    if kind == "none":
        return np.asarray(values[i - 1])
    if kind == "cosine":
        duration = times[i] - times[i - 1]
        duration[duration == 0] = 1.0  # for a plan without steps
        share = (1 - np.cos(np.pi * (t - times[i - 1]) / duration))[:, None] / 2
        return np.asarray((1 - share) * values[i - 1] + share * values[i])
    steps = [n for n in range(1, len(values)) if motion.steps[n - 1].phase == phase]
    knots = np.arange(steps[0] - 1, steps[-1] + 1)
    slopes = np.zeros_like(values[knots])
    if len(knots) > 2:
        slopes[1:-1] = PchipInterpolator(times[knots], values[knots])(times[knots[1:-1]], 1)
    return np.asarray(CubicHermiteSpline(times[knots], values[knots], slopes)(t))


def loads_at(motion: Motion, planned: Sequence[Loads], t: float, after: bool = False) -> Loads:
    """Loads at time t in s, from those of the planned steps 1, 2, ...

    At a time step they are the step's own, at time 0 weight alone. In between, each load follows
    its phase's interpolation, from its value at the step before - or, if it jumps, from its value
    right after the start of the phase; see `JumpSpec`.

    Parameters
    ----------
    after : bool
        At the start of a phase, the loads right after those that jump have jumped.

    Raises
    ------
    InputError
        If t is outside the planned time by more than rounding error.
    """
    times = _times(motion, len(planned))
    t = planned_time(motion, len(planned), t)
    step = int(np.searchsorted(times, t))  # the first that is not before t
    at_step = bool(t == times[step])
    if at_step and not (after and step in _starts(motion, len(planned))):
        return planned[step - 1] if step else Loads(motion.gravity)
    end = step + 1 if at_step else step
    if at_step:
        row = _after_jumps(motion, _table(motion, planned), end)[step]
        return _loads(planned, end, row)
    return loads_before(motion, planned, end, np.array([t]))[0]


def loads_before(
    motion: Motion, planned: Sequence[Loads], step: int | np.ndarray, times: np.ndarray
) -> list[Loads]:
    """Loads at times (m,) in s between time steps `step` (from 1), one or (m,), and those before.

    Most do not change from one time to the next; those share one object.
    """
    steps, table = np.broadcast_to(step, times.shape), _table(motion, planned)
    phases = np.array([motion.steps[i - 1].phase for i in steps.tolist()])
    rows = np.empty((times.size, table.shape[1]))
    for phase in np.unique(phases):
        inside = phases == phase
        jumped = _after_jumps(motion, table, int(steps[inside][0]))
        rows[inside] = interpolate_all(motion, jumped, times[inside])
    found: dict[tuple[int, bytes], Loads] = {}
    keys = [(i, row.tobytes()) for i, row in zip(steps.tolist(), rows, strict=True)]
    for (i, name), row in zip(keys, rows, strict=True):
        if (i, name) not in found:
            found[i, name] = _loads(planned, i, row)
    return [found[key] for key in keys]


def _loads(planned: Sequence[Loads], step: int, row: np.ndarray) -> Loads:
    """Loads from a row of the table, on the way to a time step (from 1)."""
    tip = row[PARTS["tip_force"]] + row[PARTS["tip_mass"]] + row[PARTS["pull"]]
    contact = row[PARTS["contact"]]
    before, last = planned[max(step - 2, 0)], planned[step - 1]
    touching = last if last.contact_from is not None else before
    return Loads(
        float(row[GRAVITY]),
        vector(tip),
        touching.contact_from,
        vector(contact[:3]),
        vector(contact[3:]),
        touching.contact_lever,
    )


def jumps(motion: Motion, planned: Sequence[Loads]) -> tuple[float, ...]:
    """Times in s at which loads of the planned steps 1, 2, ... jump: starts of phases."""
    times = _times(motion, len(planned))
    return tuple(
        float(times[step])
        for step in _starts(motion, len(planned))
        if _differ(
            loads_at(motion, planned, times[step]), loads_at(motion, planned, times[step], True)
        )
    )


def _number(t: object) -> float:
    """A time as a number; InputError if it is not one."""
    try:
        value = real_array(t, "t")
    except InputError:
        value = np.zeros(1)
    if t is None or value.ndim or isinstance(t, str | bytes):
        raise InputError(f"t = {shown(t, repr)}: expected one number, a time in s.")
    return float(value)


def planned_time(motion: Motion, count: int, t: float) -> float:
    """Time t in s, moved to 0 or one of `count` time steps if it differs by round-off only.

    Raises
    ------
    InputError
        If t is not a number, or is outside the planned time by more than rounding error.
    """
    times, t = _times(motion, count), _number(t)
    end = float(times[-1])
    if not -TIME_ROUND_OFF * end <= t <= end * (1 + TIME_ROUND_OFF):
        raise InputError(f"t = {t!r}: expected a time from 0 to {end!r} s.")
    nearest = float(times[np.argmin(np.abs(times - t))])
    return nearest if abs(nearest - t) <= TIME_ROUND_OFF * end else t


def with_marks(times: np.ndarray, marks: Sequence[float], gap: float) -> np.ndarray:
    """Sorted times and marks in s; marks replace times closer than `gap`, except both ends."""
    if not len(marks):
        return times
    apart = np.abs(times[:, None] - np.asarray(marks)).min(axis=1) > gap
    return np.unique(np.concatenate([times[[0, -1]], times[apart], marks]))


def _times(motion: Motion, count: int) -> np.ndarray:
    """Times (count + 1,) in s of time step 0 and the first time steps."""
    return np.append(0.0, motion.times[:count])


def _starts(motion: Motion, count: int) -> list[int]:
    """Time steps 0, 1, ... at which a phase with planned steps starts."""
    phases = [-1, *(step.phase for step in motion.steps[:count])]
    return [step for step in range(count) if phases[step + 1] != phases[step]]


def _table(motion: Motion, planned: Sequence[Loads]) -> np.ndarray:
    """Loads at time 0 and at the planned steps, split into `PARTS`: (steps + 1, 16)."""
    table = np.zeros((len(planned) + 1, GRAVITY + 1))
    table[0, GRAVITY] = motion.gravity
    for row, load, step in zip(table[1:], planned, motion.steps, strict=False):
        mass = motion.spec.phases[step.phase].loads.tip_mass
        row[PARTS["tip_mass"]] = (0.0, 0.0, mass * motion.spec.gravity)  # as when it was built
        if step.pull is not None:
            row[PARTS["pull"]] = np.subtract(load.tip_force, step.loads.tip_force)
        others = row[PARTS["tip_mass"]] + row[PARTS["pull"]]
        row[PARTS["tip_force"]] = load.tip_force - others
        row[PARTS["contact"]] = (*load.contact_force, *load.contact_couple)
        row[GRAVITY] = load.gravity
    return table


def _after_jumps(motion: Motion, table: np.ndarray, step: int) -> np.ndarray:
    """A table of loads in which those that jump have their values right after a phase's start."""
    table, phase = table.copy(), motion.steps[step - 1].phase
    before = next(n for n, other in enumerate(motion.steps) if other.phase == phase)
    spec = motion.spec.phases[phase].loads
    for name, columns in PARTS.items():
        if getattr(spec.jump, name):
            ramps = name == "pull" and (spec.pull is None or spec.pull.ramp)
            table[before, columns] = 0.0 if ramps else table[before + 1, columns]
    return table


def _differ(a: Loads, b: Loads) -> bool:
    """Whether two loads differ by more than the solver's tolerance."""
    pairs = ((getattr(x, name) for x in (a, b)) for name in ("tip_force", "contact_force",
             "contact_couple"))  # fmt: skip
    return any(
        np.abs(np.subtract(p, q)).max() > LOAD_TOL * max(np.abs(p).max(), np.abs(q).max())
        for p, q in pairs
    )

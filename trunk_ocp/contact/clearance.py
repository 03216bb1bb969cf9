"""How far a planned trunk stays from every solid and from itself, at time steps and between them.

This check shares no code with the rows of the NLP: it works on sampled shapes, with distances from
`model.solids` and the bounds of `certificate`.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from .._support.wording import step_list
from ..errors import StaticsError
from ..model.loads import Loads
from ..model.solids import Solid
from ..problem.interpolation import interpolate, loads_at
from ..problem.motion import Motion
from ..rod.shape import Shape
from ..rod.statics import solve_statics
from .certificate import bounds_along, bounds_between, pair_bounds
from .tube import Tube, apart, pair_gaps, seen_by, solid_gaps, tube

SELF = "itself"
"""Name of the trunk as the body that it may touch."""
SECTIONS = 512
"""Pieces of the trunk; also the finest of those that are compared with each other."""
COLLISION_TOL = 6e-5
"""By how much a gap may be too small, as a share of the trunk's length; 0.1 mm for the elephant."""
STRIDES = (8, 4, 2, 1)
"""Sections to a piece when the trunk is compared with itself, from coarse to fine."""
ACCURACY = 3e-5
"""Of lower bounds, as a share of the trunk's length; 0.05 mm for the elephant."""
FIRST_PARTS, MAX_PARTS = 8, 128
"""Parts of the time between two steps that are looked at, at first and at most."""


@dataclass(frozen=True)
class Gap:
    """The smallest gap between the trunk and one body at a time step, or on the way to it.

    Attributes
    ----------
    body, group : str
        Name of the solid, or `SELF`; head, log, obstacles or self.
    step : int
        Time step, from 0.
    time : float
        When the gap is smallest, in s.
    gap : float
        Smallest gap found, in m; negative inside. NaN if the trunk has no equilibrium there.
    bound : float
        No gap is smaller than this, in m, anywhere along the trunk and in this time.
    least : float
        Gap that the problem file asks for, in m.
    Z, other : float
        Where on the trunk, in m; `other` is the second place if it touches itself, else NaN.
    """

    body: str
    group: str
    step: int
    time: float
    gap: float
    bound: float
    least: float
    Z: float
    other: float = np.nan

    @property
    def depth(self) -> float:
        """By how much the gap is too small, in m; negative if it is not."""
        return self.least - self.gap


@dataclass(frozen=True, eq=False)
class Clearance:
    """Gaps between a planned trunk and every body.

    Attributes
    ----------
    at_steps, between : tuple of Gap
        The smallest gap to each body at each time step, and on the way to each.
    length : float
        Length of the trunk in m.
    """

    at_steps: tuple[Gap, ...]
    between: tuple[Gap, ...]
    length: float

    @property
    def min(self) -> Gap | None:
        """The smallest gap of all; None for a plan without steps."""
        gaps = [gap for gap in self.all if not np.isnan(gap.gap)]
        return min(gaps, key=lambda gap: gap.gap, default=None)

    @property
    def all(self) -> tuple[Gap, ...]:
        """Gaps at time steps and between them."""
        return (*self.at_steps, *self.between)

    def of_step(self, step: int) -> Gap | None:
        """The smallest gap at a time step (from 0)."""
        return min((gap for gap in self.at_steps if gap.step == step), key=lambda gap: gap.gap)

    def sentences(self, groups: Collection[str]) -> list[str]:
        """Bodies of some groups that the trunk is too close to, a sentence each.

        A gap that is bounded from below only, because the trunk has no equilibrium somewhere or
        moves too fast, counts as too small.
        """
        tol, found = COLLISION_TOL * self.length, []
        for body in dict.fromkeys(gap.body for gap in self.all if gap.group in groups):
            small = [g for g in self.all if g.body == body and not g.bound >= g.least - tol]
            if small:
                found.append(_sentence(small, tol))
        return found

    @property
    def warnings(self) -> list[str]:
        """Bodies that the trunk certainly is in, or closer to than asked, a sentence each."""
        tol, found = COLLISION_TOL * self.length, []
        for body in dict.fromkeys(gap.body for gap in self.all):
            small = [gap for gap in self.all if gap.body == body and gap.depth > tol]
            if small:
                found.append(_sentence(small, tol))
        return found


def _sentence(small: Sequence[Gap], tol: float) -> str:
    """What is wrong with gaps to one body that are too small."""
    known = [gap for gap in small if not np.isnan(gap.gap)]
    steps = step_list(sorted({gap.step + 1 for gap in small}))
    if not known:
        return (
            f"the trunk has no equilibrium on the way to {steps}, so its distance from "
            f"{small[0].body} is unknown there"
        )
    worst = max(known, key=lambda gap: gap.depth)
    body = "itself" if worst.group == "self" else f"the {worst.body}"
    at = f"at Z = {worst.Z:.2f} m" + (f" and {worst.other:.2f} m" if worst.other > 0 else "")
    when = f"worst at {worst.time:.3g} s, {steps}"
    if worst.depth <= tol:
        return f"the trunk may be {1e3 * (worst.least - worst.bound):.2g} mm too close to {body} {at}"
    if worst.gap < 0:
        return f"the trunk enters {body} by {-1e3 * worst.gap:.3g} mm {at} ({when})"
    return (
        f"the trunk is {1e3 * worst.gap:.3g} mm from {body} {at}, {1e3 * worst.least:g} mm are "
        f"asked for ({when})"
    )


def gaps_at_steps(motion: Motion, x: np.ndarray, shape: Shape) -> list[Gap]:
    """Gaps of planned controls x (H, muscles + 2) and shapes (H,) to all bodies of each step."""
    discs = tube(motion.trunk, shape, _points(motion))
    found = []
    for t, step in enumerate(motion.steps[: len(x)]):
        now = discs[t : t + 1]
        for solid in step.solids:
            seen = _part(seen_by(motion.trunk, now, solid, x[t : t + 1, -2:]), solid)
            gaps, bounds = solid_gaps(seen, solid), bounds_along(seen, solid)
            found.append(_of_solid(solid, t, np.array([step.time]), seen, gaps, bounds))
        found.append(_of_itself(t, np.array([step.time]), now, None))
    return found


def gaps_between_steps(
    motion: Motion, x: np.ndarray, loads: Sequence[Loads], shape: Shape, precise: bool
) -> list[Gap]:
    """Gaps on the way to each time step, from the one before or from rest.

    Phases without interpolation jump from step to step and are left out.

    Parameters
    ----------
    precise : bool
        Whether time is divided until lower bounds are as accurate as `ACCURACY`, or as
        `MAX_PARTS` allows, where they decide whether a gap is large enough.
    """
    return [
        gap
        for t in range(len(x))
        if motion.phases[motion.steps[t].phase].interpolation != "none"
        for gap in _Way(motion, x, loads, shape, t).gaps(precise)
    ]


def log_centers(motion: Motion) -> np.ndarray | None:
    """Centers (steps + 1, 3) in m of the log at rest and at time steps; None without a log.

    Where no log is, the last before; before the first, that one.
    """
    centers = [None if step.log is None else step.log.center for step in motion.steps]
    known = next((center for center in centers if center is not None), None)
    if known is None:
        return None
    filled = [known]
    for center in centers:
        filled.append(filled[-1] if center is None else center)
    return np.array(filled)


@dataclass(eq=False)
class _Way:
    """The motion on the way to a time step."""

    motion: Motion
    x: np.ndarray
    loads: Sequence[Loads]
    shape: Shape
    step: int

    def gaps(self, precise: bool) -> Iterator[Gap]:
        """The smallest gap to each body."""
        times = np.linspace(*self._ends, FIRST_PARTS + 1)
        try:
            discs, head = self._sampled(times)
            while True:
                results = [(gap, cells) for gap, cells in self._bodies(times, discs, head)]
                doubtful = np.any([cells for _, cells in results], axis=0)
                if not (precise and np.any(doubtful)) or len(times) > MAX_PARTS:
                    break
                middles = (times[1:] + times[:-1])[doubtful] / 2
                more, more_head = self._sampled(middles)
                order = np.argsort(np.concatenate([times, middles]))
                times = np.concatenate([times, middles])[order]
                discs, head = _merged(discs, more, order), np.concatenate([head, more_head])[order]
        except StaticsError:
            yield from self._unknown()
            return
        for gap, _ in results:
            yield gap

    @property
    def _ends(self) -> tuple[float, float]:
        times = np.append(0.0, self.motion.times)
        return float(times[self.step]), float(times[self.step + 1])

    def _sampled(self, times: np.ndarray) -> tuple[Tube, np.ndarray]:
        """Discs and head angles (n, 2) at some times (n,), the start after loads have jumped."""
        motion, start = self.motion, self._ends[0]
        trajectory = np.concatenate([np.zeros((1, self.x.shape[1])), self.x])
        controls = np.array([interpolate(motion, trajectory, t) for t in times])
        loads = [loads_at(motion, self.loads, t, after=bool(t == start)) for t in times]
        planned = motion.times[: len(self.x)]
        nearest = np.array([np.argmin(np.abs(planned - t)) for t in times])
        shapes = solve_statics(
            motion.trunk, controls[:, :-2], controls[:, -2:], loads, near=self.shape[nearest]
        )
        return tube(motion.trunk, shapes, _points(motion)), controls[:, -2:]

    def _bodies(
        self, times: np.ndarray, discs: Tube, head: np.ndarray
    ) -> Iterator[tuple[Gap, np.ndarray]]:
        """Each body's gap, and in which parts of the time it is doubtful whether it is enough."""
        accuracy = ACCURACY * self.motion.trunk.length
        for solid in self.motion.steps[self.step].solids:
            seen = seen_by(self.motion.trunk, discs, solid, head)
            if solid.group == "log":
                seen = replace(seen, center=seen.center - self._log_shift(times, solid)[:, None])
            seen = _part(seen, solid)
            gaps, bounds = solid_gaps(seen, solid), bounds_between(seen, times, solid)
            smallest, least_bound = gaps.min(axis=1), bounds.min(axis=1)
            gap = _of_solid(solid, self.step, times, seen, gaps, bounds)
            yield gap, _doubtful(gap, smallest, least_bound, accuracy)
        gap, least_bound, smallest = _pairs(self.step, times, discs, times)
        yield gap, _doubtful(gap, smallest, least_bound, accuracy)

    def _log_shift(self, times: np.ndarray, solid: Solid) -> np.ndarray:
        """How far (n, 3) the log is at some times from where it is at the step."""
        centers = log_centers(self.motion)
        if centers is None:
            return np.zeros((len(times), 3))
        return np.array([interpolate(self.motion, centers, t) for t in times]) - solid.center

    def _unknown(self) -> Iterator[Gap]:
        time, nan = self._ends[0], np.nan
        for solid in self.motion.steps[self.step].solids:
            yield Gap(
                solid.name, solid.group, self.step, time, nan, -np.inf, solid.clearance, nan
            )
        yield Gap(SELF, "self", self.step, time, nan, -np.inf, 0.0, nan)


def _doubtful(
    gap: Gap, smallest: np.ndarray, bounds: np.ndarray, accuracy: float
) -> np.ndarray:
    """Parts of the time in which a gap may be too small; none if it certainly is somewhere.

    smallest : (n + 1,) smallest gap at each instant. bounds : (n,) lower bounds between them.
    """
    near = np.minimum(smallest[:-1], smallest[1:])
    doubtful = (bounds < gap.least - accuracy) & (near - bounds > accuracy)
    return np.asarray(doubtful & (gap.depth <= accuracy))


def _points(motion: Motion) -> np.ndarray:
    return np.linspace(0.0, motion.trunk.length, SECTIONS + 1)


def _part(discs: Tube, solid: Solid) -> Tube:
    """The part of the trunk that a solid concerns; at least 3 discs."""
    inside = np.flatnonzero((discs.Z >= solid.Z[0]) & (discs.Z <= solid.Z[1]))
    low = max(min(inside[0] if inside.size else len(discs.Z), len(discs.Z) - 3), 0)
    high = max(inside[-1] if inside.size else 0, low + 2)
    return discs.part(slice(low, high + 1))


def _merged(one: Tube, other: Tube, order: np.ndarray) -> Tube:
    parts = (
        np.concatenate(pair)[order]
        for pair in (
            (one.center, other.center), (one.tangent, other.tangent), (one.radius, other.radius)
        )
    )  # fmt: skip
    return Tube(one.Z, *parts)


def _of_solid(
    solid: Solid, step: int, times: np.ndarray, discs: Tube, gaps: np.ndarray, bounds: np.ndarray
) -> Gap:
    k, i = np.unravel_index(np.argmin(gaps), gaps.shape)
    bound = min(float(bounds.min()), float(gaps[k, i]))
    return Gap(
        solid.name,
        solid.group,
        step,
        float(times[k]),
        float(gaps[k, i]),
        bound,
        solid.clearance,
        float(discs.Z[i]),
    )


def _of_itself(step: int, times: np.ndarray, discs: Tube, between: np.ndarray | None) -> Gap:
    return _pairs(step, times, discs, between)[0]


def _pairs(
    step: int, times: np.ndarray, discs: Tube, between: np.ndarray | None
) -> tuple[Gap, np.ndarray, np.ndarray]:
    """The trunk's gap to itself; its lower bounds and smallest gaps by time.

    Pairs of pieces are divided where they may be closer than the closest pair found.
    """
    accuracy = ACCURACY * discs.Z[-1]
    count = (len(discs.Z) - 1) // STRIDES[0]
    pairs = np.stack(np.triu_indices(count, 1), axis=-1)
    smallest = np.full(len(times), np.inf)
    where = np.zeros((len(times), 2))
    settled = np.full(len(times) if between is None else len(times) - 1, np.inf)
    for stride in STRIDES:
        coarse = discs.part(slice(None, None, stride))
        if stride != STRIDES[0]:
            pairs = (2 * pairs[:, None] + _CHILDREN).reshape(-1, 2)
        gaps = pair_gaps(coarse, pairs)
        best = gaps.argmin(axis=1)
        value = gaps[np.arange(len(times)), best]
        closer = value < smallest
        smallest = np.where(closer, value, smallest)
        where[closer] = coarse.Z[pairs[best]][closer]
        bounds = pair_bounds(coarse, pairs, between)
        touching = np.any(apart(coarse, pairs + [0, 1]), axis=0)
        reached = smallest if between is None else np.minimum(smallest[1:], smallest[:-1])
        bounds = np.where(touching, bounds, np.inf)
        open_ = bounds < reached[:, None] - accuracy
        settled = np.minimum(settled, np.where(open_, np.inf, bounds).min(axis=1))
        keep = np.any(open_, axis=0)
        if not np.any(keep):
            break
        pairs, last = pairs[keep], bounds[:, keep]
    else:
        settled = np.minimum(settled, last.min(axis=1))
    k = int(np.argmin(smallest))
    gap = Gap(
        SELF,
        "self",
        step,
        float(times[k]),
        float(smallest[k]),
        min(float(settled.min()), float(smallest[k])),
        0.0,
        float(where[k].min()),
        float(where[k].max()),
    )
    return gap, settled, smallest


_CHILDREN = np.array([[0, 0], [0, 1], [1, 0], [1, 1]])

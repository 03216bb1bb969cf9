"""The smallest gap between the trunk and each body, with a lower bound for all of the trunk."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..model.solids import Solid
from ..nlp.gap_rows import SELF
from ..problem.motion import Motion
from ..rod.shape import Shape
from .certificate import bounds_along, bounds_between, error_along, pair_bounds
from .tube import Tube, apart, pair_gaps, seen_by, solid_gaps, tube

SECTIONS = 512
"""Pieces of the trunk; also the finest of those that are compared with each other."""
STRIDES = (8, 4, 2, 1)
"""Sections to a piece when the trunk is compared with itself, from coarse to fine."""
ACCURACY = 3e-5
"""Of lower bounds, as a share of the trunk's length; 0.05 mm for the elephant."""


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

    def joined(self, other: Gap, bound: float) -> Gap:
        """The smaller of two gaps to the same body, with another lower bound."""
        smaller = self if self.gap <= other.gap else other
        return replace(smaller, bound=min(bound, smaller.gap))


@dataclass(frozen=True, eq=False)
class Cells:
    """C pieces of time, with the shapes at their ends and the errors between them.

    times (2, C) in s; error (C, n - 1) from `certificate`. At instants both ends are the same.
    """

    times: np.ndarray
    first: Tube
    last: Tube
    error: np.ndarray

    @staticmethod
    def instants(discs: Tube, times: np.ndarray) -> Cells:
        """Shapes at instants, as cells of no duration."""
        return Cells(np.stack([times, times]), discs, discs, error_along(discs))

    @property
    def tubes(self) -> tuple[Tube, ...]:
        """Shapes at the ends."""
        return (self.first,) if self.first is self.last else (self.first, self.last)


def gaps_at_steps(motion: Motion, x: np.ndarray, shape: Shape) -> list[Gap]:
    """Gaps of planned controls x (H, muscles + 2) and shapes (H,) to all bodies of each step."""
    discs = tube(motion.trunk, shape, section_points(motion))
    return [
        gap
        for t, step in enumerate(motion.steps[: len(x)])
        for gap in _gaps(motion, step.solids, discs[t : t + 1], x[t, -2:], t, step.time)
    ]


def gaps_at_rest(motion: Motion, shape: Shape) -> list[Gap]:
    """Gaps of the passive shape, batch axis (1,), to all bodies of the first step."""
    discs = tube(motion.trunk, shape, section_points(motion))
    return _gaps(motion, motion.steps[0].solids, discs, np.zeros(2), 0, 0.0)


def _gaps(
    motion: Motion,
    solids: Sequence[Solid],
    discs: Tube,
    head: np.ndarray,
    step: int,
    time: float,
) -> list[Gap]:
    """Gaps of one shape to solids and to itself."""
    times = np.array([time])
    found = []
    for solid in solids:
        seen = seen_by(motion.trunk, discs, solid, head[None])
        found.append(solid_gap(solid, step, Cells.instants(seen, times))[0])
    return [*found, self_gap(step, Cells.instants(discs, times))[0]]


def section_points(motion: Motion) -> np.ndarray:
    """Points (n,) in m at which the trunk is looked at."""
    return np.linspace(0.0, motion.trunk.length, SECTIONS + 1)


def solid_gap(solid: Solid, step: int, cells: Cells) -> tuple[Gap, np.ndarray]:
    """Gap from a solid that sees these shapes, and its lower bound on each cell (C,)."""
    Z = cells.first.Z
    inside = np.flatnonzero((solid.Z[0] <= Z) & (solid.Z[1] >= Z))
    low = min(int(inside[0]) if inside.size else len(Z), len(Z) - 2)
    part = slice(low, max(int(inside[-1]) if inside.size else 0, low + 1) + 1)
    tubes = [discs.part(part) for discs in cells.tubes]
    gaps = np.array([solid_gaps(discs, solid) for discs in tubes])
    error = cells.error[:, part.start : part.stop - 1]
    if len(tubes) == 1:
        bounds = bounds_along(tubes[0], solid)
    else:
        bounds = bounds_between(tubes[0], tubes[1], error, solid)
    k, c, i = np.unravel_index(np.argmin(gaps), gaps.shape)
    least = bounds.min(axis=1)
    gap = Gap(
        solid.name,
        solid.group,
        step,
        float(cells.times[k, c]),
        float(gaps[k, c, i]),
        min(float(least.min()), float(gaps[k, c, i])),
        solid.clearance,
        float(tubes[0].Z[i]),
    )
    return gap, least


def self_gap(step: int, cells: Cells) -> tuple[Gap, np.ndarray]:
    """The trunk's gap to itself, and its lower bound on each cell (C,).

    Pairs of pieces are divided where they may be closer than the closest pair found.
    """
    accuracy = ACCURACY * cells.first.Z[-1]
    count = (len(cells.first.Z) - 1) // STRIDES[0]
    pairs = np.stack(np.triu_indices(count, 1), axis=-1)
    smallest = np.full(cells.times.shape[1], np.inf)
    where = np.zeros((smallest.size, 3))  # time and both places
    bound = np.full(smallest.size, np.inf)
    for stride in STRIDES:
        if stride != STRIDES[0]:
            pairs = (2 * pairs[:, None] + _CHILDREN).reshape(-1, 2)
        coarse = [discs.part(slice(None, None, stride)) for discs in cells.tubes]
        for k, discs in enumerate(coarse):
            _closer(discs, pairs, cells.times[k], smallest, where)
        error = error_along(coarse[0])
        if len(coarse) == 2:  # of the coarse pieces along the trunk, and in time as on the finest
            error = np.maximum(error, error_along(coarse[1]))
            error = error + np.maximum.reduceat(cells.error, _starts(cells.error, stride), axis=1)
        bounds = pair_bounds(coarse, error, pairs)
        touching = np.any([apart(discs, pairs + LATER_END) for discs in coarse], axis=0)
        bounds = np.where(touching, bounds, np.inf)
        unsettled = bounds < (smallest - accuracy)[:, None]
        bound = np.minimum(bound, np.where(unsettled, np.inf, bounds).min(axis=1))
        keep = np.any(unsettled, axis=0)
        if not np.any(keep):
            break
        pairs, rest = pairs[keep], bounds[:, keep]
    else:
        bound = np.minimum(bound, rest.min(axis=1))
    c = int(np.argmin(smallest))
    time, one, other = where[c].tolist()
    least = min(float(bound.min()), float(smallest[c]))
    gap = Gap(SELF, "self", step, time, float(smallest[c]), least, 0.0, one, other)
    return gap, np.minimum(bound, smallest)


def _starts(error: np.ndarray, stride: int) -> np.ndarray:
    return np.arange(0, error.shape[1], stride)


def _closer(
    discs: Tube, pairs: np.ndarray, times: np.ndarray, smallest: np.ndarray, where: np.ndarray
) -> None:
    """Update the smallest gaps (C,) and where they are (C, 3) with those of pairs of discs."""
    gaps = pair_gaps(discs, pairs)
    best = gaps.argmin(axis=1)
    value = gaps[np.arange(len(gaps)), best]
    closer = value < smallest
    smallest[closer] = value[closer]
    places = np.concatenate([times[:, None], discs.Z[pairs[best]]], axis=1)
    where[closer] = places[closer]


LATER_END = np.array([0, 1])  # the discs of a pair of pieces that are farthest apart
_CHILDREN = np.array([[0, 0], [0, 1], [1, 0], [1, 1]])

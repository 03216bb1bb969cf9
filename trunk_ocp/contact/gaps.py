"""The smallest gap between the trunk and each body, with a lower bound for all of the trunk."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from ..model.solids import SELF, Solid
from ..problem.motion import Motion
from ..rod.shape import Shape
from .certificate import Curving, Error, curving_along, pair_bounds, solid_bounds
from .tube import Tube, apart, creases, pair_gaps, seen_by, solid_gaps, tube

SECTIONS = 512
"""Pieces of the trunk; also the finest of those that are compared with each other."""
STRIDES = (16, 8, 4, 2, 1)
"""Sections to a piece, from coarse to fine."""
FAR_ENDS = np.array([0, 1])
"""From the first discs of a pair of pieces to those that are farthest apart."""
ACCURACY, NEAR_ACCURACY, FAR_ACCURACY = 3e-5, 0.05, 0.5
"""Of lower bounds, as a share of the trunk's length (0.05 mm for the elephant); of larger gaps, as
a share of the gap; and of gaps above `FAR`, as a share of what is above it."""
FAR = 0.02
"""A gap that no plan is about to lose, over the trunk's length."""


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
class Cells:
    """C pieces of time, with the shapes at their ends and the errors between them.

    times (2, C) in s; `in_time` from `curving_in_time`. At instants both ends are the same.
    """

    times: np.ndarray
    first: Tube
    last: Tube
    in_time: Curving
    _levels: dict[int, tuple[list[Tube], Error]] = field(default_factory=dict, repr=False)

    @staticmethod
    def instants(discs: Tube, times: np.ndarray) -> Cells:
        """Shapes at instants, as cells of no duration."""
        none = Curving.none(len(times), len(discs.Z) - 1)
        return Cells(np.stack([times, times]), discs, discs, none)

    def chosen(self, index: np.ndarray) -> Cells:
        """Some of the cells."""
        first = self.first[index]
        last = first if self.last is self.first else self.last[index]
        return Cells(self.times[:, index], first, last, self.in_time[index])

    def level(self, stride: int, active: np.ndarray) -> tuple[list[Tube], Error]:
        """Every so many discs of some cells, and the errors between them.

        Those of all cells are kept, as all bodies ask for the coarsest.
        """
        if active.size == self.times.shape[1]:
            if stride not in self._levels:
                self._levels[stride] = self._level(stride, np.s_[:])
            return self._levels[stride]
        return self._level(stride, active)

    def _level(self, stride: int, active: slice | np.ndarray) -> tuple[list[Tube], Error]:
        tubes = [discs.part(slice(None, None, stride))[active] for discs in self.tubes]
        starts = np.arange(0, self.in_time.turning.shape[1], stride)
        return tubes, Error(curving_along(tubes), self.in_time[active].joined(starts))

    @property
    def tubes(self) -> tuple[Tube, ...]:
        """Shapes at the ends."""
        return (self.first,) if self.first is self.last else (self.first, self.last)


@dataclass(frozen=True)
class Bend:
    """The sharpest bend of a plan: its radius of section over its radius of curvature.

    Above 1, neighboring sections cut each other: a crease, see `tube.creases`. At a time step,
    from 0, and a place Z in m.
    """

    sharpness: float
    step: int
    Z: float


def sharpest_bend(motion: Motion, shape: Shape) -> Bend | None:
    """The sharpest bend of planned shapes (H,); None without steps."""
    Z = section_points(motion)
    sharpness = creases(tube(motion.trunk, shape, Z))
    if not sharpness.size:
        return None
    t, i = np.unravel_index(np.argmax(sharpness), sharpness.shape)
    return Bend(float(sharpness[t, i]), int(t), float(Z[i]))


@np.errstate(all="ignore")  # overflow ends as a gap that is not known
def gaps_at_steps(motion: Motion, x: np.ndarray, shape: Shape) -> list[Gap]:
    """Gaps of planned controls x (H, muscles + 2) and shapes (H,) to all bodies of each step."""
    discs = tube(motion.trunk, shape, section_points(motion))
    steps = motion.steps[: len(x)]
    times = np.array([step.time for step in steps])
    return _gaps(motion, [step.solids for step in steps], discs, x[:, -2:], times)


def gaps_at_start(motion: Motion, shape: Shape) -> list[Gap]:
    """Gaps of the shape at the start, batch axis (1,), to all bodies of the first step."""
    discs = tube(motion.trunk, shape, section_points(motion))
    return _gaps(motion, [motion.steps[0].solids], discs, motion.start[None, -2:], np.zeros(1))


def _gaps(
    motion: Motion,
    solids: Sequence[Sequence[Solid]],
    discs: Tube,
    head: np.ndarray,
    times: np.ndarray,
) -> list[Gap]:
    """Gaps of shapes (H,) to the solids at each, and to itself."""
    there: dict[Solid, list[int]] = {}
    for t, at_step in enumerate(solids):
        for solid in at_step:
            there.setdefault(solid, []).append(t)
    seen = {
        frame: Cells.instants(seen_by(motion.trunk, discs, frame, head), times)
        for frame in ("space", "head")
    }
    gaps = []
    for solid, steps in there.items():
        found = nearest_to_solid(solid, seen[solid.frame].chosen(np.array(steps)))
        gaps += [found.gap_of(solid, t, k) for k, t in enumerate(steps)]
    found = nearest_to_itself(seen["space"])
    return [*gaps, *(found.gap_of(None, t, t) for t in range(len(solids)))]


def section_points(motion: Motion) -> np.ndarray:
    """Points (n,) in m at which the trunk is looked at: at equal distances within each segment.

    The numbers of pieces are multiples of the coarsest stride, so that no piece has a jump of the
    curvature inside.
    """
    edges, L = motion.trunk.edges, motion.trunk.length
    parts = [
        np.linspace(a, b, STRIDES[0] * max(round((b - a) / L * SECTIONS / STRIDES[0]), 1) + 1)
        for a, b in pairwise(edges)
    ]
    return np.concatenate([parts[0], *(part[1:] for part in parts[1:])])


@dataclass(frozen=True, eq=False)
class Nearest:
    """The smallest gap to one body on each of C cells.

    gap (C,) in m; time (C,) in s; places (C, 2) in m, the second NaN unless the trunk touches
    itself; bound (C,), below which no gap is.
    """

    gap: np.ndarray
    time: np.ndarray
    places: np.ndarray
    bound: np.ndarray

    def gap_of(self, solid: Solid | None, step: int, cell: int) -> Gap:
        """The gap on one cell as that of a time step; `solid` is None for the trunk itself."""
        name, group, least = body_of(solid)
        numbers = (self.gap, self.bound)
        value, bound = (float(numbers_of[cell]) for numbers_of in numbers)
        Z, other = self.places[cell].tolist()
        return Gap(name, group, step, float(self.time[cell]), value, bound, least, Z, other)


def body_of(solid: Solid | None) -> tuple[str, str, float]:
    """Name, group and clearance of a solid, or of the trunk as the body that it may touch."""
    return (SELF, "self", 0.0) if solid is None else (solid.name, solid.group, solid.clearance)


def reaches(Z: np.ndarray, solid: Solid) -> np.ndarray:
    """Which points (n,) of the trunk a solid concerns; the nearest one of a very short part."""
    low, high = solid.Z
    counts = (low <= Z) & (high >= Z)
    counts[np.abs(Z - min(low, Z[-1])).argmin()] |= not np.any(counts)
    return counts


def nearest_to_solid(solid: Solid, cells: Cells) -> Nearest:
    """The smallest gaps on cells whose shapes are seen from the solid.

    Bounds are those of all pieces that the solid's part of the trunk reaches into.
    """
    (low, high), Z = solid.Z, cells.first.Z
    counts = reaches(Z, solid)

    def at_discs(discs: Tube, pieces: np.ndarray, stride: int) -> tuple[np.ndarray, np.ndarray]:
        ends = np.unique([pieces, pieces + 1])
        gaps = solid_gaps(discs.part(ends), solid)
        return np.where(counts[::stride][ends], gaps, np.inf), discs.Z[ends, None]

    def bounds(instants: list[Tube], error: Error, pieces: np.ndarray) -> np.ndarray:
        return solid_bounds(instants, error, pieces, solid)

    def divide(pieces: np.ndarray, ratio: int, stride: int) -> np.ndarray:
        parts = (ratio * pieces[:, None] + np.arange(ratio)).ravel()
        ends = Z[::stride]
        return parts[(ends[parts + 1] >= low) & (ends[parts] <= high)]

    return _Search(cells, at_discs, bounds, divide).run(
        divide(np.arange((len(Z) - 1) // STRIDES[0]), 1, STRIDES[0])
    )


def nearest_to_itself(cells: Cells) -> Nearest:
    """The trunk's smallest gaps to itself on cells."""

    def at_discs(discs: Tube, pairs: np.ndarray, stride: int) -> tuple[np.ndarray, np.ndarray]:
        return pair_gaps(discs, pairs), discs.Z[pairs]

    def bounds(instants: list[Tube], error: Error, pairs: np.ndarray) -> np.ndarray:
        touching = np.any([apart(discs, pairs + FAR_ENDS) for discs in instants], axis=0)
        return np.where(touching, pair_bounds(instants, error, pairs), np.inf)

    def divide(pairs: np.ndarray, ratio: int, stride: int) -> np.ndarray:
        parts = np.stack(np.meshgrid(*2 * [np.arange(ratio)], indexing="ij"), -1).reshape(-1, 2)
        divided = (ratio * pairs[:, None] + parts).reshape(-1, 2)
        return divided[divided[:, 0] <= divided[:, 1]]

    count = (len(cells.first.Z) - 1) // STRIDES[0]
    pairs = np.stack(np.triu_indices(count), axis=-1)
    return _Search(cells, at_discs, bounds, divide).run(pairs)


@dataclass(frozen=True, eq=False)
class _Search:
    """Branch and bound for the smallest gap on cells, from coarse pieces of the trunk to fine ones.

    Pieces, or pairs of them, are given by their first disc. They are divided where they may be
    closer than the smallest gap found.

    Attributes
    ----------
    at_discs : callable
        Gaps (C, K) of discs at the ends of pieces, and their places (K, 1) or (K, 2) in m.
    bounds : callable
        Lower bounds (C, P) of pieces, given the shapes at the ends of cells and the errors.
    divide : callable
        The parts of pieces that count, given how many there are to a piece, and the new stride.
    """

    cells: Cells
    at_discs: Callable[[Tube, np.ndarray, int], tuple[np.ndarray, np.ndarray]]
    bounds: Callable[[list[Tube], Error, np.ndarray], np.ndarray]
    divide: Callable[[np.ndarray, int, int], np.ndarray]

    def run(self, pieces: np.ndarray) -> Nearest:
        """The smallest gap on each cell, starting from the coarsest pieces."""
        cells = self.cells
        accuracy, count = ACCURACY * cells.first.Z[-1], cells.times.shape[1]
        best = Nearest(
            np.full(count, np.inf),
            cells.times[0].copy(),
            np.full((count, 2), np.nan),
            np.full(count, np.inf),
        )
        active = np.arange(count)  # cells that still have unsettled pieces
        for stride, finer in zip(STRIDES, (*STRIDES[1:], 0), strict=True):
            tubes, errors = cells.level(stride, active)
            for k, discs in enumerate(tubes):
                self._closer(discs, pieces, cells.times[k], stride, best, active)
            bounds, gap = self.bounds(tubes, errors, pieces), best.gap[active]
            known = np.where(np.isfinite(gap), gap, 0.0)
            far = FAR_ACCURACY * (known - FAR * cells.first.Z[-1])
            tolerance = np.maximum(np.maximum(far, NEAR_ACCURACY * known), accuracy)
            unsettled = bounds < (gap - tolerance)[:, None]
            if not finer:
                unsettled[:] = False
            settled = np.where(unsettled, np.inf, bounds).min(axis=1, initial=np.inf)
            best.bound[active] = np.minimum(best.bound[active], settled)
            pieces = pieces[np.any(unsettled, axis=0)]
            active = active[np.any(unsettled, axis=1)]
            if not len(pieces):
                break
            pieces = self.divide(pieces, stride // finer, finer)
        np.minimum(best.bound, best.gap, out=best.bound)
        return best

    def _closer(
        self,
        discs: Tube,
        pieces: np.ndarray,
        times: np.ndarray,
        stride: int,
        best: Nearest,
        cells: np.ndarray,
    ) -> None:
        """Update the smallest gaps of some cells, and when and where they are."""
        gaps, places = self.at_discs(discs, pieces, stride)
        nearest = gaps.argmin(axis=1)
        value = gaps[np.arange(len(gaps)), nearest]
        closer = value < best.gap[cells]
        to = cells[closer]
        best.gap[to], best.time[to] = value[closer], times[to]
        best.places[to, : places.shape[1]] = places[nearest[closer]]

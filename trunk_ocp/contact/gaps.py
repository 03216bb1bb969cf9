"""The smallest gap between the trunk and each body, with a lower bound for all of the trunk."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from ..model.solids import SELF, Solid
from ..problem.motion import Motion
from ..rod.shape import Shape
from .certificate import error_along, pair_bounds, solid_bounds
from .tube import Tube, apart, creases, pair_gaps, seen_by, solid_gaps, tube

SECTIONS = 512
"""Pieces of the trunk; also the finest of those that are compared with each other."""
STRIDES = (16, 8, 4, 2, 1)
"""Sections to a piece, from coarse to fine."""
ACCURACY, FAR_ACCURACY = 3e-5, 0.05
"""Of lower bounds, as a share of the trunk's length (0.05 mm for the elephant); of gaps from bodies
far away, as a share of the gap."""


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

    times (2, C) in s; error (C, n - 1) from `certificate`. At instants both ends are the same.
    """

    times: np.ndarray
    first: Tube
    last: Tube
    error: np.ndarray
    _parts: dict[tuple[int, int], Cells] = field(default_factory=dict, repr=False)
    _levels: dict[int, tuple[list[Tube], np.ndarray]] = field(default_factory=dict, repr=False)

    @staticmethod
    def instants(discs: Tube, times: np.ndarray) -> Cells:
        """Shapes at instants, as cells of no duration."""
        return Cells(np.stack([times, times]), discs, discs, error_along(discs))

    def chosen(self, index: np.ndarray) -> Cells:
        """Some of the cells."""
        first = self.first[index]
        last = first if self.last is self.first else self.last[index]
        return Cells(self.times[:, index], first, last, self.error[index])

    def part(self, start: int, stop: int) -> Cells:
        """Some neighboring discs of the same cells; kept, as many solids ask for the same."""
        if (key := (start, stop)) not in self._parts:
            discs = slice(start, stop)
            first = self.first.part(discs)
            last = first if self.last is self.first else self.last.part(discs)
            self._parts[key] = Cells(self.times, first, last, self.error[:, start : stop - 1])
        return self._parts[key]

    def level(self, stride: int) -> tuple[list[Tube], np.ndarray]:
        """Every so many discs, and the errors (C, P) between them; kept, too.

        The error in time of a long piece is at most the largest of its parts.
        """
        if stride not in self._levels:
            last = len(self.first.Z) - 1
            grid = np.minimum(np.arange(-(-last // stride) + 1) * stride, last)
            tubes = [discs.part(grid) for discs in self.tubes]
            errors = np.maximum.reduceat(self.error, grid[:-1], axis=1)
            if grid.size > 2:
                along = np.max([error_along(discs) for discs in tubes], axis=0)
                errors = along + errors if len(tubes) == 2 else along
            elif last > 1:  # one long piece says nothing about how it bends
                errors = np.full_like(errors, np.inf)
            self._levels[stride] = (tubes, errors)
        return self._levels[stride]

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


def gaps_at_steps(motion: Motion, x: np.ndarray, shape: Shape) -> list[Gap]:
    """Gaps of planned controls x (H, muscles + 2) and shapes (H,) to all bodies of each step."""
    discs = tube(motion.trunk, shape, section_points(motion))
    steps = motion.steps[: len(x)]
    times = np.array([step.time for step in steps])
    return _gaps(motion, [step.solids for step in steps], discs, x[:, -2:], times)


def gaps_at_rest(motion: Motion, shape: Shape) -> list[Gap]:
    """Gaps of the passive shape, batch axis (1,), to all bodies of the first step."""
    discs = tube(motion.trunk, shape, section_points(motion))
    return _gaps(motion, [motion.steps[0].solids], discs, np.zeros((1, 2)), np.zeros(1))


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
    """Points (n,) in m at which the trunk is looked at."""
    return np.linspace(0.0, motion.trunk.length, SECTIONS + 1)


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


def nearest_to_solid(solid: Solid, cells: Cells) -> Nearest:
    """The smallest gaps on cells whose shapes are seen from the solid."""
    Z = cells.first.Z
    low = int(np.searchsorted(Z, solid.Z[0]))
    high = int(np.searchsorted(Z, solid.Z[1], side="right")) - 1
    if high <= low:  # a part with one disc or none: the piece around it
        low = min(max(high, 0), len(Z) - 2)
        high = low + 1

    def at_discs(discs: Tube, pieces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        ends = np.unique([pieces, pieces + 1])
        return solid_gaps(discs.part(ends), solid), discs.Z[ends, None]

    def bounds(instants: list[Tube], error: np.ndarray, pieces: np.ndarray) -> np.ndarray:
        return solid_bounds(instants, error, pieces, solid)

    def divide(pieces: np.ndarray, ratio: int) -> np.ndarray:
        return (ratio * pieces[:, None] + np.arange(ratio)).ravel()

    return _Search(cells.part(low, high + 1), at_discs, bounds, divide).run(np.arange)


def nearest_to_itself(cells: Cells) -> Nearest:
    """The trunk's smallest gaps to itself on cells."""

    def at_discs(discs: Tube, pairs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return pair_gaps(discs, pairs), discs.Z[pairs]

    def bounds(instants: list[Tube], error: np.ndarray, pairs: np.ndarray) -> np.ndarray:
        touching = np.any([apart(discs, pairs + LATER_END) for discs in instants], axis=0)
        return np.where(touching, pair_bounds(instants, error, pairs), np.inf)

    def divide(pairs: np.ndarray, ratio: int) -> np.ndarray:
        parts = np.stack(np.meshgrid(*2 * [np.arange(ratio)], indexing="ij"), -1).reshape(-1, 2)
        return (ratio * pairs[:, None] + parts).reshape(-1, 2)

    def pairs_of(count: int) -> np.ndarray:
        return np.stack(np.triu_indices(count, 1), axis=-1)

    return _Search(cells, at_discs, bounds, divide).run(pairs_of)


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
        The parts of pieces, given how many there are along the trunk.
    """

    cells: Cells
    at_discs: Callable[[Tube, np.ndarray], tuple[np.ndarray, np.ndarray]]
    bounds: Callable[[list[Tube], np.ndarray, np.ndarray], np.ndarray]
    divide: Callable[[np.ndarray, int], np.ndarray]

    def run(self, pieces_of: Callable[[int], np.ndarray]) -> Nearest:
        """The smallest gap on each cell, starting from all pieces of a number of them."""
        cells, last = self.cells, len(self.cells.first.Z) - 1
        accuracy, count = ACCURACY * cells.first.Z[-1], cells.times.shape[1]
        best = Nearest(
            np.full(count, np.inf),
            cells.times[0].copy(),
            np.full((count, 2), np.nan),
            np.full(count, np.inf),
        )
        pieces = pieces_of(-(-last // STRIDES[0]))
        for stride, finer in zip(STRIDES, (*STRIDES[1:], 0), strict=True):
            tubes, errors = cells.level(stride)
            for k, discs in enumerate(tubes):
                self._closer(discs, pieces, cells.times[k], best)
            bounds = self.bounds(tubes, errors, pieces)
            tolerance = np.maximum(accuracy, FAR_ACCURACY * best.gap)
            unsettled = bounds < (best.gap - tolerance)[:, None]
            if not finer:
                unsettled[:] = False
            np.minimum(best.bound, np.where(unsettled, np.inf, bounds).min(axis=1), out=best.bound)
            pieces = pieces[np.any(unsettled, axis=0)]
            if not len(pieces):
                break
            parts = self.divide(pieces, stride // finer)
            pieces = parts[np.all(np.reshape(parts, (len(parts), -1)) * finer < last, axis=1)]
        np.minimum(best.bound, best.gap, out=best.bound)
        return best

    def _closer(self, discs: Tube, pieces: np.ndarray, times: np.ndarray, best: Nearest) -> None:
        """Update the smallest gaps, and when and where they are."""
        gaps, places = self.at_discs(discs, pieces)
        nearest = gaps.argmin(axis=1)
        value = gaps[np.arange(len(gaps)), nearest]
        closer = value < best.gap
        best.gap[closer], best.time[closer] = value[closer], times[closer]
        best.places[closer, : places.shape[1]] = places[nearest[closer]]


LATER_END = np.array([0, 1])  # the discs of a pair of pieces that are farthest apart

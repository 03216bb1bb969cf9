"""Gaps between time steps: time is halved until bounds decide whether gaps are large enough."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ..errors import StaticsError
from ..model.loads import Loads
from ..model.solids import Solid
from ..nlp.gap_rows import SELF
from ..problem.interpolation import interpolate_all, loads_at, loads_before
from ..problem.motion import Motion
from ..rod.shape import Shape
from ..rod.statics import solve_statics
from .certificate import cell_errors
from .gaps import ACCURACY, Cells, Gap, section_points, self_gap, solid_gap
from .tube import Tube, seen_by, tube

FIRST_CELLS = 4
"""Pieces of the time between two steps, of which each is halved at least once."""
MAX_HALVINGS = 6


def gaps_between_steps(
    motion: Motion, x: np.ndarray, loads: Sequence[Loads], shape: Shape, precise: bool
) -> list[Gap]:
    """Gaps on the way to each time step, from the one before or from rest.

    Phases without interpolation jump from step to step and are left out.

    Parameters
    ----------
    precise : bool
        Whether time is halved further where it is not clear whether a gap is large enough.
    """
    samples = _Samples(motion, x, loads, shape)
    moving = [
        t for t in range(len(x)) if motion.phases[motion.steps[t].phase].interpolation != "none"
    ]
    times = np.append(0.0, motion.times)
    grids = [np.linspace(times[t], times[t + 1], FIRST_CELLS + 1) for t in moving]
    ways = []
    for t, at in zip(moving, samples.add(moving, grids), strict=True):
        bodies = [_Body(solid, t) for solid in (*motion.steps[t].solids, None)]
        ways.append(_Way(t, bodies, np.stack([at[:-1], at[1:]]), lost=bool(np.any(at < 0))))
    for number in range(MAX_HALVINGS if precise else 1):
        halved = [way for way in ways if not way.lost and way.cells.size]
        middles = [samples.times[way.cells].mean(axis=0) for way in halved]
        for way, at in zip(halved, samples.add([w.step for w in halved], middles), strict=True):
            way.halve(samples, at, everything=number == 0)
    return [body.result(way.lost, float(times[way.step])) for way in ways for body in way.bodies]


@dataclass(eq=False)
class _Body:
    """A solid, or the trunk itself, on the way to a time step.

    `cells` (2, C) are the samples at the ends of the pieces of time where it is not clear whether
    the gap is large enough; `bound` is a lower bound in all other pieces.
    """

    solid: Solid | None
    step: int
    gap: Gap | None = None
    bound: float = np.inf
    cells: np.ndarray = field(default_factory=lambda: np.zeros((2, 0), dtype=int))
    bounds: np.ndarray = field(default_factory=lambda: np.zeros(0))

    def update(self, gap: Gap, cells: np.ndarray, bounds: np.ndarray, accuracy: float) -> None:
        """Take the gap, and lower bounds (C,) on cells (2, C), into account."""
        self.gap = gap if self.gap is None else gap.joined(self.gap, np.inf)
        doubtful = bounds < min(gap.least, self.gap.gap) - accuracy
        if self.gap.depth > accuracy:  # certainly too small somewhere, so this is decided
            doubtful[:] = False
        self.bound = min(self.bound, float(np.min(bounds[~doubtful], initial=np.inf)))
        self.cells, self.bounds = cells[:, doubtful], bounds[doubtful]

    def result(self, lost: bool, time: float) -> Gap:
        """The gap; unknown if there is a time without equilibrium."""
        if lost or self.gap is None:
            solid = self.solid
            name, group = (SELF, "self") if solid is None else (solid.name, solid.group)
            least = 0.0 if solid is None else solid.clearance
            return Gap(name, group, self.step, time, np.nan, -np.inf, least, np.nan)
        return self.gap.joined(self.gap, min(self.bound, float(self.bounds.min(initial=np.inf))))


def _observer(solid: Solid | None) -> str:
    """What the trunk is seen from: solids of one observer move in the same way."""
    if solid is None:
        return "space"
    return "log" if solid.group == "log" else solid.frame


@dataclass(eq=False)
class _Way:
    """The motion to a time step: `cells` (2, C) are the samples at the ends of pieces of time."""

    step: int
    bodies: list[_Body]
    cells: np.ndarray
    lost: bool

    def halve(self, samples: _Samples, middle: np.ndarray, everything: bool) -> None:
        """Look at both halves of the cells, given the samples (C,) at half of their time.

        `everything` : for all bodies, else for those that are in doubt there.
        """
        if np.any(middle < 0):
            self.lost = True
            return
        accuracy = ACCURACY * samples.motion.trunk.length
        ends = [samples.discs(index) for index in (self.cells[0], middle, self.cells[1])]
        error = cell_errors(*ends)
        known: dict[tuple[str, bytes], Cells] = {}
        for body in self.bodies:
            chosen = np.ones(middle.size, dtype=bool)
            if not everything:
                chosen = np.isin(self.cells[0], body.cells[0])
                if not np.any(chosen):
                    continue
            first, mid, last = self.cells[0, chosen], middle[chosen], self.cells[1, chosen]
            halves = np.concatenate([[first, mid], [mid, last]], axis=1)
            seen_from = _observer(body.solid)
            if (key := (seen_from, chosen.tobytes())) not in known:
                tubes = [samples.seen(index, body.solid) for index in halves]
                errors = np.concatenate([error[chosen], error[chosen]])
                known[key] = Cells(samples.times[halves], tubes[0], tubes[1], errors)
            cells = known[key]
            gap, bounds = (
                self_gap(self.step, cells)
                if body.solid is None
                else solid_gap(body.solid, self.step, cells)
            )
            body.update(gap, halves, bounds, accuracy)
        pieces = np.concatenate([body.cells for body in self.bodies], axis=1)
        self.cells = np.unique(pieces, axis=1)


class _Samples:
    """Shapes of the moving trunk at instants, solved in batches."""

    def __init__(self, motion: Motion, x: np.ndarray, loads: Sequence[Loads], shape: Shape) -> None:
        self.motion, self._planned, self._shape = motion, loads, shape
        controls = np.concatenate([np.zeros((1, x.shape[1])), x])
        centers = log_centers(motion)[: len(controls)]
        self._values = np.concatenate([controls, centers], axis=1)
        self._Z = section_points(motion)
        self.times, self._table = np.zeros(0), np.zeros((0, self._values.shape[1]))
        self._tube = Tube(self._Z, *(np.zeros((0, self._Z.size, *end)) for end in ((3,), (3,), ())))

    def add(self, steps: Sequence[int], times: Sequence[np.ndarray]) -> list[np.ndarray]:
        """Sample the way to each step at some times; returns indices, -1 without equilibrium."""
        counts = [part.size for part in times]
        if not sum(counts):
            return [np.zeros(0, dtype=int) for _ in times]
        try:
            return np.split(self._solve(steps, times), np.cumsum(counts)[:-1])
        except StaticsError:
            if len(steps) == 1:
                return [np.full(times[0].size, -1)]
            parts = zip(steps, times, strict=True)
            return [self.add([step], [part])[0] for step, part in parts]

    def _solve(self, steps: Sequence[int], parts: Sequence[np.ndarray]) -> np.ndarray:
        motion, count = self.motion, len(self._values) - 1
        times = np.concatenate(parts)
        values = interpolate_all(motion, self._values, times)
        loads = [load for part in zip(steps, parts, strict=True) for load in self._loads_at(*part)]
        nearest = np.abs(motion.times[:count, None] - times).argmin(axis=0)
        muscles = len(motion.trunk.muscles)
        activation, head = values[:, :muscles], values[:, muscles : muscles + 2]
        shapes = solve_statics(motion.trunk, activation, head, loads, near=self._shape[nearest])
        new = tube(motion.trunk, shapes, self._Z)
        first = self.times.size
        self.times = np.concatenate([self.times, times])
        self._table = np.concatenate([self._table, values])
        self._tube = Tube(
            self._Z,
            np.concatenate([self._tube.center, new.center]),
            np.concatenate([self._tube.tangent, new.tangent]),
            np.concatenate([self._tube.radius, new.radius]),
        )
        return np.arange(first, self.times.size)

    def _loads_at(self, step: int, times: np.ndarray) -> list[Loads]:
        """Loads on the way to a step (from 0), at its start after loads have jumped."""
        start, end = np.append(0.0, self.motion.times)[step : step + 2]
        inner = (start < times) & (times < end)
        loads = iter(loads_before(self.motion, self._planned, step + 1, times[inner]))
        return [
            next(loads) if between else loads_at(self.motion, self._planned, t, after=t == start)
            for t, between in zip(times.tolist(), inner.tolist(), strict=True)
        ]

    def discs(self, index: np.ndarray) -> Tube:
        """The trunk at some samples, in space."""
        return self._tube[index]

    def seen(self, index: np.ndarray, solid: Solid | None) -> Tube:
        """The trunk at some samples as a solid sees it, which may move."""
        muscles = len(self.motion.trunk.muscles)
        frame = "space" if solid is None else solid.frame
        head = self._table[index, muscles : muscles + 2]
        discs = seen_by(self.motion.trunk, self.discs(index), frame, head)
        if solid is not None and solid.group == "log":
            shift = self._table[index, muscles + 2 :] - solid.center
            discs = replace(discs, center=discs.center - shift[:, None])
        return discs


def log_centers(motion: Motion) -> np.ndarray:
    """Centers (steps + 1, 3) in m of the log at rest and at time steps; 0 without a log.

    Where no log is, the last before; before the first, that one.
    """
    centers = [None if step.log is None else step.log.center for step in motion.steps]
    last = next((center for center in centers if center is not None), (0.0, 0.0, 0.0))
    filled = [last]
    for center in centers:
        last = last if center is None else center
        filled.append(last)
    return np.array(filled)

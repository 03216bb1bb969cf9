"""Gaps between time steps: time is divided until bounds decide whether gaps are large enough."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ..errors import StaticsError
from ..model.loads import Loads
from ..model.solids import Solid
from ..problem.interpolation import interpolate_all, jumps, loads_at, loads_before
from ..problem.motion import Motion
from ..rod.shape import Shape
from ..rod.statics import solve_statics
from .certificate import error_in_time
from .gaps import (
    Cells,
    Gap,
    Nearest,
    body_of,
    nearest_to_itself,
    nearest_to_solid,
    section_points,
)
from .tube import Tube, seen_by, tube

FIRST_CELLS, MAX_DIVISIONS = 2, 4
"""Pieces of the time between two steps, and how often they are divided into quarters at most."""
BETWEEN_TOL = 5.5e-5
"""By how much a gap may be too small between time steps, as a share of the trunk's length; 0.096 mm
for the elephant."""
DOUBT_TOL = 4.5e-5
"""Lower bounds that allow more than this, over L, are made more accurate: the check subtracts some
0.005 mm from them, the error of planned shapes."""
MAX_DEFECT = 1e-4
"""Largest `Shape.defect` of a shape between time steps; its mesh was checked at the steps only."""
AT_ONCE = 16
"""Ways to time steps that are looked at together; each takes some 5 MB."""


@np.errstate(all="ignore")  # overflow ends as a gap that is not known
def gaps_between_steps(
    motion: Motion,
    x: np.ndarray,
    loads: Sequence[Loads],
    shape: Shape,
    precise: Collection[str],
) -> list[Gap]:
    """Gaps on the way to each time step, from the one before or from the start.

    Phases without interpolation jump from step to step and are left out.

    Parameters
    ----------
    precise : collection of str
        Groups of bodies for which time is divided further where it is not clear whether a gap is
        large enough.
    """
    moving = [
        t for t in range(len(x)) if motion.phases[motion.steps[t].phase].interpolation != "none"
    ]
    parts = [moving[i : i + AT_ONCE] for i in range(0, len(moving), AT_ONCE)]
    return [
        gap
        for ways in parts
        for gap in _gaps_on_ways(_Samples(motion, x, loads, shape), ways, precise)
    ]


def _gaps_on_ways(samples: _Samples, ways: Sequence[int], precise: Collection[str]) -> list[Gap]:
    """Gaps on the way to some time steps (from 0)."""
    motion = samples.motion
    times = np.append(0.0, motion.times)
    indices = samples.on_ways(ways)
    lost = {t for t, index in zip(ways, indices, strict=True) if np.any(index < 0)}
    parts = [
        _Cells(np.stack([index[:-1], index[1:]]), np.full(FIRST_CELLS, t))
        for t, index in zip(ways, indices, strict=True)
        if t not in lost
    ]
    bodies, cells = _bodies(motion, ways), _Cells.joined(parts)
    asked = [body for body in bodies if body_of(body.solid)[1] in precise]
    for number in range(MAX_DIVISIONS if asked else 1):
        if not cells.steps.size:
            break
        inner = samples.inside(cells)
        lost |= set(cells.steps[np.any(inner < 0, axis=0)].tolist())
        alive = ~np.isin(cells.steps, list(lost))
        those = asked if number else bodies
        _look(samples, those, cells.chosen(alive), inner[:, alive], everything=number == 0)
        cells = _Cells.joined([body.cells for body in asked]).distinct()
    return [body.gap_at(t, t in lost, times) for body in bodies for t in ways if body.there[t]]


@dataclass(frozen=True, eq=False)
class _Cells:
    """Pieces of time: samples (2, C) at their ends, and the time steps (C,) they lead to."""

    ends: np.ndarray
    steps: np.ndarray

    @staticmethod
    def joined(parts: Sequence[_Cells]) -> _Cells:
        if not parts:
            return _Cells(np.zeros((2, 0), dtype=int), np.zeros(0, dtype=int))
        ends = np.concatenate([part.ends for part in parts], axis=1)
        return _Cells(ends, np.concatenate([part.steps for part in parts]))

    def chosen(self, index: np.ndarray) -> _Cells:
        return _Cells(self.ends[:, index], self.steps[index])

    def distinct(self) -> _Cells:
        return self.chosen(np.unique(self.ends[0], return_index=True)[1])


@dataclass(eq=False)
class _Body:
    """A solid, or the trunk itself, and the smallest gap to it on the way to each time step.

    `there` (H,) says on the way to which steps it is there. `cells` are the pieces of time in
    which it is not clear whether the gap is large enough, with lower bounds `open_bounds`; `bound`
    (H,) is a lower bound in all others.
    """

    solid: Solid | None
    there: np.ndarray
    best: Nearest
    cells: _Cells = field(default_factory=lambda: _Cells.joined([]))
    open_bounds: np.ndarray = field(default_factory=lambda: np.zeros(0))

    def update(self, cells: _Cells, found: Nearest, length: float) -> None:
        """Take the smallest gaps on cells of a trunk of some length into account."""
        best, least = self.best, body_of(self.solid)[2]
        order = np.argsort(found.gap, kind="stable")
        steps, first = np.unique(cells.steps[order], return_index=True)
        closer = found.gap[order[first]] < best.gap[steps]
        to, source = steps[closer], order[first][closer]
        for name in ("gap", "time", "places"):
            getattr(best, name)[to] = getattr(found, name)[source]
        smallest = best.gap[cells.steps]
        doubtful = found.bound < least - DOUBT_TOL * length
        doubtful &= least - smallest <= BETWEEN_TOL * length  # else it is too small beyond doubt
        np.minimum.at(best.bound, cells.steps[~doubtful], found.bound[~doubtful])
        self.cells, self.open_bounds = cells.chosen(doubtful), found.bound[doubtful]

    def gap_at(self, step: int, lost: bool, times: np.ndarray) -> Gap:
        """The gap on the way to a step; unknown if there is a time without equilibrium."""
        if lost:
            name, group, least = body_of(self.solid)
            return Gap(name, group, step, float(times[step]), np.nan, -np.inf, least, np.nan)
        gap = self.best.gap_of(self.solid, step, step)
        rest = float(np.min(self.open_bounds[self.cells.steps == step], initial=np.inf))
        return replace(gap, bound=min(gap.bound, rest, gap.gap))


def _bodies(motion: Motion, ways: Sequence[int]) -> list[_Body]:
    """Solids on the way to some time steps, and the trunk itself.

    A log that moves is one body, at the place where it is first.
    """
    there: dict[Solid | None, np.ndarray] = {}
    logs: dict[Solid, Solid] = {}
    count = len(motion.steps)
    for t in ways:
        for solid in (*motion.steps[t].solids, None):
            if solid is not None and solid.group == "log":
                solid = logs.setdefault(replace(solid, center=(0.0, 0.0, 0.0)), solid)
            there.setdefault(solid, np.zeros(count, dtype=bool))[t] = True
    return [
        _Body(
            solid,
            at,
            Nearest(
                np.full(count, np.inf),
                np.append(0.0, motion.times)[:-1],
                np.full((count, 2), np.nan),
                np.full(count, np.inf),
            ),
        )
        for solid, at in there.items()
    ]


def _look(
    samples: _Samples, bodies: Sequence[_Body], cells: _Cells, inner: np.ndarray, everything: bool
) -> None:
    """Look at the quarters of cells, given the samples (3, C) at their ends.

    `everything` : for all bodies, else for those that are in doubt there.
    """
    known: dict[tuple[str, bytes], Cells] = {}
    for body in bodies:
        chosen = (
            body.there[cells.steps] if everything else np.isin(cells.ends[0], body.cells.ends[0])
        )
        if not np.any(chosen):
            body.cells, body.open_bounds = cells.chosen(chosen), np.zeros(0)
            continue
        instants = np.stack([cells.ends[0], *inner, cells.ends[1]])[:, chosen]
        quarters = np.concatenate([instants[i : i + 2] for i in range(4)], axis=1)
        key = (_observer(body.solid), chosen.tobytes())
        if key not in known:
            seen = [samples.seen(index, body.solid) for index in instants]
            ends = [samples.seen(index, body.solid) for index in quarters]
            error = np.tile(error_in_time(seen), (4, 1))
            known[key] = Cells(samples.times[quarters], ends[0], ends[1], error)
        found = (
            nearest_to_itself(known[key])
            if body.solid is None
            else nearest_to_solid(body.solid, known[key])
        )
        body.update(
            _Cells(quarters, np.tile(cells.steps[chosen], 4)), found, samples.motion.trunk.length
        )


def _observer(solid: Solid | None) -> str:
    """What the trunk is seen from: solids of one observer move in the same way."""
    if solid is None:
        return "space"
    return "log" if solid.group == "log" else solid.frame


class _Samples:
    """Shapes of the moving trunk at instants, solved in batches."""

    def __init__(self, motion: Motion, x: np.ndarray, loads: Sequence[Loads], shape: Shape) -> None:
        self.motion, self._planned, self._shape = motion, loads, shape
        controls = np.concatenate([motion.start[None], x])
        centers = log_centers(motion)[: len(controls)]
        self._jumps = jumps(motion, loads)
        self._values = np.concatenate([controls, centers], axis=1)
        self._Z = section_points(motion)
        # The first samples are the time steps.
        self.times, self._table = motion.times[: len(x)], self._values[1:]
        self._tube = tube(motion.trunk, shape, self._Z)

    def on_ways(self, steps: Sequence[int]) -> list[np.ndarray]:
        """Sample the way to each step at the ends of the first cells; -1 without equilibrium."""
        times, jumped = np.append(0.0, self.motion.times), (0.0, *self._jumps)
        grids = [np.linspace(times[t], times[t + 1], FIRST_CELLS + 1)[:-1] for t in steps]
        known = [times[t] not in jumped for t in steps]  # the start is the step before
        new = self.add(steps, [grid[int(k) :] for k, grid in zip(known, grids, strict=True)])
        return [
            np.concatenate([[t - 1] * k, index, [t]]).astype(int)
            for t, k, index in zip(steps, known, new, strict=True)
        ]

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

    def inside(self, cells: _Cells) -> np.ndarray:
        """Sample cells at the ends of their quarters; indices (3, C), -1 without equilibrium."""
        order = np.argsort(cells.steps, kind="stable")
        steps, first = np.unique(cells.steps[order], return_index=True)
        one, other = self.times[cells.ends][:, order]
        times = (one + (other - one) * np.array([[0.25], [0.5], [0.75]])).T  # (C, 3)
        found = self.add(steps.tolist(), [part.ravel() for part in np.split(times, first[1:])])
        index = np.empty((3, order.size), dtype=int)
        index[:, order] = np.concatenate(found).reshape(-1, 3).T
        return index

    def _solve(self, steps: Sequence[int], parts: Sequence[np.ndarray]) -> np.ndarray:
        motion, count = self.motion, len(self._values) - 1
        times = np.concatenate(parts)
        values = interpolate_all(motion, self._values, times)
        loads = [load for part in zip(steps, parts, strict=True) for load in self._loads_at(*part)]
        nearest = np.abs(motion.times[:count, None] - times).argmin(axis=0)
        muscles = len(motion.trunk.muscles)
        activation, head = values[:, :muscles], values[:, muscles : muscles + 2]
        shapes = solve_statics(motion.trunk, activation, head, loads, near=self._shape[nearest])
        if np.any(shapes.defect > MAX_DEFECT):
            raise StaticsError(
                "the mesh of the plan does not resolve the shapes between steps", 1.0
            )
        new = tube(motion.trunk, shapes, self._Z)
        first = self.times.size
        self.times = np.concatenate([self.times, times])
        self._table = np.concatenate([self._table, values])
        self._tube = Tube(
            self._Z,
            np.concatenate([self._tube.center, new.center]),
            np.concatenate([self._tube.tangent, new.tangent]),
            np.concatenate([self._tube.radius, new.radius]),
            new.breaks,
            np.concatenate([self._tube.arc, new.arc]),
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
    """Centers (steps + 1, 3) in m of the log at the start and at time steps; 0 without a log.

    Where no log is, the last before; before the first, that one.
    """
    centers = [None if step.log is None else step.log.center for step in motion.steps]
    last = next((center for center in centers if center is not None), (0.0, 0.0, 0.0))
    filled = [last]
    for center in centers:
        last = last if center is None else center
        filled.append(last)
    return np.array(filled)

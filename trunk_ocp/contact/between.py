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
from .certificate import curving_in_time
from .gaps import (
    FAR,
    Cells,
    Gap,
    Nearest,
    body_of,
    nearest_to_itself,
    nearest_to_solid,
    reaches,
    section_points,
)
from .tube import Tube, seen_by, solid_gaps, tube

FIRST_CELLS, MAX_DIVISIONS = 2, 4
"""Pieces of the time between two steps, and how often they are divided into quarters at most."""
BETWEEN_TOL = 5.5e-5
"""By how much a gap may be too small between time steps, as a share of the trunk's length; 0.096 mm
for the elephant."""
MAX_DEFECT = 1e-4
"""Largest `Shape.defect` of a shape between time steps; its mesh was checked at the steps only."""
GLANCE = (16, 2)
"""Sections to one that is looked at in a hurry: of all bodies, and of those closer than `FAR`."""
AT_ONCE = 16
"""Ways to time steps that are looked at together; each takes some 5 MB."""


@np.errstate(all="ignore")  # overflow ends as a gap that is not known
def gaps_between_steps(
    motion: Motion,
    x: np.ndarray,
    loads: Sequence[Loads],
    shape: Shape,
    precise: Collection[str],
    off: np.ndarray,
    hurry: bool = False,
) -> list[Gap]:
    """Gaps on the way to each time step, from the one before or from the start.

    Phases without interpolation jump from step to step and are left out.

    Parameters
    ----------
    precise : collection of str
        Groups of bodies for which time is divided further where it is not clear whether a gap is
        large enough.
    off : (H,)
        How far planned shapes may be from the true ones, in m; lower bounds are less by that.
    hurry : bool
        Whether lower bounds do not matter once some gap of these groups is too small.
    """
    moving = [
        t for t in range(len(x)) if motion.phases[motion.steps[t].phase].interpolation != "none"
    ]
    parts = [moving[i : i + AT_ONCE] for i in range(0, len(moving), AT_ONCE)]
    return [
        gap
        for ways in parts
        for gap in _gaps_on_ways(_Samples(motion, x, loads, shape), ways, precise, off, hurry)
    ]


def _gaps_on_ways(
    samples: _Samples, ways: Sequence[int], precise: Collection[str], off: np.ndarray, hurry: bool
) -> list[Gap]:
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
    bodies, cells = _bodies(motion, ways, off), _Cells.joined(parts)
    asked = [body for body in bodies if body_of(body.solid)[1] in precise]
    for number in range(MAX_DIVISIONS if asked else 1):
        if not cells.steps.size or (hurry and any(body.too_close for body in asked)):
            break
        inner = samples.inside(cells)
        lost |= set(cells.steps[np.any(inner < 0, axis=0)].tolist())
        alive = ~np.isin(cells.steps, list(lost))
        if hurry and number == 0 and _glance(samples, asked, cells.chosen(alive), inner[:, alive]):
            break
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

    `there` (H,) says on the way to which steps it is there, and `off` (H,) how far shapes on that
    way may be from the true ones, in m. Gaps may be `tol` too small. `cells` are the pieces of time
    in which it is not clear whether the gap is large enough, with lower bounds `open_bounds`;
    `best.bound` is a lower bound in all others.
    """

    solid: Solid | None
    there: np.ndarray
    off: np.ndarray
    tol: float
    best: Nearest
    cells: _Cells = field(default_factory=lambda: _Cells.joined([]))
    open_bounds: np.ndarray = field(default_factory=lambda: np.zeros(0))

    @property
    def too_close(self) -> bool:
        """Whether a gap is too small beyond doubt."""
        return bool(np.any(self.best.gap < body_of(self.solid)[2] - self.tol))

    def closer(self, ways: np.ndarray, found: Nearest) -> None:
        """Take gaps (C,) found on the ways to some steps (C,) into account."""
        best, order = self.best, np.argsort(found.gap, kind="stable")
        steps, first = np.unique(ways[order], return_index=True)
        closer = found.gap[order[first]] < best.gap[steps]
        to, source = steps[closer], order[first][closer]
        for name in ("gap", "time", "places"):
            getattr(best, name)[to] = getattr(found, name)[source]

    def update(self, cells: _Cells, found: Nearest) -> None:
        """Take the smallest gaps on cells and their lower bounds into account."""
        self.closer(cells.steps, found)
        best, least = self.best, body_of(self.solid)[2]
        smallest = best.gap[cells.steps]
        doubtful = found.bound - self.off[cells.steps] < least - self.tol
        doubtful &= least - smallest <= self.tol  # else it is too small beyond doubt
        np.minimum.at(best.bound, cells.steps[~doubtful], found.bound[~doubtful])
        self.cells, self.open_bounds = cells.chosen(doubtful), found.bound[doubtful]

    def gap_at(self, step: int, lost: bool, times: np.ndarray) -> Gap:
        """The gap on the way to a step; unknown if there is a time without equilibrium."""
        if lost:
            name, group, least = body_of(self.solid)
            return Gap(name, group, step, float(times[step]), np.nan, -np.inf, least, np.nan)
        gap = self.best.gap_of(self.solid, step, step)
        rest = float(np.min(self.open_bounds[self.cells.steps == step], initial=np.inf))
        return replace(gap, bound=min(gap.bound, rest, gap.gap) - float(self.off[step]))


def _bodies(motion: Motion, ways: Sequence[int], off: np.ndarray) -> list[_Body]:
    """Solids on the way to some time steps, and the trunk itself.

    A log that moves is one body, at the place where it is first.
    """
    there: dict[Solid | None, np.ndarray] = {}
    logs: dict[Solid, Solid] = {}
    count = len(motion.steps)
    off = np.pad(np.maximum(off, np.append(0.0, off[:-1])), (0, count - len(off)))
    for t in ways:
        for solid in (*motion.steps[t].solids, None):
            if solid is not None and solid.group == "log":
                solid = logs.setdefault(replace(solid, center=(0.0, 0.0, 0.0)), solid)
            there.setdefault(solid, np.zeros(count, dtype=bool))[t] = True
    return [
        _Body(
            solid,
            at,
            off,
            BETWEEN_TOL * motion.trunk.length,
            Nearest(
                np.full(count, np.inf),
                np.append(0.0, motion.times)[:-1],
                np.full((count, 2), np.nan),
                np.full(count, np.inf),
            ),
        )
        for solid, at in there.items()
    ]


def _glance(samples: _Samples, bodies: Sequence[_Body], cells: _Cells, inner: np.ndarray) -> bool:
    """Whether the trunk is too close to a solid at the samples of cells; then no gap is bounded."""
    for body in bodies:
        chosen = body.there[cells.steps]
        if body.solid is not None and np.any(chosen):
            index = np.concatenate([cells.ends, inner])[:, chosen]
            ways = np.tile(cells.steps[chosen], len(index))
            body.closer(ways, _at_samples(samples, index.ravel(), body.solid))
    too_close = any(body.too_close for body in bodies)
    for body in bodies:
        body.best.bound[:] = -np.inf if too_close else np.inf
    return too_close


def _at_samples(samples: _Samples, index: np.ndarray, solid: Solid) -> Nearest:
    """Gaps from a solid at some samples (C,), roughly if they are large."""
    discs = samples.seen(index, solid)
    for stride in GLANCE:
        part = discs.part(slice(None, None, stride))
        gaps = np.where(reaches(part.Z, solid), solid_gaps(part, solid), np.inf)
        if gaps.min() > FAR * samples.motion.trunk.length:
            break
    at = gaps.argmin(axis=1)
    places = np.stack([part.Z[at], np.full(at.size, np.nan)], axis=1)
    return Nearest(gaps.min(axis=1), samples.times[index], places, np.full(at.size, -np.inf))


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
            in_time = curving_in_time(seen)[np.tile(np.arange(instants.shape[1]), 4)]
            known[key] = Cells(samples.times[quarters], ends[0], ends[1], in_time)
        found = (
            nearest_to_itself(known[key])
            if body.solid is None
            else nearest_to_solid(body.solid, known[key])
        )
        body.update(_Cells(quarters, np.tile(cells.steps[chosen], 4)), found)


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

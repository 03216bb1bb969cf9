"""Which gaps a plan has to keep, found by exchange (semi-infinite programming).

The trunk must be clear of a body at every point Z, but the gap has few minima along Z, and only
these need rows in the NLP (Hettich & Kortanek 1993). So a plan is made with the rows known so far,
minima that are too small become further rows, and it is made again until none is left.

Between time steps there are no rows. Where the trunk comes too close on the way from one step to
the next, both steps have to keep a larger gap (constraint tightening).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ..errors import InputError
from ..model.anatomy import Trunk
from ..model.solids import SELF, Solid
from ..nlp.gap_rows import GapRow
from ..problem.motion import Motion
from ..rod.shape import Shape
from .between import BETWEEN_TOL
from .gaps import Gap, body_of, section_points
from .tube import Tube, pair_gaps, seen_by, solid_gaps, tube

STEP_TOL = 1e-5
"""By how much a gap may be too small at a time step, as a share of the trunk's length."""
SPACING = 0.05
"""Largest distance of the first rows along a piece of the trunk that is in a solid, over L."""
BRACKET = 0.015
"""Distance of further rows on both sides of a minimum, over L: it moves as the plan changes."""
NEAREST = 0.0015
"""Smallest distance of rows of one body along the trunk, over L."""
MARGIN = 5e-5
"""Of the rows of a plan, over L; 0.09 mm for the elephant. Without, most plans are made again for a
collision of this size."""
OVERSHOOT, OVERSHOOT_AGAIN = 1.5, 3.0
"""Tightening over what is missing, which saves a plan: other steps move a little, too. Where it was
not enough, they move more."""
FEW, FAR = 8, 0.02
"""One in so many sections is looked at first; only if some of these are closer to each other, over
L, all pairs are."""
MAX_PAIRS = 6
"""Pairs of sections that become rows of a time step in one exchange, the deepest ones."""


@dataclass(eq=False)
class Exchange:
    """The gaps that a motion's time steps have to keep, as far as known.

    Attributes
    ----------
    rows : dict
        Rows of each time step, from 0.
    extra : dict
        Additional gap in m by (time step, body), because of what happens between steps.
    margin : float
        Additional gap of all rows in m: between rows and between steps gaps are a little smaller.
    short : dict
        By how much gaps for which `add` last added rows are too small, in m by (time step, body).
    places : (n,), optional
        Where rows may be, m from the base; pairs at every second place. By default where the
        check looks.
    """

    motion: Motion
    rows: dict[int, tuple[GapRow, ...]] = field(default_factory=dict)
    extra: dict[tuple[int, str], float] = field(default_factory=dict)
    margin: float = 0.0
    places: np.ndarray | None = None
    short: dict[tuple[int, str], float] = field(default_factory=dict)

    @property
    def count(self) -> int:
        """Number of rows of all steps."""
        return sum(map(len, self.rows.values()))

    def add(self, x: np.ndarray, shape: Shape) -> int:
        """Add rows where planned shapes (H,) are too close to a body; returns how many."""
        trunk, before, self.short = self.motion.trunk, self.count, {}
        places = section_points(self.motion) if self.places is None else self.places
        discs = tube(trunk, shape, places)
        seen = {f: seen_by(trunk, discs, f, x[:, -2:]) for f in ("space", "head")}
        there: dict[Solid, list[int]] = {}
        for t in range(len(x)):
            for solid in solids_at(self.motion, t):
                if self.asks(solid.group):
                    there.setdefault(solid, []).append(t)
        for solid, steps in there.items():
            gaps = solid_gaps(seen[solid.frame][np.array(steps)], solid)
            for t, gap in zip(steps, gaps, strict=True):
                self._add_solid(t, solid, discs.Z, gap)
        for t in range(len(x)) if self.asks("self") else ():
            self._add_pairs(t, discs[t : t + 1].part(slice(None, None, 2)))
        return self.count - before

    def too_small(self, gaps: Sequence[Gap], bounds: bool = True) -> list[tuple[Gap, float]]:
        """The gaps on the way to time steps that are too small, and by how much in m.

        bounds : whether lower bounds count, if all gaps themselves are large enough.
        """
        tol = BETWEEN_TOL * self.motion.trunk.length
        asked = [gap for gap in gaps if self.asks(gap.group)]
        deep = [(gap, gap.depth) for gap in asked if gap.depth > tol]
        if deep or not bounds:
            return deep
        missing = [(gap, gap.least - gap.bound) for gap in asked]
        # Where nothing is known, larger gaps are no cure.
        return [(gap, short) for gap, short in missing if tol < short < np.inf]

    def tighten(self, gaps: Sequence[Gap], bounds: bool = True) -> list[int]:
        """Ask for larger gaps around each way on which a gap is too small; see `too_small`.

        Returns the time steps (from 0) that these ways lead to.
        """
        missing: dict[tuple[int, str], float] = {}
        small, at_steps = self.too_small(gaps, bounds), dict(self.short)
        for gap, short in small:
            steps = {max(gap.step - 1, 0), gap.step}
            known = max(at_steps.get((t, gap.body), 0.0) for t in steps)  # new rows see to it
            for t in steps:
                missing[t, gap.body] = max(missing.get((t, gap.body), 0.0), short - known)
                self._add_at(t, gap)
        for key, short in missing.items():
            known = self.extra.get(key, 0.0)
            self.extra[key] = known + (OVERSHOOT_AGAIN if known else OVERSHOOT) * short
        for t, rows in self.rows.items():
            self.rows[t] = tuple(self._row(t, row.Z, row.solid, row.other) for row in rows)
        return sorted({gap.step for gap, _ in small})

    def asks(self, group: str) -> bool:
        """Whether the motion asks to keep clear of the bodies of a group."""
        return group in self.motion.contact

    def _least(self, t: int, solid: Solid | None) -> float:
        body, _, clearance = body_of(solid)
        return clearance + self.extra.get((t, body), 0.0)

    def _row(self, t: int, Z: float, solid: Solid | None, other: float | None) -> GapRow:
        return GapRow(Z, solid, other, self._least(t, solid) + self.margin)

    def _add_at(self, t: int, gap: Gap) -> None:
        """Add a row of a step at the place of a gap beside it."""
        solids = {solid.name: solid for solid in solids_at(self.motion, t)}
        if gap.body == SELF:
            self._append(t, [self._row(t, gap.Z, None, gap.other)])
        elif gap.body in solids:
            self._append(t, [self._row(t, gap.Z, solids[gap.body], None)])

    def _add_solid(self, t: int, solid: Solid, Z: np.ndarray, gaps: np.ndarray) -> None:
        """Add minima of the gap (n,) from a solid, and points between them where it is deep."""
        trunk = self.motion.trunk
        concerned = (Z >= solid.Z[0]) & (Z <= solid.Z[1])
        concerned[np.abs(Z - solid.Z[0]).argmin()] |= not np.any(concerned)  # a very short part
        gaps = np.where(concerned, gaps - self._least(t, solid), np.inf)
        inside = gaps < -STEP_TOL * trunk.length
        if not np.any(inside):
            return
        ends = (float(Z[concerned][0]), float(Z[concerned][-1]))
        places = [
            float(np.clip(Z[i] + side * BRACKET * trunk.length, *ends))
            for i in _minima(gaps)
            if inside[i]
            for side in (0, -1, 1)
        ]
        for low, high in _runs(inside):
            count = int((Z[high] - Z[low]) / (SPACING * trunk.length))
            places += np.linspace(Z[low], Z[high], count + 2)[1:-1].tolist()
        rows = [self._row(t, Z, solid, None) for Z in places]
        self._append(t, rows, -float(gaps.min()))

    def _add_pairs(self, t: int, discs: Tube) -> None:
        """Add minima of the gap between two parts of the trunk."""
        few = discs.part(slice(None, None, FEW))
        pairs = np.stack(np.triu_indices(len(few.Z), 1), axis=-1)
        if pair_gaps(few, pairs).min() > FAR * self.motion.trunk.length:
            return
        one, other = np.triu_indices(len(discs.Z), 1)
        gaps = np.full((len(discs.Z),) * 2, np.inf)
        gaps[one, other] = pair_gaps(discs, np.stack([one, other], axis=-1))[0]
        gaps -= self._least(t, None)
        deep = np.argwhere(_minima_2d(gaps) & (gaps < -STEP_TOL * self.motion.trunk.length))
        deepest = deep[np.argsort(gaps[tuple(deep.T)])][:MAX_PAIRS]
        places = [(float(discs.Z[i]), float(discs.Z[j])) for i, j in deepest]
        self._append(t, [self._row(t, i, None, j) for i, j in places], -float(gaps.min()))

    def _append(self, t: int, rows: Sequence[GapRow], short: float = 0.0) -> None:
        """Add rows that are not beside one of the same body that is there already."""
        known = list(self.rows.get(t, ()))
        for row in rows:
            if all(_distance(row, other, self.motion.trunk) > NEAREST for other in known):
                known.append(row)
                self.short[t, row.body] = short
        if known:
            self.rows[t] = tuple(known)


def solids_at(motion: Motion, t: int) -> tuple[Solid, ...]:
    """Solids that a time step has to keep clear of: its own, and those of the way to the next."""
    own = motion.steps[t].solids
    if t + 1 == len(motion.steps):
        return own
    names = {solid.name for solid in own}
    return (*own, *(s for s in motion.steps[t + 1].solids if s.name not in names))


def rows_for(
    motion: Motion, rows: Mapping[int, tuple[GapRow, ...]]
) -> dict[int, tuple[GapRow, ...]]:
    """The same rows for a motion with solids of the same names at other places.

    Raises
    ------
    InputError
        If the motion lacks a time step, or a time step a solid.
    """
    moved = {}
    for t, gaps in rows.items():
        solids: dict[str, Solid | None] = {SELF: None}
        if t < len(motion.steps):
            solids |= {solid.name: solid for solid in motion.steps[t].solids}
        for gap in gaps:
            if t >= len(motion.steps) or gap.body not in solids:
                missing = gap.body if t < len(motion.steps) else "that step"
                raise InputError(
                    f"{motion.name}: time step {t + 1} lacks {missing}; expected the steps and "
                    "solids of the planned motion. Use plan_motion."
                )
        moved[t] = tuple(_moved(gap, solids[gap.body]) for gap in gaps)
    return moved


def _moved(row: GapRow, solid: Solid | None) -> GapRow:
    """The row for a solid at another place, or with another clearance."""
    if solid is None or row.solid is None:
        return row
    return replace(row, solid=solid, least=row.least - row.solid.clearance + solid.clearance)


def _distance(row: GapRow, other: GapRow, trunk: Trunk) -> float:
    """How far apart two rows are along the trunk, over L; infinite for different bodies."""
    if row.body != other.body or (row.other is None) != (other.other is None):
        return np.inf
    apart = [abs(a - b) for a, b in zip(row.points, other.points, strict=True)]
    return max(apart) / trunk.length


def _minima(values: np.ndarray) -> Iterator[int]:
    """Indices of local minima, ends included."""
    padded = np.pad(values, 1, constant_values=np.inf)
    yield from np.flatnonzero((values <= padded[:-2]) & (values < padded[2:])).tolist()


def _minima_2d(values: np.ndarray) -> np.ndarray:
    padded = np.pad(values, 1, constant_values=np.inf)
    n, m = values.shape
    shifts = [(i, j) for i in range(3) for j in range(3) if (i, j) != (1, 1)]
    return np.all([values <= padded[i : i + n, j : j + m] for i, j in shifts], axis=0)


def _runs(inside: np.ndarray) -> Iterator[tuple[int, int]]:
    """First and last index of each run of true values."""
    edges = np.flatnonzero(np.diff(np.pad(inside.astype(int), 1)))
    yield from zip(edges[::2].tolist(), (edges[1::2] - 1).tolist(), strict=True)

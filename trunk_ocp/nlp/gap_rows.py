"""Rows of an NLP that keep cross-sections of the trunk clear of solids, and of each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from ..model.anatomy import Trunk
from ..model.solids import SELF, Solid, pivot
from ..rod.collocation import Mesh
from ..rod.volume import volume_weights
from .gap_functions import scaled_stretch, section_gap, solid_gap
from .nlp_builder import NLPBuilder
from .quantities import Component, Meaning, Quantity, scalar, units_of
from .rod_block import RodEquations, Unknowns


@dataclass(frozen=True)
class GapRow:
    """One gap that a time step keeps: of the section at Z from a solid, or from that at `other`.

    Z and other in m; `least` is the smallest gap allowed, in m.
    """

    Z: float
    solid: Solid | None
    other: float | None
    least: float

    @property
    def body(self) -> str:
        """Name of what the section keeps clear of."""
        return self.solid.name if self.solid is not None else SELF

    @property
    def points(self) -> tuple[float, ...]:
        """Points of the trunk that it concerns, in m."""
        return (self.Z,) if self.other is None else (self.Z, self.other)


def add_volume(
    add: NLPBuilder,
    trunk: Trunk,
    mesh: Mesh,
    rod: RodEquations,
    moved: np.ndarray,
    points: np.ndarray,
    number: int,
) -> np.ndarray:
    """Add the volume ratio of a step, (1,): the section at Z has radius R_0(Z) / sqrt(ratio).

    moved : `rod.variables` of this step. points : parameters of `rates` there.
    """
    units = units_of(trunk)
    v, row = add.variables(1), add.rows(scalar("volume ratio"), 1, step=number)
    add.linear(row, v)
    weights = volume_weights(trunk, mesh).ravel()
    stretch = scaled_stretch(units.length, units.moment)
    add.term(stretch, moved, points, 0, np.arange(weights.size), row, -weights)
    return v


def add_gaps(
    add: NLPBuilder,
    trunk: Trunk,
    u: Unknowns,
    volume: np.ndarray,
    gaps: Sequence[GapRow],
    number: int,
) -> list[int]:
    """Add the rows of a time step, gap >= least; returns their row numbers in F."""
    L, numbers = trunk.length, []
    for gap in gaps:
        meaning = Meaning("gap", Quantity("gap", (Component(f"gap to {gap.body}", "m", L),)))
        row = add.rows(
            meaning, 1, lower=gap.least / L, upper=np.inf, Z=np.array([gap.Z]), step=number
        )
        function, variables, parameters = _place(trunk, u, volume, gap)
        add.term(function, variables[:, None], parameters[:, None], 0, 0, row)
        numbers.append(int(row[0]))
    return numbers


def _place(
    trunk: Trunk, u: Unknowns, volume: np.ndarray, gap: GapRow
) -> tuple[ca.Function, np.ndarray, np.ndarray]:
    """Function, indices of its unknowns, and its parameters."""
    L, solid = trunk.length, gap.solid
    q, r = u.points[gap.Z]
    if solid is None:
        if gap.other is None:
            raise AssertionError("a gap is from a solid or from another section")
        q2, r2 = u.points[gap.other]
        radii = np.asarray(trunk.radius(np.array([gap.Z, gap.other]))) / L
        return section_gap(), np.concatenate([r, q, r2, q2, volume]), radii
    in_head = solid.frame == "head"
    variables = [r, q, volume, *([u.x[-2:]] if in_head else [])]
    parameters = [
        np.asarray(solid.center) / L,
        np.ravel(solid.axes),
        pivot(trunk) / L,
        np.atleast_1d(trunk.radius(gap.Z)) / L,
        np.asarray(solid.sizes) / L,
    ]
    return solid_gap(solid.shape, in_head), np.concatenate(variables), np.concatenate(parameters)

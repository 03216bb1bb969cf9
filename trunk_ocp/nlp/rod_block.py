"""The rod of one time step as equations of an NLP: direct collocation in Z.

Unknowns of a step: activations and head angles; the strain numbers they make; the tip force;
the rod's states at element edges and Gauss points; its centerline at element edges and at
targets. Inside, lengths are in units of L and moments of E I(0) / L.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ..model.activation import segment_at, segment_fractions, strain_matrix
from ..model.anatomy import Trunk
from ..rod.collocation import Mesh, gauss
from ..rod.equations import RATES, STATES
from .nlp_builder import NLPBuilder
from .point_functions import base


@dataclass(frozen=True, eq=False)
class Unknowns:
    """Indices in x of one step's unknowns."""

    x: np.ndarray  # (muscles + 2,)
    strain: np.ndarray  # (segments, 4)
    mean: np.ndarray  # (1,)
    tip_force: np.ndarray  # (3,)
    edges: np.ndarray  # (elements + 1, 7)
    inner: np.ndarray  # (elements, degree, 7)
    line: np.ndarray  # (elements + 1, 3)
    points: dict[float, tuple[np.ndarray, np.ndarray]]  # Z: (q (4,), r (3,))

    def moved(self, by: int) -> Unknowns:
        """The same with every index grown by a number."""
        return Unknowns(
            self.x + by,
            self.strain + by,
            self.mean + by,
            self.tip_force + by,
            self.edges + by,
            self.inner + by,
            self.line + by,
            {Z: (q + by, r + by) for Z, (q, r) in self.points.items()},
        )


@dataclass(frozen=True, eq=False)
class RodEquations:
    """Variables and equations of one rod, counted from 0, without the box of x and the loads.

    `nlp_builder` has all but the nonlinear part: the rates of the rod at the Gauss points, with
    `variables` (15, N), enter row `rows` by output, place and weight as in `NLPBuilder.term`.
    """

    assembly: NLPBuilder
    unknowns: Unknowns
    variables: np.ndarray
    output: np.ndarray
    place: np.ndarray
    rows: np.ndarray
    weights: np.ndarray


@lru_cache(maxsize=64)
def rod_equations(
    trunk: Trunk, mesh: Mesh, extension: tuple[float, float], asked: tuple[float, ...]
) -> RodEquations:
    """Equations of a rod whose orientation and position are asked for at some Z.

    Steps differ by numbers only, so each kind is made once.
    """
    add = NLPBuilder()
    E, d, S = mesh.elements, mesh.degree, trunk.segments
    strain_low, strain_high = np.full((S, 4), -np.inf), np.full((S, 4), np.inf)
    strain_low[:, 0], strain_high[:, 0] = extension
    at_edge = np.full((E + 1, STATES), np.inf)
    at_edge[-1, 4:] = 0.0  # m(L) = 0
    u = Unknowns(
        x=add.variables(len(trunk.muscles) + 2),
        strain=add.variables(S, 4, lower=strain_low, upper=strain_high),
        mean=add.variables(1),
        tip_force=add.variables(3),
        edges=add.variables(E + 1, STATES, lower=-at_edge, upper=at_edge),
        inner=add.variables(E, d, STATES),
        line=add.variables(E + 1, 3),
        points={},
    )
    _strain_rows(add, trunk, u)
    _base_rows(add, trunk, u)
    inside = _point_variables(add, mesh, u, asked)
    collocation, line = _linear_rows(add, mesh, u)
    return _with_rates(add, trunk, mesh, u, collocation, line, inside)


def _strain_rows(add: NLPBuilder, trunk: Trunk, u: Unknowns) -> None:
    """Strain numbers from activations; mean extension from extensions (eqs. 5, 30)."""
    A = strain_matrix(trunk) * np.array([1, *3 * [trunk.length]])[:, None]
    rest = np.tile([1.0, 0, 0, 0], (trunk.segments, 1))
    rows = add.rows("strain", trunk.segments, 4, lower=rest, upper=rest)
    add.linear(rows, u.strain)
    add.linear(rows[..., None], u.x[: A.shape[2]], -A)
    row = add.rows("mean extension", 1)
    add.linear(row, u.mean)
    add.linear(row, u.strain[:, 0], -segment_fractions(trunk))


def _base_rows(add: NLPBuilder, trunk: Trunk, u: Unknowns) -> None:
    """Base position and orientation from the head angles (eqs. 35-39)."""
    rows = add.rows("base", 7)
    add.linear(rows, np.concatenate([u.line[0], u.edges[0, :4]]))
    add.term(base(trunk), u.x[-2:, None], np.zeros((0, 1)), np.arange(7), 0, rows, -1.0)


def _point_variables(
    add: NLPBuilder, mesh: Mesh, u: Unknowns, asked: tuple[float, ...]
) -> list[tuple[int, float, np.ndarray]]:
    """Orientation and position at every Z that is asked for.

    An element edge has them already; a point inside gets its own by the collocation
    polynomial. Returns those inside, as (element, tau, rows of r).
    """
    inside = []
    for Z in asked:
        element, tau = (value.item() for value in mesh.locate(Z))
        if tau in (0.0, 1.0):
            k = element + int(tau)
            u.points[Z] = (u.edges[k, :4], u.line[k])
            continue
        q, r = add.variables(4), add.variables(3)
        u.points[Z] = (q, r)
        rows = add.rows("frame at a target", 4, Z=np.array(Z))
        values = gauss(mesh.degree).value(tau)
        states = np.concatenate([u.edges[element, None, :4], u.inner[element, :, :4]])
        add.linear(rows, q)
        add.linear(rows, states, -values[:, None])
        rows = add.rows("position at a target", 3, Z=np.array(Z))
        add.linear(rows, r)
        add.linear(rows, u.line[element], -1.0)
        inside.append((element, tau, rows))
    return inside


def _linear_rows(add: NLPBuilder, mesh: Mesh, u: Unknowns) -> tuple[np.ndarray, np.ndarray]:
    """Collocation, continuity and centerline without the rates; rows of the first and last."""
    E, d, element = mesh.elements, mesh.degree, gauss(mesh.degree)
    states = np.concatenate([u.edges[:-1, None], u.inner], axis=1)  # (E, d + 1, 7)
    collocation = add.rows("rod", E, d, STATES, Z=mesh.points)
    add.linear(collocation[:, :, None], states[:, None], element.derivative[None, :, :, None])
    continuity = add.rows("continuity", E, STATES, Z=np.array(mesh.edges[1:]))
    add.linear(continuity, u.edges[1:])
    add.linear(continuity[:, None], states, -element.value(1.0)[None, :, None])
    line = add.rows("centerline", E, 3, Z=np.array(mesh.edges[1:]))
    add.linear(line, u.line[1:])
    add.linear(line, u.line[:-1], -1.0)
    return collocation, line


def _with_rates(
    add: NLPBuilder,
    trunk: Trunk,
    mesh: Mesh,
    u: Unknowns,
    collocation: np.ndarray,
    line: np.ndarray,
    inside: list[tuple[int, float, np.ndarray]],
) -> RodEquations:
    """Where the rates at the Gauss points enter (eq. 14)."""
    E, d, element, h = mesh.elements, mesh.degree, gauss(mesh.degree), mesh.widths / trunk.length
    place = np.arange(E * d).reshape(E, d)
    # The rates at a Gauss point are evaluated once and enter several rows: q' and m' its own
    # collocation rows; r' the centerline at the element's end, and at targets inside, by
    # quadrature weights. So the position needs no unknowns at Gauss points.
    scatter = [
        (np.arange(STATES), place[:, :, None], collocation, -h[:, None, None]),
        (
            np.arange(STATES, RATES),
            place[:, :, None],
            line[:, None, :],
            -(h[:, None] * element.integral(1.0))[:, :, None],
        ),
    ]
    for k, tau, rows in inside:
        weights = -h[k] * element.integral(tau)
        scatter.append((np.arange(STATES, RATES), place[k][:, None], rows, weights[:, None]))
    pieces = [[array.ravel() for array in np.broadcast_arrays(*part)] for part in scatter]
    output, where, rows, weights = (np.concatenate(part) for part in zip(*pieces, strict=True))
    of_element = segment_at(trunk, mesh.points[:, 0])
    every = np.ones((E, d, 1), dtype=int)
    variables = np.concatenate(
        [
            u.inner,
            u.strain[of_element][:, None, :] * every,
            u.mean * every,
            u.tip_force * every,
        ],
        axis=-1,
    )
    return RodEquations(add, u, variables.reshape(E * d, -1).T, output, where, rows, weights)

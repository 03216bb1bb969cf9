"""The rod of one time step as equations of an NLP: direct collocation in Z.

Unknowns of a step: activations and head angles; the strains of the segments; the tip force; the
rod's states at element edges and Gauss points; its centerline at element edges and at targets.
Lengths are in units of L and moments in E I(0) / L.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ..model.activation import segment_at, segment_fractions, strain_matrix
from ..model.anatomy import Trunk
from ..problem.motion import Motion, Step
from ..rod.collocation import Mesh, gauss
from ..rod.equations import RATES, STATES
from .nlp_builder import NLPBuilder
from .point_functions import base
from .quantities import Meaning, quantities

AXES = (1, 2, 3)  # of the directors
CURVATURES = tuple(f"curvature u_{i}" for i in AXES)


@dataclass(frozen=True, eq=False)
class Unknowns:
    """Indices of one step's unknowns in the decision vector; `x` are its controls."""

    x: np.ndarray  # (muscles + 2,)
    strain: np.ndarray  # (segments, 4)
    mean: np.ndarray  # (1,)
    tip_force: np.ndarray  # (3,)
    edges: np.ndarray  # (elements + 1, 7)
    inner: np.ndarray  # (elements, degree, 7)
    line: np.ndarray  # (elements + 1, 3)
    points: dict[float, tuple[np.ndarray, np.ndarray]]  # Z: (q (4,), r (3,))

    def moved(self, by: int) -> Unknowns:
        """The same with every index shifted."""
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
    """Variables and equations of one rod, numbered from 0, without bounds on controls and loads.

    `builder` has everything but the rates at the Gauss points, which depend on the loads: a term
    with the other attributes, named as in `NLPBuilder.term`; `variables` is (15, N).
    """

    builder: NLPBuilder
    unknowns: Unknowns
    variables: np.ndarray
    output: np.ndarray
    place: np.ndarray
    rows: np.ndarray
    weights: np.ndarray


def step_points(
    motion: Motion, step: Step, number: int, others: Iterable[float] = ()
) -> tuple[float, ...]:
    """Points Z in m of a step's targets, of directions that later steps hold, and others."""
    points = {target.Z for target in step.targets} | set(others)
    points |= {held.Z for held in motion.held if held.step == number}
    return tuple(sorted(points))


@lru_cache(maxsize=64)
def rod_equations(
    trunk: Trunk, mesh: Mesh, extension: tuple[float, float], points: tuple[float, ...]
) -> RodEquations:
    """Equations of a rod with orientation and position at some points Z among the unknowns.

    Most steps differ only in numbers, so each set of equations is built once and cached.
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
    inside = _point_variables(add, trunk, mesh, u, points)
    collocation, line = _linear_rows(add, trunk, mesh, u)
    return _with_rates(add, trunk, mesh, u, collocation, line, inside)


def _strain_rows(add: NLPBuilder, trunk: Trunk, u: Unknowns) -> None:
    """Strains from activations; mean extension from extensions (eqs. 5, 30)."""
    A = strain_matrix(trunk) * np.array([1, *3 * [trunk.length]])[:, None]
    rest = np.tile([1.0, 0, 0, 0], (trunk.segments, 1))
    strain, mean = quantities(trunk)["strains"], quantities(trunk)["extension"]
    labels = tuple(f"{name} made by the muscles" for name in ("extension", *CURVATURES))
    meaning = Meaning("strain", strain, labels, "segment")
    rows = add.rows(meaning, trunk.segments, 4, lower=rest, upper=rest, variables=u.strain)
    add.linear(rows, u.strain)
    add.linear(rows[..., None], u.x[: A.shape[2]], -A)
    row = add.rows(Meaning("mean extension", mean), 1)
    add.linear(row, u.mean)
    add.linear(row, u.strain[:, 0], -segment_fractions(trunk))


def _base_rows(add: NLPBuilder, trunk: Trunk, u: Unknowns) -> None:
    """Base position and orientation from the head angles (eqs. 35-39)."""
    labels = 3 * ("position of the base",) + 4 * ("orientation of the base",)
    rows = add.rows(Meaning("base", quantities(trunk)["pose"], labels), 7)
    add.linear(rows, np.concatenate([u.line[0], u.edges[0, :4]]))
    add.term(base(trunk), u.x[-2:, None], np.zeros((0, 1)), np.arange(7), 0, rows, -1.0)


def _point_variables(
    add: NLPBuilder, trunk: Trunk, mesh: Mesh, u: Unknowns, points: tuple[float, ...]
) -> list[tuple[int, float, np.ndarray]]:
    """Orientation and position at every point Z.

    Element edges have them already. A point inside an element gets variables, tied to the
    collocation polynomial: an edge at every target would enlarge the KKT system more. Returns the
    points inside elements, as (element, tau, rows of r).
    """
    inside = []
    frame = Meaning("frame at a target", quantities(trunk)["orientation"])
    position = _position("position at a target", trunk)
    for Z in points:
        element, tau = (value.item() for value in mesh.locate(Z))
        if tau in (0.0, 1.0):
            k = element + int(tau)
            u.points[Z] = (u.edges[k, :4], u.line[k])
            continue
        q, r = add.variables(4), add.variables(3)
        u.points[Z] = (q, r)
        rows = add.rows(frame, 4, Z=np.array(Z))
        values = gauss(mesh.degree).value(tau)
        states = np.concatenate([u.edges[element, None, :4], u.inner[element, :, :4]])
        add.linear(rows, q)
        add.linear(rows, states, -values[:, None])
        rows = add.rows(position, 3, Z=np.array(Z))
        add.linear(rows, r)
        add.linear(rows, u.line[element], -1.0)
        inside.append((element, tau, rows))
    return inside


def _linear_rows(
    add: NLPBuilder, trunk: Trunk, mesh: Mesh, u: Unknowns
) -> tuple[np.ndarray, np.ndarray]:
    """Collocation, continuity and centerline, without rates; rows of the first and the last."""
    E, d, element = mesh.elements, mesh.degree, gauss(mesh.degree)
    states = np.concatenate([u.edges[:-1, None], u.inner], axis=1)  # (E, d + 1, 7)
    state, ends = quantities(trunk)["state"], np.array(mesh.edges[1:])
    labels = (*4 * ("the frame's equation",), *(f"balance of moments about d{i}" for i in AXES))
    collocation = add.rows(Meaning("rod", state, labels), E, d, STATES, Z=mesh.points)
    add.linear(collocation[:, :, None], states[:, None], element.derivative[None, :, :, None])
    joint = "continuity of the moment about d"
    labels = (*4 * ("the frame's continuity",), *(f"{joint}{i}" for i in AXES))
    continuity = add.rows(Meaning("continuity", state, labels), E, STATES, Z=ends)
    add.linear(continuity, u.edges[1:])
    add.linear(continuity[:, None], states, -element.value(1.0)[None, :, None])
    line = add.rows(_position("centerline", trunk), E, 3, Z=ends)
    add.linear(line, u.line[1:])
    add.linear(line, u.line[:-1], -1.0)
    return collocation, line


def _position(name: str, trunk: Trunk) -> Meaning:
    """Meaning of rows about a position."""
    labels = tuple(f"the {name}, coordinate {axis}," for axis in "XYZ")
    return Meaning(name, quantities(trunk)["position"], labels)


def _with_rates(
    add: NLPBuilder,
    trunk: Trunk,
    mesh: Mesh,
    u: Unknowns,
    collocation: np.ndarray,
    line: np.ndarray,
    inside: list[tuple[int, float, np.ndarray]],
) -> RodEquations:
    """Add where the rates at the Gauss points enter (eq. 14).

    The centerline is a quadrature of its rates, so it needs no states inside elements.
    """
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
    ones = np.ones((E, d, 1), dtype=int)
    variables = np.concatenate(
        [
            u.inner,
            u.strain[of_element][:, None, :] * ones,
            u.mean * ones,
            u.tip_force * ones,
        ],
        axis=-1,
    )
    return RodEquations(add, u, variables.reshape(E * d, -1).T, output, where, rows, weights)

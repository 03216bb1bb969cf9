"""The exported model: one trunk, a contact region and some points Z, as tables of numbers.

Every format evaluates the same map x -> y, the shape of the trunk at the points Z, and its
derivatives. `Layout` has the order of x and y, `Tables` the numbers that the kernels of
`rod_space_axes` need.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from .._support.ranges import shown
from ..errors import InputError
from ..model.activation import segment_at, segment_fractions, stiffness, strain_matrix
from ..model.anatomy import Trunk
from ..model.loads import Loads, contact_share, couple_density, mass_beyond, vector
from ..rod.collocation import Mesh, gauss, mesh_for
from ..rod.statics import solve_statics
from .rod_space_axes import MOMENTS

DEGREE = 6
MIN_ELEMENTS, MAX_ELEMENTS = 6, 100
"""Limits of the requested number of elements; jumps and points add elements of their own."""
MAX_POINTS = 64
"""Points Z of one export; a Jacobian has 19 x 40 numbers for each."""

OUTPUTS = {"position": 3, "directors": 9, "strain": 4, "moment": 3}
"""At each point Z: r in m; d_1, d_2, d_3 in space axes; zeta and u in 1/m; m in N m, in d_i."""


@dataclass(frozen=True)
class Layout:
    """Order of the numbers in x and y.

    x has the activations; psi_Z, psi_Y in rad; gravity in m/s^2; the tip force V in N; and, with a
    contact region, contact force W in N and contact couple L in N m.
    y has, for each point Z in turn, the `OUTPUTS`.
    """

    muscles: tuple[str, ...]
    points: int
    contact: bool

    @cached_property
    def inputs(self) -> dict[str, slice]:
        """Where each part of x is."""
        sizes = {"activation": len(self.muscles), "head": 2, "gravity": 1, "tip_force": 3}
        if self.contact:
            sizes |= {"contact_force": 3, "contact_couple": 3}
        return _slices(sizes)

    @property
    def size(self) -> int:
        """Length of x."""
        return max(part.stop for part in self.inputs.values())

    @property
    def controls(self) -> int:
        """Length of the part of x that unloaded shapes depend on: activations and head."""
        return len(self.muscles) + 2

    @cached_property
    def outputs(self) -> dict[str, slice]:
        """Where each part of one point's 19 outputs is; an unloaded shape has the first 16."""
        return _slices(OUTPUTS)

    def x(self, activation: np.ndarray, head: Sequence[float], loads: Loads) -> np.ndarray:
        """The vector x (size,)."""
        contact = [*loads.contact_force, *loads.contact_couple] if self.contact else []
        return np.array([*activation, *head, loads.gravity, *loads.tip_force, *contact])


def _slices(sizes: dict[str, int]) -> dict[str, slice]:
    ends = np.cumsum([*sizes.values()]).tolist()
    return {
        name: slice(end - size, end) for (name, size), end in zip(sizes.items(), ends, strict=True)
    }


@dataclass(frozen=True, eq=False)
class Tables:
    """Numbers of a model: E elements of d Gauss points, S segments, n points Z.

    Attributes
    ----------
    strain : (S, 4, muscles)
        A of `strain_matrix`; `fractions` (S,) are the segments' shares of the length.
    segment : (E,) int
        Segment of each element.
    edge : (n,) int
        Element edge of each point Z, from 0 to E.
    ends : (n,) int
        Element whose segment gives the strains at a point: the one that ends there.
    widths : (E,)
        In m; `A` (d, d) and `b` (d,) are the weights of the Gauss method.
    section, edge_section : (E, d, 5), (E + 1, 5)
        f(Z), K_0, K_1, K_2, K_3 at Gauss points and edges: p of `rod_space_axes.rates`.
    force, edge_force : (E, d, 3), (E + 1, 3)
        Mass in kg beyond Z, share of the contact force beyond Z, couple density of a unit
        contact couple in 1/m: N = g mass e_Z + V + share W and l = density L.
    reach : (E, d)
        Stretched length in m from an element's start to its Gauss points, for
        `rod_space_axes.turn`.
    piece : (E, 4 + 21)
        p of `rod_space_axes.spiral` for each element; `piece[:, 0]` is its stretched length.
    """

    strain: np.ndarray
    fractions: np.ndarray
    segment: np.ndarray
    edge: np.ndarray
    ends: np.ndarray
    widths: np.ndarray
    A: np.ndarray
    b: np.ndarray
    section: np.ndarray
    edge_section: np.ndarray
    force: np.ndarray
    edge_force: np.ndarray
    reach: np.ndarray
    piece: np.ndarray


@dataclass(frozen=True)
class Model:
    """A trunk with the points Z at which its shape is evaluated.

    Attributes
    ----------
    Z : (n,)
        In m, increasing.
    loads : Loads
        Default loads; `contact_from` is where the contact region starts.
    elements : int
        Minimum number of collocation elements; every jump and every point Z is an edge.
    """

    trunk: Trunk
    Z: tuple[float, ...]
    loads: Loads
    elements: int = MIN_ELEMENTS

    @property
    def layout(self) -> Layout:
        """Order of x and y."""
        return Layout(self.trunk.muscles, len(self.Z), self.loads.contact_from is not None)

    @cached_property
    def mesh(self) -> Mesh:
        """Collocation elements."""
        return mesh_for(self.trunk, self.loads.contact_from, self.elements, DEGREE, self.Z)

    @cached_property
    def tables(self) -> Tables:
        """All numbers that an exported program needs."""
        trunk, mesh, edges = self.trunk, self.mesh, np.asarray(self.mesh.edges)
        element = gauss(DEGREE)
        middle = edges[:-1] + mesh.widths / 2
        edge = np.searchsorted(edges, self.Z)
        return Tables(
            strain=strain_matrix(trunk),
            fractions=segment_fractions(trunk),
            segment=segment_at(trunk, middle),
            edge=edge,
            ends=np.maximum(edge - 1, 0),
            widths=mesh.widths,
            A=element.integral(element.nodes),
            b=element.integral(1.0),
            section=self._section(mesh.points),
            edge_section=self._section(edges),
            force=self._force(mesh.points, middle[:, None]),
            edge_force=self._force(edges, edges),
            reach=self._reach(edges[:-1, None], mesh.points),
            piece=np.array([self._piece(*ends) for ends in itertools.pairwise(edges.tolist())]),
        )

    def _section(self, Z: np.ndarray) -> np.ndarray:
        return np.concatenate([self.trunk.taper(Z)[..., None], stiffness(self.trunk, Z)], axis=-1)

    def _force(self, Z: np.ndarray, inside: np.ndarray) -> np.ndarray:
        """Mass, share and density at Z; a point `inside` decides whether Z is in contact."""
        unit = replace(self.loads, contact_couple=(1.0, 0.0, 0.0)) if self.layout.contact else None
        if unit is None:
            return np.stack([mass_beyond(self.trunk, Z), 0 * Z, 0 * Z], axis=-1)
        density = couple_density(unit, self.trunk, np.ravel(inside))[:, 0].reshape(inside.shape)
        share = contact_share(unit, self.trunk, Z)
        return np.stack(
            [mass_beyond(self.trunk, Z), share, np.broadcast_to(density, Z.shape)], axis=-1
        )

    def _reach(self, start: np.ndarray, Z: np.ndarray) -> np.ndarray:
        """Stretched length int dZ / f from `start` to Z, in m."""
        k, f = self.trunk.taper_rate, self.trunk.taper(start)
        return -np.log1p(-k * (Z - start) / f) / k if k > 0 else (Z - start) / f

    def _piece(self, start: float, end: float) -> np.ndarray:
        """Parameters of `rod_space_axes.spiral` from start to end."""
        trunk = self.trunk
        nodes, weights = np.polynomial.legendre.leggauss(40)  # l^20 is smooth: round-off
        Z = start + (end - start) * (1 + nodes) / 2
        powers = self._reach(np.asarray(start), Z)[:, None] ** np.arange(MOMENTS)
        known = [
            self._reach(np.asarray(start), np.asarray(end)),
            trunk.taper(start),
            trunk.taper(end),
            trunk.taper_rate,
        ]
        return np.array([*known, *((end - start) / 2 * weights @ powers)], dtype=float)


def build_model(
    trunk: Trunk, at: Sequence[float] = (), loads: Loads | None = None, elements: int = MIN_ELEMENTS
) -> Model:
    """Model of a trunk for points Z `at` in m; by default the tip.

    Raises
    ------
    InputError
        If a point is not on the trunk, or the number of points or elements is out of range.
    """
    Z = tuple(sorted({float(trunk.clipped(point)) for point in at})) or (trunk.length,)
    for point in Z:
        if not 0 <= point <= trunk.length:
            raise InputError(
                f"--at {point:.12g}: expected points Z in m on the trunk, from 0 (base) to "
                f"{trunk.length:.12g} (tip)."
            )
    if len(Z) > MAX_POINTS:
        raise InputError(
            f"--at: {len(Z)} points make {19 * len(Z)} outputs; expected at most {MAX_POINTS} "
            f"points ({19 * MAX_POINTS} outputs). Export twice, or interpolate between them."
        )
    if not MIN_ELEMENTS <= elements <= MAX_ELEMENTS:
        raise InputError(
            f"--elements {shown(elements)}: expected {MIN_ELEMENTS} to {MAX_ELEMENTS}."
        )
    if loads is not None and loads.contact_lever != 0:
        raise InputError("loads.contact_lever: exports have no contact force on a lever.")
    return Model(trunk, Z, Loads() if loads is None else loads, elements)


def reference(model: Model, x: np.ndarray) -> np.ndarray:
    """Shapes y (B, n, 19) at inputs x (B, size) by `solve_statics` on a finer mesh.

    An independent formulation, with the moment in the directors.

    Raises
    ------
    StaticsError, InputError
        As `solve_statics` does.
    """
    trunk, layout, Z = model.trunk, model.layout, np.asarray(model.Z)
    part = {name: x[:, where] for name, where in layout.inputs.items()}
    loads = [_loads(model, {name: value[i] for name, value in part.items()}) for i in range(len(x))]
    mesh = mesh_for(trunk, model.loads.contact_from, 4 * model.elements, 8, model.Z)
    activation, head = part["activation"], part["head"]
    shape = solve_statics(trunk, activation, head, loads, mesh)
    shape = solve_statics(trunk, activation, head, loads, near=shape)  # to round-off
    directors, moment = shape.directors(Z), shape.moment(Z)
    zeta, u = shape.strain(Z)
    flat = directors.reshape(*directors.shape[:2], 9)
    return np.concatenate([shape.position(Z), flat, zeta[..., None], u, moment], axis=-1)


def _loads(model: Model, part: dict[str, np.ndarray]) -> Loads:
    tip, contact = vector(part["tip_force"]), model.loads.contact_from
    gravity = float(part["gravity"][0])
    if contact is None:
        return Loads(gravity, tip)
    force, couple = vector(part["contact_force"]), vector(part["contact_couple"])
    return Loads(gravity, tip, contact, force, couple)

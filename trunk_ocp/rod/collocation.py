"""Direct collocation in Z: the mesh and the Gauss-Legendre element.

On an element [Z_k, Z_k + h] the state is a polynomial of degree d through its value at the
left edge and d values at the Gauss points, where it satisfies the differential equation.
This is the Gauss method of d stages (Hairer, Norsett & Wanner, Solving ODEs I, II.7): of order
2d at the element edges and d + 1 inside. It conserves quadratic invariants such as |q|.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np

from ..errors import InputError
from ..model.anatomy import Trunk
from ..model.loads import check_contact


@dataclass(frozen=True, eq=False)
class Gauss:
    """Matrices of one element of degree d on the unit interval.

    Attributes
    ----------
    nodes : (d,)
        Gauss points in (0, 1).
    derivative : (d, d + 1)
        Derivative at the Gauss points from the values at 0 and at the Gauss points.
    """

    degree: int
    nodes: np.ndarray
    derivative: np.ndarray

    @cached_property
    def end(self) -> np.ndarray:
        """Weights (d + 1,) that give the state at the right end, `value(1.0)`."""
        return self.value(1.0)

    @cached_property
    def quadrature(self) -> np.ndarray:
        """Weights (d,) of the quadrature over the element, `integral(1.0)`."""
        return self.integral(1.0)

    def value(self, tau: np.ndarray | float) -> np.ndarray:
        """Weights (..., d + 1) that give a state at tau from its values at 0 and the nodes."""
        return _lagrange(np.append(0.0, self.nodes), np.asarray(tau, dtype=float))

    def from_nodes(self, tau: np.ndarray | float) -> np.ndarray:
        """Weights (..., d) that give a rate at tau from its values at the nodes alone."""
        return _lagrange(self.nodes, np.asarray(tau, dtype=float))

    def integral(self, tau: np.ndarray | float) -> np.ndarray:
        """Weights (..., d) that give a quadrature over [0, tau] from rates at the nodes."""
        tau = np.asarray(tau, dtype=float)
        points, weights = _unit_rule(self.degree)  # exact for the Lagrange basis
        bases = _lagrange(self.nodes, tau[..., None] * points)
        return tau[..., None] * np.einsum("q,...qi->...i", weights, bases)


@cache
def gauss(degree: int) -> Gauss:
    """The element of a degree from 1 to 20.

    Raises
    ------
    InputError
        For any other degree.
    """
    if not 1 <= degree <= 20:
        raise InputError(f"degree = {degree}: expected a whole number from 1 to 20.")
    nodes, _ = _unit_rule(degree)
    points = np.append(0.0, nodes)
    gaps = points[:, None] - points + np.eye(degree + 1)
    barycentric = 1 / gaps.prod(axis=1)
    derivative = barycentric / barycentric[:, None] / gaps
    np.fill_diagonal(derivative, 0.0)
    np.fill_diagonal(derivative, -derivative.sum(axis=1))  # so that constants have none, exactly
    return Gauss(degree, nodes, derivative[1:])


@cache
def _unit_rule(degree: int) -> tuple[np.ndarray, np.ndarray]:
    """Gauss-Legendre points and weights on [0, 1]."""
    points, weights = np.polynomial.legendre.leggauss(degree)
    return (1 + points) / 2, weights / 2


def _lagrange(nodes: np.ndarray, tau: np.ndarray) -> np.ndarray:
    """Values (..., n) at tau (...) of the Lagrange basis on nodes (n,)."""
    same = np.eye(nodes.size, dtype=bool)
    factors = (tau[..., None, None] - nodes) / np.where(same, 1.0, nodes[:, None] - nodes)
    return np.where(same, 1.0, factors).prod(axis=-1)


@dataclass(frozen=True)
class Mesh:
    """Elements along the trunk: `edges` (elements + 1) in m from 0 to L, and their degree."""

    edges: tuple[float, ...]
    degree: int

    @property
    def elements(self) -> int:
        """Number of elements."""
        return len(self.edges) - 1

    @cached_property
    def widths(self) -> np.ndarray:
        """Element lengths (elements,) in m."""
        return np.diff(self.edges)

    @cached_property
    def points(self) -> np.ndarray:
        """Collocation points (elements, degree) in m."""
        return np.asarray(self.edges[:-1])[:, None] + np.outer(
            self.widths, gauss(self.degree).nodes
        )

    def locate(self, Z: np.ndarray | float) -> tuple[np.ndarray, np.ndarray]:
        """Element that contains Z and the position tau in [0, 1] in it.

        An edge belongs to the element that it ends.
        """
        Z = np.asarray(Z, dtype=float)
        element = np.searchsorted(np.asarray(self.edges[1:-1]), Z, side="left")
        return element, (Z - np.asarray(self.edges)[element]) / self.widths[element]


def mesh_for(
    trunk: Trunk,
    contact_from: float | None = None,
    elements: int = 6,
    degree: int = 6,
    at: Sequence[float] = (),
) -> Mesh:
    """Mesh with an edge on every jump, that is at segment ends and at the start of contact.

    Every stretch between two jumps gets one element; the rest of `elements` go where elements
    are longest, measured in local radii, the scale on which a tapered trunk bends.

    Parameters
    ----------
    contact_from : Z_w in m
    elements : their number; more if there are more jumps
    degree : of every element, from 1 to 20
    at : further points Z in m that get an edge

    Raises
    ------
    InputError
        If contact does not start on the trunk.
    """
    if contact_from is not None:
        check_contact(trunk, contact_from)
    jumps = sorted({*trunk.edges, *([] if contact_from is None else [contact_from]), *at})
    k = trunk.taper_rate

    def in_radii(Z: np.ndarray) -> np.ndarray:
        return -np.log1p(-k * Z) / k if k > 0 else Z

    scaled = in_radii(np.asarray(jumps))
    counts = np.ones(scaled.size - 1, dtype=int)
    while counts.sum() < elements:
        counts[np.argmax(np.diff(scaled) / counts)] += 1
    edges = [0.0]
    for start, end, jump, count in zip(scaled[:-1], scaled[1:], jumps[1:], counts, strict=True):
        inner = np.linspace(start, end, count + 1)[1:]
        edges += list(-np.expm1(-k * inner) / k if k > 0 else inner)
        edges[-1] = jump  # exactly, without the rounding of scaling to radii and back
    return Mesh(tuple(float(edge) for edge in edges), degree)

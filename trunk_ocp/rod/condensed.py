"""Linearized collocation equations: elements condensed onto their left edges, and chained.

Newton's method and the derivatives of statics solve the same linear equations for changes of the
states, with other right-hand sides. In each element the changes at its Gauss points follow from
the change at its left edge; the elements together leave the three components of m(0), which are
determined by m(L) = 0.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..model.activation import stiffness
from ..model.anatomy import Trunk
from .collocation import Mesh, gauss
from .equations import MOMENT, STATES
from .linear_bvp import solve_linear_bvp

MAX_GROWTH = 1e4  # of rounding errors on the march from base to tip; some 200 on the elephant's


@dataclass(frozen=True, eq=False)
class CondensedElements:
    """Changes of states in the elements of B rods, for c right-hand sides.

    Attributes
    ----------
    by_edge : (B, E, d, 7, 7)
        Changes at the Gauss points per change at the element's left edge.
    fixed : (B, E, d, 7, c)
        Changes at the Gauss points where that edge does not change.
    maps : (B, E, 7, 7)
        Changes at the right edge per change at the left edge.
    offsets : (B, E, 7, c)
        Changes at the right edge where the left edge does not change.
    """

    by_edge: np.ndarray
    fixed: np.ndarray
    maps: np.ndarray
    offsets: np.ndarray

    def at_points(self, edges: np.ndarray) -> np.ndarray:
        """Changes (B, E, d, 7, c) at the Gauss points from those (B, E, 7, c) at left edges."""
        return self.fixed + np.einsum("bkjxy,bkyc->bkjxc", self.by_edge, edges)

    def at_edges(self, trunk: Trunk, mesh: Mesh, gaps: np.ndarray) -> np.ndarray:
        """Changes (B, E + 1, 7, c) at the element edges, with no change of the pose at the base.

        gaps : (B, E, 7, c), added at each right edge: where the states do not join yet, and the
        moment that is left at the tip.
        """
        unit = edge_units(trunk, mesh)
        edges, growth = self._marched(gaps, unit)
        unsafe = np.flatnonzero(~(growth <= MAX_GROWTH))
        if unsafe.size:
            maps = self.maps[unsafe] * unit[:-1, None] / unit[1:, :, None]
            total = (self.offsets[unsafe] + gaps[unsafe]) / unit[1:, :, None]
            edges[unsafe] = solve_linear_bvp(maps, total) * unit[..., None]
        return edges

    def _marched(self, gaps: np.ndarray, unit: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Changes at the edges, marching from base to tip, and the growth of errors (B,).

        That is the largest derivative of a state by m(0), in `unit`: m(0) comes out of a solve
        with the tip's derivatives, and its rounding errors grow by as much on the way back.
        """
        B, E, _, c = gaps.shape
        # Change at each edge: three columns times the unknown change of m(0), and the rest.
        left = np.zeros((B, E + 1, STATES, 3 + c))
        left[:, 0, MOMENT, :3] = np.eye(3)
        for k in range(E):
            left[:, k + 1] = self.maps[:, k] @ left[:, k]
            left[:, k + 1, :, 3:] += self.offsets[:, k]
            left[:, k + 1, :, 3:] += gaps[:, k]
        base = solve_each(left[:, -1, MOMENT, :3], -left[:, -1, MOMENT, 3:])
        edges = left[..., 3:] + left[..., :3] @ base[:, None]
        growth = np.abs(left[..., :3] * (unit[0, MOMENT] / unit[:, :, None])).max(axis=(1, 2, 3))
        return edges, growth


def condense(mesh: Mesh, slopes: np.ndarray, forcing: np.ndarray) -> CondensedElements:
    """Elements of the linear equations D x - h slope x = forcing for changes x of the states.

    Parameters
    ----------
    slopes : (B, E, d, 7, 7)
        Jacobians of (q', m') by the state at the Gauss points, per m.
    forcing : (B, E, d, 7, c)
    """
    (B, E, d), element, n = forcing.shape[:3], gauss(mesh.degree), mesh.degree * STATES
    # Element matrix, (B, E, d, 7, d, 7): D acts on Gauss points, the slope within each of them.
    matrix = np.zeros((B, E, d, STATES, d, STATES))
    same = np.arange(STATES)
    matrix[:, :, :, same, :, same] = element.derivative[:, 1:]
    for j in range(d):
        matrix[:, :, j, :, j, :] -= mesh.widths[:, None, None] * slopes[:, :, j]
    right = np.zeros((B, E, d, STATES, STATES + forcing.shape[-1]))
    right[..., same, same] = -element.derivative[:, 0][:, None]
    right[..., STATES:] = forcing
    inner = solve_each(matrix.reshape(B, E, n, n), right.reshape(B, E, n, -1))
    inner = inner.reshape(right.shape)
    start, *weights = element.value(1.0)
    ends = np.einsum("j,bkjxc->bkxc", np.array(weights), inner)
    maps, offsets = ends[..., :STATES] + start * np.eye(STATES), ends[..., STATES:]
    return CondensedElements(inner[..., :STATES], inner[..., STATES:], maps, offsets)


def edge_units(trunk: Trunk, mesh: Mesh) -> np.ndarray:
    """Units (elements + 1, 7) of states at the edges, in which they compare: 1 and E I(Z) / L."""
    unit = np.ones((mesh.elements + 1, STATES))
    unit[:, MOMENT] = stiffness(trunk, np.asarray(mesh.edges))[:, 1:2] / trunk.length
    return unit


def solve_each(matrices: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solve the systems of every rod (axis 0); NaN for the rods where one is singular."""
    try:
        return np.linalg.solve(matrices, right)
    except np.linalg.LinAlgError:
        if len(matrices) == 1:
            return np.full_like(right, np.nan)
        return np.concatenate(
            [solve_each(matrices[i : i + 1], right[i : i + 1]) for i in range(len(right))]
        )

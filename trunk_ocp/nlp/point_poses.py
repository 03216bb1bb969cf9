"""Poses at points of a window's rods that targets or held directions ask for."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from ..rod.collocation import Mesh, gauss
from ..rod.equations import STATES
from .condensed_rods import CondensedRods
from .window import Window


class PointPoses:
    """How poses at P points follow from states and rates at Gauss points, all of them linearly.

    Attributes
    ----------
    step, element, edge : (P,) int
        Time step and element of each point, and the edge whose state counts beside those inside.
    q, r : (P, 4), (P, 3) int
        Indices of orientation and position (in L) in the decision vector.
    """

    def __init__(self, window: Window) -> None:
        rows = []
        for t, u in enumerate(window.unknowns):
            for Z, (q, r) in u.points.items():
                k, edge, of_states, of_rates = _weights(window.mesh, window.length, Z)
                states = np.vstack([u.edges[edge, :4], u.inner[k, :, :4]])
                rows.append((t, k, edge, q, r, u.line[0], states, of_states, of_rates))
        E, d, P = window.mesh.elements, window.mesh.degree, len(rows)
        columns: list[Any] = list(zip(*rows, strict=True)) if P else [()] * 9
        self.step, self.element, self.edge = (np.array(column, int) for column in columns[:3])
        self.q, self.r, self._origin, self._states = (
            np.array(column, int).reshape(P, *shape)
            for column, shape in zip(columns[3:7], ((4,), (3,), (3,), (d + 1, 4)), strict=True)
        )
        self._of_states = np.array(columns[7]).reshape(P, d + 1)
        self._of_rates = np.array(columns[8]).reshape(P, E, d)

    def set(self, full: np.ndarray, slopes: np.ndarray) -> None:
        """Set the poses in a decision vector from its states, and r' (H, E, d, 3) per L."""
        full[self.q] = (self._of_states[:, None] @ full[self._states])[:, 0]
        P, E, d = self._of_rates.shape
        along = slopes[self.step].reshape(P, E * d, 3)
        full[self.r] = full[self._origin] + (self._of_rates.reshape(P, 1, E * d) @ along)[:, 0]

    def set_changes(self, changes: np.ndarray, rods: CondensedRods, origins: np.ndarray) -> None:
        """Set changes (variables, C + 1) of the poses from those of the rods and their origins."""
        t, k = self.step, self.element
        P, E, d = self._of_rates.shape
        inputs = rods.inputs[t]  # (P, E, 16, C + 1)
        inside = self._of_states[:, None, 1:] @ rods.states[t, k, :, :4].reshape(P, d, -1)
        q = inside.reshape(P, 4, -1) @ inputs[np.arange(P), k]
        changes[self.q] = q + self._of_states[:, :1, None] * rods.edges[t, self.edge, :4]
        along = self._of_rates[:, :, None] @ rods.centerline[t].reshape(P, E, d, -1)
        r = (along.reshape(P, E, 3, -1) @ inputs).sum(axis=1)
        r[:, :, :-1] += origins[t]
        changes[self.r] = r

    def forces_on(
        self, rods: CondensedRods, forces: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """What forces (variables,) on the poses do to the rods.

        Derivatives by the states at edges (H, E + 1, 7) and Gauss points (H, E, d, 7), by r' there
        (H, E, d, 3), and by the origins (H, 3).
        """
        H, E, d = rods.rates.shape[:3]
        t, by_q, by_r = self.step, forces[self.q], forces[self.r]
        by_edges, by_states = np.zeros((H, E + 1, STATES)), np.zeros((H, E, d, STATES))
        np.add.at(by_edges[..., :4], (t, self.edge), self._of_states[:, :1] * by_q)
        inside = self._of_states[:, 1:, None] * by_q[:, None]
        np.add.at(by_states[..., :4], (t, self.element), inside)
        by_line = sums_by_step(H, t, self._of_rates[..., None] * by_r[:, None, None])
        return by_edges, by_states, by_line, sums_by_step(H, t, by_r)


def sums_by_step(count: int, steps: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Sums (count, ...) of values (N, ...) by their time steps (N,)."""
    chosen = (steps == np.arange(count)[:, None]).astype(float)
    sums = chosen @ values.reshape(len(values), -1)  # np.add.at takes ten times as long
    return np.asarray(sums.reshape(count, *values.shape[1:]))


@lru_cache(maxsize=1024)
def _weights(mesh: Mesh, length: float, Z: float) -> tuple[int, int, np.ndarray, np.ndarray]:
    """How the pose at Z in m follows: its element, an edge, and weights of states and rates.

    The orientation is weights (d + 1) of the states at that edge and the element's Gauss points;
    the position is r(0) and weights (E, d) of the rates r'.
    """
    element, h = gauss(mesh.degree), mesh.widths / length
    k, tau = (value.item() for value in mesh.locate(Z))
    before = np.arange(mesh.elements)[:, None] < k
    of_rates = np.where(before, h[:, None] * element.quadrature, 0.0)
    of_rates[k] = h[k] * element.integral(tau)
    if tau in (0.0, 1.0):
        return k, k + int(tau), np.eye(mesh.degree + 1)[0], of_rates
    return k, k, element.value(tau), of_rates

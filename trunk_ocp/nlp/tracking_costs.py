"""Costs of a condensed window's targets, to second order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from .point_poses import sums_by_step
from .term_derivatives import first_derivatives, second_derivatives, values
from .window import Window


@dataclass(frozen=True, eq=False)
class TrackingAt:
    """Costs at a decision vector, by changes in C local variables of each time step.

    Attributes
    ----------
    value : float
    gradient : (H, C)
    blocks : (H, C + 1, C + 1)
        Hessians, in the Newton step as well.
    forces : (variables,)
        Derivatives by the variables.
    parts : sequence of (variables, steps, slopes, bent)
        For each function the indices of its variables (N, n), time steps (N,), derivatives (N, n),
        and their changes (N, n, C + 1).
    """

    value: float
    gradient: np.ndarray
    blocks: np.ndarray
    forces: np.ndarray
    parts: Sequence[tuple[np.ndarray, ...]]

    def forces_after(self, local: np.ndarray) -> np.ndarray:
        """Forces after changes (H, C + 1) of the local variables, to first order."""
        forces = np.zeros_like(self.forces)
        for variables, steps, slopes, bent in self.parts:
            np.add.at(forces, variables, slopes + (bent @ local[steps, :, None])[..., 0])
        return forces


class TrackingCosts:
    """Sum of small functions, each at the points of many time steps: `Window.tracking`."""

    def __init__(self, window: Window) -> None:
        self._count = len(window.steps)
        step_of = np.zeros(window.bounds["lbx"].size, dtype=int)
        for t, u in enumerate(window.unknowns):
            for index in (u.x, *(part for pose in u.points.values() for part in pose)):
                step_of[index] = t
        self._step_of = step_of
        self.renumber(window)

    def renumber(self, window: Window) -> None:
        """Take the targets of a window that differs in numbers only."""
        self._terms: list[tuple[ca.Function, np.ndarray, np.ndarray, np.ndarray]] = [
            (function, variables.T, parameters.T, self._step_of[variables].max(axis=0))
            for function, variables, parameters in window.tracking()
        ]

    def value(self, full: np.ndarray) -> float:
        """Value at a decision vector."""
        return sum(float(values(f, full[v], p).sum()) for f, v, p, _ in self._terms)

    def at(self, full: np.ndarray, changes: np.ndarray) -> TrackingAt:
        """To second order, with changes (variables, C + 1) by local variables and Newton step."""
        H, C = self._count, changes.shape[1] - 1
        value, gradient, forces = 0.0, np.zeros((H, C)), np.zeros(full.size)
        blocks, parts = np.zeros((H, C + 1, C + 1)), []
        for function, variables, parameters, steps in self._terms:
            w = full[variables]
            error, slope = first_derivatives(function, w, parameters)
            second = second_derivatives(function, w, parameters, np.ones((len(w), 1)))
            change = changes[variables]  # (N, n, C + 1)
            bent = second @ change
            value += float(error.sum())
            np.add.at(forces, variables, slope[:, 0])
            gradient += sums_by_step(H, steps, (slope @ change)[:, 0, :-1])
            blocks += sums_by_step(H, steps, change.swapaxes(-1, -2) @ bent)
            parts.append((variables, steps, slope[:, 0], bent))
        return TrackingAt(value, gradient, blocks, forces, parts)

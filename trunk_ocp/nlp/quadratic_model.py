"""A quadratic model of a condensed window: what a step of sequential quadratic programming sees."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .condensed_rods import CondensedRods
from .tracking_costs import TrackingAt


@dataclass(frozen=True, eq=False)
class QuadraticModel:
    """Objective and Lagrangian to second order in z at a decision vector.

    Attributes
    ----------
    full : (variables,)
        The decision vector.
    objective : float
    gradient : (n,)
    blocks : (H, C, C)
        Hessian by the local variables of each step, but for the costs of controls.
    to_local : (C, controls + 3 D)
        Derivatives of the local variables by a step's controls and the held directions.
    diagonal, links : (H, controls)
        Hessian of the costs of controls: by each control twice, and by each and the same one of the
        step before, or the start's.
    held_rows, held_rest : (3 D, n), (3 D,)
        Equations of the held directions, held_rows dz = held_rest.
    rods : CondensedRods
    tracking : TrackingAt
    changes : (variables, C + 1)
        Changes of head angles, held directions and poses of targets by the local variables, and by
        the Newton step that removes residuals.
    newton : float
        Share of that Newton step that a step takes: 1, or 0 where there are no residuals.
    """

    full: np.ndarray
    objective: float
    gradient: np.ndarray
    blocks: np.ndarray
    to_local: np.ndarray
    diagonal: np.ndarray
    links: np.ndarray
    held_rows: np.ndarray
    held_rest: np.ndarray
    rods: CondensedRods
    tracking: TrackingAt
    changes: np.ndarray
    newton: float = 1.0

    def by_step(self, step: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """A step in z by its controls (H, controls), and held directions (3 D,)."""
        return step[: self.links.size].reshape(self.links.shape), step[self.links.size :]

    def local(self, step: np.ndarray) -> np.ndarray:
        """A step in z by local variables of each time step, (H, C)."""
        own, held = self.by_step(step)
        beside = np.broadcast_to(held, (len(own), held.size))
        return np.asarray(np.concatenate([own, beside], axis=1) @ self.to_local.T)

    def change(self, step: np.ndarray) -> float:
        """Change of the objective by a step in z."""
        local, (own, _) = self.local(step), self.by_step(step)
        bent = np.sum((self.blocks @ local[..., None])[..., 0] * local)
        bent += np.sum(self.diagonal * own**2)
        return float(self.gradient @ step + bent / 2 + np.sum(self.links[1:] * own[1:] * own[:-1]))

"""A quadratic model of a condensed window: what a step of sequential quadratic programming sees."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .condensed_rods import CondensedRods


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
        Hessian by the local controls of each step: its own, and all held directions.
    links : (H, controls)
        Hessian by each control and the same one of the step before, or the start's.
    held_rows : (3 D, n), held_rest : (3 D,)
        Equations of the held directions, held_rows dz = held_rest.
    rods : CondensedRods
    targets : sequence of (variables, steps, gradients, changes of gradients)
        Parts of the tracking cost, for `CondensedWindow.expected_forces`.
    changes : (variables, C + 1)
        Changes of controls, held directions and poses of targets by the local controls, and by the
        Newton step that removes residuals.
    newton : float
        Share of that Newton step that a step takes: 1, or 0 where there are no residuals.
    """

    full: np.ndarray
    objective: float
    gradient: np.ndarray
    blocks: np.ndarray
    links: np.ndarray
    held_rows: np.ndarray
    held_rest: np.ndarray
    rods: CondensedRods
    targets: Sequence[tuple[np.ndarray, ...]]
    changes: np.ndarray
    newton: float = 1.0

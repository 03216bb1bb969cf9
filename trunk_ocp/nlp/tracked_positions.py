"""Distances of a window's steps from their target positions, and how the unknowns change them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Self

import numpy as np
import scipy.sparse as sp

from ..model.anatomy import Trunk
from ..model.solids import from_head_frame, pivot
from ..problem.targets import Target


@dataclass(frozen=True, eq=False)
class TrackedPositions:
    """The n positions of a window that have a target.

    Attributes
    ----------
    positions, heads : (n, 3), (n, 2) int
        Indices in the decision vector of the positions, in units of L, and of the head angles.
    targets : (n, 3)
        In m, at head angles 0 where they turn with the head.
    turns : (n,) bool
        Whether they do.
    """

    trunk: Trunk
    positions: np.ndarray
    heads: np.ndarray
    targets: np.ndarray
    turns: np.ndarray

    @classmethod
    def of(cls, trunk: Trunk, tracked: Iterable[tuple[Target, np.ndarray, np.ndarray]]) -> Self:
        """From each target, with indices of its position and of the head angles of its step."""
        table = [
            (r, head, target.position, target.frame == "head")
            for target, r, head in tracked
            if target.position is not None and target.position_weight > 0
        ]
        positions, heads, targets, turns = zip(*table, strict=True) if table else 4 * ((),)
        return cls(
            trunk,
            np.array(positions, dtype=int).reshape(-1, 3),
            np.array(heads, dtype=int).reshape(-1, 2),
            np.array(targets, dtype=float).reshape(-1, 3),
            np.array(turns, dtype=bool),
        )

    def errors(self, full: np.ndarray) -> np.ndarray:
        """Distances (n,) in m from the targets."""
        return np.linalg.norm(self._offsets(full)[0], axis=1)

    def errors_and_slopes(self, full: np.ndarray) -> tuple[np.ndarray, sp.csr_matrix]:
        """Distances (n,) in m from the targets, and their Jacobian (n, variables)."""
        offset, places = self._offsets(full)
        errors = np.linalg.norm(offset, axis=1)
        unit = offset / np.maximum(errors, np.finfo(float).tiny)[:, None]
        # The head turns about e_Z and about e_Y, which the turn about e_Z takes along.
        psi, axes = full[self.heads[:, 0]], np.zeros((len(errors), 2, 3))
        axes[:, 0, 2], axes[:, 1, 0], axes[:, 1, 1] = 1.0, -np.sin(psi), np.cos(psi)
        moves = np.cross(axes, (places - pivot(self.trunk))[:, None]) * self.turns[:, None, None]
        by_head = -np.einsum("nai,ni->na", moves, unit)
        slopes = np.hstack([self.trunk.length * unit, by_head]).ravel()
        columns = np.hstack([self.positions, self.heads]).ravel()
        rows = np.repeat(np.arange(len(errors)), 5)
        shape = (len(errors), full.size)
        return errors, sp.csr_matrix((slopes, (rows, columns)), shape=shape)

    def _offsets(self, full: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Offsets (n, 3) in m of the positions from the targets, and the targets in space."""
        places = self.targets
        if self.turns.any():
            turned = from_head_frame(self.trunk, places[:, None], full[self.heads])[:, 0]
            places = np.where(self.turns[:, None], turned, places)
        return full[self.positions] * self.trunk.length - places, places

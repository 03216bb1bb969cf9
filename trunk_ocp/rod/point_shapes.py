"""Shapes at a few points of the trunk, as `ShapeMap` returns them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..model.quaternions import director_rows
from .equations import MOMENT, ORIENTATION, POSITION


@dataclass(frozen=True, repr=False, eq=False)
class PointShapes:
    """Shapes at a few points, with any leading batch axes (...).

    Attributes
    ----------
    Z : (n,)
        Points in m; the last is the tip.
    path : (..., n, 10)
        At each point q (4), m (3) in N m, r (3) in m.
    """

    Z: np.ndarray
    path: np.ndarray

    def __repr__(self) -> str:
        return f"<PointShapes: batch {self.path.shape[:-2]}, {self.Z.size} points>"

    def __getitem__(self, index: Any) -> PointShapes:
        """Some shapes of the batch, indexed by its axes."""
        batch = self.path.shape[:-2]
        chosen = np.arange(math.prod(batch)).reshape(batch)[index]
        return PointShapes(self.Z, self.path.reshape(-1, *self.path.shape[-2:])[chosen])

    @property
    def found(self) -> np.ndarray:
        """Whether an equilibrium was found, (...,); see `ShapeMap`'s `strict`."""
        return np.isfinite(self.path).all(axis=(-1, -2))

    @property
    def position(self) -> np.ndarray:
        """Centerline (..., n, 3) in m."""
        return self.path[..., POSITION]

    @property
    def orientation(self) -> np.ndarray:
        """Quaternions (..., n, 4) of the director frame, scalar first."""
        return self.path[..., ORIENTATION]

    @property
    def moment(self) -> np.ndarray:
        """Internal moment (..., n, 3) N m, in the directors."""
        return self.path[..., MOMENT]

    @property
    def directors(self) -> np.ndarray:
        """Directors (..., n, 3, 3): row i is d_i in space axes."""
        return director_rows(self.orientation)

    @property
    def defect(self) -> np.ndarray:
        """Largest | |q|^2 - 1 | at the points, (...,): how well the steps resolve the shape.

        The exact rod keeps |q| = 1, so this estimates the error at no cost: positions are off
        by 0.2 to 20 times as much, in units of L, on 98 of 100 random shapes and loads; rarely,
        where |q| happens to be kept, by hundreds of times.
        """
        return np.asarray(np.abs(np.sum(self.orientation**2, axis=-1) - 1).max(axis=-1))

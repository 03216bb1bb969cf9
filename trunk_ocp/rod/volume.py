"""Radii of the loaded trunk: all sections scale by one factor, which keeps the trunk's volume."""

from __future__ import annotations

import numpy as np

from ..model.anatomy import Trunk
from .collocation import Mesh, gauss
from .shape import Shape


def volume_weights(trunk: Trunk, mesh: Mesh) -> np.ndarray:
    """Weights (elements, degree), of sum 1, of |dr/dZ| at the Gauss points in the volume ratio.

    The ratio is the volume of the deformed trunk with its initial radii over its initial volume.
    """
    weights = mesh.widths[:, None] * gauss(mesh.degree).integral(1.0)
    volume = weights * np.asarray(trunk.taper(mesh.points)) ** 2
    return np.asarray(volume / volume.sum())


def section_scale(trunk: Trunk, shape: Shape) -> np.ndarray:
    """Factor (...,) on all radii that keeps the volume of each shape."""
    stretch = np.linalg.norm(shape.slopes, axis=-1)  # |dr/dZ| (..., elements, degree)
    ratio = np.sum(volume_weights(trunk, shape.mesh) * stretch, axis=(-2, -1))
    return np.asarray(1 / np.sqrt(ratio))

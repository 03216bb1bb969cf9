"""Trunks seen from their right side, as a small SVG picture for a notebook's cell.

A few polygons in meters instead of a figure: they take about a millisecond, and no matplotlib.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..rod.shape import Shape
from ..scene.body import frames

SIZE = 220.0  # pixels, of the longer side
MARGIN = 0.04  # of the longer side
MIN_SIDE = 0.35  # of the longer side, so that a straight trunk has room beside it
FEW = 8  # targets, which get larger dots
POINTS = 41  # along a trunk
LIGHT, DARK = np.array([214, 218, 223]), np.array([84, 96, 107])  # from early to late
TARGET, LOG = "#CC0055", "#B08D57"
CONSTANT = 'vector-effect="non-scaling-stroke"'  # widths of lines are in pixels
FROM_THE_SIDE = [0, 2]  # X to the right, Z down, as in a picture


def side_view(
    shapes: Shape,
    targets: Sequence[np.ndarray] = (),
    logs: Sequence[tuple[np.ndarray, float]] = (),
) -> str:
    """SVG of shapes (H,), from light to dark.

    Parameters
    ----------
    targets : points (3,) in m
    logs : centers (3,) and radii in m
        Of cylinders along e_Y.
    """
    outlines = silhouettes(shapes)
    discs = [(center[FROM_THE_SIDE], radius) for center, radius in logs]
    places = [target[FROM_THE_SIDE] for target in targets]
    corners = [center + s * radius for center, radius in discs for s in (-1.0, 1.0)]
    low, side = _box(np.concatenate([*outlines, np.reshape(corners + places, (-1, 2))]))
    parts = [_circle(center, radius, f'fill="{LOG}"') for center, radius in discs]
    parts += [_polygon(line, _shade(i, len(outlines))) for i, line in enumerate(outlines)]
    size = side.max() * (0.02 if len(places) <= FEW else 0.007)
    parts += [_circle(place, size, f'fill="{TARGET}"') for place in places]
    width, height = SIZE * side / side.max()
    return (
        f'<svg width="{width:.0f}" height="{height:.0f}" viewBox="{_numbers([*low, *side])}" '
        f'role="img" aria-label="seen from the right side">{"".join(parts)}</svg>'
    )


def silhouettes(shapes: Shape) -> np.ndarray:
    """Outlines (H, 2 n, 2) in m of shapes (H,): X and Z, down one side and back the other.

    A section's half-width is across the tangent as it appears, as for a straight cone.
    """
    at = frames(shapes.trunk, shapes, np.linspace(0.0, shapes.trunk.length, POINTS))
    center = at.position[..., FROM_THE_SIDE]
    along = at.directors[..., 2, FROM_THE_SIDE]
    length = np.linalg.norm(along, axis=-1, keepdims=True)
    across = np.stack([-along[..., 1], along[..., 0]], -1) / np.maximum(length, 1e-9)
    reach = (shapes.trunk.base_radius * at.scale)[..., None] * across
    return np.concatenate([center + reach, (center - reach)[:, ::-1]], axis=1)


def _box(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Corner and sides (2,) in m of a box around points (n, 2), with a margin."""
    low, high = points.min(axis=0), points.max(axis=0)
    size = max(float((high - low).max()), 1e-9)
    side = np.maximum(high - low, MIN_SIDE * size) + 2 * MARGIN * size
    return (low + high - side) / 2, side


def _shade(number: int, count: int) -> str:
    share = (number + 1) / count
    red, green, blue = np.round((1 - share) * LIGHT + share * DARK).astype(int).tolist()
    return f"#{red:02X}{green:02X}{blue:02X}"


def _polygon(points: np.ndarray, color: str) -> str:
    look = f'fill="{color}" stroke="#FFFFFF" stroke-width="1.5" paint-order="stroke" {CONSTANT}'
    return f'<polygon points="{_numbers(points.ravel())}" {look}/>'


def _circle(center: np.ndarray, radius: float, look: str) -> str:
    x, y, r = (f"{value:.5g}" for value in (*center, radius))
    return f'<circle cx="{x}" cy="{y}" r="{r}" {look}/>'


def _numbers(values: Sequence[float] | np.ndarray) -> str:
    return " ".join(f"{value:.4g}" for value in values)

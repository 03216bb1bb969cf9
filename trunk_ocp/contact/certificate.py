"""Lower bounds of gaps between sample points along the trunk, and between instants.

The surface point of the disc at (Z, t) in some direction, x(Z, t), differs on a cell of a grid in
Z and t from its bilinear interpolant by at most

    e = sup |x_ZZ| h^2 / 8 + sup |x_tt| k^2 / 8.

By (*) of `model.solids`, the distance from a convex solid is at least a linear function l(x), whose
minimum over a bilinear patch is at a corner. So a cell is at least (least of l over the discs at
its corners) - e away. For two parts of the trunk, l is the difference along the line between them.
The bounds need no bound on the curvature of solids; sup is taken over the second differences at
the corners, times `SAFETY`, because the grid only samples them.
"""

from __future__ import annotations

import numpy as np

from ..model.solids import Solid, signed_distance
from .tube import Tube, dot

SAFETY = 2.0
"""On second differences of motions and shapes, which are smooth at the scale of a cell."""


def bounds_along(discs: Tube, solid: Solid) -> np.ndarray:
    """Lower bounds (H, n - 1) of the gap from a solid between neighboring discs of each shape."""
    center = discs.center
    distance, normal = signed_distance(solid, (center[:, :-1] + center[:, 1:]) / 2)
    middle = (center[:, :-1] + center[:, 1:]) / 2
    corners = [_corner(discs, distance, normal, middle, slice(None), part) for part in _ENDS]
    return np.asarray(np.minimum(*corners) - error_along(discs))


def bounds_between(discs: Tube, times: np.ndarray, solid: Solid) -> np.ndarray:
    """Lower bounds (H - 1, n - 1) of the gap from a solid in cells between discs and instants.

    times : (H,) in s, at least 3 of a smooth motion.
    """
    center = discs.center
    middle = (center[:-1, :-1] + center[:-1, 1:] + center[1:, :-1] + center[1:, 1:]) / 4
    distance, normal = signed_distance(solid, middle)
    corners = [
        _corner(discs, distance, normal, middle, instant, part)
        for instant in _ENDS
        for part in _ENDS
    ]
    return np.asarray(np.min(corners, axis=0) - cell_errors(discs, times))


def pair_bounds(discs: Tube, pairs: np.ndarray, times: np.ndarray | None = None) -> np.ndarray:
    """Lower bounds (H, P) of the gap between pairs of pieces of the trunk.

    pairs : (P, 2), pieces by their first disc.
    times : (H,) in s; if given, the bounds (H - 1, P) hold between instants.
    """
    instants = (slice(None),) if times is None else _ENDS
    error = error_along(discs) if times is None else cell_errors(discs, times)
    corners = [(instant, end) for instant in instants for end in (0, 1)]
    pieces = [
        [(discs[instant], pairs[:, side] + end) for instant, end in corners] for side in (0, 1)
    ]
    middles = [sum(part.center[:, index] for part, index in ends) / len(ends) for ends in pieces]
    between = middles[0] - middles[1]
    distance = np.sqrt(dot(between, between))[..., None]
    normal = between / np.where(distance > 0, distance, 1.0)
    low = np.min([_extent(part, index, normal, -1) for part, index in pieces[0]], axis=0)
    high = np.max([_extent(part, index, normal, 1) for part, index in pieces[1]], axis=0)
    return np.asarray(low - high - error[:, pairs[:, 0]] - error[:, pairs[:, 1]])


def _extent(discs: Tube, index: np.ndarray, normal: np.ndarray, side: int) -> np.ndarray:
    """Largest (side 1) or least (-1) coordinate of discs (H, P) along unit vectors."""
    along = dot(normal, discs.tangent[:, index])
    reach = discs.radius[:, index] * np.sqrt(np.maximum(1 - along**2, 0.0))
    return np.asarray(dot(normal, discs.center[:, index]) + side * reach)


_ENDS = (slice(None, -1), slice(1, None))


def _corner(
    discs: Tube,
    distance: np.ndarray,
    normal: np.ndarray,
    middle: np.ndarray,
    instant: slice,
    part: slice,
) -> np.ndarray:
    """Least value on one corner's discs of the linear function that bounds the distance."""
    center, tangent = discs.center[instant, part], discs.tangent[instant, part]
    along = dot(normal, tangent)
    reach = discs.radius[instant, part] * np.sqrt(np.maximum(1 - along**2, 0.0))
    return np.asarray(distance + dot(normal, (center - middle)) - reach)


def error_along(discs: Tube) -> np.ndarray:
    """How far surface points between two discs are from the chords of their ends, (H, n - 1)."""
    first = [np.diff(values, axis=1) for values in (discs.center, discs.tangent)]
    growth = np.abs(np.diff(discs.radius, axis=1))
    turned = _norm(first[1])
    second = [_norm(np.diff(values, axis=1)) for values in first]
    inner = _middle_max(turned) ** 2 + second[1]
    bend = second[0] + discs.radius[:, 1:-1] * inner + 2 * _middle_max(growth * turned)
    padded = np.pad(bend, ((0, 0), (1, 1)), mode="edge")
    return np.asarray(SAFETY / 8 * np.maximum(padded[:, :-1], padded[:, 1:]))


def cell_errors(discs: Tube, times: np.ndarray) -> np.ndarray:
    """The error e of cells, (H - 1, n - 1)."""
    along = error_along(discs)
    step = np.diff(times)
    accelerations = _accelerations(discs, times)  # (H, n)
    largest = np.maximum(accelerations[:-1], accelerations[1:])
    in_time = SAFETY / 8 * step[:, None] ** 2 * np.maximum(largest[:, :-1], largest[:, 1:])
    return np.asarray(np.maximum(along[:-1], along[1:]) + in_time)


def _accelerations(discs: Tube, times: np.ndarray) -> np.ndarray:
    """Bounds (H, n) on the accelerations of surface points, in m/s^2, by second differences."""
    step = np.diff(times)[:, None]
    velocity = [
        np.diff(values, axis=0) / step[..., None] for values in (discs.center, discs.tangent)
    ]
    growth = np.diff(discs.radius, axis=0) / step
    spacing = (step[1:] + step[:-1]) / 2
    center, turn = (_norm(np.diff(v, axis=0)) / spacing for v in velocity)
    spin = _neighbors_max(_norm(velocity[1]))
    swelling = np.abs(np.diff(growth, axis=0)) / spacing
    radius = discs.radius[1:-1]
    both = 2 * _neighbors_max(np.abs(growth)) * spin
    inner = center + radius * (turn + spin**2) + swelling + both
    return np.pad(inner, ((1, 1), (0, 0)), mode="edge")


def _norm(vectors: np.ndarray) -> np.ndarray:
    return np.asarray(np.sqrt(dot(vectors, vectors)))


def _middle_max(values: np.ndarray) -> np.ndarray:
    """Larger of neighbors along the second axis."""
    return np.asarray(np.maximum(values[:, 1:], values[:, :-1]))


def _neighbors_max(values: np.ndarray) -> np.ndarray:
    """Larger of neighbors along the first axis."""
    return np.asarray(np.maximum(values[1:], values[:-1]))

"""Lower bounds of gaps between sample points along the trunk, and between instants.

The surface point of the disc at (Z, t) in some direction, x(Z, t), differs on a cell of a grid in
Z and t from its bilinear interpolant by at most

    e = sup |x_ZZ| h^2 / 8 + sup |x_tt| k^2 / 8.

By (*) of `model.solids`, the distance from a convex solid is at least a linear function l(x), whose
minimum over a bilinear patch is at a corner. So a cell is at least (least of l over the discs at
its corners) - e away. For two parts of the trunk, l is the difference along the line between them.
The bounds need no bound on the curvature of solids; sup is taken over second differences at and
beside the corners, times `SAFETY`, because the grid only samples them. If the body moves, x is seen
from it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..model.solids import Solid, signed_distance
from .tube import Tube, dot

SAFETY = 2.0
"""On second differences of motions and shapes, which are smooth at the scale of a cell."""


def solid_bounds(
    instants: Sequence[Tube], error: np.ndarray, pieces: np.ndarray, solid: Solid
) -> np.ndarray:
    """Lower bounds (C, P) of the gap between pieces of the trunk and a solid.

    instants : the C shapes, or those at the start and the end of each cell.
    error : (C, n - 1), e on each piece.
    pieces : (P,), by their first disc.
    """
    corners = [(discs, pieces + end) for discs in instants for end in (0, 1)]
    middle = np.mean([discs.center[:, index] for discs, index in corners], axis=0)
    distance, normal = signed_distance(solid, middle)
    least = np.min([_extent(discs, index, normal, -1) for discs, index in corners], axis=0)
    return np.asarray(distance - dot(normal, middle) + least - error[:, pieces])


def pair_bounds(instants: Sequence[Tube], error: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """Lower bounds (C, P) of the gap between pairs of pieces of the trunk.

    instants : the C shapes, or those at the start and the end of each cell.
    error : (C, n - 1), e on each piece.
    pairs : (P, 2), pieces by their first disc.
    """
    pieces = [
        [(discs, pairs[:, side] + end) for discs in instants for end in (0, 1)] for side in (0, 1)
    ]
    middles = [np.mean([discs.center[:, i] for discs, i in ends], axis=0) for ends in pieces]
    between = middles[0] - middles[1]
    normal = between / _positive(np.sqrt(dot(between, between)))[..., None]
    low = np.min([_extent(discs, i, normal, -1) for discs, i in pieces[0]], axis=0)
    high = np.max([_extent(discs, i, normal, 1) for discs, i in pieces[1]], axis=0)
    return np.asarray(low - high - error[:, pairs[:, 0]] - error[:, pairs[:, 1]])


def error_along(discs: Tube) -> np.ndarray:
    """How far surface points between two discs are from the chords of their ends, (H, n - 1).

    Second differences do not reach across breaks. A piece between two breaks, or one that is all
    of the tube, has none: its error is infinite.
    """
    center, tangent = (np.diff(values, axis=1) for values in (discs.center, discs.tangent))
    growth, turned = np.abs(np.diff(discs.radius, axis=1)), _norm(tangent)
    spin = np.maximum(turned[:, 1:], turned[:, :-1])
    bend = (
        _norm(np.diff(center, axis=1))
        + discs.radius[:, 1:-1] * (_norm(np.diff(tangent, axis=1)) + spin**2)
        + 2 * np.maximum(growth[:, 1:], growth[:, :-1]) * spin
    )
    bend = np.pad(
        np.where(discs.breaks[1:-1], np.nan, bend), ((0, 0), (1, 1)), constant_values=np.nan
    )
    largest = np.fmax(bend[:, :-1], bend[:, 1:])
    return np.asarray(SAFETY / 8 * np.where(np.isnan(largest), np.inf, largest))


def error_in_time(instants: Sequence[Tube]) -> np.ndarray:
    """The part of e that is due to time, (C, n - 1), on the quarters of C cells.

    instants : the shapes (C,) at 0, 1/4, 1/2, 3/4 and 1 of the time of each cell, as seen from the
        body. With five, a second difference that vanishes in the middle is noticed beside it.
    """
    centers, tangents, radii = (
        np.array([getattr(discs, name) for discs in instants])
        for name in ("center", "tangent", "radius")
    )
    spin = _norm(np.diff(tangents, axis=0)).max(axis=0)
    growth = np.abs(np.diff(radii, axis=0)).max(axis=0)
    bend = (
        _norm(np.diff(centers, 2, axis=0)).max(axis=0)
        + radii.max(axis=0) * (_norm(np.diff(tangents, 2, axis=0)).max(axis=0) + spin**2)
        + np.abs(np.diff(radii, 2, axis=0)).max(axis=0)
        + 2 * growth * spin
    )
    return np.asarray(SAFETY / 8 * np.maximum(bend[:, :-1], bend[:, 1:]))


def _extent(discs: Tube, index: np.ndarray, normal: np.ndarray, side: int) -> np.ndarray:
    """Largest (side 1) or least (-1) coordinate of some discs along unit vectors."""
    along = dot(normal, discs.tangent[:, index])
    reach = discs.radius[:, index] * np.sqrt(np.maximum(1 - along**2, 0.0))
    return np.asarray(dot(normal, discs.center[:, index]) + side * reach)


def _norm(vectors: np.ndarray) -> np.ndarray:
    return np.asarray(np.sqrt(dot(vectors, vectors)))


def _positive(lengths: np.ndarray) -> np.ndarray:
    return np.where(lengths > 0, lengths, 1.0)

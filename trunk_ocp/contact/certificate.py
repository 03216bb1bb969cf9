"""Lower bounds of gaps between sample points along the trunk, and between instants.

The surface point of the disc at (Z, t) in some direction, x(Z, t), lies on a cell of a grid in Z
and t below its bilinear interpolant, along a unit vector n, by at most

    e = h^2 / 8 max(0, sup n . x_ZZ) + k^2 / 8 max(0, sup n . x_tt).

By (*) of `model.solids`, the distance from a convex solid is at least a linear function l(x) with
gradient n, whose minimum over a bilinear patch is at a corner. So a cell is at least (least of l
over the discs at its corners) - e away. For two parts of the trunk, l is the difference along the
line between them. A trunk that curls around a solid bends toward it, so its chords are closer to
the solid than itself and e is 0; likewise inside a curl. The bounds need no bound on the curvature
of solids. Suprema are those of second differences at and beside the corners, whose range is
widened to `SAFETY` times its size, because the grid only samples them; more so in time, where a
cell has few samples. If the body moves, x is seen from it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..model.solids import Solid, signed_distance
from .tube import Tube, dot

SAFETY = 2.0
"""On the range of second differences of motions and shapes, smooth at the scale of a cell."""
ASIDE = 0.25
"""Share of an acceleration that may point anywhere, where only three are known of a cell."""


@dataclass(frozen=True, eq=False)
class Curving:
    """Second derivatives of surface points on P pieces of the trunk in C cells, times h^2 or k^2.

    Those of centers are about `low` to `high` (C, P, 3), in m; discs add at most `turning` (C, P),
    infinite where nothing is known.
    """

    low: np.ndarray
    high: np.ndarray
    turning: np.ndarray

    @staticmethod
    def none(cells: int, pieces: int) -> Curving:
        """That of straight pieces, or of cells of no duration."""
        zero = np.zeros((cells, pieces, 3))
        return Curving(zero, zero, zero[..., 0])

    def __getitem__(self, cells: slice | np.ndarray) -> Curving:
        """That of some of the cells."""
        return Curving(self.low[cells], self.high[cells], self.turning[cells])

    def joined(self, starts: np.ndarray) -> Curving:
        """That of longer pieces, given the first part of each."""
        return Curving(
            np.minimum.reduceat(self.low, starts, axis=1),
            np.maximum.reduceat(self.high, starts, axis=1),
            np.maximum.reduceat(self.turning, starts, axis=1),
        )

    def below(self, pieces: np.ndarray, normal: np.ndarray) -> np.ndarray:
        """How far some pieces (K,) may lie below their chords along unit vectors (C, K, 3)."""
        low, high = self.low[:, pieces], self.high[:, pieces]
        twice = dot(normal, low + high) + SAFETY * dot(np.abs(normal), high - low)
        return np.asarray(np.maximum(twice / 2 + self.turning[:, pieces], 0.0) / 8)


@dataclass(frozen=True, eq=False)
class Error:
    """How far surface points are from bilinear interpolants, along the trunk and in time."""

    along: Curving
    in_time: Curving

    def below(self, pieces: np.ndarray, normal: np.ndarray) -> np.ndarray:
        """Error e (C, K) of some pieces (K,) along unit vectors (C, K, 3)."""
        return self.along.below(pieces, normal) + self.in_time.below(pieces, normal)


def solid_bounds(
    instants: Sequence[Tube], error: Error, pieces: np.ndarray, solid: Solid
) -> np.ndarray:
    """Lower bounds (C, P) of the gap between pieces of the trunk and a solid.

    instants : the C shapes, or those at the start and the end of each cell.
    pieces : (P,), by their first disc.
    """
    corners = [(discs, pieces + end) for discs in instants for end in (0, 1)]
    offset, normal = _plane(solid, *_mean_disc(corners))
    least = np.min([_extent(discs, index, normal, -1) for discs, index in corners], axis=0)
    return np.asarray(offset + least - error.below(pieces, normal))


def _mean_disc(corners: Sequence[tuple[Tube, np.ndarray]]) -> tuple[np.ndarray, ...]:
    """Center (C, P, 3), normal, and radius (C, P) of a disc between some discs."""
    parts = ("center", "tangent", "radius")
    return tuple(
        np.mean([getattr(discs, name)[:, index] for discs, index in corners], axis=0)
        for name in parts
    )


def _plane(
    solid: Solid, center: np.ndarray, tangent: np.ndarray, radius: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Offset (C, P) and unit normal (C, P, 3) of planes; the solid is as far away, or farther.

    The tangent plane of the distance at the center of a disc, or that at the point of its rim
    which is nearest by the first: whichever is farther from the disc, if that is tilted.
    """
    distance, normal = signed_distance(solid, center)
    across = normal - dot(normal, tangent)[..., None] * tangent
    rim = center - (radius / _positive(_norm(across)))[..., None] * across
    at_rim, normal_there = signed_distance(solid, rim)
    planes = ((distance, center, normal), (at_rim, rim, normal_there))
    offsets = [value - dot(n, point) for value, point, n in planes]
    reach = [radius * np.sqrt(np.maximum(1 - dot(n, tangent) ** 2, 0)) for *_, n in planes]
    gaps = [c + dot(n, center) - r for c, (*_, n), r in zip(offsets, planes, reach, strict=True)]
    better = gaps[1] > gaps[0]
    return np.where(better, *offsets[::-1]), np.where(better[..., None], normal_there, normal)


def pair_bounds(instants: Sequence[Tube], error: Error, pairs: np.ndarray) -> np.ndarray:
    """Lower bounds (C, P) of the gap between pairs of pieces of the trunk.

    instants : the C shapes, or those at the start and the end of each cell.
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
    off = error.below(pairs[:, 0], normal) + error.below(pairs[:, 1], -normal)
    return np.asarray(low - high - off)


def curving_along(instants: Sequence[Tube]) -> Curving:
    """Second derivatives along pieces between two discs, of shapes at one or several instants.

    Second differences do not reach across breaks. A piece between two breaks, or one that is all
    of the tube, has none, so nothing is known of it.
    """
    parts = [_curving_along(discs) for discs in instants]
    return Curving(
        np.min([part.low for part in parts], axis=0),
        np.max([part.high for part in parts], axis=0),
        np.max([part.turning for part in parts], axis=0),
    )


def _curving_along(discs: Tube) -> Curving:
    turned, growth = np.diff(discs.tangent, axis=1), np.abs(np.diff(discs.radius, axis=1))
    spin, known = _norm(turned), ~discs.breaks[1:-1]
    spin, growth = (np.maximum(part[:, 1:], part[:, :-1]) for part in (spin, growth))
    middle, tangent = np.diff(discs.center, 2, axis=1), discs.tangent[:, 1:-1]
    twist = np.diff(turned, axis=1)
    twist -= dot(twist, tangent)[..., None] * tangent  # discs only have points across d_3
    turning = discs.radius[:, 1:-1] * (SAFETY * _norm(twist) + spin**2) + 2 * growth * spin
    nearby = _beside(np.where(known[:, None], middle, np.nan), 2)
    nearby[0][np.isnan(nearby[1])] = np.nan  # beyond a break
    nearby[3][np.isnan(nearby[2])] = np.nan
    low, high = np.fmin.reduce(nearby), np.fmax.reduce(nearby)
    single = np.sum(~np.isnan(nearby[..., :1]), axis=0) == 1  # tells nothing of others
    low, high = low - single * np.abs(low), high + single * np.abs(high)
    turning = np.fmax.reduce(_beside(np.where(known, turning, np.nan), 1))
    unknown = np.isnan(turning)
    return Curving(
        np.where(unknown[..., None], 0.0, low),
        np.where(unknown[..., None], 0.0, high),
        np.where(unknown, np.inf, turning),
    )


def _beside(inner: np.ndarray, reach: int) -> np.ndarray:
    """Values (H, n - 2, ...) at inner discs, at those on each side of n - 1 pieces.

    Up to so many on each side, (2 reach, H, n - 1, ...); NaN beyond the ends.
    """
    count, rest = inner.shape[1] + 1, [(0, 0)] * (inner.ndim - 2)
    padded = np.pad(inner, [(0, 0), (reach, reach), *rest], constant_values=np.nan)
    return np.stack([padded[:, i : i + count] for i in range(2 * reach)])


def curving_in_time(instants: Sequence[Tube]) -> Curving:
    """Second derivatives in time, on the quarters of C cells.

    Three second differences tell little of the ends of a cell, where accelerations may have turned
    or changed sign. So their range also counts in all directions, and a share of their size.

    instants : the shapes (C,) at 0, 1/4, 1/2, 3/4 and 1 of the time of each cell, as seen from the
        body. With five, a second difference that vanishes in the middle is noticed beside it.
    """
    centers, tangents, radii = (
        np.array([getattr(discs, name) for discs in instants])
        for name in ("center", "tangent", "radius")
    )
    spin = _norm(np.diff(tangents, axis=0)).max(axis=0)
    growth = np.abs(np.diff(radii, axis=0)).max(axis=0)
    turning = SAFETY * (
        radii.max(axis=0) * (_norm(np.diff(tangents, 2, axis=0)).max(axis=0) + spin**2)
        + np.abs(np.diff(radii, 2, axis=0)).max(axis=0)
        + 2 * growth * spin
    )
    bend = np.diff(centers, 2, axis=0)
    low, high = bend.min(axis=0), bend.max(axis=0)
    turning += _norm(high - low) + ASIDE * _norm(bend).max(axis=0)
    return Curving(
        np.minimum(low[:, :-1], low[:, 1:]),
        np.maximum(high[:, :-1], high[:, 1:]),
        np.maximum(turning[:, :-1], turning[:, 1:]),
    )


def _extent(discs: Tube, index: np.ndarray, normal: np.ndarray, side: int) -> np.ndarray:
    """Largest (side 1) or least (-1) coordinate of some discs along unit vectors."""
    along = dot(normal, discs.tangent[:, index])
    reach = discs.radius[:, index] * np.sqrt(np.maximum(1 - along**2, 0.0))
    return np.asarray(dot(normal, discs.center[:, index]) + side * reach)


def _norm(vectors: np.ndarray) -> np.ndarray:
    return np.asarray(np.sqrt(dot(vectors, vectors)))


def _positive(lengths: np.ndarray) -> np.ndarray:
    return np.where(lengths > 0, lengths, 1.0)

"""The trunk as discs along its centerline, at some instants, and how far they are from solids.

A disc with center r, unit normal d_3 and radius R reaches R sqrt(1 - (n . d_3)^2) along a unit
vector n. Together with (*) of `model.solids` this bounds its distance from a convex solid,

    distance(r) - R sqrt(1 - (n . d_3)^2),    n = gradient of the distance at r.

The bound is sharp where n is perpendicular to d_3, as at a minimum along the trunk, and for flat
surfaces. Between discs, and between instants, see `certificate`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..model.anatomy import Trunk
from ..model.quaternions import director_rows
from ..model.solids import Solid, in_head_frame, signed_distance, turn
from ..rod.equations import ORIENTATION
from ..rod.shape import Shape
from ..rod.volume import section_scale


@dataclass(frozen=True, eq=False)
class Tube:
    """Discs at n points Z (n,) in m, in H shapes.

    Attributes
    ----------
    Z : (n,)
        In m, at equal distances between two breaks.
    center, tangent : (H, n, 3)
        In m, and unit vectors.
    radius : (H, n)
        In m.
    breaks : (n,) bool
        Where the curvature jumps, as at the ends of muscles; by default nowhere.
    arc : (H, n)
        Length of the centerline from the first disc, in m; by default that of the chords.
    """

    Z: np.ndarray
    center: np.ndarray
    tangent: np.ndarray
    radius: np.ndarray
    breaks: np.ndarray = None  # type: ignore[assignment]  # set below
    arc: np.ndarray = None  # type: ignore[assignment]

    def __post_init__(self) -> None:
        if self.breaks is None:
            object.__setattr__(self, "breaks", np.zeros(len(self.Z), dtype=bool))
        if self.arc is None:
            chords = np.diff(self.center, axis=1)
            lengths = np.cumsum(np.sqrt(dot(chords, chords)), axis=1)
            object.__setattr__(self, "arc", np.pad(lengths, ((0, 0), (1, 0))))

    def __getitem__(self, index: slice | np.ndarray) -> Tube:
        """Some of the shapes."""
        shapes = (self.center[index], self.tangent[index], self.radius[index])
        return Tube(self.Z, *shapes, self.breaks, self.arc[index])

    def part(self, chosen: slice | np.ndarray) -> Tube:
        """Some of the discs."""
        discs = (self.center[:, chosen], self.tangent[:, chosen], self.radius[:, chosen])
        return Tube(self.Z[chosen], *discs, self.breaks[chosen], self.arc[:, chosen])

    def reach(self, along: np.ndarray) -> np.ndarray:
        """How far each disc reaches (H, n), given the cosine (H, n) of a vector with d_3."""
        sine: np.ndarray = np.sqrt(np.maximum(1 - along**2, 0.0))
        return self.radius * sine


def dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Scalar products (...,) of vectors (..., 3); much faster than a sum over the last axis."""
    return np.asarray(np.einsum("...c,...c->...", a, b))


def tube(trunk: Trunk, shape: Shape, Z: np.ndarray) -> Tube:
    """Discs of shapes with one batch axis (H,) at points Z (n,) in m."""
    q = shape.state(Z)[..., ORIENTATION]
    tangent = director_rows(q)[..., 2, :]
    tangent /= np.linalg.norm(tangent, axis=-1, keepdims=True)
    radius = section_scale(trunk, shape)[:, None] * trunk.radius(Z)
    return Tube(Z, shape.position(Z), tangent, radius, np.isin(Z, trunk.edges))


def seen_by(trunk: Trunk, discs: Tube, frame: str, head: np.ndarray) -> Tube:
    """The discs as seen in space, or from the head at angles (H, 2)."""
    if frame == "space":
        return discs
    rotation = turn(head)
    center = in_head_frame(trunk, discs.center, head)
    tangent = discs.tangent @ np.swapaxes(rotation, -1, -2)
    return Tube(discs.Z, center, tangent, discs.radius, discs.breaks, discs.arc)


def solid_gaps(discs: Tube, solid: Solid) -> np.ndarray:
    """Gap (H, n) in m of each disc from a solid, in the frame of the solid; negative inside."""
    distance, normal = signed_distance(solid, discs.center)
    return np.asarray(distance - discs.reach(dot(normal, discs.tangent)))


def pair_gaps(discs: Tube, pairs: np.ndarray) -> np.ndarray:
    """Gap (H, P) in m between pairs (P, 2) of discs; infinite for neighbors, which may touch.

    A tube of radius R that bends no more sharply than its own radius can touch itself only at
    points that are a half circle, pi R, or more apart; sharper bends are creases, see `creases`.
    """
    one, other = pairs.T
    between = discs.center[:, one] - discs.center[:, other]
    distance = np.sqrt(dot(between, between))
    normal = between / np.where(distance > 0, distance, 1.0)[..., None]
    gaps = distance
    for index in (one, other):
        along = dot(normal, discs.tangent[:, index])
        gaps = gaps - discs.radius[:, index] * np.sqrt(np.maximum(1 - along**2, 0.0))
    return np.where(apart(discs, pairs), gaps, np.inf)


def apart(discs: Tube, pairs: np.ndarray) -> np.ndarray:
    """Which pairs (H, P) of discs are at least half a circle apart, see `pair_gaps`."""
    one, other = pairs.T
    half_circle = np.pi * (discs.radius[:, one] + discs.radius[:, other]) / 2
    return np.asarray(np.abs(discs.arc[:, one] - discs.arc[:, other]) >= half_circle)


def creases(discs: Tube) -> np.ndarray:
    """Bending curvature times radius (H, n - 1) between discs; above 1 they cut each other."""
    turned = np.linalg.norm(np.diff(discs.tangent, axis=1), axis=-1)
    length = np.linalg.norm(np.diff(discs.center, axis=1), axis=-1)
    radius = np.maximum(discs.radius[:, 1:], discs.radius[:, :-1])
    return np.asarray(radius * turned / length)

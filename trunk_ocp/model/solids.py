"""Convex solids that the trunk must not enter, and the signed distance of points from them.

A solid lies still in space or moves with the head. In its own axes, with its middle at the origin,
it is one of

    sphere      radius                 |x| <= a
    capsule     radius, half length    distance from the segment |z| <= h, x = y = 0, at most a
    cylinder    radius, half length    x^2 + y^2 <= a^2 and |z| <= h
    half-space                         z <= 0
    box         three half sizes       |x_i| <= h_i
    ellipsoid   three half axes        sum of (x_i / a_i)^2 <= 1

The signed distance of a convex solid is a convex function, negative inside, whose gradient n is
the unit normal at the nearest point of the surface, so that for every point x + d

    distance(x + d) >= distance(x) + n . d.                                                   (*)
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np

from .anatomy import Trunk
from .head import turn_quaternion
from .loads import Vector, vector
from .quaternions import about_x, about_y, about_z, director_rows, product
from .solid_specs import KEYS, Frame, SolidSpec

SolidShape = Literal["sphere", "capsule", "cylinder", "half-space", "box", "ellipsoid"]
Group = Literal["head", "log", "obstacles"]
Axes = tuple[Vector, Vector, Vector]
UNTURNED: Axes = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
SELF = "itself"
"""Name of the trunk as the body that it may touch."""

MAX_NEWTON_STEPS = 60
"""For the distance from an ellipsoid; 10 suffice unless its axes differ by orders of magnitude."""


@dataclass(frozen=True)
class Solid:
    """A convex solid, as in the table above.

    Attributes
    ----------
    name : str
        For messages.
    group : str
        What it belongs to: the head, a log, or the obstacles of the problem file.
    center : (3,)
        Origin of its own axes in m; a point of the surface of a half-space.
    axes : (3, 3)
        Rows are its own axes. The third is the axis of a capsule and a cylinder, and the outward
        normal of a half-space.
    sizes : tuple of float
        In m; see the table.
    frame : str
        "space", or "head": center and axes are those at head angles 0, and turn with the head.
    clearance : float
        Distance in m that the trunk keeps from it.
    Z : (2,)
        Part of the trunk that must keep clear of it, m from the base.
    """

    name: str
    group: Group
    shape: SolidShape
    center: Vector
    axes: Axes = UNTURNED
    sizes: tuple[float, ...] = ()
    frame: Frame = "space"
    clearance: float = 0.0
    Z: tuple[float, float] = (0.0, np.inf)


@lru_cache(maxsize=256)  # motions are built again for every small move of a control loop
def built_solid(spec: SolidSpec, group: Group, frame: Frame) -> Solid:
    """The solid that a file describes."""
    read = {key: np.array(getattr(spec, key)) for key in KEYS[spec.shape]}
    axes = _turned(spec.rotation_deg)
    match spec.shape:
        case "sphere":
            center, sizes = read["center"], read["radius"]
        case "capsule":
            half = (read["to"] - read["from"]) / 2
            center, axes = read["from"] + half, axes_along(half)
            sizes = np.array([read["radius"], np.linalg.norm(half)])
        case "half-space":
            center, axes, sizes = read["point"], axes_along(read["normal"]), np.zeros(0)
        case "box":
            center, sizes = read["center"], read["half_sizes"]
        case "ellipsoid":
            center, sizes = read["center"], read["half_axes"]
    part = (0.0, np.inf) if spec.Z is None else spec.Z
    lengths = tuple(np.atleast_1d(sizes).tolist())
    return Solid(
        spec.name, group, spec.shape, vector(center), axes, lengths, frame, spec.clearance, part
    )


def axes_along(third: np.ndarray) -> Axes:
    """Right-handed axes whose third points along a vector (3,) of any length."""
    third = third / np.abs(third).max()  # so that no square overflows or vanishes
    third = third / np.linalg.norm(third)
    second = np.cross(third, np.eye(3)[np.argmin(np.abs(third))])
    second /= np.linalg.norm(second)
    return vector(np.cross(second, third)), vector(second), vector(third)


def _turned(degrees: Vector) -> Axes:
    """Axes turned by angles about e_X, then e_Y, then e_Z."""
    x, y, z = np.radians(degrees)
    rows = director_rows(np.array(product(about_z(z), product(about_y(y), about_x(x)))))
    return vector(rows[0]), vector(rows[1]), vector(rows[2])


def signed_distance(solid: Solid, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Signed distance (...,) in m of points (..., 3) from a solid, and its gradient (..., 3).

    Points are in the frame of the solid. Where several points of the surface are nearest, the
    gradient belongs to one of them.
    """
    axes = np.asarray(solid.axes)
    local = (np.asarray(points) - solid.center) @ axes.T
    distance, normal = _DISTANCES[solid.shape](local, np.asarray(solid.sizes))
    return distance, normal @ axes


def in_head_frame(trunk: Trunk, points: np.ndarray, head: np.ndarray) -> np.ndarray:
    """Points (..., 3) in m seen from a head at angles (..., 2) rad: where they are at angles 0.

    The head turns about the pivot S of eq. (35); the base, at 0 for head angles 0, moves with it.
    """
    return (np.asarray(points) - pivot(trunk)) @ np.swapaxes(turn(head), -1, -2) + pivot(trunk)


def from_head_frame(trunk: Trunk, points: np.ndarray, head: np.ndarray) -> np.ndarray:
    """Where points (n, 3) of a head at angles 0 are at angles (..., 2) rad: (..., n, 3) in m."""
    return (np.asarray(points) - pivot(trunk)) @ turn(head) + pivot(trunk)


def turn(head: np.ndarray) -> np.ndarray:
    """Rotation (..., 3, 3) by head angles (..., 2): row i is where e_i goes."""
    psi = np.asarray(head, dtype=float)
    return director_rows(np.stack(turn_quaternion(psi[..., 0], psi[..., 1]), axis=-1))


@lru_cache(maxsize=64)
def pivot(trunk: Trunk) -> np.ndarray:
    """Pivot S (3,) in m, about which the head turns (eq. 35)."""
    head = trunk.head
    rest = np.array(product(about_z(head.xi_z), about_y(head.xi_y)))
    return -head.pivot_radius * director_rows(rest)[2]


def _unit(vectors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lengths (...,) of vectors and unit vectors (..., 3); e_X for those of no length."""
    length = np.sqrt(np.einsum("...c,...c->...", vectors, vectors))
    safe = np.where(length > 0, length, 1.0)[..., None]
    return length, np.where(length[..., None] > 0, vectors / safe, np.eye(vectors.shape[-1])[0])


def _sphere(x: np.ndarray, sizes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    length, normal = _unit(x)
    return length - sizes[0], normal


def _capsule(x: np.ndarray, sizes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    on_axis = np.zeros_like(x)
    on_axis[..., 2] = np.clip(x[..., 2], -sizes[1], sizes[1])
    return _sphere(x - on_axis, sizes)


def _cylinder(x: np.ndarray, sizes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    radius, outward = _unit(x[..., :2])
    flat = np.stack([radius, x[..., 2]], axis=-1)
    distance, normal = _box(flat, sizes)
    return distance, np.concatenate([normal[..., :1] * outward, normal[..., 1:]], axis=-1)


def _half_space(x: np.ndarray, sizes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return x[..., 2], np.broadcast_to(np.array([0.0, 0.0, 1.0]), x.shape)


def _box(x: np.ndarray, sizes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    beyond = np.abs(x) - sizes
    sign = np.where(x < 0, -1.0, 1.0)
    outside, normal = _unit(np.maximum(beyond, 0.0))
    nearest = np.eye(x.shape[-1])[np.argmax(beyond, axis=-1)]  # the nearest face, seen from inside
    inside = np.all(beyond <= 0, axis=-1)
    distance = np.where(inside, beyond.max(axis=-1), outside)
    return distance, sign * np.where(inside[..., None], nearest, normal)


def _ellipsoid(x: np.ndarray, sizes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The nearest point is y_i = a_i^2 x_i / (a_i^2 + t), with t > -min a_i^2 (Eberly).

    Newton's method finds s = t + min a_i^2, as t itself cancels near the center.
    """
    # On a plane of symmetry inside, the nearest point may leave the plane; step off it.
    x = np.where(np.abs(x) < 1e-12 * sizes.max(), 1e-12 * sizes.max(), x)
    shortest = sizes.min()
    excess = (sizes - shortest) * (sizes + shortest)
    s = np.max(sizes * np.abs(x) - excess, axis=-1)  # left of the root, where the method is safe
    for _ in range(MAX_NEWTON_STEPS):
        below = excess + s[..., None]
        terms = (sizes * x / below) ** 2
        step = (terms.sum(-1) - 1) / (2 * (terms / below).sum(-1))
        s = s + step
        if np.all(np.abs(step) <= 1e-15 * s):
            break
    length, normal = _unit(x / (excess + s[..., None]))
    return (s - shortest**2) * length, normal


_DISTANCES: dict[str, Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]] = {
    "sphere": _sphere,
    "capsule": _capsule,
    "cylinder": _cylinder,
    "half-space": _half_space,
    "box": _box,
    "ellipsoid": _ellipsoid,
}

"""Surfaces of solids as facets: parts of the head, and obstacles, at a moment of a motion."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..model.anatomy import Trunk
from ..model.solids import Solid, from_head_frame
from ..planning.plan import Plan
from ..problem.step_solids import head_solids
from .body import Body
from .colors import HEAD, OBSTACLE
from .moments import phase_at

AROUND = 24  # points around a round solid
PATCH = 0.8  # half the side of the part of a half-space that is drawn, over the trunk's length
CELLS = 8  # along each edge of a flat face: facets that are sorted by depth must be small


@dataclass(frozen=True, eq=False)
class SolidSurface:
    """Points (n, 3) in m, and facets (k, 4) of them, counter-clockwise from outside.

    The last two points of a facet may be the same: it is a triangle.
    """

    points: np.ndarray
    facets: np.ndarray

    @property
    def body(self) -> Body:
        """The surface as triangles."""
        a, b, c, d = self.facets.T
        halves = np.concatenate([np.stack([a, b, c], -1), np.stack([a, c, d], -1)[c != d]])
        return Body(self.points[None], halves)


def head_and_obstacles(
    plan: Plan, time: float, head: np.ndarray, after: bool = False
) -> list[tuple[Solid, SolidSurface]]:
    """Parts of the head, and obstacles, where they are at a time in s and head angles (2,) in rad.

    `after` at the end of a phase, with the obstacles of the next.
    """
    phase = phase_at(plan.motion, time, after)
    solids = (*head_solids(plan.motion.trunk), *obstacles(plan, phase))
    return [(solid, placed(plan.motion.trunk, solid, head)) for solid in solids]


def obstacles(plan: Plan, phase: int) -> tuple[Solid, ...]:
    """Obstacles of a phase, given by its number from 0."""
    step = next(step for step in plan.motion.steps if step.phase == phase)
    return tuple(solid for solid in step.solids if solid.group == "obstacles")


def color_of(solid: Solid) -> str:
    """Color "#RRGGBB" of a part of the head, or of an obstacle."""
    return HEAD if solid.group == "head" else OBSTACLE


def placed(trunk: Trunk, solid: Solid, head: np.ndarray) -> SolidSurface:
    """The surface of a solid at head angles (2,) in rad."""
    surface = solid_surface(solid, trunk.length)
    if solid.frame == "space":
        return surface
    return SolidSurface(from_head_frame(trunk, surface.points, head), surface.facets)


def solid_surface(solid: Solid, length: float) -> SolidSurface:
    """The surface of a solid at head angles 0.

    It is closed, except that of a half-space: a square near the base of a trunk of a length in m.
    """
    sizes, axes = np.array(solid.sizes), np.array(solid.axes)
    if solid.shape == "half-space":
        square = _face(np.array([PATCH * length, PATCH * length, 0.0]), 2, 1)
        surface = SolidSurface(square.points - axes @ solid.center * [1, 1, 0], square.facets)
    elif solid.shape == "box":
        surface = _joined([_face(sizes, axis, sign) for axis in range(3) for sign in (-1, 1)])
    else:
        surface = _round(_PROFILES[solid.shape](sizes))
    scale = sizes if solid.shape == "ellipsoid" else np.ones(3)
    return SolidSurface(np.array(solid.center) + scale * surface.points @ axes, surface.facets)


def _face(sizes: np.ndarray, axis: int, sign: int) -> SolidSurface:
    """A face of a box of half `sizes` (3,)."""
    u, v = np.meshgrid(*[np.linspace(-1, 1, CELLS + 1)] * 2, indexing="ij")
    points = np.empty((u.size, 3))
    points[:, axis] = sign * sizes[axis]
    points[:, (axis + 1) % 3] = sign * u.ravel() * sizes[(axis + 1) % 3]
    points[:, (axis + 2) % 3] = v.ravel() * sizes[(axis + 2) % 3]
    here = (np.arange(CELLS)[:, None] * (CELLS + 1) + np.arange(CELLS)).ravel()
    beside = here + CELLS + 1
    return SolidSurface(points, np.stack([here, beside, beside + 1, here + 1], axis=-1))


def _joined(parts: list[SolidSurface]) -> SolidSurface:
    starts = np.cumsum([0, *(len(part.points) for part in parts[:-1])])
    facets = [part.facets + start for part, start in zip(parts, starts, strict=True)]
    return SolidSurface(np.concatenate([part.points for part in parts]), np.concatenate(facets))


def _ball(sizes: np.ndarray) -> np.ndarray:
    angle = np.linspace(0, np.pi, AROUND // 2 + 2)
    return sizes[0] * np.stack([np.sin(angle), -np.cos(angle)], axis=-1)


def _unit_ball(sizes: np.ndarray) -> np.ndarray:
    return _ball(np.ones(1))


def _capsule(sizes: np.ndarray) -> np.ndarray:
    below, above = np.split(_ball(sizes), 2)
    half = np.array([0.0, sizes[1]])
    return np.concatenate([below - half, _side(*sizes), above + half])


def _cylinder(sizes: np.ndarray) -> np.ndarray:
    ends = np.array([[0.0, -sizes[1]], [0.0, sizes[1]]])
    rims = np.array([[sizes[0], -sizes[1]], [sizes[0], sizes[1]]])
    return np.concatenate([ends[:1], rims[:1], _side(*sizes), rims[1:], ends[1:]])


def _side(radius: float, half: float) -> np.ndarray:
    """Points (n, 2) on the straight side, without its ends."""
    along = np.linspace(-half, half, 2 + min(int(2 * half / radius), 2 * CELLS))[1:-1]
    return np.stack([np.full_like(along, radius), along], axis=-1)


_PROFILES: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "sphere": _ball,
    "capsule": _capsule,
    "cylinder": _cylinder,
    "ellipsoid": _unit_ball,
}


def _round(profile: np.ndarray) -> SolidSurface:
    """What a profile (n, 2) of radii and heights sweeps; its first and last point are poles."""
    angle = 2 * np.pi * np.arange(AROUND) / AROUND
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    rings = profile[1:-1, None, :1] * circle
    heights = np.broadcast_to(profile[1:-1, None, 1:], (*rings.shape[:2], 1))
    points = np.concatenate([rings, heights], axis=-1).reshape(-1, 3)
    poles = np.array([[0, 0, profile[0, 1]], [0, 0, profile[-1, 1]]])
    here = np.arange(len(points)).reshape(-1, AROUND)
    beside = np.roll(here, -1, axis=1)
    south, north = np.full(AROUND, len(points)), np.full(AROUND, len(points) + 1)
    facets = [
        np.stack([south, beside[0], here[0], here[0]], axis=-1),
        np.stack([here[:-1], beside[:-1], beside[1:], here[1:]], axis=-1).reshape(-1, 4),
        np.stack([north, here[-1], beside[-1], beside[-1]], axis=-1),
    ]
    return SolidSurface(np.concatenate([points, poles]), np.concatenate(facets))

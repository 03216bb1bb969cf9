"""Head, obstacles and tip mass as surfaces, cut where they meet the trunk and each other."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache, partial

import numpy as np

from ..model.solids import Solid, from_head_frame, in_head_frame, signed_distance
from ..planning.plan import Plan
from ..problem.step_solids import head_solids
from ..scene.body import section_scale
from ..scene.colors import MASS
from ..scene.moments import Moment, phase_at
from ..scene.solid_meshes import color_of, obstacles, solid_surface
from ..scene.surroundings import TipMass
from .projection import Surface, ball, outside

CENTERS = 40  # points of the centerline
OVERLAP = 0.002  # of the trunk's length: how deep bodies stay in each other, to leave no gap
HEAD_OVERLAP = 0.005  # the same of parts of the head, which have one color


def mass_surfaces(plan: Plan, mass: TipMass | None, moment: Moment) -> list[Surface]:
    """The tip mass at a moment, if it is there."""
    center = mass.center(plan, moment) if mass else None
    return [] if mass is None or center is None else [Surface(ball(center, mass.radius), MASS)]


def solid_surfaces(plan: Plan, moment: Moment, bounded: bool = False) -> list[Surface]:
    """Head and obstacles at a moment; if `bounded`, without half-spaces, which have no end."""
    trunk, phase = plan.motion.trunk, phase_at(plan.motion, moment.time, moment.after)
    parts = head_solids(trunk)
    facets = [from_head_frame(trunk, part, moment.head) for part in _head(parts, trunk.length)]
    surfaces = [Surface(f, color_of(solid)) for f, solid in zip(facets, parts, strict=True)]
    for solid in obstacles(plan, phase):
        if not (bounded and solid.shape == "half-space"):
            mesh = solid_surface(solid, trunk.length)
            points = mesh.points
            if solid.frame == "head":
                points = from_head_frame(trunk, points, moment.head)
            surfaces.append(Surface(points[mesh.facets], color_of(solid)))
    return surfaces


@lru_cache(maxsize=8)
def _head(parts: tuple[Solid, ...], length: float) -> tuple[np.ndarray, ...]:
    """Facets (k, 4, 3) of each part of a head at angles 0, without what is inside the others."""
    pieces = []
    for part in parts:
        mesh = solid_surface(part, length)
        facets = mesh.points[mesh.facets]
        for other in parts:
            if other is not part:
                facets = outside(facets, partial(_gap, other, HEAD_OVERLAP * length))
        gap, normal = signed_distance(part, facets)  # corners of cut facets are on chords
        pieces.append(facets - gap[..., None] * normal)
    return tuple(pieces)


def _gap(solid: Solid, overlap: float, points: np.ndarray) -> np.ndarray:
    return signed_distance(solid, points)[0] + overlap


def joined_with_head(plan: Plan, moment: Moment, bodies: Sequence[Surface]) -> list[Surface]:
    """Bodies of the trunk at a moment, head and obstacles: without what is inside each other."""
    solids = solid_surfaces(plan, moment)
    parts = head_solids(plan.motion.trunk)
    if not parts:
        return [*bodies, *solids]
    in_trunk = _distance_from_trunk(plan, moment)
    in_head = _distance_from_head(plan, moment, solids[: len(parts)])
    head = [Surface(outside(s.facets, in_trunk), s.color) for s in solids[: len(parts)]]
    free = [Surface(outside(body.facets, in_head), body.color) for body in bodies]
    return [*free, *head, *solids[len(parts) :]]


Distance = Callable[[np.ndarray], np.ndarray]


def _distance_from_head(plan: Plan, moment: Moment, surfaces: Sequence[Surface]) -> Distance:
    """Signed distance in m from the nearest part of the head; 1 m of points that are not near."""
    trunk = plan.motion.trunk
    corners = np.concatenate([surface.facets.reshape(-1, 3) for surface in surfaces])
    low, high = corners.min(axis=0), corners.max(axis=0)

    def distance(points: np.ndarray) -> np.ndarray:
        gaps = np.ones(points.shape[:-1])
        near = ((points > low) & (points < high)).all(axis=-1)
        if not near.any():
            return gaps
        there = in_head_frame(trunk, points[near], moment.head)
        each = [signed_distance(part, there)[0] for part in head_solids(trunk)]
        gaps[near] = np.min(each, axis=0) + OVERLAP * trunk.length
        return gaps

    return distance


def _distance_from_trunk(plan: Plan, moment: Moment) -> Distance:
    """Distance in m from the trunk, negative inside; 1 m of points that are not near.

    The trunk is a row of balls here, so that its base has no flat end.
    """
    trunk = plan.motion.trunk
    Z = np.linspace(0.0, trunk.length, CENTERS)
    centers = moment.shape.position(Z)[0]
    radii = section_scale(trunk, moment.shape)[0] * trunk.base_radius * np.asarray(trunk.taper(Z))

    low, high = (centers - radii[:, None]).min(axis=0), (centers + radii[:, None]).max(axis=0)

    def distance(points: np.ndarray) -> np.ndarray:
        gaps = np.ones(points.shape[:-1])
        near = ((points > low) & (points < high)).all(axis=-1)
        apart = np.linalg.norm(points[near][:, None] - centers, axis=-1)
        gaps[near] = (apart - radii).min(axis=-1) + OVERLAP * trunk.length
        return gaps

    return distance

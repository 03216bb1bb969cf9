"""Surfaces of muscles for 3D viewers: coarse enough to send, with normals for shading."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ..model.anatomy import Muscle, Trunk
from ..rod.shape import Shape
from .body import Body, disc, frames, outline, round_body, swept

SMOOTH_COSINE = np.cos(np.radians(30.0))  # faces at a larger angle get an edge between them


@dataclass(frozen=True, eq=False)
class Surface:
    """A closed moving surface, cut open at its edges so that each side has its own normals.

    vertices (H, v, 3) in m; normals (H, v, 3), unit and outward; triangles (t, 3).
    """

    vertices: np.ndarray
    normals: np.ndarray
    triangles: np.ndarray


def coarse_body(trunk: Trunk, muscle: Muscle | None, shape: Shape, sections: int) -> Body:
    """A muscle, or the whole trunk, on every other point of its outline, in shapes (H,).

    Its vertices are among those of `body.muscle_body`. Points of an arc are at most 15 degrees
    apart, so a cross-section is at most 1.1 % too small.
    """
    if muscle is None:
        Z = np.concatenate([np.linspace(a, b, sections) for a, b in _segments(trunk)])
        return round_body(disc(trunk.base_radius)[::2], frames(trunk, shape, np.unique(Z)))
    section, caps = coarse_outline(muscle)
    start, end = _segments(trunk)[muscle.segment]
    return swept(section, frames(trunk, shape, np.linspace(start, end, sections)), caps)


def _segments(trunk: Trunk) -> list[tuple[float, float]]:
    return list(zip(trunk.edges[:-1], trunk.edges[1:], strict=True))


def coarse_outline(muscle: Muscle) -> tuple[np.ndarray, np.ndarray]:
    """Every other point (m, 2) of `body.outline`, ends included, and triangles (k, 3) in it."""
    section = outline(muscle)
    hollow = muscle.radii[0] > 0
    arc = len(section) // 2 if hollow else len(section) - 1
    keep = np.unique([*range(0, arc, 2), arc - 1])
    first = np.arange(len(keep) - 1)
    if not hollow:
        center = np.full_like(first, len(keep))
        return section[[*keep, arc]], np.stack([first, first + 1, center], axis=-1)
    back = 2 * len(keep) - 1 - first  # the inner point beside each outer one
    halves = [np.stack([first, first + 1, back], -1), np.stack([first + 1, back - 1, back], -1)]
    return section[[*keep, *(2 * arc - 1 - keep[::-1])]], np.concatenate(halves)


def shaded(body: Body) -> Surface:
    """A body with normals, smooth except at the edges of its first shape."""
    flat = _face_normals(body)  # (H, t, 3), of length twice the area
    corners, index = np.unique(
        np.stack([body.triangles.ravel(), np.repeat(_patches(body, flat[0]), 3)], axis=-1),
        axis=0,
        return_inverse=True,
    )
    index = index.ravel()
    ones = np.ones(len(index))
    around = coo_array((ones, (index, np.repeat(np.arange(flat.shape[1]), 3)))).tocsr()
    summed = np.stack([around @ normals for normals in flat])
    return Surface(body.vertices[:, corners[:, 0]], _unit(summed), index.reshape(-1, 3))


def _face_normals(body: Body) -> np.ndarray:
    a, b, c = (body.vertices[:, body.triangles[:, i]] for i in range(3))
    return np.cross(b - a, c - a)


def _patches(body: Body, flat: np.ndarray) -> np.ndarray:
    """Number of the smooth patch that each triangle (t,) belongs to."""
    triangles = body.triangles
    sides = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    order = np.lexsort(sides.T)  # the two triangles at a side become neighbors
    same = np.flatnonzero((sides[order[1:]] == sides[order[:-1]]).all(axis=1))
    one, other = order[same] // 3, order[same + 1] // 3
    unit = _unit(flat)
    smooth = np.einsum("ti,ti->t", unit[one], unit[other]) > SMOOTH_COSINE
    count = len(triangles)
    joined = coo_array((smooth[smooth], (one[smooth], other[smooth])), shape=(count, count))
    patches: np.ndarray = connected_components(joined, directed=False)[1]
    return patches


def _unit(vectors: np.ndarray) -> np.ndarray:
    """Unit vectors (..., 3); +Z for those of no length, because glTF allows no zero normals."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    safe = np.where(length > 0, length, 1.0)
    unit: np.ndarray = np.where(length > 0, vectors / safe, [0.0, 0.0, 1.0])
    return unit

"""Bodies in space projected onto paper: rotated, sorted by depth, shaded.

Views are orthographic, so that lengths can be measured in all of them, and consist of polygons, so
that a PDF has only vectors. +Z points down in the model and on paper.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgb
from matplotlib.ticker import MaxNLocator
from matplotlib.transforms import Bbox

from ..scene.body import Body

LIGHT = (-0.4, -0.6, 0.7)  # direction to the light: upper left, toward the reader
DARKEST = 0.55  # fraction of a color that is left where no light falls
FACETS = 20  # around a round body


@dataclass(frozen=True, eq=False)
class View:
    """An orthographic view: unit vectors along the paper and out of it, to the reader."""

    name: str
    across: np.ndarray
    down: np.ndarray
    out: np.ndarray
    labels: tuple[str, str] | None
    mirrored: bool = False
    """Whether `across` points to the left on paper."""

    def flat(self, points: np.ndarray) -> np.ndarray:
        """Coordinates on paper (..., 2) in m of points (..., 3)."""
        return np.stack([points @ self.across, points @ self.down], axis=-1)


def toward(name: str, eye: Sequence[float], below: Sequence[float] = (0.0, 0.0, 1.0)) -> View:
    """View from the direction `eye`; `below`, by default +Z, points down on paper."""
    out = np.asarray(eye) / np.linalg.norm(eye)
    down = np.asarray(below) - (out @ np.asarray(below)) * out
    down /= np.linalg.norm(down)
    return View(name, np.cross(out, down), down, out, None)


_X, _Y, _Z = np.eye(3)
SIDE = View("side", _X, _Z, _Y, ("X, forward (m)", "Z, down (m)"))
FRONT = View("front", _Y, _Z, _X, ("Y, to the right (m)", "Z, down (m)"), mirrored=True)
ABOVE = View("above", _X, _Y, -_Z, None)
AZIMUTHS = (41.6, 30.0, 55.0, -41.6, -30.0, -55.0)  # deg, from the front to the right
ABOVE_LEVEL = 0.33  # of the direction of three-quarter views that is upward


def three_quarter(lines: np.ndarray) -> View:
    """Three-quarter view of centerlines (n, points, 3), in m, that shows most of their bends.

    From the right or the left: of `AZIMUTHS` the one in which lines cover the largest area, so
    that the plane in which the trunk bends is not seen edge-on.
    """
    views = [
        toward("three-quarter", (np.cos(angle), np.sin(angle), -ABOVE_LEVEL))
        for angle in np.radians(AZIMUTHS)
    ]
    centered = lines - lines.mean(axis=1, keepdims=True)
    areas = [np.linalg.svd(v.flat(centered), compute_uv=False).prod(axis=-1).sum() for v in views]
    best = max(areas)
    return next(v for v, area in zip(views, areas, strict=True) if area >= 0.98 * best)


@dataclass(frozen=True, eq=False)
class Surface:
    """Facets (k, 4, 3) in m of one color, counter-clockwise from outside."""

    facets: np.ndarray
    color: str | tuple[float, float, float]


def paint(
    axes: Axes, view: View, surfaces: Sequence[Surface], zorder: float = 2, darkest: float = DARKEST
) -> None:
    """Draw surfaces together, sorted by depth."""
    if not surfaces:
        return
    facets = np.concatenate([surface.facets for surface in surfaces])
    rgb = np.concatenate([np.tile(to_rgb(s.color), (len(s.facets), 1)) for s in surfaces])
    normal = np.cross(facets[:, 2] - facets[:, 0], facets[:, 3] - facets[:, 1])
    length = np.linalg.norm(normal, axis=1)
    seen = (normal @ view.out > 0) & (length > 0) & np.isfinite(facets).all(axis=(1, 2))
    facets, rgb, normal = facets[seen], rgb[seen], normal[seen] / length[seen, None]
    order = np.argsort((facets.mean(axis=1) @ view.out), kind="stable")
    left = -1.0 if view.mirrored else 1.0
    light = LIGHT[0] * left * view.across + LIGHT[1] * view.down + LIGHT[2] * view.out
    bright = darkest + (1 - darkest) * np.clip(normal @ (light / np.linalg.norm(light)), 0, 1)
    drawn = (rgb * bright[:, None])[order]
    outlines: Any = view.flat(facets)[order]  # an array is what is fast
    axes.add_collection(
        # Edges in the facet's own color hide the hairlines between neighbors.
        PolyCollection(
            outlines,
            facecolors=drawn,
            edgecolors=drawn,
            linewidths=0.25,
            zorder=zorder,
        ),
        autolim=False,
    )


def outside(
    facets: np.ndarray, distance: Callable[[np.ndarray], np.ndarray], halvings: int = 1
) -> np.ndarray:
    """Facets (k, 4, 3) without what is inside a body, cut along its surface.

    Sorted by depth, large facets of two bodies that meet would cover each other in teeth.

    Parameters
    ----------
    distance : callable
        Signed distance (...,) in m of points (..., 3) from the body, negative inside.
    """
    gaps = distance(facets)
    if (gaps >= 0).all():
        return facets
    cut = (gaps < 0).any(axis=1) & (gaps > 0).any(axis=1)
    whole = facets[(gaps >= 0).all(axis=1)]
    if not halvings:
        return np.concatenate([whole, _trimmed(facets[cut], gaps[cut])])
    return np.concatenate([whole, outside(_quartered(facets[cut]), distance, halvings - 1)])


def _trimmed(facets: np.ndarray, gaps: np.ndarray) -> np.ndarray:
    """Facets (k, 4, 3) whose corners with gaps < 0 move along an edge to where the gap is 0."""
    inside = gaps < 0
    moved, left = facets.copy(), inside.copy()
    for way in (1, -1):
        beside, beyond = np.roll(facets, way, axis=1), np.roll(gaps, way, axis=1)
        here = left & (beyond > 0)
        share = gaps[here] / (gaps[here] - beyond[here])
        moved[here] += share[:, None] * (beside[here] - facets[here])
        left &= ~here
    across = (np.roll(moved, 1, axis=1) + np.roll(moved, -1, axis=1)) / 2
    moved[left] = across[left]  # opposite to the only corner outside
    return moved


def _quartered(facets: np.ndarray) -> np.ndarray:
    """Facets (4 k, 4, 3): each split at the middles of its edges."""
    middles = (facets + np.roll(facets, -1, axis=1)) / 2
    center = np.broadcast_to(facets.mean(axis=1, keepdims=True), facets.shape)
    quarters = np.stack([facets, middles, center, np.roll(middles, 1, axis=1)], axis=2)
    return quarters.reshape(-1, 4, 3)


def tube(rings: np.ndarray) -> np.ndarray:
    """Facets (k, 4, 3) of a closed tube, from rings (n, around, 3), counter-clockwise."""
    return np.concatenate([_wall(rings), _lid(rings[0])[:, ::-1], _lid(rings[-1])])


def facets_of(body: Body, sections: int) -> np.ndarray:
    """Facets (k, 4, 3) of a swept body in the first of its shapes.

    A pair of triangles between cross-sections becomes one facet: half as many to draw.
    """
    rings = body.vertices[0].reshape(sections, -1, 3)
    section = body.triangles // rings.shape[1]
    caps = body.triangles[np.all(section == section[:, :1], axis=1)]
    return np.concatenate([_wall(rings), body.vertices[0][caps[:, [0, 1, 2, 2]]]])


def _wall(rings: np.ndarray) -> np.ndarray:
    beside = np.roll(rings, -1, axis=1)
    return np.stack([rings[:-1], beside[:-1], beside[1:], rings[1:]], axis=2).reshape(-1, 4, 3)


def _lid(ring: np.ndarray) -> np.ndarray:
    center, beside = np.broadcast_to(ring.mean(axis=0), ring.shape), np.roll(ring, -1, axis=0)
    return np.stack([center, ring, beside, beside], axis=1)


def cylinder(center: np.ndarray, radius: float, length: float) -> np.ndarray:
    """Facets (k, 4, 3) of a cylinder about e_Y, in m."""
    angle = np.linspace(0, 2 * np.pi, FACETS, endpoint=False)
    ring = radius * np.stack([np.sin(angle), np.zeros(FACETS), np.cos(angle)], axis=-1)
    along = np.linspace(-length / 2, length / 2, 2 + int(length / radius))
    rings = ring + along[:, None, None] * _Y
    return tube(np.asarray(center) + rings)


def ball(center: np.ndarray, radius: float) -> np.ndarray:
    """Facets (k, 4, 3) of a ball, in m."""
    angle = np.linspace(0, 2 * np.pi, FACETS, endpoint=False)
    height = np.linspace(-np.pi / 2, np.pi / 2, FACETS // 2)[:, None]
    rings = np.stack(
        [
            np.cos(height) * np.cos(angle),
            np.cos(height) * np.sin(angle),
            np.broadcast_to(np.sin(height), (FACETS // 2, FACETS)),
        ],
        axis=-1,
    )
    return tube(np.asarray(center) + radius * rings)


def silhouette(view: View, line: np.ndarray, radii: np.ndarray) -> np.ndarray:
    """Quadrilaterals (n - 1, 4, 2) on paper that a round body about a line (n, 3) m covers."""
    flat = view.flat(line)
    along = np.gradient(flat, axis=0)
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-12)
    across = radii[:, None] * along[:, ::-1] * (1.0, -1.0)
    one, other = flat + across, flat - across
    return np.stack([one[:-1], one[1:], other[1:], other[:-1]], axis=1)


def extent(view: View, points: np.ndarray, margin: float) -> Bbox:
    """Box on paper around points (n, 3), with a margin in m."""
    flat = view.flat(points[np.isfinite(points).all(axis=1)])
    low, high = flat.min(axis=0) - margin, flat.max(axis=0) + margin
    return Bbox([low, high])


def frame(axes: Axes, view: View, box: Bbox) -> None:
    """Set equal scales on both axes, +Z down; views without labels get no axes."""
    axes.set_aspect("equal")
    axes.set_xlim(*((box.x1, box.x0) if view.mirrored else (box.x0, box.x1)))
    axes.set_ylim(box.y1, box.y0)
    size, inch = axes.get_window_extent(), axes.figure.dpi
    for axis, room in ((axes.xaxis, size.width / inch), (axes.yaxis, size.height / inch)):
        count = int(np.clip(3.6 * room, 1, 5))  # labels take less than a third of an inch
        axis.set_major_locator(MaxNLocator(count, steps=[1, 2, 4, 5, 10], min_n_ticks=1))
    if view.labels is not None:
        axes.set_xlabel(view.labels[0])
        axes.set_ylabel(view.labels[1])
    else:
        axes.set_axis_off()


def _round(length: float) -> float:
    """The largest of ..., 0.5, 1, 2, 5, 10, ... that is at most a length in m."""
    power = 10.0 ** np.floor(np.log10(length))
    first = max(digit for digit in (1, 2, 5) if digit * power <= length * (1 + 1e-9))
    return float(f"{first * power:.1g}")


def measure(axes: Axes, box: Bbox) -> None:
    """Draw a scale bar below a view without axes."""
    length = _round(0.3 * max(box.width, box.height))
    x, y = box.x0 + 0.03 * box.width, box.y1 + 0.02 * box.height
    axes.plot(
        [x, x + length], [y, y], color="k", linewidth=1.2, solid_capstyle="butt", clip_on=False
    )
    axes.annotate(
        f"{length:g} m", (x + length / 2, y), (0, -2), textcoords="offset points",
        ha="center", va="top", gid="measure", annotation_clip=False,
    )  # fmt: skip

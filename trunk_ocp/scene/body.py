"""The trunk as a body: where each muscle's material is in a deformed shape.

A point (R, Theta, Z) of the initial trunk moves with its cross-section,

    x = r(Z) + s f(Z) R (cos Theta d_1 + sin Theta d_2),

where R is its radius at Z = 0 (eq. 29). The scale s of the sections is one number for a shape, as
in eq. (30), chosen so that the whole trunk keeps its volume. The factor 1 / sqrt(mean extension) of
eq. (30), which the rod's stiffness uses, does that only if all sections extend equally. When the
trunk lifts a log, the thick base shortens by a third and the thin tip does not: that factor would
lose up to 12 % of the volume, 6 % of the radius. Sections stay plane and round, so the volume of a
single muscle in a bent trunk is not exactly that of its tissue.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..model.anatomy import Muscle, Trunk
from ..rod.collocation import gauss
from ..rod.shape import Shape

MAX_ARC_STEP = np.radians(7.5)  # between two points of an arc


@dataclass(frozen=True, eq=False)
class Frames:
    """Cross-sections of H shapes at n points.

    Z (n,) in m; position (H, n, 3) in m; directors (H, n, 3, 3), row i is d_i; scale (H, n), the
    factor on a radius at Z = 0 of the initial trunk.
    """

    Z: np.ndarray
    position: np.ndarray
    directors: np.ndarray
    scale: np.ndarray


def frames(trunk: Trunk, shape: Shape, Z: np.ndarray) -> Frames:
    """Cross-sections of shapes with one batch axis (H,) at points Z (n,) in m.

    Raises
    ------
    InputError
        If the shapes do not have exactly one batch axis.
    """
    if shape.states.ndim != 4:
        raise InputError(f"shape: expected one batch axis, got {shape.states.ndim - 3}.")
    position, directors = shape.position(Z), shape.directors(Z)
    return Frames(Z, position, directors, section_scale(trunk, shape)[:, None] * trunk.taper(Z))


def section_scale(trunk: Trunk, shape: Shape) -> np.ndarray:
    """Factor s on all radii that keeps the volume of each shape, (H,)."""
    mesh = shape.mesh
    weights = mesh.widths[:, None] * gauss(mesh.degree).integral(1.0)
    stretch = np.linalg.norm(shape.slopes, axis=-1)  # |dr/dZ| (H, elements, degree)
    area = np.asarray(trunk.taper(mesh.points)) ** 2
    scale: np.ndarray = np.sqrt((weights * area).sum() / (weights * area * stretch).sum((-1, -2)))
    return scale


def outline(muscle: Muscle) -> np.ndarray:
    """Outline (m, 2) of a muscle's cross-section at Z = 0, in m along d_1 and d_2.

    Counter-clockwise: the outer arc, then the inner arc backward, or the center if there is none.
    """
    inner, outer = muscle.radii
    first, second = muscle.sector
    Theta = np.linspace(first, second, 1 + _arc_steps(second - first))
    arc = np.stack([np.cos(Theta), np.sin(Theta)], axis=-1)
    return np.concatenate([outer * arc, inner * arc[::-1] if inner > 0 else np.zeros((1, 2))])


def disc(radius: float) -> np.ndarray:
    """Outline (m, 2) of the whole trunk at Z = 0, counter-clockwise."""
    Theta = np.linspace(0, 2 * np.pi, 1 + _arc_steps(2 * np.pi))[:-1]
    return radius * np.stack([np.cos(Theta), np.sin(Theta)], axis=-1)


def _arc_steps(angle: float) -> int:
    """Number of straight pieces of an arc; round-off in the angle does not add one."""
    return max(1, int(np.ceil(angle / MAX_ARC_STEP - 1e-9)))


@dataclass(frozen=True, eq=False)
class Body:
    """A closed moving surface: vertices (H, v, 3) in m, triangles (t, 3) seen from outside."""

    vertices: np.ndarray
    triangles: np.ndarray

    @property
    def volume(self) -> np.ndarray:
        """Volume inside, (H,) in m^3, by the divergence theorem."""
        a, b, c = (self.vertices[:, self.triangles[:, i]] for i in range(3))
        volume: np.ndarray = np.einsum("hti,hti->h", a, np.cross(b, c)) / 6
        return volume


def swept(section: np.ndarray, at: Frames, caps: np.ndarray) -> Body:
    """The body that an outline (m, 2) sweeps along cross-sections.

    caps : (k, 3), counter-clockwise triangles between the outline's points that fill it.
    """
    n, m = at.Z.size, len(section)
    radial = section * at.scale[..., None, None]  # (H, n, m, 2)
    vertices = at.position[:, :, None] + radial @ at.directors[:, :, :2]
    here = np.arange(n - 1)[:, None] * m + np.arange(m)
    beside = np.roll(here, -1, axis=1)
    sides = [np.stack([here, beside, beside + m], -1), np.stack([here, beside + m, here + m], -1)]
    triangles = [side.reshape(-1, 3) for side in sides] + [caps[:, ::-1], caps + (n - 1) * m]
    return Body(vertices.reshape(len(vertices), n * m, 3), np.concatenate(triangles))


def muscle_body(trunk: Trunk, muscle: Muscle, shape: Shape, sections: int = 24) -> Body:
    """The subdomain of a muscle in shapes (H,), on a number of cross-sections."""
    start, end = trunk.edges[muscle.segment], trunk.edges[muscle.segment + 1]
    Z = np.linspace(start, end, sections)
    section = outline(muscle)
    return swept(section, frames(trunk, shape, Z), _band(len(section), muscle.radii[0] > 0))


def trunk_body(trunk: Trunk, shape: Shape, sections: int = 120) -> Body:
    """The whole trunk in shapes (H,)."""
    Z = np.linspace(0.0, trunk.length, sections)
    return round_body(disc(trunk.base_radius), frames(trunk, shape, Z))


def core_body(trunk: Trunk, segment: int, shape: Shape, sections: int) -> Body:
    """The tissue inside the muscles of a segment, in shapes (H,), on a number of cross-sections."""
    Z = np.linspace(trunk.edges[segment], trunk.edges[segment + 1], sections)
    return round_body(disc(core_radius(trunk, segment)), frames(trunk, shape, Z))


def core_radius(trunk: Trunk, segment: int) -> float:
    """Radius in m at Z = 0 of the core that no muscle of a segment reaches into."""
    inner = (muscle.radii[0] for muscle in trunk.subdomains if muscle.segment == segment)
    return min(inner, default=trunk.base_radius)


def round_body(section: np.ndarray, at: Frames) -> Body:
    """The body that a round outline (m, 2) sweeps along cross-sections."""
    fan = np.arange(1, len(section) - 1)
    return swept(section, at, np.stack([np.zeros_like(fan), fan, fan + 1], axis=-1))


def _band(m: int, hollow: bool) -> np.ndarray:
    """Triangles (k, 3) that fill the outline of an annular sector, or of a sector if not hollow."""
    if not hollow:
        fan = np.arange(m - 2)
        return np.stack([fan, fan + 1, np.full_like(fan, m - 1)], axis=-1)
    half = np.arange(m // 2 - 1)
    back = m - 1 - half  # the inner point beside each outer one
    return np.concatenate(
        [np.stack([half, half + 1, back], -1), np.stack([half + 1, back - 1, back], -1)]
    )

"""What the numbers mean: axes, Z along the trunk, head angles, and what a contraction does."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, FancyArrowPatch

from trunk_ocp.figures import style
from trunk_ocp.figures.anatomy import draw_section
from trunk_ocp.figures.projection import (
    ABOVE,
    FRONT,
    SIDE,
    Surface,
    View,
    extent,
    facets_of,
    frame,
    paint,
)
from trunk_ocp.model.anatomy import Trunk
from trunk_ocp.model.solids import pivot
from trunk_ocp.rod.shape import Shape
from trunk_ocp.rod.statics import solve_statics
from trunk_ocp.scene.body import core_body, disc, frames, muscle_body, round_body
from trunk_ocp.scene.colors import group_colors

HEAD_ANGLE = np.radians(25.0)
CONTRACTION = -1.0
SECTIONS = 24
THIN = 0.15  # of the base radius; names do not fit into thinner muscles
SEGMENT_COLORS = ("#8796A5", "#AAB5C0", "#8796A5")
GHOST, ARROW, HEAD, CORE = "#E3E8EC", "#CC0055", "#F1EDE4", "#F4F4F4"
HEIGHT = 112.0  # mm


def draw_conventions(trunk: Trunk, folder: Path, formats: Sequence[str]) -> list[Path]:
    """Draw the trunk under its own weight with axes and signs; lengths in m.

    Axes X, Y, Z (+Z down); segments and Z from the base; head angles psi_Z and psi_Y (eq. 37); a
    cross-section in cm; one muscle with gamma < 0, and how the trunk bends.
    """
    with style.styled():
        return style.save(conventions_figure(trunk), folder, "conventions", formats)


def conventions_figure(trunk: Trunk) -> Figure:
    """The figure that `draw_conventions` writes."""
    figure = style.new_figure(HEIGHT)
    passive = _shape(trunk)
    _side_panel(figure.add_axes((0.0, 0.01, 0.48, 0.93)), trunk, passive)
    _above_panel(figure.add_axes((0.49, 0.57, 0.23, 0.37)), trunk, passive)
    _section_panel(figure.add_axes((0.83, 0.64, 0.16, 0.24)), trunk)
    if trunk.subdomains:
        _contraction_panels(figure, trunk, passive)
    return figure


def _shape(
    trunk: Trunk, head: tuple[float, float] = (0.0, 0.0), muscle: int | None = None
) -> Shape:
    activation = np.zeros(len(trunk.muscles))
    if muscle is not None:
        activation[muscle] = CONTRACTION
    return Shape.stack([solve_statics(trunk, activation, head)])


def _segments(trunk: Trunk, shape: Shape, colors: Sequence[str]) -> list[Surface]:
    """The trunk, with a color for each segment in turn."""
    section, surfaces = disc(trunk.base_radius), []
    for number, ends in enumerate(zip(trunk.edges[:-1], trunk.edges[1:], strict=True)):
        body = round_body(section, frames(trunk, shape, np.linspace(*ends, SECTIONS)))
        surfaces.append(Surface(facets_of(body, SECTIONS), colors[number % len(colors)]))
    return surfaces


def _muscles(trunk: Trunk, shape: Shape, chosen: int) -> list[Surface]:
    """The trunk as muscles and the tissue inside them, one muscle in the color of its group."""
    bodies = [muscle_body(trunk, muscle, shape, SECTIONS) for muscle in trunk.subdomains]
    shades = [SEGMENT_COLORS[muscle.segment % 3] for muscle in trunk.subdomains]
    shades[chosen] = group_colors(trunk)[trunk.subdomains[chosen].group]
    cores = [core_body(trunk, segment, shape, SECTIONS) for segment in range(trunk.segments)]
    return [
        Surface(facets_of(body, SECTIONS), color)
        for body, color in zip([*bodies, *cores], [*shades, *[CORE] * len(cores)], strict=True)
    ]


def _side_panel(axes: Axes, trunk: Trunk, passive: Shape) -> None:
    """From the right: axes, segments, Z and psi_Y."""
    turned = _shape(trunk, (0.0, HEAD_ANGLE))
    _head_panel(axes, SIDE, trunk, passive, turned, "$\\psi_Y > 0$:\nhead turns up")
    _name_segments(axes, trunk, passive)
    corner, arm = np.array([-0.5, 0.0, 0.7]) * trunk.length, 0.17 * trunk.length
    for end, name, side in (
        ((arm, 0, 0), " X, forward", "left"),
        ((0, 0, arm), "\nZ, down", "center"),
    ):
        a, b = SIDE.flat(corner), SIDE.flat(corner + end)
        axes.annotate("", tuple(b), tuple(a), arrowprops={"arrowstyle": "-|>", "shrinkA": 0})
        _write(axes, b, name, ha=side, va="center")
    axes.plot(*SIDE.flat(corner), "o", color=style.INK, markersize=5, markerfacecolor="white")
    axes.plot(*SIDE.flat(corner), ".", color=style.INK, markersize=2)
    axes.annotate("Y, to the elephant's right\n(toward you)", tuple(SIDE.flat(corner)), (0, 6),
                  textcoords="offset points", ha="left", va="bottom")  # fmt: skip
    end = corner + np.array([0, 0, 0.24 * trunk.length])
    _fit(axes, SIDE, trunk, [passive, turned], np.stack([corner, end]))
    axes.set_title("Seen from the elephant's right", fontweight="bold")


def _name_segments(axes: Axes, trunk: Trunk, passive: Shape) -> None:
    """Names of the segments, and Z in m at their ends, along the ventral side."""
    edges = np.array(trunk.edges)
    names = {0: " (base)", len(edges) - 1: " (tip)"}
    for number, Z in enumerate(edges.tolist()):
        side = 1.0 if number == 0 else -1.0  # the base's ventral side is inside the head
        start, end = (_beside(trunk, passive, Z, side * out) for out in (1.0, 1.5))
        axes.plot(*np.stack([start, end]).T, color=style.INK, linewidth=0.8, zorder=4)
        place, text = end + side * np.array([0.01, -0.02]), f"Z = {Z:.3g} m{names.get(number, '')}"
        ha, va = ("center", "bottom") if side > 0 else ("right", "center")
        _write(axes, place, text, ha=ha, va=va)
    for number, Z in enumerate((edges[:-1] + edges[1:]) / 2, 1):
        place, look = _beside(trunk, passive, float(Z), -1.2), {"ha": "right", "va": "center"}
        _write(axes, place, f"segment {number}", color=style.FAINT, fontweight="bold", **look)


def _beside(trunk: Trunk, shape: Shape, Z: float, out: float) -> np.ndarray:
    """Point of the side view on the dorsal side of the centerline, `out` radii away from it."""
    at = np.array([Z])
    offset = out * float(trunk.radius(Z)) * shape.directors(at)[0, 0, 0]
    return SIDE.flat(shape.position(at)[0, 0] + offset)


def _above_panel(axes: Axes, trunk: Trunk, passive: Shape) -> None:
    """From above: psi_Z."""
    turned = _shape(trunk, (HEAD_ANGLE, 0.0))
    _head_panel(axes, ABOVE, trunk, passive, turned, "$\\psi_Z > 0$:\nhead\nturns\nright")
    _fit(axes, ABOVE, trunk, [passive, turned])
    axes.set_title("From above", fontweight="bold")


def _head_panel(
    axes: Axes, view: View, trunk: Trunk, passive: Shape, turned: Shape, label: str
) -> None:
    """Head and trunk at rest, over a pale trunk with the head turned, and an arrow to it."""
    radius = trunk.head.pivot_radius
    if radius > 0:
        center = view.flat(pivot(trunk))
        axes.add_patch(Circle(tuple(center), radius, color=HEAD, linewidth=0, zorder=0.5))
        _write(axes, (center - (0.35 * radius, 0)), "head", ha="center", va="center")
    paint(axes, view, _segments(trunk, turned, [GHOST]), zorder=1, darkest=0.85)
    paint(axes, view, _segments(trunk, passive, SEGMENT_COLORS), zorder=2)
    tip, gap = np.array([trunk.length]), 0.05 * trunk.length
    start, end = (view.flat(shape.position(tip)[0, 0]) for shape in (passive, turned))
    axes.add_patch(
        FancyArrowPatch(
            (start[0] + gap, start[1]), tuple(end), arrowstyle="-|>", mutation_scale=9,
            color=ARROW, connectionstyle="arc3,rad=0.2", zorder=5, linewidth=1.2,
        )
    )  # fmt: skip
    _write(axes, ((start + end) / 2 + (2 * gap, 0)), label, color=ARROW, ha="left", va="center")


def _section_panel(axes: Axes, trunk: Trunk) -> None:
    """Cross-section at the base with the names of the muscle groups."""
    draw_section(axes, trunk, 0)
    to_cm = 100 * float(trunk.taper(0.0))
    reach, corners = 103 * trunk.base_radius, iter((1, -1))
    for number, muscle in enumerate(trunk.subdomains):
        if muscle.segment == 0 and muscle.side == "R":
            share = 0.82 if number % 2 else 0.55  # neighbors' names would overlap at one angle
            Theta = np.dot(muscle.sector, (1 - share, share))
            radius, look = sum(muscle.radii) / 2, {"fontsize": 5.5, "fontweight": "bold"}
            place = to_cm * radius * np.array([np.sin(Theta), np.cos(Theta)])
            if np.diff(muscle.radii)[0] > THIN * trunk.base_radius:
                _write(axes, place, muscle.group, color="white", ha="center", va="center", **look)
            else:  # outside, in a corner, with a line to the muscle on that side
                side, color = next(corners), group_colors(trunk)[muscle.group]
                axes.annotate(
                    muscle.group, (side * place[0], place[1]), (side * reach, -reach),
                    ha="right" if side > 0 else "left", va="bottom", color=color, **look,
                    arrowprops={"arrowstyle": "-", "linewidth": 0.6, "shrinkA": 0, "shrinkB": 0},
                )  # fmt: skip
    axes.set_title("Cross-section\nseen from the base", fontweight="bold")
    axes.set_ylabel("$d_1$, dorsal (cm)")


def _contraction_panels(figure: Figure, trunk: Trunk, passive: Shape) -> None:
    """The first muscle contracts, seen from the right and from the front."""
    name, bent = trunk.muscles[0], _shape(trunk, muscle=0)
    for view, left, side in ((SIDE, 0.5, "from the right"), (FRONT, 0.76, "from the front")):
        axes = figure.add_axes((left, 0.01, 0.24, 0.37))
        paint(axes, view, _segments(trunk, passive, [GHOST]), zorder=1, darkest=0.85)
        paint(axes, view, _muscles(trunk, bent, 0), zorder=2)
        _fit(axes, view, trunk, [passive, bent], head=False)
        axes.set_title(side, color=style.FAINT)
    title = f"Muscle {name} contracts: $\\gamma = {CONTRACTION:g}$"
    figure.text(0.5, 0.5, title, fontweight="bold", fontsize=7.5)
    text = (
        "$\\gamma < 0$ shortens its fibers, and the trunk bends toward it: here up\n"
        "and to the right. Pale: no muscle contracts, $\\gamma = 0$."
    )
    figure.text(0.5, 0.46, text, va="center")


def _write(axes: Axes, place: np.ndarray, text: str, **look: Any) -> None:
    axes.text(float(place[0]), float(place[1]), text, **look)


def _fit(
    axes: Axes,
    view: View,
    trunk: Trunk,
    shapes: Sequence[Shape],
    more: np.ndarray | None = None,
    head: bool = True,
) -> None:
    """Show all of some shapes, of more points (n, 3) in m and of the head."""
    Z = np.linspace(0.0, trunk.length, 30)
    points = [shape.position(Z)[0] for shape in shapes] + ([] if more is None else [more])
    if head and trunk.head.pivot_radius > 0:
        around = np.stack([view.across, -view.across, view.down, -view.down])
        points.append(pivot(trunk) + (trunk.head.pivot_radius - trunk.base_radius) * around)
    frame(axes, view, extent(view, np.concatenate(points), 1.05 * trunk.base_radius))
    axes.set_axis_off()
    axes.set_anchor("N")

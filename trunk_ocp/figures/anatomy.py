"""The muscles of a trunk: cross-sections and an exploded view (figs. 3b-d)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Patch, Polygon
from matplotlib.ticker import MaxNLocator

from ..model.anatomy import Muscle, Trunk
from ..model.loads import Loads
from ..rod.shape import Shape
from ..rod.statics import solve_statics
from ..scene.body import muscle_body, outline
from ..scene.colors import group_colors, groups
from . import style
from .projection import Surface, extent, facets_of, frame, measure, paint, toward

# On paper the base is at the left: in the trunk's own axes d3 points right and d1, dorsal, up.
DORSAL = toward("dorsal", (1.0, 0.0, 0.0), below=(0.0, 1.0, 0.0))
EXPLODED = toward("exploded", (0.45, 0.8, -0.6), below=(-1.0, 0.0, 0.0))
SECTIONS = 36  # of the whole trunk; each segment has its share
NAME_WIDTH = 1.9  # mm of a letter
LEGEND_LINE = 3.6  # mm, height of a line of the legend
MAX_GAP, ALL_GAPS = 0.12, 0.6  # of the trunk's length, between exploded segments: one, and all
MARGIN = 0.02 / 1.75  # of the trunk's length, around all muscles
MUSCLE_OFFSET = 1.1  # of the base radius; how far exploded muscles move outward


def draw_anatomy(
    trunk: Trunk, folder: str | Path, formats: Sequence[str] = style.FORMATS
) -> list[Path]:
    """Draw the muscles of a trunk: cross-sections in cm, bodies in m (figs. 3b-d).

    Returns the files written.
    """
    with style.styled():
        paths = style.save(sections_figure(trunk), folder, "anatomy-sections", formats)
        if trunk.subdomains:
            paths += style.save(bodies_figure(trunk), folder, "anatomy-exploded", formats)
    return paths


@style.self_contained
def sections_figure(trunk: Trunk) -> Figure:
    """Cross-sections of every segment in cm, all to one scale."""
    shown = style.shown_segments(trunk)
    width = min(style.WIDTH, 60.0 * len(shown))
    columns = 3 if width > 100 else 2 if width > 60 or len(groups(trunk)) > 3 else 1
    header = max(14.0, 7 + LEGEND_LINE * np.ceil(len(groups(trunk)) / columns))
    height = (width - 14) / len(shown) + 12 + header
    figure = style.new_figure(height, width)
    grid = figure.add_gridspec(
        1, len(shown), left=12 / width, right=1 - 2 / width, top=1 - header / height,
        bottom=8 / height, wspace=0.18,
    )  # fmt: skip
    panels = grid.subplots(squeeze=False, sharex=True, sharey=True)[0]
    for segment, axes in zip(shown, panels, strict=True):
        draw_section(axes, trunk, segment)
    panels[0].set_ylabel("$d_1$, dorsal (cm)")
    figure.legend(
        handles=_legend(trunk), loc="upper center", ncols=columns,
        handlelength=1, columnspacing=1,
    )  # fmt: skip
    return figure


def _legend(trunk: Trunk) -> list[Patch]:
    names = group_colors(trunk).items()
    return [
        Patch(color=c, label=f"{g}: {style.full_name(g)}" if g in style.NAMES else g)
        for g, c in names
    ]


def draw_section(axes: Axes, trunk: Trunk, segment: int) -> None:
    """Draw a segment's muscles at its start, seen from the base: right is on the right."""
    start = trunk.edges[segment]
    to_cm = 100 * float(trunk.taper(start))
    radius = to_cm * trunk.base_radius
    axes.add_patch(Circle((0, 0), radius, facecolor="#F4F4F4"))
    axes.add_patch(  # over the white edges of muscles
        Circle((0, 0), radius, fill=False, edgecolor=style.INK, linewidth=0.6, zorder=3)
    )
    for muscle in trunk.subdomains:
        if muscle.segment == segment:
            color = group_colors(trunk)[muscle.group]
            corners = to_cm * outline(muscle)[:, ::-1]
            axes.add_patch(
                Polygon(corners, facecolor=color, edgecolor="white", linewidth=0.5, gid=muscle.name)
            )
    reach = 105 * trunk.base_radius
    wide = trunk.segments <= 3
    axes.set_xlim(-reach, reach)
    axes.set_ylim(-reach, reach)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(4))
    axes.set_aspect("equal")
    title = style.segment_title(trunk, segment)
    axes.set_title(f"{title}, from Z = {start:.3g} m" if wide else f"{title}\nZ = {start:.3g} m")
    axes.set_xlabel("$d_2$, right (cm)")


@style.self_contained
def bodies_figure(trunk: Trunk) -> Figure:
    """Left: each group from above (dorsal); right: all muscles, moved outward."""
    relaxed = np.zeros((1, len(trunk.subdomains)))
    straight = solve_statics(trunk, relaxed, loads=Loads(gravity=0.0))
    names = groups(trunk)
    height = max(12.0 * len(names), 60.0) + 12
    figure = style.new_figure(height)
    bodies = [(muscle, _facets(trunk, muscle, straight)) for muscle in trunk.subdomains]
    margin = MARGIN * trunk.length
    box = extent(DORSAL, np.concatenate([b.reshape(-1, 3) for _, b in bodies]), margin)
    colors = group_colors(trunk)
    tall = (height - 12) / len(names)
    left = min(0.005 + NAME_WIDTH * max(len(group) for group in names) / style.WIDTH, 0.15)
    left = max(left, 0.04)
    for row, group in enumerate(names):
        bottom = (height - 6 - tall * (row + 1)) / height
        axes = figure.add_axes((left, bottom, 0.44 - left, tall / height))
        chosen = [Surface(body, colors[group]) for m, body in bodies if m.group == group]
        paint(axes, DORSAL, chosen)
        frame(axes, DORSAL, box)
        if row == len(names) - 1:
            measure(axes, box)
        name = style.escaped(style.shortened(group, int(0.145 * style.WIDTH / NAME_WIDTH)))
        figure.text(0.005, bottom + tall / height / 2, name, color=colors[group], va="center",
                    fontweight="bold")  # fmt: skip
    _exploded(figure, trunk, bodies)
    figure.text(0.24, 1 - 1 / height, "each group, dorsal view", ha="center", va="top")
    figure.text(0.72, 1 - 1 / height, f"all {len(bodies)} muscles, moved apart", ha="center",
                va="top")  # fmt: skip
    return figure


def _exploded(figure: Figure, trunk: Trunk, bodies: list[tuple[Muscle, np.ndarray]]) -> None:
    moved = []
    gap = min(MAX_GAP, ALL_GAPS / trunk.segments)
    for muscle, body in bodies:
        Theta = sum(muscle.sector) / 2
        outward = np.array([np.cos(Theta), np.sin(Theta), 0.0])
        middle = sum(muscle.radii) / 2
        along = np.array([0.0, 0, gap * trunk.length * muscle.segment])
        moved.append(body + (MUSCLE_OFFSET * (0.3 + middle / trunk.base_radius)) * trunk.base_radius
                     * outward + along)  # fmt: skip
    box = extent(
        EXPLODED, np.concatenate([body.reshape(-1, 3) for body in moved]), MARGIN * trunk.length
    )
    height = figure.get_figheight() / style.MM
    axes = figure.add_axes((0.46, 6 / height, 0.53, 1 - 12 / height))
    colors = group_colors(trunk)
    pairs = zip(bodies, moved, strict=True)
    paint(axes, EXPLODED, [Surface(body, colors[muscle.group]) for (muscle, _), body in pairs])
    frame(axes, EXPLODED, box)
    measure(axes, box)


def _facets(trunk: Trunk, muscle: Muscle, straight: Shape) -> np.ndarray:
    """A muscle's facets (k, 4, 3) in the trunk's own axes (d1, d2, d3), m."""
    sections = max(SECTIONS // trunk.segments, 2)
    body = muscle_body(trunk, muscle, straight, sections)
    base = np.zeros(1)
    local = (body.vertices[0] - straight.position(base)[0, 0]) @ straight.directors(base)[0, 0].T
    return facets_of(replace(body, vertices=local[None]), sections)

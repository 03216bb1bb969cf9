"""Each muscle group alone, deformed and colored by activation (figs. 5, 7, 9)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from ..model.anatomy import Trunk
from ..planning.active_bounds import limits
from ..planning.plan import Plan
from ..scene.body import muscle_body
from ..scene.colors import group_colors, groups
from ..scene.moments import Moment, end_of, moments_at, times_of_motion
from . import style
from .projection import Surface, extent, facets_of, frame, measure, paint, toward

ACTIVATION = "YlOrRd"  # darker is stronger, to any color vision and in gray
SECTIONS = 10
MIN_COLUMN = 16.0  # mm; the figure grows with the number of groups
LETTER_WIDTH = 1.6  # mm, in a heading
MARGIN = 0.02 / 1.75  # of the trunk's length, around it
DARKEST = 0.8  # light shading, so that it is not mistaken for activation
# Each side as seen from beside the elephant, slightly in front and above.
VIEWS = {side: toward(side, (0.35, y, -0.25)) for side, y in (("R", 1.0), ("L", -1.0))}


def draw_muscles(plan: Plan, folder: Path, formats: Sequence[str]) -> list[Path]:
    """Draw each muscle group alone at several times, colored by |activation| (figs. 5, 7, 9).

    A figure for each side; columns are groups, rows times in s. Muscles are their subdomains in the
    deformed trunk, seen from their own side; the thin line is the trunk's centerline.
    """
    trunk = plan.motion.trunk
    end = end_of(plan)
    moments = moments_at(plan, times_of_motion(plan) if end > 0 else np.zeros(1))
    paths: list[Path] = []
    if not moments:
        return paths
    with style.styled():
        for side, (name, _) in style.SIDES.items():
            if any(muscle.side == side for muscle in trunk.subdomains):
                figure = muscles_figure(plan, moments, side)
                paths += style.save(figure, folder, f"muscles-{name}", formats)
    return paths


def muscles_figure(plan: Plan, moments: list[Moment], side: str) -> Figure:
    """One of the figures that `draw_muscles` writes, for side "R" or "L"."""
    trunk, view, name = plan.motion.trunk, VIEWS[side], style.SIDES[side][0]
    names = groups(trunk)
    Z = np.linspace(0, trunk.length, 50)
    lines = [moment.shape.position(Z)[0] for moment in moments]
    box = extent(view, np.concatenate(lines), trunk.base_radius + MARGIN * trunk.length)
    left, right, above, below = 13.0, 2.0, 14.0, 17.0  # mm
    page = max(style.WIDTH, left + right + MIN_COLUMN * len(names))
    width = (page - left - right) / len(names)
    tall = min(width * box.height / box.width, 34.0)
    height = above + below + tall * len(moments)
    figure = style.new_figure(height, page)
    title = f"{style.title(plan.motion)} ({plan.mode}{style.unsolved_note(plan)})"
    style.headline(figure, f"{title}: {name} muscles, seen from the {name}")
    scale = Normalize(0.0, strongest(plan))
    for row, (moment, line) in enumerate(zip(moments, lines, strict=True)):
        bottom = (below + tall * (len(moments) - 1 - row)) / height
        middle, text = bottom + tall / height / 2, f"t =\n{moment.time:.2f} s"
        text += ",\nafter\nloads\njumped" if moment.after else ""
        figure.text(1.5 / page, middle, text, va="center")
        for column, group in enumerate(names):
            x = (left + column * width) / page
            axes = figure.add_axes((x, bottom, width / page, tall / height))
            axes.plot(*view.flat(line).T, color=style.FAINT, linewidth=0.5, zorder=1)
            paint(axes, view, _surfaces(plan, moment, group, side, scale), darkest=DARKEST)
            frame(axes, view, box)
            if row == 0:
                _head_column(axes, trunk, group, int(width / LETTER_WIDTH))
            if column == 0 and row == len(moments) - 1:  # one bar for all
                measure(axes, box)
    color_bar(figure, scale)
    return figure


def _head_column(axes: Axes, trunk: Trunk, group: str, most: int) -> None:
    named = f"{group}\n{style.full_name(group)}"
    axes.set_title(
        named if group in style.NAMES else style.shortened(group, most),
        color=group_colors(trunk)[group], fontsize=6.5, fontweight="bold", pad=2,
    )  # fmt: skip


def _surfaces(plan: Plan, moment: Moment, group: str, side: str, scale: Normalize) -> list[Surface]:
    trunk = plan.motion.trunk
    surfaces = []
    for index, muscle in enumerate(trunk.subdomains):
        if muscle.side == side and muscle.group == group:
            body = muscle_body(trunk, muscle, moment.shape, SECTIONS)
            color = activation_color(scale, moment.activation[index])
            surfaces.append(Surface(facets_of(body, SECTIONS), color))
    return surfaces


def activation_color(scale: Normalize, activation: float) -> tuple[float, float, float]:
    """Color of a muscle with an activation."""
    return matplotlib.colormaps[ACTIVATION](float(scale(abs(activation))))[:3]


def strongest(plan: Plan) -> float:
    """Upper end of the color bar: the bound on |activation|, or a plan's largest if beyond it."""
    count = len(plan.motion.trunk.muscles)
    values = [bound[:, :count].ravel() for bound in limits(plan)] + [
        plan.trajectory[:, :-2].ravel()
    ]
    return float(np.nanmax(np.abs(np.concatenate(values)), initial=0.0)) or 1.0


def color_bar(figure: Figure, scale: Normalize) -> None:
    """Draw the color bar of |activation| at the bottom of a figure."""
    height = figure.get_figheight() / style.MM
    axes = figure.add_axes((0.3, 9.0 / height, 0.4, 2.2 / height))
    mapped = ScalarMappable(scale, matplotlib.colormaps[ACTIVATION])
    figure.colorbar(mapped, cax=axes, orientation="horizontal", label="|activation| (no unit)")

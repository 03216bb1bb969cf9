"""Each muscle group alone, deformed and colored by activation (figs. 5, 7, 9)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox

from ..model.anatomy import Trunk
from ..planning.plan import Plan
from ..scene.body import muscle_body, section_scale
from ..scene.colors import group_colors, groups
from ..scene.moments import Moment, end_of, moments_at, times_of_motion
from . import style
from .activation_colors import activation_color, color_bar, strongest
from .projection import (
    Surface,
    View,
    extent,
    facets_of,
    frame,
    measure,
    paint,
    silhouette,
    toward,
)

SILHOUETTE = "#D9DDE1"  # of the trunk, behind its muscles
SECTIONS = 30  # of the whole trunk; each segment has its share
ABOVE, BELOW, RIGHT = 14.0, 17.0, 2.0  # mm, around the panels
MAX_COLUMNS = 6  # of a page
MIN_COLUMN = 16.0  # mm; a figure of more groups is wider
MAX_HEIGHT = 200.0  # mm, of all rows together
MAX_LENGTH = 75.0  # mm on paper for the trunk's length
LETTER_WIDTH = 1.55  # mm, in a heading
MARGIN = 0.02 / 1.75  # of the trunk's length, around it
ALIKE = 0.03, 0.1  # of the trunk's length, and of the strongest activation
DARKEST = 0.8  # light shading, so that it is not mistaken for activation
# Each side as seen from beside the elephant, slightly in front and above.
VIEWS = {side: toward(side, (0.35, y, -0.25)) for side, y in (("R", 1.0), ("L", -1.0))}


def draw_muscles(plan: Plan, folder: Path, formats: Sequence[str]) -> list[Path]:
    """Draw each muscle group alone at several times, colored by |activation| (figs. 5, 7, 9).

    A figure for each side, of several pages if there are many groups; columns are groups, rows
    times in s. Neighboring times at which the trunk is alike share a row. Muscles are their
    subdomains in the deformed trunk, whose silhouette is gray, seen from their own side.
    """
    trunk = plan.motion.trunk
    end = end_of(plan)
    moments = moments_at(plan, times_of_motion(plan) if end > 0 else np.zeros(1))
    paths: list[Path] = []
    if not moments:
        return paths
    with style.styled():
        for side, (name, _) in style.SIDES.items():
            of_side = {muscle.group for muscle in trunk.subdomains if muscle.side == side}
            names = [group for group in groups(trunk) if group in of_side]
            for page in range(0, len(names), MAX_COLUMNS):
                figure = muscles_figure(plan, moments, side, names[page : page + MAX_COLUMNS])
                number = f"-{page // MAX_COLUMNS + 1}" if page else ""
                paths += style.save(figure, folder, f"muscles-{name}{number}", formats)
    return paths


@style.self_contained
def muscles_figure(
    plan: Plan, moments: list[Moment], side: str, names: Sequence[str] | None = None
) -> Figure:
    """One of the figures that `draw_muscles` writes: for side "R" or "L", of some groups or all."""
    trunk, view = plan.motion.trunk, VIEWS[side]
    names = groups(trunk) if names is None else names
    times = _different(plan, moments)
    Z = np.linspace(0, trunk.length, 50)
    lines = [time[-1].shape.position(Z)[0] for time in times]
    margin = trunk.base_radius + MARGIN * trunk.length
    boxes = [extent(view, line, margin) for line in lines]
    grid = max(
        (_grid(trunk, boxes, len(names), across) for across in (False, True)),
        key=lambda grid: (grid.scale, not grid.times_across),
    )
    figure = style.new_figure(grid.height, grid.page)
    title = f"{style.title(plan.motion)} ({plan.mode}{style.unsolved_note(plan)})"
    whose = style.SIDES[side][0]
    style.headline(figure, f"{title}: {whose} muscles, seen from the {whose}")
    colors = Normalize(0.0, strongest(plan))
    for number, (time, line, box) in enumerate(zip(times, lines, boxes, strict=True)):
        _label(figure, grid, number, grid.times_across, _times(time), style.INK, "time")
        for index, group in enumerate(names):
            axes = figure.add_axes(grid.place(number, index, box))
            _silhouette(axes, view, trunk, time[-1], line, Z)
            paint(axes, view, _surfaces(plan, time[-1], group, side, colors), darkest=DARKEST)
            frame(axes, view, box)
            if grid.lowest_left(number, index):  # one bar for all
                measure(axes, box)
    for index, group in enumerate(names):
        heading, color = _heading(group, grid), group_colors(trunk)[group]
        _label(figure, grid, index, not grid.times_across, heading, color, "heading")
    color_bar(figure, colors)
    return figure


@dataclass(frozen=True, eq=False)
class _Grid:
    """Columns and rows of panels, in mm: times down and groups across, or the other way round."""

    times_across: bool
    scale: float
    widths: np.ndarray
    heights: np.ndarray
    left: float
    page: float
    height: float

    def place(self, time: int, group: int, box: Bbox) -> tuple[float, float, float, float]:
        """Place in the figure of the panel of a time and a group, in the middle of its cell."""
        column, row = (time, group) if self.times_across else (group, time)
        wide, high = self.scale * box.width, self.scale * box.height
        x, y = self.middle(column, True) - wide / 2, self.middle(row, False) - high / 2
        return x / self.page, y / self.height, wide / self.page, high / self.height

    def middle(self, number: int, across: bool) -> float:
        """Middle of a column from the left, or of a row from the bottom."""
        sizes = self.widths if across else self.heights
        along = float(sizes[:number].sum() + sizes[number] / 2)
        return self.left + along if across else self.height - ABOVE - along

    def lowest_left(self, time: int, group: int) -> bool:
        """Whether the panel of a time and a group is in the corner at the lower left."""
        column, row = (time, group) if self.times_across else (group, time)
        return column == 0 and row == len(self.heights) - 1


def _grid(trunk: Trunk, boxes: list[Bbox], groups: int, times_across: bool) -> _Grid:
    """The largest grid on a page: rows as high, or columns as wide, as each time needs."""
    wide, high = np.array([box.width for box in boxes]), np.array([box.height for box in boxes])
    if times_across:
        left, widths, heights = 26.0, wide, np.full(groups, high.max())
    else:
        left, widths, heights = 15.0, np.full(groups, wide.max()), high
    page = max(style.WIDTH, left + RIGHT + MIN_COLUMN * len(widths))
    usable = page - left - RIGHT
    scale = min(usable / widths.sum(), MAX_HEIGHT / heights.sum(), MAX_LENGTH / trunk.length)
    widths = scale * widths + (usable - scale * widths.sum()) / len(widths)
    height = ABOVE + BELOW + scale * heights.sum()
    return _Grid(times_across, scale, widths, scale * heights, left, page, height)


def _label(
    figure: Figure, grid: _Grid, number: int, across: bool, text: str, color: str, gid: str
) -> None:
    """Write what a column, or a row, shows."""
    bold = "bold" if gid == "heading" else "normal"
    if across:
        x, y = grid.middle(number, True) / grid.page, 1 - 7.0 / grid.height
        if gid == "heading":
            text = _fitting(text, grid.widths[number])
        figure.text(x, y, text, color=color, ha="center", va="top", fontweight=bold,
                    fontsize=6.5, gid=gid)  # fmt: skip
    else:
        y = grid.middle(number, False) / grid.height
        if gid == "heading":
            text = _fitting(text, grid.left - 1.5)
        figure.text(1.5 / grid.page, y, text, color=color, va="center", fontweight=bold,
                    fontsize=6.5, gid=gid)  # fmt: skip


def _heading(group: str, grid: _Grid) -> str:
    if group not in style.NAMES:
        return group
    full = style.full_name(group)
    return f"{group}\n{full.replace(' ', chr(10)) if grid.times_across else full}"


def _fitting(text: str, width: float) -> str:
    """Lines of a heading, shortened to a width in mm."""
    most = max(int(width / LETTER_WIDTH), 4)
    return "\n".join(style.escaped(style.shortened(line, most)) for line in text.split("\n"))


def _different(plan: Plan, moments: list[Moment]) -> list[list[Moment]]:
    """Moments in groups of neighbors that look alike."""
    trunk = plan.motion.trunk
    Z = np.linspace(0, trunk.length, 9)
    apart, stronger = ALIKE[0] * trunk.length, ALIKE[1] * strongest(plan)
    rows = [[moments[0]]]
    for moment in moments[1:]:
        first = rows[-1][0]
        moved = np.abs(moment.shape.position(Z) - first.shape.position(Z)).max()
        changed = np.abs(moment.activation - first.activation).max(initial=0.0)
        if moved < apart and changed < stronger:
            rows[-1].append(moment)
        else:
            rows.append([moment])
    return rows


def _times(row: list[Moment]) -> str:
    """Label of a row: its time, or the first and the last of moments that are alike."""
    first, last = row[0], row[-1]
    jumped = "\n(loads\njumped)" if last.after else ""
    if first.time < last.time:
        return f"t =\n{first.time:.2f} to\n{last.time:.2f} s{jumped}"
    return f"t =\n{last.time:.2f} s{jumped if first.after else ''}"


def _silhouette(
    axes: Axes, view: View, trunk: Trunk, moment: Moment, line: np.ndarray, Z: np.ndarray
) -> None:
    scale = section_scale(trunk, moment.shape)[0]
    radii = scale * trunk.base_radius * np.asarray(trunk.taper(Z))
    outlines: Any = silhouette(view, line, radii)
    axes.add_collection(
        PolyCollection(
            outlines, facecolors=SILHOUETTE, edgecolors=SILHOUETTE,
            linewidths=0.25, zorder=1, gid="silhouette",
        ),
        autolim=False,
    )  # fmt: skip


def _surfaces(plan: Plan, moment: Moment, group: str, side: str, scale: Normalize) -> list[Surface]:
    trunk = plan.motion.trunk
    surfaces, sections = [], sections_of(trunk)
    for index, muscle in enumerate(trunk.subdomains):
        if muscle.side == side and muscle.group == group:
            body = muscle_body(trunk, muscle, moment.shape, sections)
            color = activation_color(scale, moment.activation[index])
            surfaces.append(Surface(facets_of(body, sections), color))
    return surfaces


def sections_of(trunk: Trunk) -> int:
    """Cross-sections of a muscle: a share of `SECTIONS`, two at least."""
    return max(SECTIONS // trunk.segments, 2)

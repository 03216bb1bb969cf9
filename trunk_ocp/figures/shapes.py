"""The trunk through each phase, with head, log, targets and errors (figs. 4a-c, 6a-b, 8a-d)."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.transforms import Bbox
from scipy.interpolate import make_interp_spline

from .._support.wording import rounded
from ..planning.plan import Plan
from ..scene.body import frames, round_body
from ..scene.colors import HEAD, MASS, OBSTACLE, TARGET, WOOD
from ..scene.moments import Moment, moments_at, times_of_phase
from ..scene.surroundings import Log, Mark, TipMass, logs, marks, tip_mass
from . import style
from .bodies import joined_with_head, mass_surfaces, solid_surfaces
from .projection import (
    FACETS,
    FRONT,
    SIDE,
    Surface,
    View,
    cylinder,
    extent,
    facets_of,
    frame,
    measure,
    paint,
    three_quarter,
)

EARLY_TO_LATE = LinearSegmentedColormap.from_list("time", ["#E3E6EA", "#5B6670"])
LOG_PATH = "#5A3E12"
SECTIONS = 36
HEADER = 6.0  # mm, for the title
LEGEND_ENTRIES = 6  # in a row
ARROW = 0.1  # of the trunk's length
FORESHORTENED = 0.3  # of its length, below which an arrow is a symbol
CAPTION = 118  # letters in a line
MARGIN = 0.035  # of the trunk's length, around all that is drawn
MAX_HEIGHT = 225.0  # mm, of all rows together: a page
MAX_ROWS = 5  # on a page; if there are more phases, several share a row
MAX_TIPS = 61  # computed points of the tip's path through a phase
SMOOTH = 60  # points of the curve through them
MAX_TRUNKS = 6  # in a row
MAX_LENGTH = 105.0  # mm on paper for the trunk's length, even where it moves little


@dataclass(frozen=True, eq=False)
class Row:
    """What one phase shows, or all phases from `number` to `last`.

    `log_paths` has, for each log, its centers (n, 3) in m at the phase's steps; `tips` (n, 3) m is
    the path of the tip.
    """

    number: int
    trunks: list[Moment]
    logs: list[Log]
    log_paths: list[np.ndarray]
    mass: TipMass | None
    marks: list[Mark]
    tips: np.ndarray
    last: int | None = None


def draw_shapes(plan: Plan, folder: Path, formats: Sequence[str]) -> list[Path]:
    """Draw trunk shapes through each phase; positions in m (figs. 4a-c, 6a-b, 8a-d).

    A row for each phase, or for several together if there are many; from left to right the side,
    the front and a three-quarter view, all to one scale. Time runs from light to dark, later shapes
    over earlier ones. A trunk that passes through the head or a log is drawn doing so.
    """
    with style.styled():
        return style.save(shapes_figure(plan, rows_of(plan)), folder, "shapes", formats)


def rows_of(plan: Plan) -> list[Row]:
    """Rows of the figure: one for each phase with planned steps, or else the trunk at the start."""
    numbers = dict.fromkeys(step.phase for step in plan.motion.steps[: len(plan.x)])
    if not numbers:
        return [Row(0, moments_at(plan, np.zeros(1)), [], [], None, [], np.zeros((0, 3)))]
    return merged([row_of(plan, number) for number in numbers])


def row_of(plan: Plan, number: int) -> Row:
    """What a phase with planned steps shows."""
    steps = [i for i, s in enumerate(plan.motion.steps[: len(plan.x)]) if s.phase == number]
    trunks = moments_at(plan, times_of_phase(plan, number), number)
    cylinders = logs(plan)
    log_paths = [log.centers[steps[0] : steps[-1] + 2] for log in cylinders]  # row 0 is the start
    tips = _tip_path(plan, number, len(steps))
    return Row(number, trunks, cylinders, log_paths, tip_mass(plan), marks(plan, steps[-1]), tips)


def _tip_path(plan: Plan, number: int, steps: int) -> np.ndarray:
    """Path (n, 3) in m of the tip through a phase: a curve through some computed points."""
    tip = np.array([plan.motion.trunk.length])
    count = min(max(9, 2 * steps + 1), MAX_TIPS)
    moments = moments_at(plan, times_of_phase(plan, number, count), number)
    tips = np.array([moment.shape.position(tip)[0, 0] for moment in moments]).reshape(-1, 3)
    if len(tips) < 3 or plan.motion.phases[number].interpolation == "none":
        return tips
    times = np.array([moment.time for moment in moments])
    fine = np.unique([*times, *np.linspace(times[0], times[-1], SMOOTH)])
    smooth: np.ndarray = make_interp_spline(times, tips, k=min(3, len(tips) - 1))(fine)
    return smooth


def merged(rows: list[Row]) -> list[Row]:
    """At most `MAX_ROWS` rows: if there are more, neighbors share one."""
    if len(rows) <= MAX_ROWS:
        return rows
    groups = np.array_split(np.arange(len(rows)), MAX_ROWS)
    return [_one_row([rows[i] for i in group.tolist()]) for group in groups]


def _one_row(rows: list[Row]) -> Row:
    """Phases in one row: the trunk at the start and at the end of each, every target and log."""
    trunks = rows[0].trunks[:1] + [trunk for row in rows for trunk in row.trunks[-1:]]
    kept = np.unique(np.linspace(0, len(trunks) - 1, MAX_TRUNKS).round().astype(int))
    paths = zip(*(row.log_paths for row in rows), strict=True)
    return Row(
        rows[0].number,
        [trunks[i] for i in kept.tolist() if i >= 0],
        rows[0].logs,
        [np.concatenate(path) for path in paths],
        rows[0].mass,
        [mark for row in rows for mark in row.marks],
        np.concatenate([row.tips for row in rows]),
        rows[-1].number,
    )


@style.self_contained
def shapes_figure(plan: Plan, rows: list[Row]) -> Figure:
    """The figure that `draw_shapes` writes."""
    views = (SIDE, FRONT, three_quarter(_centerlines(plan, rows)))
    boxes = _boxes(plan, rows, views)
    left, between, above, below, right = 13.5, 14.0, 12.0, 8.0, 2.0  # mm
    usable = style.WIDTH - left - 2 * between - right
    tall = [max(box.height for box in of_row) for of_row in boxes]
    room = MAX_HEIGHT - len(rows) * (above + below)
    largest = MAX_LENGTH / plan.motion.trunk.length
    scale = min(usable / sum(box.width for box in boxes[0]), room / sum(tall), largest)
    spare = (usable - scale * sum(box.width for box in boxes[0])) / 2
    legend = _legend(plan, rows)
    header = HEADER + style.ROW * len(legend)
    height = scale * sum(tall) + len(rows) * (above + below) + header
    figure = style.new_figure(height)
    style.headline(figure, f"{style.title(plan.motion)} ({plan.mode}{style.unsolved_note(plan)})")
    style.legend_below_title(figure, *legend)
    top = height - header
    for row, of_row, size in zip(rows, boxes, tall, strict=True):
        top -= above
        x = left
        figure.text(
            x / style.WIDTH, (top + 4) / height, _caption(plan, row), fontsize=7, va="bottom",
            gid="caption",
        )  # fmt: skip
        layers = [layer(plan, row, index) for index in range(len(row.trunks))]
        for view, box in zip(views, of_row, strict=True):
            wide, high = box.width * scale, box.height * scale
            place = (x / style.WIDTH, (top - high) / height, wide / style.WIDTH, high / height)
            axes = figure.add_axes(place)
            for index, surfaces in enumerate(layers):
                # Later shapes cover earlier ones: sorted by depth, similar shapes would mix.
                paint(axes, view, surfaces, zorder=2 + index / len(layers))
            _panel(axes, plan, row, view, box)
            x += wide + between + spare
        top -= scale * size + below
    return figure


def _centerlines(plan: Plan, rows: list[Row]) -> np.ndarray:
    """Centerlines (n, points, 3) in m of all trunks that are drawn."""
    Z = np.linspace(0, plan.motion.trunk.length, 25)
    return np.concatenate([moment.shape.position(Z) for row in rows for moment in row.trunks])


def _boxes(plan: Plan, rows: list[Row], views: Sequence[View]) -> list[list[Bbox]]:
    """What each view of each row shows: as wide as all rows need, as high as this one does."""
    contents = [_contents(plan, row) for row in rows]
    margin = MARGIN * plan.motion.trunk.length
    boxes = [[extent(view, points, margin) for view in views] for points in contents]
    together = [Bbox.union(of_view) for of_view in zip(*boxes, strict=True)]
    return [
        [
            Bbox([[wide.x0, box.y0], [wide.x1, box.y1]])
            for wide, box in zip(together, of_row, strict=True)
        ]
        for of_row in boxes
    ]


def _contents(plan: Plan, row: Row) -> np.ndarray:
    """Points (n, 3) in m that a row's panels have room for: all that is drawn in them."""
    trunk = plan.motion.trunk
    points = [_body(plan, moment).reshape(-1, 3) for moment in row.trunks]
    points += [np.zeros((1, 3)), row.tips]
    for moment in row.trunks:
        hung = mass_surfaces(plan, row.mass, moment)
        points += [surface.facets.reshape(-1, 3) for surface in hung]
    for log, path in zip(row.logs, row.log_paths, strict=True):
        points += [cylinder(center, log.radius, log.length).reshape(-1, 3) for center in path]
    for mark in row.marks:
        points.append(np.stack([mark.target, mark.reached]))
        points += [(mark.target + ARROW * trunk.length * d)[None] for d in mark.directions]
    for moment in row.trunks[-1:]:
        points += [solid.facets.reshape(-1, 3) for solid in solid_surfaces(plan, moment, True)]
    return np.concatenate(points)


def _panel(axes: Axes, plan: Plan, row: Row, view: View, box: Bbox) -> None:
    _paths(axes, view, row)
    for mark in row.marks:
        _mark(axes, view, mark, ARROW * plan.motion.trunk.length)
    frame(axes, view, box)
    if view.labels is None:
        measure(axes, box)
    axes.set_title(view.name, loc="right", color=style.FAINT, fontsize=6.5)


def layer(plan: Plan, row: Row, index: int) -> list[Surface]:
    """The trunk at one moment with the tip mass.

    Logs are there at the start and the end of the row; head and obstacles at the end only.
    """
    moment, ends = row.trunks[index], {0: 0, len(row.trunks) - 1: -1}
    body = Surface(_body(plan, moment), _shade(index, len(row.trunks)))
    last = index == len(row.trunks) - 1
    surfaces = joined_with_head(plan, moment, [body]) if last else [body]
    if index in ends:
        surfaces += [
            Surface(cylinder(path[ends[index]], log.radius, log.length), WOOD)
            for log, path in zip(row.logs, row.log_paths, strict=True)
        ]
    return surfaces + mass_surfaces(plan, row.mass, moment)


def _shade(index: int, count: int) -> tuple[float, float, float]:
    return EARLY_TO_LATE(index / max(count - 1, 1))[:3]


def _body(plan: Plan, moment: Moment) -> np.ndarray:
    """Facets of the trunk; coarser than `body.trunk_body`, to keep vector files small."""
    trunk = plan.motion.trunk
    angle = np.linspace(0, 2 * np.pi, FACETS, endpoint=False)
    section = trunk.base_radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    Z = np.linspace(0.0, trunk.length, SECTIONS)
    return facets_of(round_body(section, frames(trunk, moment.shape, Z)), SECTIONS)


def _paths(axes: Axes, view: View, row: Row) -> None:
    for path in row.log_paths:
        if np.ptp(path, axis=0).any():
            axes.plot(
                *view.flat(path).T, color=LOG_PATH, linewidth=0.8, marker=".", markersize=2.5,
                zorder=5, gid="log path",
            )  # fmt: skip
    if len(row.tips):
        axes.plot(*view.flat(row.tips).T, color="k", linewidth=0.7, linestyle=":", zorder=5)


def _mark(axes: Axes, view: View, mark: Mark, arrow: float) -> None:
    target, reached = view.flat(mark.target), view.flat(mark.reached)
    if mark.placed:
        axes.plot(*np.stack([target, reached]).T, color=TARGET, linewidth=1.2, zorder=6)
        axes.plot(
            *target, marker="o", markersize=3.2, markerfacecolor="white", markeredgecolor=TARGET,
            markeredgewidth=0.8, zorder=6.5, gid="target",
        )  # fmt: skip
    elif mark.directions:
        axes.plot(*target, marker="D", markersize=2.2, color=TARGET, zorder=6.5, gid="pointed at")
    for direction in mark.directions:
        _direction(axes, view, mark.target, arrow * direction)


def _direction(axes: Axes, view: View, start: np.ndarray, arrow: np.ndarray) -> None:
    """Draw an arrow (3,) in m from a point (3,); toward the reader a dot, away a cross, in a ring.

    These are the symbols of physics for what points out of the paper and into it.
    """
    foot, tip = view.flat(start), view.flat(start + arrow)
    if np.linalg.norm(tip - foot) < FORESHORTENED * np.linalg.norm(arrow):
        style_of: dict[str, Any] = {"color": TARGET, "linestyle": "", "zorder": 6.4}
        axes.plot(
            *foot, marker="o", markersize=6.5, markerfacecolor="none", markeredgewidth=0.7,
            gid="direction", **style_of,
        )  # fmt: skip
        toward = arrow @ view.out > 0
        axes.plot(
            *foot, marker="." if toward else "x", markersize=2.5 if toward else 4.4,
            markeredgewidth=0.6, **style_of,
        )  # fmt: skip
        return
    axes.annotate(
        "", tuple(tip), tuple(foot),
        arrowprops={"arrowstyle": "-|>", "color": TARGET, "linewidth": 0.7,
                    "mutation_scale": 5, "shrinkA": 1.5, "shrinkB": 0},
        zorder=6, gid="direction",
    )  # fmt: skip


def _legend(plan: Plan, rows: list[Row]) -> list[list[Artist]]:
    """Rows of the legend: an entry for each kind of thing that is drawn."""
    entries: list[Artist] = [Patch(color=EARLY_TO_LATE(0.7), label="trunk (later: darker)")]
    marks_drawn = [mark for row in rows for mark in row.marks]
    if any(mark.placed for mark in marks_drawn):
        entries.append(
            Line2D([], [], color=TARGET, marker="o", markersize=3.2, markerfacecolor="white",
                   linewidth=1.2, label="target (line: error)")
        )  # fmt: skip
    if any(mark.directions for mark in marks_drawn):
        entries.append(
            Line2D([], [], color=TARGET, marker=">", markersize=3.0, linewidth=0.7,
                   label="direction asked for")
        )  # fmt: skip
    if any(len(row.tips) for row in rows):
        entries.append(
            Line2D([], [], color="k", linestyle=":", linewidth=0.7, label="path of the tip")
        )
    if plan.motion.trunk.head.body:
        entries.append(Patch(color=HEAD, label="head"))
    if plan.motion.spec.obstacles:
        entries.append(Patch(color=OBSTACLE, label="obstacle"))
    if any(row.logs for row in rows):
        entries.append(Patch(color=WOOD, label="log"))
    if any(np.ptp(path, axis=0).any() for row in rows for path in row.log_paths):
        entries.append(
            Line2D([], [], color=LOG_PATH, marker=".", linewidth=0.8, label="path of the log")
        )
    mass = rows[0].mass
    if mass is not None:
        label = f"{mass.mass:g} kg that the tip carries"
        entries.append(Line2D([], [], color=MASS, marker="o", linestyle="", label=label))
    count = -(-len(entries) // LEGEND_ENTRIES)
    return [[*part] for part in np.array_split(np.array(entries, dtype=object), count)]


def _ends(row: Row) -> list[int]:
    """Number of a row's first phase and, if there are several, of its last."""
    return [row.number] if row.last is None else [row.number, row.last]


def _caption(plan: Plan, row: Row) -> str:
    after = [" (just after)" if moment.after else "" for moment in row.trunks]
    times = ", ".join(f"{moment.time:.2f}{w}" for moment, w in zip(row.trunks, after, strict=True))
    names = [style.escaped(style.shortened(plan.motion.phases[n].name, 30)) for n in _ends(row)]
    text = f"{' to '.join(names)}:  t = {times} s"
    errors = [
        1e3 * float(np.linalg.norm(mark.target - mark.reached)) for mark in row.marks if mark.placed
    ]
    if errors:
        text += f";  position error at the end: at most {rounded(max(errors))} mm"
    if row.mass is not None and any(row.mass.carried[number] for number in _ends(row)):
        text += f";  {row.mass.mass:g} kg at the tip"
    return "\n".join(textwrap.wrap(text, CAPTION))

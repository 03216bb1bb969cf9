"""The trunk through each phase, with head, log, targets and errors (figs. 4a-c, 6a-b, 8a-d)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle
from matplotlib.transforms import Bbox

from .._support.wording import rounded
from ..planning.plan import Plan
from ..scene.body import frames, swept
from ..scene.colors import MASS
from ..scene.moments import Instant, instants, within_phase
from ..scene.surroundings import Log, Mark, carried, head_sphere, log_at, marks, steps_of
from . import style
from .scene import (
    FACETS,
    VIEWS,
    Surface,
    View,
    ball,
    cylinder,
    extent,
    facets_of,
    frame,
    measure,
    paint,
)

EARLY_TO_LATE = LinearSegmentedColormap.from_list("time", ["#E3E6EA", "#5B6670"])
WOOD = "#B08D57"
LOG_PATH = "#5A3E12"
HEAD = "#F3EFE6"
TARGET = "#CC0055"
SECTIONS = 36
CARGO_RADIUS = 0.08 / 1.75  # of the trunk's length; the mass at the tip is known, its size is not
HEADER = 10.0  # mm, for title and key
ARROW = 0.1  # of the trunk's length
TALLEST = 225.0  # mm, of all rows together: a page
MOST_ROWS = 5  # on a page; of more phases several share a row
MOST_TIPS = 121  # points of the tip's path through a phase
MOST_TRUNKS = 6  # in a row
LONGEST = 105.0  # mm on paper for the trunk's length, even where little happens


@dataclass(frozen=True, eq=False)
class Row:
    """What one phase shows, or all phases from `number` to `last`."""

    number: int
    trunks: list[Instant]
    logs: list[Log]
    marks: list[Mark]
    tips: np.ndarray
    last: int | None = None


def draw_shapes(plan: Plan, folder: Path, formats: Sequence[str]) -> list[Path]:
    """Draw trunk shapes through each phase; positions in m (figs. 4a-c, 6a-b, 8a-d).

    A row for each phase, or for some together if there are many; from left to right the side, the
    front and a three-quarter view, all to one scale. Time runs from light to dark, later shapes
    over earlier ones. Nothing is moved aside: a trunk that passes through the head or a log is
    drawn doing so.
    """
    numbers = range(len(plan.motion.phases))
    rows = joined([row_of(plan, number) for number in numbers if steps_of(plan, number)])
    if not rows:
        rows = [Row(0, instants(plan, np.zeros(1)), [], [], np.zeros((0, 3)))]
    with style.styled():
        return style.save(picture(plan, rows), folder, "shapes", formats)


def row_of(plan: Plan, number: int) -> Row:
    """What a phase with planned steps shows."""
    steps = steps_of(plan, number)
    trunks = instants(plan, within_phase(plan, number), number)
    before = [steps[0] - 1] if steps[0] > 0 else []
    found = [log_at(plan.motion, step) for step in before + steps]
    logs = [log for log in found if log is not None] if found[-1] is not None else []
    tip = np.array([plan.motion.trunk.length])
    count = min(max(13, 3 * len(steps) + 1), MOST_TIPS)  # corners would be the picture's own
    between = instants(plan, within_phase(plan, number, count), number)
    tips = [instant.shape.position(tip)[0, 0] for instant in between]
    return Row(number, trunks, logs, marks(plan, steps[-1]), np.array(tips).reshape(-1, 3))


def joined(rows: list[Row]) -> list[Row]:
    """At most `MOST_ROWS` rows: of more, neighbors together."""
    if len(rows) <= MOST_ROWS:
        return rows
    groups = np.array_split(np.arange(len(rows)), MOST_ROWS)
    return [_together([rows[i] for i in group.tolist()]) for group in groups]


def _together(rows: list[Row]) -> Row:
    """Phases in one row: the trunk at the start and at the end of each, every target and log."""
    trunks = rows[0].trunks[:1] + [trunk for row in rows for trunk in row.trunks[-1:]]
    kept = np.unique(np.linspace(0, len(trunks) - 1, MOST_TRUNKS).round().astype(int))
    return Row(
        rows[0].number,
        [trunks[i] for i in kept.tolist() if i >= 0],
        [log for row in rows for log in row.logs],
        [mark for row in rows for mark in row.marks],
        np.concatenate([row.tips for row in rows]),
        rows[-1].number,
    )


def picture(plan: Plan, rows: list[Row]) -> Figure:
    """The figure that `draw_shapes` writes."""
    boxes = [_boxes(plan, rows, row) for row in rows]
    left, between, above, below, right = 13.5, 14.0, 12.0, 8.0, 2.0  # mm
    usable = style.WIDTH - left - 2 * between - right
    tall = [max(box.height for box in of_row) for of_row in boxes]
    room = TALLEST - len(rows) * (above + below)
    largest = LONGEST / plan.motion.trunk.length
    scale = min(usable / sum(box.width for box in boxes[0]), room / sum(tall), largest)
    spare = (usable - scale * sum(box.width for box in boxes[0])) / 2
    height = scale * sum(tall) + len(rows) * (above + below) + HEADER
    figure = style.new_figure(height)
    style.headline(figure, f"{style.title(plan.motion)} ({plan.mode}{style.mark(plan)})")
    _key(figure, plan)
    top = height - HEADER
    for row, of_row, size in zip(rows, boxes, tall, strict=True):
        top -= above
        x = left
        figure.text(x / style.WIDTH, (top + 5) / height, _caption(plan, row), fontsize=7)
        for view, box in zip(VIEWS, of_row, strict=True):
            wide, high = box.width * scale, box.height * scale
            place = (x / style.WIDTH, (top - high) / height, wide / style.WIDTH, high / height)
            _panel(figure.add_axes(place), plan, row, view, box)
            x += wide + between + spare
        top -= scale * size + below
    return figure


def _boxes(plan: Plan, rows: list[Row], row: Row) -> list[Bbox]:
    """What each view of a row shows: as wide as all rows need, as high as this one does."""
    boxes = []
    for view in VIEWS:
        every = extent(view, np.concatenate([_everything(plan, other, view) for other in rows]), 0)
        own = extent(view, _everything(plan, row, view), 0)
        margin = 0.035 * plan.motion.trunk.length
        boxes.append(
            Bbox([[every.x0 - margin, own.y0 - margin], [every.x1 + margin, own.y1 + margin]])
        )
    return boxes


def _everything(plan: Plan, row: Row, view: View) -> np.ndarray:
    """Points (n, 3) in m that a row's panels have room for: bodies, mass, sphere and targets."""
    trunk, sphere = plan.motion.trunk, head_sphere(plan.motion.trunk)
    points = [_body(plan, instant).reshape(-1, 3) for instant in row.trunks] + [np.zeros((1, 3))]
    for instant in row.trunks:
        hung = cargo(plan, _phase_at(plan, row, instant), instant)
        points += [surface.facets.reshape(-1, 3) for surface in hung]
    for log in row.logs:
        points.append(cylinder(log.center, log.radius, log.length).reshape(-1, 3))
    for mark in row.marks:
        points.append(np.stack([mark.target, mark.reached]))
        points += [(mark.target + ARROW * trunk.length * d)[None] for d in mark.directions]
    if sphere is not None:
        around = np.stack([view.across, -view.across, view.down, -view.down])
        points.append(sphere[0] + sphere[1] * around)
    return np.concatenate(points)


def _panel(axes: Axes, plan: Plan, row: Row, view: View, box: Bbox) -> None:
    sphere = head_sphere(plan.motion.trunk)
    if sphere is not None:
        center, radius = view.flat(sphere[0]), sphere[1]
        axes.add_patch(Circle(tuple(center), radius, color=HEAD, linewidth=0, zorder=1))
        outline = Circle(tuple(center), radius, fill=False, linewidth=0.6, zorder=4, gid="head")
        outline.set_linestyle((0, (4, 2)))  # drawn over the trunk, that both are seen
        axes.add_patch(outline)
    for index in range(len(row.trunks)):
        # Time before depth: shapes that nearly coincide would show through each other.
        paint(axes, view, layer(plan, row, index), zorder=2 + index / len(row.trunks))
    _paths(axes, view, row)
    for mark in row.marks:
        _mark(axes, view, mark, ARROW * plan.motion.trunk.length)
    frame(axes, view, box)
    if view.labels is None:
        measure(axes, box)
    axes.set_title(view.name, loc="right", color=style.FAINT, fontsize=6.5)


def layer(plan: Plan, row: Row, index: int) -> list[Surface]:
    """The trunk at one instant, with what it holds at the phase's start and end."""
    surfaces = [Surface(_body(plan, row.trunks[index]), _shade(index, len(row.trunks)))]
    last = index == len(row.trunks) - 1
    for number, log in enumerate(row.logs):
        if (number == 0 and index == 0) or (number == len(row.logs) - 1 and last):
            surfaces.append(Surface(cylinder(log.center, log.radius, log.length), WOOD))
    return surfaces + cargo(plan, _phase_at(plan, row, row.trunks[index]), row.trunks[index])


def _phase_at(plan: Plan, row: Row, instant: Instant) -> int:
    """Number of the phase of a row that an instant belongs to."""
    if row.last is None:
        return row.number
    ends = [phase.end for phase in plan.motion.phases[row.number : row.last]]
    edge = 1e-9 if instant.after else -1e-9
    return row.number + int(np.searchsorted(ends, instant.time + edge))


def cargo(plan: Plan, number: int, instant: Instant) -> list[Surface]:
    """The mass that hangs at the tip during a phase, if any, ahead of the tip."""
    if not carried(plan.motion, number) > 0:
        return []
    end, shape = np.array([plan.motion.trunk.length]), instant.shape
    radius = CARGO_RADIUS * plan.motion.trunk.length
    ahead = radius * shape.directors(end)[0, 0, 2]
    return [Surface(ball(shape.position(end)[0, 0] + ahead, radius), MASS)]


def _shade(index: int, count: int) -> tuple[float, float, float]:
    red, green, blue, _ = EARLY_TO_LATE(index / max(count - 1, 1))
    return (red, green, blue)


def _body(plan: Plan, instant: Instant) -> np.ndarray:
    """Facets of the trunk; coarser than `geometry.trunk_body`, so that vectors stay light."""
    trunk = plan.motion.trunk
    angle = np.linspace(0, 2 * np.pi, FACETS, endpoint=False)
    section = trunk.base_radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    fan = np.arange(1, FACETS - 1)
    caps = np.stack([np.zeros_like(fan), fan, fan + 1], axis=-1)
    Z = np.linspace(0.0, trunk.length, SECTIONS)
    body = swept(section, frames(trunk, instant.shape, Z), caps)
    return facets_of(body, SECTIONS)


def _paths(axes: Axes, view: View, row: Row) -> None:
    if len(row.logs) > 1:
        flat = view.flat(np.array([log.center for log in row.logs]))
        axes.plot(
            *flat.T, color=LOG_PATH, linewidth=0.8, marker=".", markersize=2.5, zorder=5,
            gid="log path",
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
    for direction in mark.directions:
        tip = view.flat(mark.target + arrow * direction)
        axes.annotate(
            "", tuple(tip), tuple(target),
            arrowprops={"arrowstyle": "-|>", "color": TARGET, "linewidth": 0.7,
                        "mutation_scale": 5, "shrinkA": 1.5, "shrinkB": 0},
            zorder=6, gid="direction",
        )  # fmt: skip


def _key(figure: Figure, plan: Plan) -> None:
    phases = range(len(plan.motion.phases))
    entries = [
        Line2D([], [], color=TARGET, marker="o", markersize=3.2, markerfacecolor="white",
               linewidth=1.2, label="target, error, direction"),
        Line2D([], [], color="k", linestyle=":", linewidth=0.7, label="path of the tip"),
    ]  # fmt: skip
    if head_sphere(plan.motion.trunk) is not None:
        dashes = (0, (4, 2))
        entries.append(Line2D([], [], color="k", linestyle=dashes, linewidth=0.6, label="head"))
    if any(plan.motion.spec.phases[number].wrap is not None for number in phases):
        entries.append(
            Line2D([], [], color=LOG_PATH, marker=".", linewidth=0.8, label="path of the log")
        )
    if any(carried(plan.motion, number) > 0 for number in phases):
        ball = Line2D([], [], color=MASS, marker="o", linestyle="", label="mass at the tip")
        entries.append(ball)
    style.legend_above(figure, entries)


def _ends(row: Row) -> list[int]:
    """Numbers of a row's first phase and, if there are several, of its last."""
    return [row.number] if row.last is None else [row.number, row.last]


def _caption(plan: Plan, row: Row) -> str:
    after = [" (just after)" if instant.after else "" for instant in row.trunks]
    times = ", ".join(
        f"{instant.time:.2f}{w}" for instant, w in zip(row.trunks, after, strict=True)
    )
    names = [style.plain(style.short(plan.motion.phases[n].name, 30)) for n in _ends(row)]
    text = f"{' to '.join(names)}:  t = {times} s, from light to dark"
    errors = [
        1e3 * float(np.linalg.norm(mark.target - mark.reached)) for mark in row.marks if mark.placed
    ]
    if errors:
        text += f";  position error at the end: at most {rounded(max(errors))} mm"
    mass = max(carried(plan.motion, number) for number in _ends(row))
    if mass > 0:
        text += f";  {mass:g} kg at the tip"
    return text

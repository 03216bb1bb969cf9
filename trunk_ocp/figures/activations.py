"""Activations and head angles over time, with their bounds (figs. 4d-e, 6c-d, 8e-f)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ..planning.active_bounds import limits, touching
from ..planning.plan import Plan
from ..problem.motion import HEAD_LIMIT
from ..scene.colors import group_colors, groups
from ..scene.moments import curve_times, curves, end_of
from . import style
from .activation_colors import ACTIVATION, color_bar_beside, strongest

MAX_DOTS = 60  # time steps in a panel that can be distinguished
MIN_HEAD_RANGE = 2.0  # deg, of an axis, for a head that hardly turns
HEAD_NAMES = ("head to the right,\nψZ (°)", "head up,\nψY (°)")
PANEL, HEADS = 25.0, 23.0  # mm, heights of a row of muscles and of the head's angles
MAX_ROWS = 8  # groups on a page


def draw_activations(plan: Plan, folder: Path, formats: Sequence[str]) -> list[Path]:
    """Draw activations (no unit) and head angles (deg) over time (figs. 4d-e, 6c-d, 8e-f).

    Rows are muscle groups, columns segments; right solid, left dotted; contraction upward. Gray
    lines are the motion's bounds, dots time steps, squares time steps at a bound: filled at that of
    contraction, small and empty at the other. Free head angles have no bounds drawn. A trunk of
    many segments is drawn as a map of colors instead, and many groups on several pages.
    """
    names = groups(plan.motion.trunk)
    paths: list[Path] = []
    with style.styled():
        for page in range(0, max(len(names), 1), MAX_ROWS):
            figure = activations_figure(plan, names[page : page + MAX_ROWS])
            number = f"-{page // MAX_ROWS + 1}" if page else ""
            paths += style.save(figure, folder, f"activations{number}", formats)
    return paths


@style.self_contained
def activations_figure(plan: Plan, names: Sequence[str] | None = None) -> Figure:
    """The figure that `draw_activations` writes, of some muscle groups or all."""
    motion, names = plan.motion, groups(plan.motion.trunk) if names is None else names
    mapped = motion.trunk.segments > style.MAX_SEGMENTS
    heads = HEADS if _head_turns(plan) or not names else 0.0
    above, below = style.header(motion, rows=0 if mapped else 1) + 6.5, 10.0
    between = 12.0 if names and heads else 0.0
    height = above + PANEL * len(names) + between + heads + below
    figure = style.new_figure(height)
    times = curve_times(plan)
    values = curves(plan, times)
    style.headline(figure, f"{style.title(motion)} ({plan.mode}{style.unsolved_note(plan)})")
    if names:
        grid = figure.add_gridspec(
            len(names), len(style.SIDES) if mapped else motion.trunk.segments, hspace=0.18,
            wspace=0.12, left=0.1, right=0.9 if mapped else 0.985, top=1 - above / height,
            bottom=(below + heads + between) / height,
        )  # fmt: skip
        panels = grid.subplots(squeeze=False, sharex=True, sharey=True)
        (map_panels if mapped else muscle_panels)(panels, plan, names, times, values)
    if heads:
        grid = figure.add_gridspec(
            1, 2, wspace=0.22, left=0.1, right=0.985, top=(below + heads) / height,
            bottom=below / height,
        )  # fmt: skip
        angles = np.degrees(values[:, -2:]).T
        for index, panel in enumerate(grid.subplots(squeeze=False)[0]):
            _head_panel(panel, plan, index, times, angles[index])
            if not names:
                style.number_phases(panel, motion, end_of(plan))
    shaded = bool(heads) or not mapped or style.numbered(motion)
    style.legend_below_title(
        figure, () if mapped else _legend(bool(heads)), motion=motion if shaded else None
    )
    return figure


def muscle_panels(
    panels: np.ndarray, plan: Plan, names: Sequence[str], times: np.ndarray, values: np.ndarray
) -> None:
    """Fill panels (groups, segments) with a plan's activations, bounds and time steps.

    values (n, muscles + 2) at times (n,) in s.
    """
    trunk = plan.motion.trunk
    for row, group in enumerate(names):
        for segment in range(trunk.segments):
            axes = panels[row, segment]
            frame_panel(axes, plan, group, segment, row == len(names) - 1)
            if row == 0:
                style.head_segment(axes, plan.motion, segment, end_of(plan))
            for index, muscle in style.muscles_of(trunk, group, segment):
                line = style.SIDES[muscle.side][1]
                color = group_colors(trunk)[group]
                axes.plot(times, values[:, index], line, color=color, zorder=3, gid=muscle.name)
                _steps(axes, plan, index, color, values[0, index])
        panels[row, 0].set_ylabel(f"{group}\nactivation (no unit)", color=style.INK)
    if panels.size:
        panels[0, 0].set_ylim(*activation_range([plan]))  # shared by all panels


def map_panels(
    panels: np.ndarray, plan: Plan, names: Sequence[str], times: np.ndarray, values: np.ndarray
) -> None:
    """Fill panels (groups, sides) with maps of activation: time across, segments down.

    values (n, muscles + 2) at times (n,) in s.
    """
    trunk = plan.motion.trunk
    scale = Normalize(0.0, strongest(plan))
    for row, group in enumerate(names):
        for column, (side, (side_name, _)) in enumerate(style.SIDES.items()):
            axes = panels[row, column]
            shown = np.full((trunk.segments, len(times)), np.nan)
            for index, muscle in enumerate(trunk.subdomains):
                if (muscle.group, muscle.side) == (group, side):
                    shown[muscle.segment] = np.abs(values[:, index])
            axes.pcolormesh(
                times, np.arange(1, trunk.segments + 1), shown, norm=scale, cmap=ACTIVATION,
                shading="nearest", rasterized=True, gid=f"{group} {side}",
            )  # fmt: skip
            axes.set_facecolor(style.BANDS[1])
            axes.set_ylim(trunk.segments + 0.5, 0.5)
            if end_of(plan) > 0:
                axes.set_xlim(0, end_of(plan))
            for phase in plan.motion.phases[:-1]:
                axes.axvline(phase.end, color=style.FAINT, linewidth=0.5)
            if row == 0:
                style.number_phases(axes, plan.motion, end_of(plan), named=True)
                axes.set_title(side_name, pad=style.NUMBERS_PAD)
            if row == len(names) - 1:
                axes.set_xlabel("time (s)")
        panels[row, 0].set_ylabel(f"{group}\nsegment (number)", color=style.INK)
    color_bar_beside(panels, scale)


def frame_panel(axes: Axes, plan: Plan, group: str, segment: int, labeled: bool) -> None:
    """Shade the phases of a panel; if it is the lowest, label its time."""
    style.note_if_empty(axes, plan.motion.trunk, group, segment)
    style.shade_phases(axes, plan.motion, end_of(plan))
    if labeled:
        axes.set_xlabel("time (s)")


def activation_range(plans: Sequence[Plan]) -> tuple[float, float]:
    """Ends of the activation axis of plans and their bounds: contraction, negative, is upward."""
    values = [np.zeros(1)]
    for plan in plans:
        values += [bound[:, :-2].ravel() for bound in limits(plan)] + [
            plan.trajectory[:, :-2].ravel()
        ]
    joined = np.concatenate(values)
    low, high = float(np.nanmin(joined)), float(np.nanmax(joined))
    margin = 0.08 * (high - low or 1.0)
    return high + margin, low - margin


def _steps(axes: Axes, plan: Plan, index: int, color: str, start: float) -> None:
    """Time steps as dots; those at a bound as squares, filled at the lower, empty at the upper.

    The lower bound limits contraction; the upper one is usually rest, so its squares are small.
    """
    times = plan.motion.times[: len(plan.x)]
    value = plan.x[:, index]
    below, above = (at[:, index] for at in touching(plan))
    free = ~(below | above) & (len(times) <= MAX_DOTS)
    axes.plot([0, *times[free]], [start, *value[free]], ".", color=color, markersize=2.5,
              zorder=3.5)  # fmt: skip
    for touch, size, face, gid in (
        (above, 2.2, "white", "at upper bound"),
        (below, 3.8, color, "at lower bound"),
    ):
        if not touch.any():
            continue
        axes.plot(
            times[touch], value[touch], "s", markersize=size, markerfacecolor=face,
            markeredgecolor="k" if touch is below else color, markeredgewidth=0.6,
            zorder=4, clip_on=False, gid=gid,
        )  # fmt: skip
    draw_bounds(axes, plan, index)


def draw_bounds(axes: Axes, plan: Plan, index: int, factor: float = 1.0) -> None:
    """Draw the motion's bounds on one unknown, times a factor, over the duration of each step."""
    times = plan.times
    for bound in limits(plan):
        if len(plan.x):
            values = bound[:, index]
            if index >= len(plan.motion.trunk.muscles):  # free
                values = np.where(np.abs(values) == HEAD_LIMIT, np.nan, values)
            axes.stairs(
                factor * values, times, baseline=None, **style.BOUND, zorder=2, gid="bound",
            )  # fmt: skip


def _head_turns(plan: Plan) -> bool:
    """Whether the head's angles are ever free or not zero."""
    return any(values[:, -2:].any() for values in (plan.trajectory, *limits(plan)))


def _head_panel(axes: Axes, plan: Plan, index: int, times: np.ndarray, degrees: np.ndarray) -> None:
    column = len(plan.motion.trunk.muscles) + index
    style.shade_phases(axes, plan.motion, end_of(plan))
    axes.plot(times, degrees, color="k", zorder=3, gid=f"head {index}")
    steps, value = plan.motion.times[: len(plan.x)], np.degrees(plan.x[:, column])
    below, above = (at[:, column] for at in touching(plan))
    touch = below | above
    axes.plot(steps[~touch], value[~touch], ".", color="k", markersize=2.5, zorder=3.5)
    axes.plot(steps[touch], value[touch], "s", color="k", markersize=3.6, zorder=4, clip_on=False)
    draw_bounds(axes, plan, column, float(np.degrees(1.0)))
    axes.set_xlabel("time (s)")
    axes.margins(y=0.1)
    low, high = axes.get_ylim()
    wider = max(0.0, MIN_HEAD_RANGE - (high - low)) / 2
    axes.set_ylim(low - wider, high + wider)
    axes.set_ylabel(HEAD_NAMES[index])


def line_keys() -> list[Line2D]:
    """Legend entries for the lines of both sides and of bounds."""
    return [
        Line2D([], [], color=style.INK, label="right"),
        Line2D([], [], color=style.INK, linestyle=":", label="left"),
        Line2D([], [], **style.BOUND, label="bound"),
    ]


def _legend(heads: bool) -> list[Artist]:
    ink = style.INK
    bound = "at the bound of contraction" + (" or of the head" if heads else "")
    return [
        *line_keys(),
        Line2D([], [], color=ink, marker=".", linestyle="", markersize=3, label="time step"),
        Line2D([], [], color=ink, marker="s", linestyle="", markersize=3.8, label=bound),
        Line2D([], [], color="white", marker="s", linestyle="", markersize=2.2,
               markeredgecolor=ink, markeredgewidth=0.6, label="at the other bound"),
    ]  # fmt: skip

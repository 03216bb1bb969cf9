"""Activations and head angles over time, with their bounds (figs. 4d-e, 6c-d, 8e-f)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ..planning.active_bounds import limits, touching
from ..planning.plan import Plan
from ..problem.motion import HEAD_LIMIT, Motion
from ..scene.colors import group_colors, groups
from ..scene.moments import curve_times, curves, end_of
from . import style

MAX_DOTS = 60  # time steps in a panel that can be distinguished
MIN_HEAD_RANGE = 2.0  # deg, of an axis, for a head that hardly turns
HEAD_NAMES = ("head to the\nright, $\\psi_Z$ (°)", "head\nup, $\\psi_Y$ (°)")


def draw_activations(plan: Plan, folder: Path, formats: Sequence[str]) -> list[Path]:
    """Draw activations (no unit) and head angles (deg) over time (figs. 4d-e, 6c-d, 8e-f).

    Rows are muscle groups, columns segments; right solid, left dotted; contraction upward. Gray
    lines are the motion's bounds, dots time steps, squares time steps at a bound: filled at that of
    contraction, small and empty at the other. Free head angles have no bounds drawn.
    """
    with style.styled():
        return style.save(activations_figure(plan), folder, "activations", formats)


def activations_figure(plan: Plan) -> Figure:
    """The figure that `draw_activations` writes."""
    trunk = plan.motion.trunk
    rows = len(groups(trunk))
    height = 27.0 * rows + 30 + 24
    figure = style.new_figure(height)
    style.headline(figure, f"{style.title(plan.motion)} ({plan.mode}{style.unsolved_note(plan)})")
    grids = figure.add_gridspec(
        2, 1, height_ratios=[max(27.0 * rows, 1e-3), 24], hspace=12 / (13.5 * rows + 12),
        left=0.085, right=0.985, top=1 - 18 / height, bottom=10 / height,
    )  # fmt: skip
    if rows:
        panels = grids[0].subgridspec(rows, trunk.segments, hspace=0.18, wspace=0.12)
        muscle_panels(figure, panels.subplots(squeeze=False, sharex=True, sharey=True), plan)
    heads = grids[1].subgridspec(1, 2, wspace=0.22).subplots(squeeze=False)[0]
    for index, axes in enumerate(heads):
        _head_panel(axes, plan, index)
    _legend(figure, plan.motion)
    return figure


def muscle_panels(figure: Figure, panels: np.ndarray, plan: Plan) -> None:
    """Fill panels (groups, segments) with a plan's activations, bounds and time steps."""
    trunk = plan.motion.trunk
    times = curve_times(plan)
    values = curves(plan, times)
    for row, group in enumerate(groups(trunk)):
        for segment in range(trunk.segments):
            axes = panels[row, segment]
            frame_panel(axes, plan, row, segment, len(panels))
            for index, muscle in style.muscles_of(trunk, group, segment):
                line = style.SIDES[muscle.side][1]
                color = group_colors(trunk)[group]
                axes.plot(times, values[:, index], line, color=color, zorder=3, gid=muscle.name)
                _steps(axes, plan, index, color, values[0, index])
        panels[row, 0].set_ylabel(f"{group}\nactivation (no unit)", color=style.INK)
    if panels.size:
        panels[0, 0].set_ylim(*activation_range([plan]))  # shared by all panels


def frame_panel(axes: Axes, plan: Plan, row: int, segment: int, rows: int) -> None:
    """Shade the phases of a panel, and label it if it is at the top or at the bottom."""
    trunk = plan.motion.trunk
    style.note_if_empty(axes, trunk, groups(trunk)[row], segment)
    style.shade_phases(axes, plan.motion, end_of(plan))
    if row == 0:
        axes.set_title(f"segment {segment + 1}")
    if row == rows - 1:
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


def _head_panel(axes: Axes, plan: Plan, index: int) -> None:
    times = curve_times(plan)
    column = len(plan.motion.trunk.muscles) + index
    style.shade_phases(axes, plan.motion, end_of(plan))
    degrees = np.degrees(curves(plan, times)[:, column])
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


def _legend(figure: Figure, motion: Motion) -> None:
    ink = style.INK
    handles = [
        *line_keys(),
        Line2D([], [], color=ink, marker=".", linestyle="", markersize=3, label="time step"),
        Line2D([], [], color=ink, marker="s", linestyle="", markersize=3.8,
               label="at the bound of contraction"),
        Line2D([], [], color="white", marker="s", linestyle="", markersize=2.2,
               markeredgecolor=ink, markeredgewidth=0.6, label="at the other bound"),
    ]  # fmt: skip
    style.legend_below_title(figure, handles, style.phase_patches(motion))

"""A sequential plan and a horizon plan of one motion in the same figure."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from ..analysis.measures import time_at_bounds
from ..planning.active_bounds import touching
from ..planning.plan import Plan
from ..scene.colors import group_colors, groups
from ..scene.moments import curve_times, curves, end_of
from . import style
from .activations import activation_range, draw_bounds, frame_panel, line_keys

SEQUENTIAL, HORIZON = "#9A9A9A", "#000000"


def draw_comparison(
    sequential: Plan, horizon: Plan, folder: str | Path, formats: Sequence[str] = style.FORMATS
) -> list[Path]:
    """Draw two plans of one motion over each other; activations and J_T (eq. 42) have no unit.

    In addition to the paper's figures 4d, 6c and 8f: the largest change between steps, and the
    number of muscles at their bound. Returns the files written.
    """
    with style.styled():
        return style.save(comparison_figure(sequential, horizon), folder, "comparison", formats)


@style.self_contained
def comparison_figure(sequential: Plan, horizon: Plan) -> Figure:
    """The figure that `draw_comparison` writes."""
    trunk = horizon.motion.trunk
    rows = len(groups(trunk))
    above = style.header(horizon.motion, rows=2) + 6.5
    height = above + 25.0 * rows + 45
    figure = style.new_figure(height)
    first, second = (f"{plan.mode}{style.unsolved_note(plan)}" for plan in (sequential, horizon))
    style.headline(figure, f"{style.title(horizon.motion)}: {first} and {second}")
    grids = figure.add_gridspec(
        2, 1, height_ratios=[max(25.0 * rows, 1e-3), 30], hspace=14 / (12.5 * rows + 15),
        left=0.1, right=0.985, top=1 - above / height, bottom=10 / height,
    )  # fmt: skip
    if rows:
        columns = len(style.shown_segments(trunk))
        grid = grids[0].subgridspec(rows, columns, hspace=0.18, wspace=0.12)
        panels = grid.subplots(squeeze=False, sharex=True, sharey=True)
        _activations(panels, (sequential, horizon))
    below = grids[1].subgridspec(1, 3, wspace=0.55).subplots(squeeze=False)[0]
    _numbers(list(below), (sequential, horizon))
    _legend(figure, (sequential, horizon))
    return figure


def _activations(panels: np.ndarray, plans: tuple[Plan, Plan]) -> None:
    longest = max(plans, key=end_of)
    trunk = longest.motion.trunk
    drawn = [(plan, times, curves(plan, times)) for plan in plans for times in [curve_times(plan)]]
    for row, group in enumerate(groups(trunk)):
        for column, segment in enumerate(style.shown_segments(trunk)):
            axes: Axes = panels[row, column]
            frame_panel(axes, longest, group, segment, row == len(panels) - 1)
            if row == 0:
                style.head_segment(axes, longest.motion, segment, end_of(longest))
            for index, muscle in style.muscles_of(trunk, group, segment):
                for plan, times, values in drawn:
                    horizon = plan is plans[1]
                    axes.plot(
                        times, values[:, index], style.SIDES[muscle.side][1],
                        color=group_colors(trunk)[group] if horizon else SEQUENTIAL,
                        linewidth=1.3 if horizon else 1.0, zorder=4 if horizon else 3,
                        gid=f"{plan.mode} {muscle.name}",
                    )  # fmt: skip
                draw_bounds(axes, plans[1], index)
        panels[row, 0].set_ylabel(f"{group}\nactivation (no unit)")
    panels[0, 0].set_ylim(*activation_range(plans))


def _numbers(panels: list[Axes], plans: tuple[Plan, Plan]) -> None:
    longest = max(plans, key=end_of)
    for axes in panels:
        style.shade_phases(axes, longest.motion, end_of(longest))
        axes.set_xlabel("time (s)")
    for plan, color in zip(plans, (SEQUENTIAL, HORIZON), strict=True):
        times = plan.motion.times[: len(plan.x)]
        errors = plan.errors if len(plan.x) else ()
        cost = np.array([error.paper for error in errors])
        # Without the change from the start to step 1, which every plan has.
        change = np.abs(np.diff(plan.trajectory[:, :-2], axis=0)).max(axis=1, initial=0.0)[1:]
        at_bound = touching(plan)[0][:, :-2].sum(axis=1)
        for axes, values in zip(panels, (cost, change, at_bound), strict=True):
            at = times[len(times) - len(values) :]
            axes.plot(
                at,
                values,
                "o-",
                color=color,
                markersize=2.5,
                gid=plan.mode,
                clip_on=False,
                zorder=3,
            )
    panels[0].set_ylim(bottom=0)
    panels[2].set_ylim(-0.1, max(panels[2].get_ylim()[1], 1.1))
    panels[2].yaxis.set_major_locator(MaxNLocator(4, integer=True))
    panels[0].set_ylabel("J_T of eq. (42) (no unit)")
    panels[1].set_ylabel("largest change between\nsteps (no unit)")
    panels[2].set_ylabel("muscles at their bound\nof contraction (count)")


def _legend(figure: Figure, plans: tuple[Plan, Plan]) -> None:
    handles: list[Artist] = []
    for plan, color in zip(plans, (SEQUENTIAL, HORIZON), strict=True):
        cost = f"{plan.objective.paper:.3g}" if len(plan.x) else "none"
        at_bound = f"{time_at_bounds(plan):.2g} muscle-seconds at the bound"
        label = f"{plan.mode}: J = {cost}, {at_bound}"
        handles.append(Line2D([], [], color=color, marker="o", markersize=2.5, label=label))
    style.legend_below_title(figure, handles, line_keys(), motion=plans[1].motion)

"""Lookahead studies: costs against lookahead, and planning methods over time."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter, StrMethodFormatter

from ..analysis.lookahead_study import Foresight
from ..analysis.measures import Measures
from ..planning.active_bounds import touching
from ..planning.plan import Plan
from ..planning.status import Status
from . import style

PAPER, COSTED, BLIND, HORIZON = "#D55E00", "#E69F00", "#56B4E9", "#000000"
CURVES = (
    ("planner_objective", "planner's objective (no unit)"),
    ("paper_objective", "J of eq. (42), summed\n(no unit)"),
    ("total_variation", "total variation of\nactivations (no unit)"),
)
SOLVED = Status.SOLVED.name.lower()


def draw_foresight(
    result: Foresight, folder: str | Path, formats: Sequence[str] = style.FORMATS
) -> list[Path]:
    """Draw costs against lookahead, and four planning methods over time.

    Returns the files written.
    """
    with style.styled():
        return style.save(lookahead_figure(result), folder, "comparison", formats)


def draw_survey(
    data: Mapping[str, Any], folder: str | Path, formats: Sequence[str] = style.FORMATS
) -> list[Path]:
    """Draw the result of `survey_limits`: cost and smoothness against lookahead, by limits."""
    with style.styled():
        return style.save(survey_figure(data), folder, f"foresight-{data['problem']}", formats)


def draw_front(
    data: Mapping[str, Any], folder: str | Path, formats: Sequence[str] = style.FORMATS
) -> list[Path]:
    """Draw the result of `smoothness_tradeoff`: tracking against smoothness."""
    with style.styled():
        return style.save(front_figure(data), folder, f"front-{data['problem']}", formats)


@style.self_contained
def lookahead_figure(result: Foresight) -> Figure:
    """The figure that `draw_foresight` writes."""
    above = style.header(result.motion, rows=2) + 6.0
    height = above + 94.0
    figure = style.new_figure(height)
    title = f"{style.title(result.motion)}: benefit of lookahead"
    style.headline(figure, f"{title} ({_limits(result.limits)})")
    panels = figure.subplots(2, 3)
    figure.subplots_adjust(
        left=0.09, right=0.985, top=1 - above / height, bottom=10 / height, wspace=0.42, hspace=0.32
    )
    for axes, (name, label) in zip(panels[0], CURVES, strict=True):
        _against_lookahead(axes, result, name)
        axes.set_ylabel(label)
    methods = _methods(result)
    _over_time(list(panels[1]), list(methods.values()))
    lines = [Line2D([], [], color=color, label=name) for name, (_, color) in methods.items()]
    style.legend_below_title(figure, lines, _mark_keys(), motion=result.motion)
    return figure


def _mark_keys() -> list[Line2D]:
    """Legend entries for the circles of `_marks`."""
    return [
        Line2D([], [], color=style.INK, marker="o", markersize=3, label="all targets reached"),
        Line2D([], [], color=style.INK, marker="o", markersize=3, markerfacecolor="white",
               label="some target missed, or not solved"),
    ]  # fmt: skip


def _methods(result: Foresight) -> dict[str, tuple[Plan, str]]:
    """The plans that are drawn over time, and their colors."""
    return {
        "the paper's method: tracking only": (result.paper, PAPER),
        "the same with effort and rate costs": (result.paper_costed, COSTED),
        "blind, with the horizon's bounds": (result.curve.blind, BLIND),
        "horizon": (result.curve.best, HORIZON),
    }


def _against_lookahead(axes: Axes, result: Foresight, name: str) -> None:
    """One measure at all lookaheads; the paper's methods and the best horizon as lines."""
    lookaheads = list(result.curve.plans)
    measured = [result.measures[f"lookahead {H}"] for H in lookaheads]
    values = [float(getattr(measures, name)) for measures in measured]
    axes.plot(lookaheads, values, color=style.INK, zorder=3, gid=name)
    statuses = [measures.status for measures in measured]
    _marks(axes, zip(lookaheads, values, statuses, strict=True))
    for method, color in (("paper", PAPER), ("paper, same cost", COSTED)):
        value = float(getattr(result.measures[method], name))
        axes.axhline(value, color=color, zorder=2, gid=method)
    best: Measures | None = result.measures.get("best horizon")
    if best is not None:
        axes.axhline(float(getattr(best, name)), **style.BOUND)
    axes.set_xlabel("lookahead (time steps)")
    axes.set_ylim(0, 1.05 * axes.get_ylim()[1])
    axes.xaxis.set_major_locator(MaxNLocator(8, integer=True))


def _marks(axes: Axes, points: Iterable[tuple[int, float, str]], color: Any = style.INK) -> None:
    """A filled circle at each lookahead and value whose status is solved, an open one elsewhere."""
    for H, value, status in points:
        face = color if status == SOLVED else "white"
        axes.plot(H, value, "o", color=color, markerfacecolor=face, markersize=3, zorder=4)


def _over_time(panels: list[Axes], plans: Sequence[tuple[Plan, str]]) -> None:
    labels = (
        "J_T of eq. (42) (no unit)",
        "fastest change of an\nactivation (1/s)",
        "muscles at their bound\nof contraction (count)",
    )
    motion = plans[0][0].motion
    for axes, label in zip(panels, labels, strict=True):
        style.shade_phases(axes, motion, motion.steps[-1].time)
        style.number_phases(axes, motion, motion.steps[-1].time)
        axes.set_xlabel("time (s)")
        axes.set_ylabel(label)
    for plan, color in plans:
        times = plan.motion.times[: len(plan.x)]
        cost = np.array([error.paper for error in plan.errors])
        # Without the change from the start to step 1, which every plan has.
        change = np.abs(np.diff(plan.activations, axis=0)).max(axis=1, initial=0.0)
        rate = change / [step.duration for step in plan.motion.steps[1 : len(plan.x)]]
        at_bound = touching(plan)[0][:, :-2].sum(axis=1)
        for axes, values in zip(panels, (cost, rate, at_bound), strict=True):
            at = times[len(times) - len(values) :]
            axes.plot(at, values, "o-", color=color, markersize=2.5, clip_on=False, zorder=3)
    for axes in panels:
        axes.set_ylim(bottom=0)
        axes.yaxis.get_offset_text().set_x(-0.18)  # beside the numbers of phases
    panels[2].set_ylim(0, max(panels[2].get_ylim()[1], 1.1))
    panels[2].yaxis.set_major_locator(MaxNLocator(4, integer=True))


@style.self_contained
def survey_figure(data: Mapping[str, Any]) -> Figure:
    """The figure that `draw_survey` writes."""
    cells = data["cells"]
    height = 78.0
    figure = style.new_figure(height)
    style.headline(figure, f"{style.escaped(data['problem'])}: how far to look ahead")
    left, right = figure.subplots(1, 2)
    figure.subplots_adjust(
        left=0.08, right=0.73, top=1 - 8 / height, bottom=10 / height, wspace=0.34
    )
    colors = matplotlib.colormaps["viridis"](np.linspace(0, 0.92, max(len(cells), 2)))
    handles: list[Line2D] = []
    for cell, color in zip(cells, colors, strict=False):
        plans = cell["lookaheads"]
        lookaheads = [int(H) for H in plans]
        statuses = [plan["status"] for plan in plans.values()]
        least = cell["best"]["planner_objective"]
        excess = [100 * (plan["planner_objective"] / least - 1) for plan in plans.values()]
        variation = [plan["total_variation"] for plan in plans.values()]
        for axes, values in ((left, excess), (right, variation)):
            axes.plot(lookaheads, values, color=color, zorder=3)
            _marks(axes, zip(lookaheads, values, statuses, strict=True), color)
        label = _limits(cell["limits"])
        handles.append(Line2D([], [], color=color, marker="o", markersize=3, label=label))
    left.axhline(1.0, **style.BOUND)
    left.set_yscale("symlog", linthresh=1.0)
    left.set_ylim(bottom=0)
    left.set_ylabel("objective over the best horizon's (%)")
    left.yaxis.set_major_formatter("{x:g}")
    right.set_ylim(bottom=0)
    right.set_ylabel("total variation of activations (no unit)")
    for axes in (left, right):
        axes.set_xlabel("lookahead (time steps)")
        axes.xaxis.set_major_locator(MaxNLocator(8, integer=True))
    best = Line2D([], [], **style.BOUND, label="1 % over the best horizon")
    handles += [best, *_mark_keys()]
    figure.legend(handles=handles, loc="center left", bbox_to_anchor=(0.735, 0.5))
    return figure


def _limits(limits: Mapping[str, float | None]) -> str:
    """Limits on strength and speed in words."""
    activation, rate = limits["activation"], limits["rate"]
    words = [f"|activation| $\\leq$ {activation:g}"] if activation is not None else []
    words += [f"rate $\\leq$ {rate:g}/s"] if rate is not None else []
    return ", ".join(words) or "own bounds"


@style.self_contained
def front_figure(data: Mapping[str, Any]) -> Figure:
    """The figure that `draw_front` writes."""
    height = 70.0
    figure = style.new_figure(height, 90.0)
    style.headline(figure, f"{style.escaped(data['problem'])}: tracking against smoothness")
    axes = figure.subplots()
    figure.subplots_adjust(left=0.16, right=0.97, top=1 - 8 / height, bottom=11 / height)
    for mode, color in (("blind", BLIND), ("horizon", HORIZON)):
        rate = [plan["squared_rate"] for plan in data[mode]]
        tracking = [plan["tracking"] for plan in data[mode]]
        axes.plot(rate, tracking, "o-", color=color, markersize=3, label=mode, gid=mode)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axes.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_xlabel("integral of squared rates (1/s)")
    axes.set_ylabel("tracking: weighted squared distances (no unit)")
    axes.legend()
    return figure

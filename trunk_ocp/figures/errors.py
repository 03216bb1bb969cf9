"""Distances of the trunk from its targets over time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter, StrMethodFormatter

from ..planning.plan import Plan
from ..scene.moments import end_of
from . import style

MAX_NAMED = 8  # points of the trunk in a legend
COLORMAP = "cividis"  # for targets, from base to tip; unlike the colors of muscles


def draw_errors(plan: Plan, folder: Path, formats: Sequence[str]) -> list[Path]:
    """Draw each target's error over time: positions in mm, directions as a length (eq. 42).

    Dots are time steps, the only times that have targets; lines guide the eye.
    """
    with style.styled():
        return style.save(errors_figure(plan), folder, "errors", formats)


def error_series(plan: Plan, kind: str) -> dict[float, tuple[np.ndarray, np.ndarray]]:
    """Times in s and errors of each point Z (m): "position" in m, "direction" without unit.

    If several directors have a target at one point, the worst of them.
    """
    series: dict[float, dict[float, float]] = {}
    if len(plan.x):
        for step, errors in zip(plan.motion.steps, plan.errors, strict=False):
            of_step = zip(getattr(errors, f"{kind}_Z"), getattr(errors, kind), strict=True)
            for Z, error in of_step:
                at = series.setdefault(float(Z), {})
                at[step.time] = max(float(error), at.get(step.time, 0.0))
    return {Z: (np.array([*at]), np.array([*at.values()])) for Z, at in sorted(series.items())}


@style.self_contained
def errors_figure(plan: Plan) -> Figure:
    """The figure that `draw_errors` writes."""
    above = style.header(plan.motion, rows=0) + 4.5
    height = above + 48.0
    figure = style.new_figure(height)
    style.headline(figure, f"{style.title(plan.motion)} ({plan.mode}{style.unsolved_note(plan)})")
    style.legend_below_title(figure, motion=plan.motion)
    grid = figure.add_gridspec(
        1, 2, left=0.09, right=0.88, top=1 - above / height, bottom=10 / height, wspace=0.65
    )
    position, direction = plan.motion.tolerance
    left, right = grid.subplots(squeeze=False)[0]
    _panel(left, plan, "position", 1e3, 1e3 * position)
    left.set_ylabel("position error (mm)")
    _panel(right, plan, "direction", 1.0, direction)
    right.set_ylabel("direction error (no unit)")
    return figure


def _panel(axes: Axes, plan: Plan, kind: str, factor: float, tolerance: float) -> None:
    style.shade_phases(axes, plan.motion, end_of(plan))
    style.number_phases(axes, plan.motion, end_of(plan))
    axes.set_yscale("log")
    axes.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.set_xlabel("time (s)")
    series = error_series(plan, kind)
    if not series:  # a log axis cannot find a range from the line of the tolerance alone
        axes.set_ylim(tolerance / 10, 10 * tolerance)
    axes.axhline(tolerance, color=style.INK, linewidth=0.8, linestyle="--", label="tolerance")
    if not series:
        axes.text(0.5, 0.3, f"no targets of {kind}", color=style.FAINT, transform=axes.transAxes,
                  ha="center")  # fmt: skip
    named = np.linspace(0, len(series) - 1, MAX_NAMED).round().astype(int)
    worst: dict[float, float] = {}
    shades = matplotlib.colormaps[COLORMAP](np.linspace(0.0, 0.88, max(len(series), 2)))
    for n, ((Z, (times, errors)), color) in enumerate(zip(series.items(), shades, strict=False)):
        label = f"Z = {Z:.3g} m" if n in named else None
        axes.plot(times, factor * errors, "o-", color=to_hex(color), markersize=2.8,
                  linewidth=0.6, label=label, clip_on=False, zorder=3)  # fmt: skip
        for time, error in zip(times.tolist(), errors.tolist(), strict=True):
            worst[time] = max(error, worst.get(time, 0.0))
    if len(series) > 1:
        values = [factor * worst[time] for time in sorted(worst)]
        axes.plot(sorted(worst), values, color="k", linewidth=3.0, alpha=0.25, label="worst",
                  gid="worst", zorder=2)  # fmt: skip
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), handlelength=1.4)

"""Ranges of activation that leave the motion unchanged, behind the planned activations."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from ..analysis.redundancy.report import Redundancy
from ..planning.plan import Plan
from ..scene.colors import group_colors, groups
from ..scene.moments import end_of
from . import style

PALE, DARK = 0.22, 0.5  # fraction of color in a band; opaque, to hide the shading of phases
ROW_HEIGHT = 13.5  # mm
MAX_NAME = 10  # letters of a group beside a row


def draw_redundancy(
    redundancy: Redundancy, folder: str | Path, formats: Sequence[str] = style.FORMATS
) -> list[Path]:
    """Draw ranges, plan and least effort of every muscle (activation, no unit) over time.

    Rows are sides of muscle groups, columns segments; contraction upward. Bands are exact at time
    steps and straight in between.
    """
    with style.styled():
        return style.save(redundancy_figure(redundancy), folder, "redundancy", formats)


@style.self_contained
def redundancy_figure(redundancy: Redundancy) -> Figure:
    """The figure that `draw_redundancy` writes."""
    plan = redundancy.plan
    trunk = plan.motion.trunk
    kinds = list(dict.fromkeys((muscle.group, muscle.side) for muscle in trunk.subdomains))
    kinds.sort(key=lambda kind: groups(trunk).index(kind[0]))
    above = style.header(plan.motion, rows=1) + 6.5
    height = ROW_HEIGHT * len(kinds) + above + 12
    figure = style.new_figure(height)
    style.headline(
        figure, f"{style.title(plan.motion)} ({plan.mode}): what each muscle could do instead"
    )
    shown = style.shown_segments(trunk)
    panels = figure.subplots(
        max(len(kinds), 1), len(shown), squeeze=False, sharex=True, sharey=True,
        gridspec_kw={"hspace": 0.16, "wspace": 0.07, "left": 0.09, "right": 0.985,
                     "top": 1 - above / height, "bottom": 9 / height},
    )  # fmt: skip
    for row, (group, side) in enumerate(kinds):
        name = style.escaped(style.shortened(group, MAX_NAME))
        panels[row, 0].set_ylabel(f"{name}\n{style.SIDES[side][0]}", color=style.INK)
        for axes, segment in zip(panels[row], shown, strict=True):
            style.shade_phases(axes, plan.motion, end_of(plan))
            style.note_if_empty(axes, trunk, group, segment)
            for index, muscle in style.muscles_of(trunk, group, segment):
                if muscle.side == side:
                    _panel(axes, redundancy, index, group_colors(trunk)[group])
    for axes, lowest, segment in zip(panels[0], panels[-1], shown, strict=True):
        style.head_segment(axes, plan.motion, segment, end_of(plan))
        lowest.set_xlabel("time (s)")
    values = np.concatenate([redundancy.freedom.alone.ravel(), plan.activations.ravel(), [0.0]])
    margin = 0.06 * (np.ptp(values) or 1.0)
    panels[0, 0].set_ylim(values.max() + margin, values.min() - margin)  # contraction upward
    _legend(figure, plan)
    return figure


def _panel(axes: Axes, redundancy: Redundancy, index: int, color: str) -> None:
    plan, freedom = redundancy.plan, redundancy.freedom
    times = plan.times
    start = np.full((1, 2), plan.motion.start[index])
    for band, fraction, gid in ((freedom.alone, PALE, "alone"), (freedom.joint, DARK, "joint")):
        low, high = np.concatenate([start, band[:, index]]).T
        axes.fill_between(times, low, high, color=_mixed(color, fraction), linewidth=0, gid=gid)
    effort = redundancy.versions["least effort"].trajectory[:, index]
    axes.plot(times, plan.trajectory[:, index], ".-", color=color, markersize=2.5, gid="plan")
    axes.plot(times, effort, color="k", linewidth=0.7, linestyle=(0, (2, 1.5)), gid="least effort")
    axes.text(
        0.985, 0.93, freedom.kinds[index], transform=axes.transAxes, ha="right", va="top",
        fontsize=5.5, color=style.INK,
    )  # fmt: skip


def _mixed(color: str, fraction: float) -> str:
    """A color mixed with white."""
    red, green, blue = (1 - fraction * (1 - part) for part in to_rgb(color))
    return to_hex((red, green, blue))


def _legend(figure: Figure, plan: Plan) -> None:
    ink = style.INK
    handles = [
        Patch(color=_mixed(ink, PALE), linewidth=0, label="range, each step alone"),
        Patch(color=_mixed(ink, DARK), linewidth=0, label="within the bounds on change"),
        Line2D([], [], color=ink, marker=".", markersize=2.5, label="plan"),
        Line2D([], [], color="k", linewidth=0.7, linestyle=(0, (2, 1.5)), label="least effort"),
    ]
    style.legend_below_title(figure, handles, motion=plan.motion)

"""How far a simulated trunk is from the planned one, and how fast it moves."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from ..planning.simulated_plan import SimulatedPlan
from ..scene.moments import end_of
from . import style


def draw_simulation(result: SimulatedPlan, folder: Path, formats: Sequence[str]) -> list[Path]:
    """Draw distances from the plan and speeds over time."""
    with style.styled():
        return style.save(simulation_figure(result), folder, "simulation", formats)


def simulation_figure(result: SimulatedPlan) -> Figure:
    """The figure that `draw_simulation` writes."""
    height, plan, times = 62.0, result.plan, result.simulation.times
    figure = style.new_figure(height)
    name = f"{style.title(plan.motion)} ({plan.mode}), with inertia"
    style.headline(figure, name)
    style.legend_below_title(figure, style.phase_patches(plan.motion))
    grid = figure.add_gridspec(
        1, 2, left=0.075, right=0.98, top=1 - 14 / height, bottom=10 / height, wspace=0.25
    )
    left, right = grid.subplots(squeeze=False)[0]
    for axes in (left, right):
        style.shade_phases(axes, plan.motion, end_of(plan))
        axes.set_xlabel("time (s)")
    left.plot(times, 1e3 * result.distance.max(axis=1), color=style.INK, label="largest")
    left.plot(times, 1e3 * result.distance[:, -1], color=style.FAINT, linestyle="--", label="tip")
    left.set_ylabel("distance from the plan (mm)")
    speed = np.linalg.norm(result.simulation.velocity, axis=2)
    right.plot(times, speed.max(axis=1), color=style.INK, label="largest")
    right.plot(times, speed[:, -1], color=style.FAINT, linestyle="--", label="tip")
    right.set_ylabel("speed (m/s)")
    for axes in (left, right):
        axes.set_ylim(bottom=0)
        axes.legend(loc="best")
    return figure

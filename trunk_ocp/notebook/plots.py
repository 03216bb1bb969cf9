"""Figures of a plan by name, as matplotlib figures that notebooks show."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from ..errors import InputError
from ..figures import style
from ..figures.activations import activations_figure
from ..figures.errors import errors_figure
from ..figures.muscles import muscles_figure
from ..figures.shapes import rows_of, shapes_figure
from ..planning.plan import Plan
from ..scene.moments import end_of, moments_at, times_of_motion


def drawn(plan: Plan, name: str, **options: Any) -> Figure:
    """A figure of a plan; see `planning.plots.Plots`.

    Raises
    ------
    InputError
        If the plan has no time steps.
    """
    if not len(plan.x):
        raise InputError(f"{plan.motion.name}: the plan has no time steps; nothing to draw.")
    with style.styled():
        return FIGURES[name](plan, **options)


def _shapes(plan: Plan) -> Figure:
    return shapes_figure(plan, rows_of(plan))


def _muscles(plan: Plan, side: str) -> Figure:
    """The muscles of one side.

    Raises
    ------
    InputError
        If the trunk has no muscles on that side.
    """
    sides = sorted({muscle.side for muscle in plan.motion.trunk.subdomains})
    if side not in sides:
        known = " or ".join(map(repr, sides)) or "a trunk with muscles"
        raise InputError(f"side = {side!r}: expected {known}.")
    end = end_of(plan)
    times = times_of_motion(plan) if end > 0 else np.zeros(1)
    return muscles_figure(plan, moments_at(plan, times), side)


FIGURES: dict[str, Callable[..., Figure]] = {
    "shapes": _shapes,
    "activations": activations_figure,
    "muscles": _muscles,
    "errors": errors_figure,
}

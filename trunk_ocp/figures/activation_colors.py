"""Colors of |activation|: one scale for muscles in space and for maps over time."""

from __future__ import annotations

import matplotlib
import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from ..planning.active_bounds import limits
from ..planning.plan import Plan
from . import style

ACTIVATION = "YlOrRd"  # darker is stronger, to any color vision and in gray
LABEL = "|activation| (no unit)"


def activation_color(scale: Normalize, activation: float) -> tuple[float, float, float]:
    """Color of a muscle with an activation."""
    return matplotlib.colormaps[ACTIVATION](float(scale(abs(activation))))[:3]


def strongest(plan: Plan) -> float:
    """Upper end of the color bar: the bound on |activation|, or a plan's largest if beyond it."""
    count = len(plan.motion.trunk.muscles)
    values = [bound[:, :count].ravel() for bound in limits(plan)] + [
        plan.trajectory[:, :-2].ravel()
    ]
    return float(np.nanmax(np.abs(np.concatenate(values)), initial=0.0)) or 1.0


def color_bar(figure: Figure, scale: Normalize) -> None:
    """Draw the color bar of |activation| at the bottom of a figure."""
    height = figure.get_figheight() / style.MM
    axes = figure.add_axes((0.3, 9.0 / height, 0.4, 2.2 / height), label="color bar")
    mapped = ScalarMappable(scale, matplotlib.colormaps[ACTIVATION])
    figure.colorbar(mapped, cax=axes, orientation="horizontal", label=LABEL)


def color_bar_beside(panels: np.ndarray, scale: Normalize) -> None:
    """Draw the color bar of |activation| to the right of panels (rows, columns)."""
    top, bottom = panels[0, -1].get_position(), panels[-1, -1].get_position()
    figure = panels[0, 0].figure
    place = (top.x1 + 0.02, bottom.y0, 0.012, top.y1 - bottom.y0)
    axes = figure.add_axes(place, label="color bar")
    figure.colorbar(ScalarMappable(scale, matplotlib.colormaps[ACTIVATION]), cax=axes, label=LABEL)

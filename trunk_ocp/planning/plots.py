"""The figures of a plan: `plan.plot.shapes()` and the others."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from .._support.outputs import outputs

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, repr=False)
class Plots:
    """Figures of a plan, each a new matplotlib Figure to change, show or save.

    They have the look of those that `solve-motion` writes. Of a plan that is not solved, they show
    the planned steps, and the title says so. InputError for a plan without time steps.
    """

    _plan: object

    def __repr__(self) -> str:
        return f"<Plots of {self._plan!r}: shapes(), activations(), muscles(), errors()>"

    def shapes(self) -> Figure:
        """The trunk through each phase with head, log, obstacles and targets, in m."""
        return outputs().figure(self._plan, "shapes")

    def activations(self) -> Figure:
        """Activations (no unit) and head angles (degrees) over time, with their bounds."""
        return outputs().figure(self._plan, "activations")

    def muscles(self, side: Literal["R", "L"] = "R") -> Figure:
        """Each muscle group of the right or left side alone, colored by |activation|."""
        return outputs().figure(self._plan, "muscles", side=side)

    def errors(self) -> Figure:
        """Distances from the targets over time: positions in mm, directions without unit."""
        return outputs().figure(self._plan, "errors")

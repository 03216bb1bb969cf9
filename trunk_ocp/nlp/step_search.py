"""How far to go along a step of a quadratic model, and what makes up for its curvature."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from .condensed_window import CondensedWindow
from .control_qp import ControlQP, QPError, QPStep
from .outcome import FEASIBILITY_TOL
from .pace import Pace
from .quadratic_model import QuadraticModel
from .window import Window

MAX_TRIALS = 7
"""Of shares of a step, until one lowers the objective and rods find their equilibrium."""
MAX_CORRECTIONS = 2
"""Second-order corrections of a step."""
SUFFICIENT_DECREASE = 1e-4
MOST_REDUCED = 0.02, 0.5
"""Limits of what is left of a share in the next trial."""


@dataclass(frozen=True, eq=False)
class SQPPoint:
    """A decision vector, with what the next solve needs.

    Attributes
    ----------
    full : (variables,)
    multipliers : (3 D,)
        Of the equations of held directions.
    forces : (variables,) or None
        As in `CondensedWindow.model`.
    residual : float
        Of the equations at `full`, for the window that it was found for.
    """

    full: np.ndarray
    multipliers: np.ndarray
    forces: np.ndarray | None = None
    residual: float = math.inf


@dataclass(frozen=True, eq=False)
class StepSearch:
    """Points along the step `found` of a model; all are in equilibrium and within bounds."""

    qp: ControlQP
    condensed: CondensedWindow
    window: Window
    model: QuadraticModel
    found: QPStep
    pace: Pace

    def accepted(self, expected: float, surely: bool) -> SQPPoint | None:
        """The first point that is accepted: after the step, a corrected step, or a share of it.

        Parameters
        ----------
        expected : float
            Change of the objective by the model, which the step must achieve in part; infinite if
            the step restores bounds, so that any is accepted.
        surely : bool
            Whether to go on after the deadline, though without corrections.
        """
        share = 1.0
        for trial in range(MAX_TRIALS):
            if trial and not (surely or self.pace.allows("trial")):
                break
            goal = self.model.objective + SUFFICIENT_DECREASE * share * expected
            point, value = self._moved(self.model, self.found, share)
            if point is not None and value <= goal:
                return point
            if point is not None and not trial:
                corrected = self._corrected(point, value, goal)
                if corrected is not None:
                    return corrected
            share *= self._reduction(share * expected, value)
        return None

    def _reduction(self, expected: float, value: float) -> float:
        """What to multiply a share with that was expected to change the objective so, but did not.

        Targets' errors beyond the model grow with the square of the share, their costs with its
        fourth power: they may take half of what the next share gains.
        """
        excess = value - self.model.objective - expected
        if not (0 < excess < math.inf and expected < 0):
            return MOST_REDUCED[1]
        return float(np.clip(np.cbrt(-expected / (2 * excess)), *MOST_REDUCED))

    def polished(self, point: SQPPoint) -> SQPPoint:
        """The accepted point or, if that is better and there is time, the corrected one."""
        value = self.condensed.objective(point.full)
        return self._corrected(point, value, value) or point

    def _corrected(self, point: SQPPoint, value: float, goal: float) -> SQPPoint | None:
        """The point after corrections, if its objective reaches the goal."""
        for _ in range(MAX_CORRECTIONS):
            if not self.pace.allows("program", "trial"):
                return None
            again = self.condensed.recentered(self.model, point.full)
            try:
                with self.pace.part("program"):
                    found = self.qp.solve(self.window, again, point.full[self.condensed.x])
            except QPError:
                return None
            corrected, now = self._moved(again, found)
            if corrected is None or now <= goal:
                return corrected
            if now > value:
                return None
            point, value = corrected, now
        return None

    def _moved(
        self, model: QuadraticModel, found: QPStep, share: float = 1.0
    ) -> tuple[SQPPoint | None, float]:
        """The point after a share of a step and its objective; None if rods do not settle."""
        condensed = self.condensed
        with self.pace.part("trial"):
            moved = condensed.moved(model, found.step, share)
            full, residual = condensed.settled(moved, self.model.rods)
            if not residual <= FEASIBILITY_TOL:
                return None, math.inf
            forces = condensed.expected_forces(model, share * found.step)
            point = SQPPoint(full, found.multipliers, forces, residual)
            return point, condensed.objective(full)

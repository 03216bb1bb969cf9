"""Costs of a plan."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..problem.motion import Motion
from ..problem.weights import Weights


@dataclass(frozen=True)
class Objective:
    """Costs of a plan: the paper's J (eq. 42, un-squared norms, in m) and the planner's own.

    The planner minimizes `tracking` + `effort` + `rate` + `head_effort`; see `Weights`.
    """

    paper: float
    tracking: float
    effort: float
    rate: float
    head_effort: float

    @property
    def total(self) -> float:
        """What the planner minimizes."""
        return self.tracking + self.effort + self.rate + self.head_effort


def objective_of(
    motion: Motion, x: np.ndarray, weights: Weights, paper: float, tracking: float
) -> Objective:
    """Costs of planned controls x (H, muscles + 2), given those of the distance to targets."""
    working = np.array([bool(step.targets) for step in motion.steps[: len(x)]], dtype=bool)
    squares = np.sum(x[working] ** 2, axis=0)  # steps without targets are free
    return Objective(
        paper,
        tracking,
        effort=float(weights.of_muscles(motion.trunk.muscles) @ squares[:-2]),
        rate=weights.rate * squared_rate(motion, x),
        head_effort=weights.head_effort * float(squares[-2:].sum()),
    )


def squared_rate(motion: Motion, x: np.ndarray) -> float:
    """Integral over time of the squared rates of planned controls x (H, muscles + 2), 1/s.

    Of straight lines between time steps, from the motion's start on.
    """
    change = np.diff(np.concatenate([motion.start[None], x]), axis=0)
    duration = np.array([step.duration for step in motion.steps[: len(x)]])
    return float(np.sum(change**2 / duration[:, None]))

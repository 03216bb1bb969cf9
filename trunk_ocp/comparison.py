"""Sequential against horizon: what foresight changes, in numbers."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from .solution import Plan, squared_rate


@dataclass(frozen=True)
class Measures:
    """What a plan achieves and what it costs.

    Attributes
    ----------
    planner_objective : float
        What the planner minimises: tracking + effort + rate.
    paper_objective : float
        J of eq. (42), summed over time steps.
    worst_position_error, mean_position_error : float
        Over all targets of all steps, in m.
    worst_direction_error : float
    squared_activation : float
        Sum over time steps of the squared activations.
    squared_rate : float
        Integral over time of the squared rates of activations and head angles, 1/s, of straight
        lines between time steps.
    largest_change : float
        Largest change of one activation between two time steps, the first step's from rest
        left out.
    change_excess : float
        Largest excess over the bounds on change between consecutive steps; a sequential plan
        that follows auxiliary solutions may have one.
    seconds : float
        Wall time of the plan, the plan it starts from included.
    """

    planner_objective: float
    paper_objective: float
    worst_position_error: float
    mean_position_error: float
    worst_direction_error: float
    squared_activation: float
    squared_rate: float
    largest_change: float
    change_excess: float
    iterations: int
    seconds: float


def measure(plan: Plan) -> Measures:
    """Measures of one plan."""
    positions = np.concatenate([e.position for e in plan.errors] or [np.zeros(0)])
    directions = np.concatenate([e.direction for e in plan.errors] or [np.zeros(0)])
    x = np.concatenate([np.zeros((1, plan.x.shape[1])), plan.x])
    change = np.diff(x, axis=0)
    steps = plan.motion.steps[: len(plan.x)]
    excess = [
        np.maximum(step.change.lower - dx, dx - step.change.upper).max()
        for step, dx in zip(steps, change, strict=True)
    ]
    return Measures(
        planner_objective=plan.objective.total,
        paper_objective=plan.objective.paper,
        worst_position_error=float(positions.max(initial=0.0)),
        mean_position_error=float(positions.mean()) if positions.size else 0.0,
        worst_direction_error=float(directions.max(initial=0.0)),
        squared_activation=float(np.sum(plan.activations**2)),
        squared_rate=squared_rate(plan),
        largest_change=float(np.abs(change[1:, :-2]).max(initial=0.0)),
        change_excess=max(0.0, float(max(excess, default=0.0))),
        iterations=plan.iterations,
        seconds=plan.total_seconds,
    )


def compare(sequential: Plan, horizon: Plan) -> dict[str, dict[str, Any]]:
    """Measures of both plans of one motion, by the names of their modes."""
    return {plan.mode: asdict(measure(plan)) for plan in (sequential, horizon)}

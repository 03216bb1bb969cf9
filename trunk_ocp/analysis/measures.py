"""Measures of what a plan achieves and costs, for comparing ways of planning."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Annotated, Any, get_type_hints

import numpy as np

from .._support.arguments import check_arguments
from ..planning.active_bounds import touching
from ..planning.plan import Plan
from ..problem.weights import Weights
from .reached_bounds import change_excess

REVERSAL = 0.1
"""Distance an activation must move before and after a turn for it to count as a reversal."""


@dataclass(frozen=True)
class Measures:
    """Measures of one plan: each with its unit, "" if it is dimensionless, and its meaning."""

    status: Annotated[str, "", "how the plan ended, as in summary.json"]
    planner_objective: Annotated[
        float, "", "weighted tracking + effort + rate + head effort, minimized"
    ]
    paper_objective: Annotated[float, "", "J of eq. (42), not squared, summed over time steps"]
    tracking: Annotated[float, "", "weighted squared distances of all targets of all time steps"]
    worst_position_error: Annotated[float, "m", "largest distance to a target"]
    mean_position_error: Annotated[float, "m", "mean distance to a target, over all targets"]
    worst_direction_error: Annotated[float, "", "largest length of the error of a director"]
    squared_activation: Annotated[float, "", "sum of squares over muscles and time steps"]
    squared_rate: Annotated[
        float,
        "1/s",
        "integral over time of the squared rates of activations and head angles, along straight "
        "lines between time steps, from the start on",
    ]
    total_variation: Annotated[
        float,
        "",
        "sum over muscles of the magnitudes of all changes from step to step, without the change "
        "from the start to step 1",
    ]
    largest_change: Annotated[
        float,
        "",
        "largest change of one activation between two steps, without that from the start to step 1",
    ]
    reversals: Annotated[
        int,
        "",
        "turns, summed over muscles, before and after which an activation moves by more than "
        f"{REVERSAL:g}; from step 1 on",
    ]
    time_at_bound: Annotated[
        float,
        "s",
        "time at the bound of contraction, summed over muscles; each step counts for its duration",
    ]
    saturated_muscles: Annotated[int, "", "number of muscles that reach their bound of contraction"]
    head_travel: Annotated[
        float,
        "rad",
        "sum of the magnitudes of all changes of both head angles, from the start on",
    ]
    change_excess: Annotated[
        float,
        "",
        "largest excess over the bounds on change between consecutive steps; a sequential plan "
        "that follows auxiliary solutions may have one",
    ]
    iterations: Annotated[int, "", "of the optimizer, with those of the starting plan"]
    seconds: Annotated[float, "s", "wall time of the plan, including that of the starting plan"]


DEFINITIONS: dict[str, tuple[str, str]] = {
    name: hint.__metadata__ for name, hint in get_type_hints(Measures, include_extras=True).items()
}
"""Unit and meaning of each measure."""


@check_arguments
def plan_measures(plan: Plan, weights: Weights | None = None) -> Measures:
    """Measures of one plan.

    Parameters
    ----------
    plan : Plan
    weights : Weights, optional
        For the objective; by default the plan's own.

    Returns
    -------
    Measures

    Raises
    ------
    InputError
        If an argument is of the wrong type.
    """
    weights = weights or plan.weights
    positions = np.concatenate([e.position for e in plan.errors] or [np.zeros(0)])
    directions = np.concatenate([e.direction for e in plan.errors] or [np.zeros(0)])
    change = np.diff(plan.trajectory, axis=0)
    objective = plan.objective
    weighted = plan.costs(weights, objective.paper, objective.tracking)
    return Measures(
        status=plan.check().name.lower(),
        planner_objective=weighted.total,
        paper_objective=objective.paper,
        tracking=objective.tracking,
        worst_position_error=float(positions.max(initial=0.0)),
        mean_position_error=float(positions.mean()) if positions.size else 0.0,
        worst_direction_error=float(directions.max(initial=0.0)),
        squared_activation=float(np.sum(plan.activations**2)),
        squared_rate=plan.squared_rate,
        total_variation=float(np.abs(change[1:, :-2]).sum()),
        largest_change=float(np.abs(change[1:, :-2]).max(initial=0.0)),
        reversals=sum(reversals(curve) for curve in plan.activations.T),
        time_at_bound=time_at_bounds(plan),
        saturated_muscles=int(touching(plan)[0][:, :-2].any(axis=0).sum()),
        head_travel=float(np.abs(change[:, -2:]).sum()),
        change_excess=max(0.0, change_excess(plan)),
        iterations=plan.iterations,
        seconds=plan.total_seconds,
    )


def reversals(curve: np.ndarray, least: float = REVERSAL) -> int:
    """Number of turns of a curve (H,), without small wiggles.

    A turn counts if the curve has moved by more than `least` since the previous turn, and then
    moves back by more than that.
    """
    count, direction = 0, 0  # +1 rising, -1 falling, 0 neither so far
    lowest, highest = np.inf, -np.inf
    for value in curve.tolist():
        lowest, highest = min(lowest, value), max(highest, value)
        if direction <= 0 and value - lowest > least:
            count += direction < 0
            direction, highest = 1, value
        elif direction >= 0 and highest - value > least:
            count += direction > 0
            direction, lowest = -1, value
    return count


def time_at_bounds(plan: Plan) -> float:
    """Time in s at the bound of contraction, summed over muscles, by the steps' durations."""
    below, _ = touching(plan)
    durations = [step.duration for step in plan.motion.steps[: len(plan.x)]]
    return float(below[:, :-2].sum(axis=1) @ np.array(durations))


@check_arguments
def compare(sequential: Plan, horizon: Plan) -> dict[str, dict[str, Any]]:
    """Measures of both plans of one motion, by the names of their modes."""
    return {plan.mode: asdict(plan_measures(plan)) for plan in (sequential, horizon)}

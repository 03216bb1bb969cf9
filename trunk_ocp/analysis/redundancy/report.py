"""Everything about a motion's redundancy in one place, and as JSON."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from ...planning.plan import Plan
from .needed import AblationResult
from .ranges import NARROW, Freedom, freedom
from .variants import fewest_muscles, least_cost, least_effort, least_peak


@dataclass(frozen=True, repr=False)
class Redundancy:
    """What a plan's motion leaves open, and the best of all choices.

    Attributes
    ----------
    versions : dict
        The same motion by other activations: "plan" itself, "least cost" (by the planner's
        weights), "least effort", "least peak", "fewest muscles".
    needs : tuple of AblationResult
        What the motion is like without each muscle; empty if nobody asked.
    """

    plan: Plan
    freedom: Freedom
    versions: dict[str, Plan]
    needs: tuple[AblationResult, ...] = ()


def redundancy(plan: Plan) -> Redundancy:
    """Ranges, kinds of muscles and the best versions of a plan's motion.

    Raises
    ------
    InputError
        If the plan is not a verified one of all time steps.
    """
    versions = {
        "plan": plan,
        "least cost": least_cost(plan),
        "least effort": least_effort(plan),
        "least peak": least_peak(plan),
        "fewest muscles": fewest_muscles(plan),
    }
    return Redundancy(plan, freedom(plan), versions)


def cost(plan: Plan) -> dict[str, float]:
    """What activations cost: no unit, but 1/s for the rate."""
    return {
        "squared_activation": float(np.sum(plan.activations**2)),
        "squared_rate": plan.squared_rate,
        "largest_activation": float(np.abs(plan.activations).max(initial=0.0)),
        "working_muscles": int(np.count_nonzero(largest(plan) > NARROW)),
        "planner_objective": plan.objective.total,
    }


def largest(plan: Plan) -> np.ndarray:
    """Largest size of each activation (muscles,) during a motion."""
    return np.abs(plan.activations).max(axis=0, initial=0.0)


def report(found: Redundancy) -> dict[str, Any]:
    """A motion's redundancy in numbers, ready for JSON."""
    plan, free = found.plan, found.freedom
    peaks = {name: largest(version) for name, version in found.versions.items()}
    return {
        "problem": plan.motion.name,
        "mode": plan.mode,
        "versions": {name: cost(version) for name, version in found.versions.items()},
        "muscles": [
            {
                "name": name,
                "kind": kind,
                "narrowest_range": float(free.width[:, i].min()),
                "widest_range": float(free.width[:, i].max()),
                "steps_at_work": int(free.must_work[:, i].sum()),
                "least_work": float(free.least_work[:, i].max()),
                "largest_activation": {which: float(peak[i]) for which, peak in peaks.items()},
                "range_alone": free.alone[:, i].tolist(),
                "range_joint": free.joint[:, i].tolist(),
            }
            for i, (name, kind) in enumerate(
                zip(plan.motion.trunk.muscles, free.kinds, strict=True)
            )
        ],
        "without": [asdict(need) for need in found.needs],
        "times": plan.motion.times.tolist(),
        "units": {
            "times": "s",
            "squared_rate": "1/s",
            "working_muscles": f"those that contract by more than {NARROW:g} at some step",
            "worst_position_error, mean_position_error": "m",
            "range_alone": "smallest and largest activation at each time step, that step alone",
            "range_joint": "the same with all steps within the bounds on change",
            "steps_at_work": "time steps at which the muscle cannot rest",
            "least_work": "largest, over time steps, of the least the muscle must contract",
        },
    }

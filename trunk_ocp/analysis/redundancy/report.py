"""The redundancy of one motion in one place, ready for JSON."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from ...planning.plan import Plan
from .ablation import AblationResult
from .activation_ranges import NARROW_RANGE, Freedom, muscle_freedom
from .alternatives import fewest_muscles, least_cost, least_effort, least_peak


@dataclass(frozen=True, repr=False)
class Redundancy:
    """What the motion of a plan leaves open, and the best choices.

    Attributes
    ----------
    versions : dict
        The same motion by other activations: "plan" itself, "least cost" (by the planner's
        weights), "least effort", "least peak", "fewest muscles".
    needs : tuple of AblationResult
        The motion without each muscle; empty if not computed.
    """

    plan: Plan
    freedom: Freedom
    versions: dict[str, Plan]
    needs: tuple[AblationResult, ...] = ()

    def as_dict(self) -> dict[str, Any]:
        """All numbers, ready for JSON."""
        plan, free = self.plan, self.freedom
        peaks = {name: largest(version) for name, version in self.versions.items()}
        return {
            "problem": plan.motion.name,
            "mode": plan.mode,
            "versions": {name: cost(version) for name, version in self.versions.items()},
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
            "without": [asdict(need) for need in self.needs],
            "times": plan.motion.times.tolist(),
            "units": {
                "times": "s",
                "squared_rate": "1/s",
                "working_muscles": f"muscles with |activation| above {NARROW_RANGE:g} at some step",
                "worst_position_error, mean_position_error": "m",
                "range_alone": "smallest and largest activation at each time step, that step alone",
                "range_joint": "the same with all steps within the bounds on change",
                "steps_at_work": "time steps at which the muscle cannot rest",
                "least_work": "largest, over time steps, of the least the muscle must contract",
            },
        }


def analyze_redundancy(plan: Plan) -> Redundancy:
    """Activation ranges, kinds of muscles and the best versions of a plan's motion.

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
    return Redundancy(plan, muscle_freedom(plan), versions)


def cost(plan: Plan) -> dict[str, float]:
    """Costs of a plan's activations: dimensionless, except for the rate in 1/s."""
    return {
        "squared_activation": float(np.sum(plan.activations**2)),
        "squared_rate": plan.squared_rate,
        "largest_activation": float(np.abs(plan.activations).max(initial=0.0)),
        "working_muscles": int(np.count_nonzero(largest(plan) > NARROW_RANGE)),
        "planner_objective": plan.objective.total,
    }


def largest(plan: Plan) -> np.ndarray:
    """Largest magnitude of each activation (muscles,) during a motion."""
    return np.abs(plan.activations).max(axis=0, initial=0.0)

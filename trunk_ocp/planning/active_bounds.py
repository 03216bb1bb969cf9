"""Bounds on the controls of a plan, and where it reaches them."""

from __future__ import annotations

import math

import numpy as np

from .plan import Plan

ACTIVE_BOUND_TOL = 1e-3  # of a bound's range; an interior-point method stops short of bounds


def limits(plan: Plan) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper bounds (H, muscles + 2) of a plan's time steps, rad for angles.

    Where a sequential plan follows an auxiliary solution, the motion's bounds on activations
    replace the phase's (appendix B); the deviation from that solution is no bound on a muscle.
    """
    motion, count = plan.motion, len(plan.motion.trunk.muscles)
    steps = motion.steps[: len(plan.x)]
    lower = np.array([step.box.lower for step in steps]).reshape(-1, count + 2)
    upper = np.array([step.box.upper for step in steps]).reshape(-1, count + 2)
    for t in plan.auxiliary:
        auxiliary = steps[t].auxiliary if t < len(steps) else None
        if auxiliary is not None and math.isfinite(auxiliary.activation_deviation):
            lower[t, :count] = motion.box.lower[:count]
            upper[t, :count] = motion.box.upper[:count]
    return lower, upper


def touching(plan: Plan) -> tuple[np.ndarray, np.ndarray]:
    """Which controls (H, muscles + 2) are at their lower and at their upper bound.

    A control whose bounds are equal is at neither.
    """
    lower, upper = limits(plan)
    room = upper - lower
    near = ACTIVE_BOUND_TOL * room
    free = room > 0
    return free & (plan.x - lower <= near), free & (upper - plan.x <= near)

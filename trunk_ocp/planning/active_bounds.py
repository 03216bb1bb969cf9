"""The bounds a motion sets, and where a plan touches them."""

from __future__ import annotations

import math

import numpy as np

from .plan import Plan

TOUCH = 1e-3  # of the room between two bounds; an interior-point method never quite arrives


def limits(plan: Plan) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper bounds (H, muscles + 2) of the motion at a plan's time steps, rad for angles.

    Where a sequential plan follows an auxiliary solution, appendix B has the bounds of the whole
    motion in place of the phase's; how far it may be from that solution is no bound on a muscle.
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
    """Which unknowns (H, muscles + 2) are at their lower and at their upper bound.

    A muscle that may not move at all is at neither: it has no choice.
    """
    lower, upper = limits(plan)
    room = upper - lower
    near = TOUCH * room
    free = room > 0
    return free & (plan.x - lower <= near), free & (upper - plan.x <= near)

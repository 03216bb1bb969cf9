"""Free choices of a plan: a side taken by chance, a head that turns at almost no benefit.

If a motion is its own mirror image, the mirror image of each plan has the same cost, and chance
decides which of the two is found. If the cost hardly depends on a head angle, the angle ends
wherever its bounds happen to be. Both look like findings about the trunk unless they are reported.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from .._support.wording import rounded
from ..errors import InputError
from ..planning.options import Options
from ..planning.plan import Plan
from ..planning.planner import plan_from
from ..planning.status import Status
from ..problem.mirror import is_symmetric, mirrored_controls
from ..problem.variants import held_head_spec
from ..reporting import Reporter

ONE_SIDED_TOL = 0.05  # asymmetry of activations, or of angles in rad, above which it is reported
HEAD_TURN_TOL = np.radians(1.0)  # smaller head angles count as none
NEGLIGIBLE_ERROR = 0.05  # of the tolerance; smaller errors are not compared
MAX_ITERATIONS = 300
TINY = np.finfo(float).tiny
AXES = ("z", "y")  # psi_Z, psi_Y


def one_sided(plan: Plan) -> str:
    """A sentence if a plan is one-sided although its motion is symmetric, else ""."""
    if not len(plan.x) or not is_symmetric(plan.motion):
        return ""
    image = mirrored_controls(plan.motion.trunk, plan.x)
    muscles = float(np.abs(image - plan.x)[:, :-2].max(initial=0.0))
    turned = plan.head[np.argmax(np.abs(plan.head[:, 0])), 0]
    if max(muscles, abs(turned)) <= ONE_SIDED_TOL:
        return ""
    sentence = (
        f"activations of right and left differ by up to {muscles:.2g}, and could be exchanged at "
        "the same cost"
    )
    if abs(turned) > HEAD_TURN_TOL:
        degrees = np.degrees(turned)
        sentence = (
            f"psi_Z reaches {degrees:.3g} deg, and {-degrees:.3g} would be equally good; "
            f"{sentence}; symmetric = true in [weights] gives equal sides and a straight head"
        )
    return sentence


def held_heads(plan: Plan, angles: set[int], reporter: Reporter | None = None) -> Iterator[str]:
    """Cost of holding head angles (0: psi_Z, 1: psi_Y) at 0, one sentence each.

    Each takes a new plan, started from this one. An angle is skipped if it may not be 0, hardly
    moves, or if no plan is found with it held.
    """
    for angle in sorted(angles):
        if np.abs(plan.head[:, angle]).max(initial=0.0) <= HEAD_TURN_TOL:
            continue
        try:
            motion = plan.motion.with_spec(held_head_spec(plan.motion.spec, angle))
        except InputError:
            continue
        options = Options(weights=plan.weights, max_iterations=MAX_ITERATIONS)
        again = plan_from(motion, plan.x, None, options, reporter)
        if again.converged and again.verified:
            yield _cost(plan, again, angle)


def _cost(plan: Plan, again: Plan, angle: int) -> str:
    """A sentence that compares a plan with a head angle held to the plan itself."""
    name = f"psi_{AXES[angle].upper()}"
    more = 100 * (again.objective.total / max(plan.objective.total, TINY) - 1)
    worst, before = (
        1e3 * max((float(e.position.max(initial=0.0)) for e in p.errors), default=0.0)
        for p in (again, plan)
    )
    free = again.status is Status.SOLVED
    reached = "every target is still reached" if free else "a target is missed"
    negligible = NEGLIGIBLE_ERROR * 1e3 * plan.motion.tolerance[0]
    if max(worst, before) > negligible and rounded(worst) != rounded(before):
        reached += f", the worst position is {rounded(worst)} mm off instead of "
        reached += rounded(before)
    option = f" (head_{AXES[angle]}_deg = [0.0, 0.0] in [bounds])" if free else ""
    way = "raises" if more >= 0 else "lowers"
    return f"holding {name} at 0{option} {way} the objective by {abs(more):.2g} %; {reached}"

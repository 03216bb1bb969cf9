"""What a plan does though its task does not ask for it: a side taken, a head that turns for free.

Where a motion is its own mirror image, so is each plan's image a plan of the same cost, and which
of the two is found is chance. And where the cost hardly changes along a head angle, it ends
wherever the bounds happen to be. Both look like findings about the trunk unless someone says so.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from .._support.wording import rounded
from ..errors import InputError
from ..planning.options import Options
from ..planning.plan import Plan, Status
from ..planning.planner import plan_from
from ..problem.mirror import is_symmetric, mirrored_unknowns
from ..problem.variants import held_head_spec
from ..reporting import Reporter

LEANS = 0.05  # of an activation or an angle in rad, from which on a plan takes sides
TURNS = np.radians(1.0)  # of a head that turns
NEGLIGIBLE = 0.05  # of the tolerance; errors below it are not compared
ITERATIONS = 300
TINY = np.finfo(float).tiny
AXES = ("z", "y")  # psi_Z, psi_Y


def one_sided(plan: Plan) -> str:
    """A sentence on a plan that takes sides where its motion does not; "" if there is none."""
    if not len(plan.x) or not is_symmetric(plan.motion):
        return ""
    image = mirrored_unknowns(plan.motion.trunk, plan.x)
    muscles = float(np.abs(image - plan.x)[:, :-2].max(initial=0.0))
    turned = plan.head[np.argmax(np.abs(plan.head[:, 0])), 0]
    if max(muscles, abs(turned)) <= LEANS:
        return ""
    told = (
        f"activations of right and left differ by up to {muscles:.2g}, and could be exchanged at "
        "the same cost"
    )
    if abs(turned) > TURNS:
        degrees = np.degrees(turned)
        told = (
            f"psi_Z reaches {degrees:.3g} deg, and {-degrees:.3g} would do as well; {told}; "
            "head_z_deg = [0.0, 0.0] in [bounds] keeps the head straight"
        )
    return told


def held_heads(plan: Plan, angles: set[int], reporter: Reporter | None = None) -> Iterator[str]:
    """What holding head angles (0: psi_Z, 1: psi_Y) at 0 would cost, a sentence each.

    Each is a plan of its own, started from this one. Nothing is said where an angle may not be 0,
    hardly moves, or where no plan is found with it held.
    """
    for angle in sorted(angles):
        if np.abs(plan.head[:, angle]).max(initial=0.0) <= TURNS:
            continue
        try:
            motion = plan.motion.with_spec(held_head_spec(plan.motion.spec, angle))
        except InputError:
            continue
        options = Options(weights=plan.weights, max_iterations=ITERATIONS)
        again = plan_from(motion, plan.x, None, options, reporter)
        if again.converged and again.verified:
            yield _cost(plan, again, angle)


def _cost(plan: Plan, again: Plan, angle: int) -> str:
    """A plan with a head angle held, beside the plan."""
    name = f"psi_{AXES[angle].upper()}"
    more = 100 * (again.objective.total / max(plan.objective.total, TINY) - 1)
    worst, before = (
        1e3 * max((float(e.position.max(initial=0.0)) for e in p.errors), default=0.0)
        for p in (again, plan)
    )
    free = again.status is Status.SOLVED
    reached = "every target is still reached" if free else "a target is missed"
    near = NEGLIGIBLE * 1e3 * plan.motion.tolerance[0]
    if max(worst, before) > near and rounded(worst) != rounded(before):
        reached += f", the worst position is {rounded(worst)} mm off instead of "
        reached += rounded(before)
    option = f" (head_{AXES[angle]}_deg = [0.0, 0.0] in [bounds])" if free else ""
    way = "raises" if more >= 0 else "lowers"
    return f"holding {name} at 0{option} {way} the objective by {abs(more):.2g} %; {reached}"

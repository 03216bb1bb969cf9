"""Tasks of studies: plans made in worker processes."""

from __future__ import annotations

import numpy as np

from ..planning.options import Options
from ..planning.plan import Plan
from ..planning.planner import plan_from, plan_motion
from ..problem.motion import Motion
from ..reporting import Reporter


def sound(plan: Plan) -> bool:
    """Whether a plan is a verified optimum, whether or not it meets its targets."""
    return plan.converged and plan.verified


def plan_of(
    motion: Motion, lookahead: int | None, options: Options, start: Plan | None, reporter: Reporter
) -> Plan:
    """`plan_motion` in a worker process, check included."""
    return _with_status(plan_motion(motion, lookahead, options, reporter, start, throw=False))


def _with_status(plan: Plan) -> Plan:
    plan.check()  # is cached, so that the check runs in the worker
    return plan


def blind_and_horizon(motion: Motion, options: Options, reporter: Reporter) -> tuple[Plan, Plan]:
    """The blind plan and the horizon that starts from it."""
    blind = plan_of(motion, 1, options, None, reporter)
    return blind, plan_of(motion, None, options, blind, reporter)


def plan_from_start(
    motion: Motion, x: np.ndarray, lookahead: int | None, options: Options, reporter: Reporter
) -> Plan:
    """`plan_from` in a worker process, check included."""
    return _with_status(plan_from(motion, x, lookahead, options, reporter))

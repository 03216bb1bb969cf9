"""Planning clear of solids: a plan is made again, with gaps to keep, until it keeps them all."""

from __future__ import annotations

from dataclasses import replace

from ..contact.exchange import Exchange
from .plan import Plan
from .planning_run import PlanningRun

MAX_ROUNDS = 25
"""Plans made to find out which gaps to keep; shipped motions need 2 to 4."""


def clear_of_bodies(plan: Plan, run: PlanningRun) -> Plan:
    """The plan, made again with rows for gaps that are too small, until none is.

    `run` made the plan; its motion says which bodies to keep clear of. Gaps between time steps
    matter once those at time steps are kept. Ends early where a plan does not converge.
    """
    exchange, reporter = Exchange(run.motion), run.optimizer.reporter
    for _ in range(MAX_ROUNDS):
        if not plan.converged or run.stopped or len(plan.x) < len(run.motion.steps):
            break
        if not exchange.add(plan.x, plan.shape) and not exchange.tighten(plan.clearance.between):
            break
        reporter.note(f"Planning again with {exchange.count} gaps to keep.")
        plan = replace(
            run, mesh=plan.mesh, start=None, checkpoint=None, guess=plan.x, gaps=exchange.rows
        ).run()
    return plan

"""Planning clear of solids: a plan is made again, with gaps to keep, until it keeps them all."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from ..contact.exchange import Exchange
from ..contact.gaps import Gap
from ..contact.obstructions import stuck_at_rest
from ..problem.interpolation import interpolate_all
from ..problem.motion import Motion
from ..problem.variants import refined_spec
from .options import REFINEMENTS, TOO_COARSE, finer_mesh
from .plan import Plan
from .planning_run import PlanningRun

MAX_ROUNDS = 25
"""Plans with the same time steps that find out which gaps to keep; shipped motions need 2 to 4."""
MAX_INSERTIONS = 2
"""How often time steps are inserted."""
DETOUR, LEAST_ACTIVATION, LEAST_TURN = 2.0, 0.1, 0.05
"""Largest change on the way to a time step, over that of the plan without detour; and what is
allowed at least: activation, and rad of a head angle."""
MAX_TIGHTENING = 5e-3
"""Collision between time steps that larger gaps at the steps may cure, over the trunk's length;
9 mm for the elephant. A deeper one needs more time steps."""


def clear_of_bodies(plan: Plan, run: PlanningRun) -> Plan:
    """The plan, made again with rows for gaps that are too small, until none is.

    `run` made the plan; its motion says which bodies to keep clear of. Gaps between time steps
    matter once those at time steps are kept. A horizon that passes deep through a body between
    them gets additional time steps. Ends early where a plan does not converge.
    """
    exchange = Exchange(run.motion, dict(run.gaps))
    stuck = {gap.body for gap in stuck_at_rest(run.motion)}
    for insertions in range(MAX_INSERTIONS + 1):
        plan, deep = _exchanged(plan, run, exchange, stuck)
        motion = _refined(plan, deep)
        if insertions == MAX_INSERTIONS or motion is None:
            break
        before, count = len(run.motion.steps), len(motion.steps)
        run.optimizer.reporter.note(
            f"Planning again with {count} time steps instead of {before}, to get around bodies."
        )
        exchange = Exchange(motion)
        guess = interpolate_all(plan.motion, plan.trajectory, motion.times)
        again = replace(run, start=None, checkpoint=None)
        run = replace(again, motion=motion, lookahead=count, guess=guess)
        plan = run.run()
    return plan


def _exchanged(
    plan: Plan, run: PlanningRun, exchange: Exchange, stuck: Collection[str]
) -> tuple[Plan, list[Gap]]:
    """The plan with all gaps that its time steps can keep, and those too small between them.

    stuck : bodies that the trunk is in at rest, which no plan can change.
    """
    reporter, mesh, refinements = run.optimizer.reporter, plan.mesh, 0
    limit = MAX_TIGHTENING * run.motion.trunk.length
    clear_at_steps: Plan | None = None
    for _ in range(MAX_ROUNDS):
        if not plan.converged or run.stopped or len(plan.x) < len(run.motion.steps):
            break
        if exchange.add(plan.x, plan.shape):
            reporter.note(f"Planning again with {exchange.count} gaps to keep.")
        else:
            between = [g for g in plan.clearance.between if g.step or g.body not in stuck]
            deep = [gap for gap in between if exchange.asks(gap.group) and not gap.depth <= limit]
            if deep and run.mode == "horizon":
                return plan, deep
            if ways := exchange.tighten(between):
                clear_at_steps = clear_at_steps or plan
                reporter.note(f"Planning again with wider gaps, for the way to {ways} time steps.")
            elif plan.verification.too_coarse and refinements < REFINEMENTS:
                refinements += 1
                mesh = finer_mesh(run.motion, mesh)
                reporter.note(TOO_COARSE.format(mesh.elements))
            else:
                break
        next_run = replace(run, mesh=mesh, start=None, checkpoint=None, gaps=exchange.rows)
        again = replace(next_run, guess=plan.x).run()
        if clear_at_steps is not None and not again.converged and not again.cut_short:
            return _not_tightened(clear_at_steps, run), []
        plan = again
    return plan, []


def _not_tightened(plan: Plan, run: PlanningRun) -> Plan:
    """The plan before gaps were widened, which collides between time steps, with a note why."""
    violated = next((s.violations for s in reversed(run.optimizer.solves) if s.violations), ())
    reason = f": {violated[0]}" if violated else ""
    note = f"no plan was found with wider gaps, to keep clear between time steps{reason}"
    return plan.with_record(notes=(*plan.notes, note))


def _refined(plan: Plan, deep: Sequence[Gap]) -> Motion | None:
    """The motion with more time steps in the phases with collisions; None if that is no use.

    The new steps must lead somewhere: without bounds on change, one may go around a body on the
    left and the next on the right.
    """
    if not deep:
        return None
    motion = plan.motion
    step_phases = np.array([step.phase for step in motion.steps])
    change = np.abs(np.diff(plan.trajectory, axis=0))
    changes = {}
    for phase in sorted({motion.steps[gap.step].phase for gap in deep}):
        inside = change[step_phases == phase].max(axis=0)
        widest = (inside[:-2].max(), inside[-2], inside[-1])
        least = (LEAST_ACTIVATION, LEAST_TURN, LEAST_TURN)
        changes[phase] = tuple(max(DETOUR * a, b) for a, b in zip(widest, least, strict=True))
    spec = refined_spec(motion.spec, changes)
    return None if spec is None else motion.with_spec(spec)

"""Planning clear of solids: a plan is made again, with gaps to keep, until it keeps them all."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from .._support.wording import step_list
from ..contact.exchange import MARGIN, Exchange
from ..contact.gaps import Gap
from ..contact.obstructions import Obstructions
from ..errors import InputError
from ..problem.interpolation import interpolate_all
from ..problem.motion import Motion
from ..problem.variants import refined_spec
from ..rod.collocation import Mesh
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
NEARLY_CLEAR = 1e-3
"""Collision at time steps with which gaps between them are looked at, too, over the trunk's length;
1.75 mm for the elephant."""
MAX_TIGHTENINGS = 8
"""How often gaps are widened."""
MAX_TIGHTENING = 5e-3
"""Collision between time steps that larger gaps at the steps may cure, over the trunk's length;
9 mm for the elephant. A deeper one needs more time steps."""


def clear_of_bodies(plan: Plan, run: PlanningRun, blocked: Obstructions) -> Plan:
    """The plan, made again with rows for gaps that are too small, until none is.

    `run` made the plan; its motion says which bodies to keep clear of, and `blocked` which it
    cannot. Gaps between time steps matter once those at time steps are kept. A horizon that passes
    deep through a body between them gets additional time steps. Ends early where a plan does not
    converge.
    """
    margin = MARGIN * run.motion.trunk.length
    exchange = Exchange(run.motion, dict(run.gaps), margin=margin)
    most = 0 if blocked.sentences else MAX_INSERTIONS
    for insertions in range(most + 1):
        plan, deep = _exchanged(plan, run, exchange, blocked.at_start)
        motion = _refined(plan, deep) if run.mode == "horizon" and insertions < most else None
        if motion is None:
            break
        before, count = len(run.motion.steps), len(motion.steps)
        run.optimizer.reporter.note(
            f"Planning again with {count} time steps instead of {before}, to get around bodies."
        )
        exchange = Exchange(motion, margin=margin)
        guess = interpolate_all(plan.motion, plan.trajectory, motion.times)
        again = replace(run, start=None, checkpoint=None, gaps={}, multipliers={})
        run = replace(again, motion=motion, lookahead=count, guess=guess, near=None)
        finer = run.run()
        if not finer.converged and not finer.cut_short:
            return _with_reason(plan, run, f"no plan with {count} time steps was found")
        plan = finer
    return plan


def _exchanged(
    plan: Plan, run: PlanningRun, exchange: Exchange, stuck: Collection[str]
) -> tuple[Plan, list[Gap]]:
    """The plan with all gaps that its time steps can keep, and those too small between them.

    stuck : bodies that the trunk is in at the start, which no plan can change.
    """
    reporter, mesh, refinements = run.optimizer.reporter, plan.mesh, 0
    limit, nearly = (x * run.motion.trunk.length for x in (MAX_TIGHTENING, NEARLY_CLEAR))
    nearly_clear, tightenings = None, 0
    for _ in range(MAX_ROUNDS):
        if not plan.converged or run.stopped or len(plan.x) < len(run.motion.steps):
            break
        added = exchange.add(plan.x, plan.shape)
        if added:
            reporter.note(f"Planning again with {exchange.count} gaps to keep.")
        if max(exchange.short.values(), default=0.0) <= nearly:
            between = _between(plan, exchange, stuck)
            deep = [gap for gap in between if exchange.asks(gap.group) and not gap.depth <= limit]
            if deep and not added:
                return plan, deep
            tightenings += 1
            coarse = plan.verification.too_coarse and refinements < REFINEMENTS
            more = tightenings <= MAX_TIGHTENINGS
            ways = exchange.tighten(between, bounds=not coarse) if more else []
            if ways:
                nearly_clear = nearly_clear or plan
                steps = step_list([step + 1 for step in ways])
                reporter.note(f"Planning again with wider gaps, to keep clear before {steps}.")
            elif coarse:
                refinements += 1
                mesh = finer_mesh(run.motion, mesh)
                reporter.note(TOO_COARSE.format(mesh.elements))
            elif not added:
                break
        again = _with_rows(plan, run, exchange, mesh)
        if nearly_clear is not None and not again.converged and not again.cut_short:
            wanted = "no plan was found with wider gaps, to keep clear between time steps"
            return _with_reason(nearly_clear, run, wanted), []
        plan = again
    return plan, []


def _between(plan: Plan, exchange: Exchange, stuck: Collection[str]) -> list[Gap]:
    """Gaps between time steps that the plan may change; lower bounds count if all are kept."""
    hurried = plan.gaps_on_ways(hurry=True)
    between = [gap for gap in hurried if gap.step or gap.body not in stuck]
    if exchange.too_small(between, bounds=False):
        return between
    if not exchange.too_small(hurried, bounds=False):
        vars(plan)["gaps_between"] = hurried  # in no hurry they are the same
    return [gap for gap in plan.gaps_between if gap.step or gap.body not in stuck]


def _with_rows(plan: Plan, run: PlanningRun, exchange: Exchange, mesh: Mesh) -> Plan:
    """The plan made again on a mesh, with all rows known so far."""
    near = plan.shape
    if plan.mesh != mesh:
        near = near.on(mesh)
        run.multipliers.clear()
    kept = replace(run, mesh=mesh, start=None, checkpoint=None, gaps=exchange.rows)
    return replace(kept, guess=plan.x, near=near).run()


def _with_reason(plan: Plan, run: PlanningRun, failure: str) -> Plan:
    """A plan that collides between time steps, with a note why the attempt after it failed."""
    violated = next((s.violations for s in reversed(run.optimizer.solves) if s.violations), ())
    reason = f": {violated[0]}" if violated else ""
    return plan.with_record(notes=(*plan.notes, failure + reason))


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
    try:
        return None if spec is None else motion.with_spec(spec)
    except InputError:
        return None

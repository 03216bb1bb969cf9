"""Planning a motion as a sequence of windows of time steps.

A window of H consecutive steps is one NLP. After each solve the first step
of the window is kept and the window moves on by one; the last window keeps all of its steps.
H = 1 is the paper's sequential solve, H = all the horizon, anything between a receding
horizon; the loop is the same.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import asdict, replace
from numbers import Real

import numpy as np

from .._support.arguments import check_arguments, real_array
from .._support.blas_threads import one_thread
from .._support.provenance import versions
from ..contact.exchange import MARGIN, Exchange
from ..contact.obstructions import obstructions
from ..errors import InputError
from ..nlp.ipopt import Optimizer
from ..nlp.ipopt_options import AGAIN_OPTIONS, CONTACT_OPTIONS, ROUGH_OPTIONS
from ..nlp.size import check_size
from ..problem.motion import Motion
from ..reporting import Reporter
from .avoidance import clear_of_bodies
from .checkpoint import Checkpoint
from .checkpoint_file import COUNTERS
from .options import (
    REFINEMENTS,
    TOO_COARSE,
    Options,
    finer_mesh,
    first_mesh,
    is_deferred,
    mode_of,
)
from .plan import Plan, PlanError
from .planning_run import PlanningRun
from .status import ACCEPTED

ROUGH_ITERATIONS = 200
"""Most iterations of a step of a plan that only starts a horizon; shipped motions take 45."""


@check_arguments
@one_thread()
def plan_motion(
    motion: Motion,
    lookahead: int | None = None,
    options: Options | None = None,
    reporter: Reporter | None = None,
    start: Plan | None = None,
    checkpoint: Checkpoint | None = None,
    throw: bool = True,
    deadline: float | None = None,
    initial: np.ndarray | None = None,
    check: str = "now",
) -> Plan:
    """Find activations and head angles that perform a motion.

    Parameters
    ----------
    lookahead : int, optional
        Time steps planned together: 1 is the paper's sequential solve (with appendix B's
        auxiliary problems, guesses and feasible sets), None all of them.
    start : Plan, optional
        A plan of the same motion to improve on. By default a lookahead beyond 1 first makes a
        sequential plan, with an auxiliary problem for the first step only. The objective of a
        horizon is never worse than that of its start, if the start keeps the horizon's bounds,
        which appendix B does not require of a sequential plan.
    checkpoint : Checkpoint, optional
        Saves the plan after every window, and resumes it.
    throw : bool
        False to return a plan that is not solved instead of raising; look at its `status`.
    deadline : float, optional
        Seconds of wall time after which no iteration of the optimizer begins. The plan as far as
        it was reached is returned with status TIME_LIMIT; its check takes extra time.
    initial : (muscles + 2,), optional
        Activations and head angles (rad) from which the motion starts, in place of its own `start`;
        the same as to plan `motion.started(initial)`.
    check : str
        "later" to return a plan that converged before it is checked: its status is UNCHECKED until
        `plan.check()`. Its mesh is not refined, as only the check could ask for that. Who never
        wants a check never calls it. Motions with contact are checked while they are planned.

    Returns
    -------
    Plan
        Solved and verified, or not checked yet.

    Raises
    ------
    PlanError
        If the plan is not solved; the error has the plan.
    InputError
        If the lookahead is not a whole number of at least 1, the deadline not positive, `check`
        neither of the two, `initial` no controls of this trunk, or the checkpoint belongs to
        another plan.
    KeyboardInterrupt
        On Ctrl-C, unless its handler has been replaced. Any error of a reporter reaches the caller
        as well.
    SolverMissingError
        If the linear solver is not installed.
    """
    began = time.perf_counter()
    motion = motion if initial is None else motion.started(initial)
    options, reporter = options or Options(), reporter or Reporter()
    options = replace(options, weights=options.weights_for(motion))
    mode, lookahead = mode_of(motion, lookahead)
    ends, deferred = began + seconds_allowed(deadline), is_deferred(check)
    _check_start(start, motion)
    optimizer = Optimizer(options.linear_solver, options.max_iterations, reporter, deadline=ends)
    rough_iterations = min(options.max_iterations, ROUGH_ITERATIONS)
    rough = Optimizer(options.linear_solver, rough_iterations, reporter, ROUGH_OPTIONS, ends)
    avoiding = replace(optimizer, ipopt=CONTACT_OPTIONS, warm=AGAIN_OPTIONS, solves=[])
    mesh = first_mesh(motion, options)
    if warning := check_size(motion, mesh, lookahead):
        reporter.note(warning)
    blocked = obstructions(motion)
    for sentence in blocked.sentences:
        reporter.note(f"Note: {sentence}.")
    given = start  # its iterations and seconds are counted as well
    if checkpoint is not None:
        checkpoint.open(motion, mode, lookahead, options, start)
    if mode != "sequential" and start is None:
        first = PlanningRun(motion, mesh, "sequential", 1, options, rough, None, checkpoint)
        start = replace(first, only_starts=True).run()
    run = PlanningRun(motion, mesh, mode, lookahead, options, optimizer, start, checkpoint)
    if motion.contact and start is not None and start.converged:
        seed = Exchange(motion, margin=MARGIN * motion.trunk.length)  # saves a horizon without gaps
        seed.add(start.x, start.shape)
        run = replace(run, gaps=seed.rows, optimizer=avoiding if seed.count else optimizer)
    if run.stopped and start is not None:
        plan = _start_as_plan(start, run)
    else:
        plan = run.run()
        if not motion.contact and not deferred:
            plan = _refined(plan, run)
        elif motion.contact:  # looks at the mesh once gaps are kept
            plan = clear_of_bodies(plan, replace(run, optimizer=avoiding), blocked)
            if run.stopped and plan.collisions:
                plan = _stopped(plan, run)
    parts: list[Optimizer | Plan] = [*([given] if given else []), rough, optimizer, avoiding]
    earlier = (given.total_seconds if given else 0) + (checkpoint.seconds if checkpoint else 0)
    plan = plan.with_record(notes=(*plan.notes, *blocked.sentences))
    plan = _recorded(plan, parts, time.perf_counter() - began + earlier, options, deferred)
    if throw and plan.status not in ACCEPTED:
        raise PlanError(plan)
    return plan


def _recorded(
    plan: Plan, parts: Sequence[Optimizer | Plan], seconds: float, options: Options, deferred: bool
) -> Plan:
    """The plan with the record of all that took part in making it."""
    return plan.with_record(
        **{name: sum(getattr(part, name) for part in parts) for name in COUNTERS},
        total_seconds=seconds,
        solves=tuple(solve for part in parts for solve in part.solves),
        versions=versions(),
        options=asdict(options),
        notes=(*plan.notes, *([] if deferred else plan.doubts)),
        deferred=deferred,
    )


def _check_start(start: Plan | None, motion: Motion) -> None:
    """Raise InputError for a start of another trunk or with more steps than the motion."""
    if start is None:
        return
    if start.motion.trunk != motion.trunk:
        raise InputError("start: expected a plan of the same trunk.")
    if len(start.x) > len(motion.steps):
        raise InputError(
            f"start: has {len(start.x)} time steps; expected at most the motion's, "
            f"{len(motion.steps)}."
        )


def _start_as_plan(start: Plan, run: PlanningRun) -> Plan:
    """The plan that a horizon starts from, if the horizon itself was stopped before its solve."""
    reason = "interrupted" if run.optimizer.reporter.stop else "out of time"
    complete = len(start.x) == len(run.motion.steps)
    what = "the plan it starts from" if complete else "a part of the plan it would start from"
    note = f"{reason} before the horizon's own solve; this is {what}"
    plan = replace(start, motion=run.motion, mode=run.mode, lookahead=run.lookahead, notes=(note,))
    return _stopped(plan, run)


def _refined(plan: Plan, run: PlanningRun) -> Plan:
    """The plan, made again on finer meshes where its check finds the mesh too coarse."""
    mesh = run.mesh
    for _ in range(REFINEMENTS):
        if not plan.converged or not plan.verification.too_coarse or plan.cut_short:
            break
        if run.stopped:
            return _stopped(plan, run)
        mesh = finer_mesh(run.motion, mesh)
        run.optimizer.reporter.note(TOO_COARSE.format(mesh.elements))
        start = plan if run.mode != "sequential" else None
        finer = replace(run, mesh=mesh, start=start).run()
        plan = finer if len(finer.x) == len(plan.x) else _stopped(plan, run)
    return plan


def _stopped(plan: Plan, run: PlanningRun) -> Plan:
    """The plan, marked as stopped by the user or the deadline."""
    interrupted = run.optimizer.reporter.stop
    return plan.with_record(interrupted=interrupted, late=not interrupted)


def seconds_allowed(deadline: float | None) -> float:
    """A deadline in s, infinite if there is none.

    Raises
    ------
    InputError
        If it is not a positive number.
    """
    if deadline is None:
        return math.inf
    if isinstance(deadline, bool) or not isinstance(deadline, Real) or not deadline > 0:
        raise InputError(f"deadline = {deadline!r}: expected seconds, more than 0.")
    return float(deadline)


@check_arguments
def plan_from(
    motion: Motion,
    x: np.ndarray,
    lookahead: int | None = None,
    options: Options | None = None,
    reporter: Reporter | None = None,
) -> Plan:
    """The plan that one solve of each window leads to from given controls, good or bad.

    `plan_motion` looks for a good plan; this is for finding out how many optima there are.

    Parameters
    ----------
    x : (H, muscles + 2)
        Activations and head angles of all time steps; brought within bounds first.

    Raises
    ------
    InputError
        If `x` does not have that shape, or a value is not finite.
    """
    began = time.perf_counter()
    x, shape = real_array(x, "x"), (len(motion.steps), len(motion.trunk.muscles) + 2)
    if x.shape != shape or not np.all(np.isfinite(x)):
        raise InputError(f"x: expected finite values of shape {shape}, got shape {x.shape}.")
    options, (mode, lookahead) = options or Options(), mode_of(motion, lookahead)
    optimizer = Optimizer(options.linear_solver, options.max_iterations, reporter or Reporter())
    mesh = first_mesh(motion, options)
    run = PlanningRun(motion, mesh, mode, lookahead, options, optimizer, guess=x)
    plan = run.run()
    if motion.contact:
        plan = clear_of_bodies(plan, run, obstructions(motion))
    return replace(
        plan,
        **{name: getattr(optimizer, name) for name in COUNTERS},
        total_seconds=time.perf_counter() - began,
        solves=tuple(optimizer.solves),
    )

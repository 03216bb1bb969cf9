"""Planning a motion: windows of time steps, solved one after the other.

A window of H consecutive steps is one NLP. After each solve the first step
of the window is kept and the window moves on by one; the last window keeps all of its steps.
H = 1 is the paper's sequential solve, H = all the horizon, anything between a receding
horizon; the loop is the same.
"""

from __future__ import annotations

import math
import time
from dataclasses import asdict, replace
from numbers import Real

import numpy as np

from .._support.arguments import check_arguments, real_array
from .._support.blas_threads import one_thread
from .._support.provenance import versions
from ..errors import InputError
from ..nlp.ipopt import ROUGH, Optimizer
from ..nlp.size import check_size
from ..problem.motion import Motion
from ..reporting import Reporter
from ..rod.collocation import mesh_for
from .checkpoint import Checkpoint
from .plan import Plan
from .planning_run import PlanningRun
from .state import REFINEMENTS, Options, first_mesh, mode_of

ROUGH_ITERATIONS = 200
"""Most iterations of a step of a plan that only starts a horizon; the shipped motions take 60."""


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
) -> Plan:
    """Find activations and head angles that perform a motion.

    Parameters
    ----------
    lookahead : int, optional
        Time steps planned together: 1 is the paper's sequential solve (with appendix B's
        auxiliary problems, guesses and feasible sets), None all of them.
    start : Plan, optional
        A plan of the same motion to improve on. By default a lookahead beyond 1 first makes
        the sequential plan. A horizon returns nothing worse by its own objective, as long as
        the start keeps the horizon's bounds, which appendix B does not ask of a sequential plan.
    checkpoint : Checkpoint, optional
        Where every finished window is kept, and gone on from.
    throw : bool
        False to get a plan that is not solved as well: look at its `status`.
    deadline : float, optional
        Seconds of wall time after which no iteration of the optimizer begins. What was reached is
        returned, with status TIME_LIMIT; its check comes on top.

    Returns
    -------
    Plan
        Solved and verified.

    Raises
    ------
    PlanError
        If it is not solved; the error has the plan.
    InputError
        If the lookahead is not a whole number from 1 on, the deadline not positive, or the
        checkpoint of another plan.
    KeyboardInterrupt
        On Ctrl-C, unless its handler has been replaced. Whatever else a reporter raises reaches
        the caller as well.
    SolverMissingError
        If the linear solver is not there.
    """
    began = time.perf_counter()
    options, reporter = options or Options(), reporter or Reporter()
    mode, lookahead = mode_of(motion, lookahead)
    ends = began + seconds_allowed(deadline)
    _check_start(start, motion)
    optimizer = Optimizer(options.linear_solver, options.max_iterations, reporter, deadline=ends)
    few = min(options.max_iterations, ROUGH_ITERATIONS)
    rough = Optimizer(options.linear_solver, few, reporter, ROUGH, ends)
    mesh = first_mesh(motion, options)
    if large := check_size(motion, mesh, lookahead):
        reporter.note(large)
    given = start  # its own cost counts as well
    if checkpoint is not None:
        checkpoint.open(motion, mode, lookahead, options, start)
    if mode != "sequential" and start is None:
        start = PlanningRun(motion, mesh, "sequential", 1, options, rough, None, checkpoint).run()
    own = PlanningRun(motion, mesh, mode, lookahead, options, optimizer, start, checkpoint)
    if own.stopped and start is not None:
        plan = _instead(start, own)
    else:
        plan = _on_finer_meshes(own.run(), own)
    parts: list[Optimizer | Plan] = [optimizer, rough, *([given] if given else [])]
    plan = plan.recorded(
        iterations=sum(part.iterations for part in parts),
        setup_seconds=sum(part.setup_seconds for part in parts),
        solve_seconds=sum(part.solve_seconds for part in parts),
        derivative_seconds=sum(part.derivative_seconds for part in parts),
        total_seconds=time.perf_counter()
        - began
        + (given.total_seconds if given else 0)
        + (checkpoint.seconds if checkpoint else 0),
        solves=(*(given.solves if given else ()), *rough.solves, *optimizer.solves),
        versions=versions(),
        options=asdict(options),
        notes=(*plan.notes, *plan.verification.doubts),
    )
    return plan.checked() if throw else plan


def _check_start(start: Plan | None, motion: Motion) -> None:
    """Raise InputError for a plan that a plan of this motion cannot start from."""
    if start is None:
        return
    if start.motion.trunk != motion.trunk:
        raise InputError("start: expected a plan of the same trunk.")
    if len(start.x) > len(motion.steps):
        raise InputError(
            f"start: has {len(start.x)} time steps; expected at most the motion's, "
            f"{len(motion.steps)}."
        )


def _instead(start: Plan, own: PlanningRun) -> Plan:
    """The plan that a horizon starts from, where there was no time for the horizon itself."""
    how = "interrupted" if own.optimizer.reporter.stop else "out of time"
    whole = len(start.x) == len(own.motion.steps)
    what = "the plan it starts from" if whole else "a part of the plan it would start from"
    note = f"{how} before the horizon's own solve; this is {what}"
    kept = replace(start, motion=own.motion, mode=own.mode, lookahead=own.lookahead, notes=(note,))
    return _cut_short(kept, own)


def _on_finer_meshes(plan: Plan, own: PlanningRun) -> Plan:
    """The plan, made again on finer meshes where its check asks for them."""
    mesh = own.mesh
    for _ in range(REFINEMENTS):
        if not plan.converged or not plan.verification.too_coarse or plan.cut_short:
            break
        if own.stopped:
            return _cut_short(plan, own)
        mesh = mesh_for(own.motion.trunk, own.motion.contact_from, 2 * mesh.elements, mesh.degree)
        told = f"The mesh was too coarse; planning again with {mesh.elements} elements."
        own.optimizer.reporter.note(told)
        again = plan if own.mode != "sequential" else None
        finer = replace(own, mesh=mesh, start=again).run()
        plan = finer if len(finer.x) == len(plan.x) else _cut_short(plan, own)
    return plan


def _cut_short(plan: Plan, own: PlanningRun) -> Plan:
    """The plan, marked as what was there when the user or the deadline ended it."""
    stop = own.optimizer.reporter.stop
    return plan.recorded(interrupted=stop, late=not stop)


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
    """The plan that one solve of each window from given unknowns leads to, good or bad.

    `plan_motion` looks for a good plan; this is for asking how many there are.

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
    plan = PlanningRun(motion, mesh, mode, lookahead, options, optimizer, guess=x).run()
    return replace(
        plan,
        iterations=optimizer.iterations,
        setup_seconds=optimizer.setup_seconds,
        solve_seconds=optimizer.solve_seconds,
        derivative_seconds=optimizer.derivative_seconds,
        total_seconds=time.perf_counter() - began,
        solves=tuple(optimizer.solves),
    )

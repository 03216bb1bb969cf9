"""Fast re-planning after a small change of targets, loads or bounds."""

from __future__ import annotations

import threading
import time
from dataclasses import asdict, replace
from typing import Any

from .._support.arguments import check_arguments
from .._support.blas_threads import one_thread
from .._support.deferred_signals import deferred_interrupts
from .._support.provenance import versions
from ..contact.exchange import rows_for
from ..errors import InputError
from ..nlp.ipopt import Optimizer
from ..nlp.ipopt_options import WARM_OPTIONS
from ..nlp.window import Window
from ..problem.motion import Motion
from ..reporting import Reporter
from .decided_steps import DecidedSteps
from .options import Options
from .plan import Plan
from .planner import seconds_allowed
from .planning_run import PlanningRun


class Replanner:
    """Keeps a horizon's solver, solution and multipliers, and re-solves from there.

    A motion that differs slightly takes a few iterations:

        again = Replanner(plan)
        plan = again(moved_motion)

    Parameters
    ----------
    plan : Plan
        A converged horizon plan; it is solved again to get the multipliers.

    Raises
    ------
    InputError
        If the plan did not converge or lacks time steps.
    """

    @check_arguments
    @deferred_interrupts()
    @one_thread()
    def __init__(
        self, plan: Plan, options: Options | None = None, reporter: Reporter | None = None
    ) -> None:
        if len(plan.x) != len(plan.motion.steps) or not plan.converged:
            raise InputError("plan: expected a converged plan of all time steps.")
        options = options or Options()
        self._lock, self._busy = threading.RLock(), False
        self._mesh, self._gaps = plan.mesh, plan.gaps
        self._options = replace(options, weights=plan.weights)
        self._optimizer = Optimizer(
            options.linear_solver, options.max_iterations, reporter or Reporter(), WARM_OPTIONS
        )
        window, _ = self._window(plan.motion)
        self._structure = window.structure
        start = window.pack(plan.x, plan.shape)
        self._last = self._optimizer.solve(window, start, "horizon", "multipliers")

    @check_arguments
    def __call__(self, motion: Motion, throw: bool = True, deadline: float | None = None) -> Plan:
        """Plan a motion of the same steps, kinds of targets and mesh as the last one.

        Threads take turns. Each re-plan starts from the last one that reached its targets, or else
        from the plan of the constructor. One that runs out of time or iterations returns its last
        iterate, which may violate bounds. Gaps from bodies are kept where the plan of the
        constructor keeps them; one that comes too close elsewhere has the status COLLIDING.

        Parameters
        ----------
        throw, deadline
            As in `plan_motion`.

        Raises
        ------
        PlanError
            If the plan is not solved; the error has the plan.
        InputError
            If the motion has another structure; use `plan_motion`. If a reporter calls the
            re-planner that it reports on.
        """
        ends = time.perf_counter() + seconds_allowed(deadline)
        with self._lock:
            if self._busy:
                raise InputError("this Replanner is busy; a reporter needs a Replanner of its own.")
            self._busy = True
            try:
                plan = self._replan(motion, ends)
            finally:
                self._busy = False
        return plan.checked() if throw else plan

    @deferred_interrupts()
    @one_thread()
    def _replan(self, motion: Motion, ends: float) -> Plan:
        began = time.perf_counter()
        optimizer, last = self._optimizer, self._last
        optimizer.deadline = ends
        solve, derivatives = optimizer.solve_seconds, optimizer.derivative_seconds
        window, planner = self._window(motion)
        if window.structure != self._structure:
            raise InputError(
                f"{motion.name}: differs from the planned motion in structure; expected "
                "the same steps, target points and kinds of bounds. Use plan_motion."
            )
        outcome = optimizer.solve(
            window, last.full, "horizon", "re-plan", last.multipliers, return_last=True
        )
        if outcome.converged and window.reached(outcome.full):
            self._last = outcome
        state = DecidedSteps()
        planner.keep(window, outcome, len(motion.steps), state)
        del optimizer.solves[:-1]  # else a control loop would keep them all
        return replace(
            planner.plan(state),
            versions=versions(),
            options=asdict(self._options),
            iterations=outcome.iterations,
            solve_seconds=optimizer.solve_seconds - solve,
            derivative_seconds=optimizer.derivative_seconds - derivatives,
            total_seconds=time.perf_counter() - began,
            solves=tuple(optimizer.solves),
        )

    def __getstate__(self) -> dict[str, Any]:
        """State for pickle and deepcopy: all but the solver, which the next call builds again."""
        kept = {name: value for name, value in self.__dict__.items() if name != "_lock"}
        kept["_busy"] = False
        return {**kept, "_optimizer": replace(self._optimizer, _ready={}, solves=[])}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state, _lock=threading.RLock())

    def _window(self, motion: Motion) -> tuple[Window, PlanningRun]:
        count = len(motion.steps)
        planner = PlanningRun(
            motion,
            self._mesh,
            "horizon",
            count,
            self._options,
            self._optimizer,
            gaps=rows_for(motion, self._gaps),
        )
        return planner.window(0, motion.steps, DecidedSteps()), planner

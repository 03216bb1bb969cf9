"""Fast re-planning after a change of targets, loads, bounds or the current state."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from numbers import Integral
from typing import Any

import numpy as np

from .._support.arguments import check_arguments
from .._support.blas_threads import one_thread
from .._support.deferred_signals import deferred_interrupts
from .._support.provenance import versions
from .._support.ranges import shown
from ..contact.exchange import rows_for
from ..errors import InputError
from ..nlp.control_sqp import STUCK, ControlSQP
from ..nlp.ipopt import Optimizer
from ..nlp.ipopt_options import WARM_OPTIONS
from ..nlp.outcome import FEASIBILITY_TOL, Outcome
from ..nlp.step_search import SQPPoint
from ..nlp.window import Window
from ..nlp.window_layout import can_condense, layout_of
from ..problem.motion import Motion
from ..reporting import Reporter
from .decided_steps import DecidedSteps
from .options import Options, is_deferred
from .plan import Plan, PlanError
from .planner import seconds_allowed
from .planning_run import PlanningRun
from .status import ACCEPTED

FORGOTTEN = 0.9
"""What an earlier re-plan took after its solve counts so much less with each one since."""


@dataclass(frozen=True, eq=False)
class _Point:
    """A decision vector, with what the solver that found it needs to start from there."""

    full: np.ndarray
    sqp: SQPPoint | None = None
    multipliers: dict[str, Any] | None = None  # of Ipopt


class Replanner:
    """Plans again from the last plan, in milliseconds: for controllers.

    A motion that differs in numbers takes a few iterations of sequential quadratic programming in
    the controls, each of which leaves a plan that can be used:

        again = Replanner(plan)
        plan = again(moved_motion, initial=current, deadline=0.01)

    Motions with gaps from bodies, and trunks too thin for this method, are planned by Ipopt, with
    the multipliers of the last solve.

    Parameters
    ----------
    plan : Plan
        A converged horizon plan.

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
        # Weights that were the plan's alone stay; those of its motion go with the motion.
        own = plan.weights if plan.weights != plan.motion.weights else options.weights
        self._options = replace(options, weights=own)
        self._optimizer = Optimizer(
            options.linear_solver, options.max_iterations, reporter or Reporter(), WARM_OPTIONS
        )
        self._motion, self._layout = plan.motion, layout_of(plan.motion)
        self._window = self._new_window(plan.motion)
        self._sqp = ControlSQP(self._window) if can_condense(self._window) else None
        self._newest = self._reached = _Point(self._window.pack(plan.x, plan.shape))
        self._rest = 0.0  # seconds from a solve to its plan
        self._newest, _ = self._by_any(self._window, np.inf)
        self._reached = self._newest

    @check_arguments
    def __call__(
        self,
        motion: Motion,
        throw: bool = True,
        deadline: float | None = None,
        initial: np.ndarray | Sequence[float] | None = None,
        check: str = "now",
        advance: int = 0,
    ) -> Plan:
        """Plan a motion with the steps, mesh and kinds of targets of the last one.

        Threads take turns. Each re-plan starts from the newest one, or the last one that reached
        its targets, whichever is better now. One that runs out of time or iterations returns its
        newest iterate, with status TIME_LIMIT or ITERATION_LIMIT; the last of `solves` has its
        objective and infeasibility, which is below 1e-6 after an iteration that succeeded. Where
        SQP fails, Ipopt takes over, unless there is a deadline: it needs tenths of a second to
        begin.

        Gaps from bodies are kept where the plan of the constructor keeps them; a plan that comes
        too close elsewhere has the status COLLIDING.

        Parameters
        ----------
        motion
            May differ in numbers: targets, loads, stiffness, density, bounds, weights. Durations,
            bounds on extension, the start of contact, and which controls have bounds on change are
            structure; so is a direction's weight that becomes 0.
        throw, deadline, check
            As in `plan_motion`. An iteration that would pass the deadline is not begun, except for
            the first.
        initial : (muscles + 2,), optional
            Activations and head angles of now, in place of those of the motion's `start`.
        advance : int
            Time steps by which the horizon has moved on since the last plan: it has lost so many at
            its beginning, and gained as many at its end.

        Raises
        ------
        PlanError
            If the plan is not solved; the error has the plan.
        InputError
            If the motion has another structure; use `plan_motion`. If a reporter calls the
            re-planner that it reports on.
        """
        ends, deferred = time.perf_counter() + seconds_allowed(deadline), is_deferred(check)
        if not isinstance(advance, Integral) or not 0 <= advance <= len(motion.steps):
            raise InputError(f"advance = {shown(advance)}: expected a number of time steps.")
        if initial is not None:
            motion = motion.started(np.asarray(initial, dtype=float))
        with self._lock:
            if self._busy:
                raise InputError("this Replanner is busy; a reporter needs a Replanner of its own.")
            self._busy = True
            try:
                plan = self._replan(motion, ends, int(advance), deferred)
            finally:
                self._busy = False
        if throw and plan.status not in ACCEPTED:
            raise PlanError(plan)
        return plan

    @deferred_interrupts()
    @one_thread()
    def _replan(self, motion: Motion, ends: float, advance: int, deferred: bool) -> Plan:
        began = time.perf_counter()
        optimizer = self._optimizer
        optimizer.deadline = ends
        solve, derivatives = optimizer.solve_seconds, optimizer.derivative_seconds
        window = self._window_of(motion)
        if advance:
            same = self._newest is self._reached
            self._reached = _advanced(window, self._reached, advance)
            self._newest = self._reached if same else _advanced(window, self._newest, advance)
        self._newest, outcome = self._by_any(window, ends - self._rest)
        solved = time.perf_counter()
        usable = outcome.converged or (outcome.late and outcome.infeasibility <= FEASIBILITY_TOL)
        if usable and window.reached(outcome.full):
            self._reached = self._newest
        state = DecidedSteps()
        run = self._run(motion)
        run.keep(window, outcome, len(motion.steps), state)
        settled = outcome.infeasibility <= FEASIBILITY_TOL
        shape = None
        if self._sqp and self._newest.sqp and (settled or math.isfinite(ends)):
            # To solve for equilibria that are not there may take seconds.
            shape = self._sqp.shape(window, outcome.full)
        plan = run.plan(state, shape)
        del optimizer.solves[:-1]  # else a control loop would keep them all
        plan = replace(
            plan,
            late=outcome.late,
            deferred=deferred,
            versions=versions(),
            options=asdict(replace(self._options, weights=run.weights)),
            iterations=outcome.iterations,
            solve_seconds=optimizer.solve_seconds - solve,
            derivative_seconds=optimizer.derivative_seconds - derivatives,
            total_seconds=time.perf_counter() - began,
            solves=tuple(optimizer.solves),
        )
        self._rest = max(time.perf_counter() - solved, FORGOTTEN * self._rest)
        return plan

    def _by_any(self, window: Window, ends: float) -> tuple[_Point, Outcome]:
        """Solve a window by SQP; by Ipopt where that does not apply, or does not converge."""
        full = self._reached.full
        if self._sqp is not None:
            starts = [point.sqp or self._sqp.start(point.full) for point in self._starts]
            outcome, found = self._sqp.solve(window, starts, ends, self._optimizer)
            if outcome.message == STUCK and found.residual > FEASIBILITY_TOL:
                # Loads or stiffness changed too much for Newton's method: equilibria come first.
                run = self._run(window.motion)
                full = run.packed(window, window.controls_of(found.full))
                starts = [self._sqp.start(full)]
                outcome, found = self._sqp.solve(window, starts, ends, self._optimizer)
            done = outcome.converged or outcome.stopped
            if done or math.isfinite(ends) or outcome.iterations == self._optimizer.max_iterations:
                return _Point(found.full, found), outcome
            full = found.full  # with time, Ipopt may do better, or says which bounds are violated
        last = self._reached.multipliers
        outcome = self._optimizer.solve(window, full, "horizon", "re-plan", last, return_last=True)
        return _Point(outcome.full, None, outcome.multipliers), outcome

    @property
    def _starts(self) -> list[_Point]:
        """Points to start from: the newest, and if it did not reach its targets, others as well.

        The last that did; and the newest as if the horizon had moved on by a step: as long as
        targets are out of reach, or have just come back, the trunk is on its way.
        """
        newest, reached = self._newest, self._reached
        if newest is reached:
            return [newest]
        return [newest, reached, _advanced(self._window, newest, 1)]

    def _window_of(self, motion: Motion) -> Window:
        """The window of a motion; builds it anew only where more than numbers changed."""
        if layout_of(motion) != self._layout or not self._same_mesh(motion):
            raise InputError(
                f"{motion.name}: differs from the planned motion in structure; expected "
                "the same steps, target points and kinds of bounds. Use plan_motion."
            )
        same = motion.trunk is self._motion.trunk or motion.trunk == self._motion.trunk
        if not same or self._sqp is None or self._run(motion).weights != self._window.weights:
            window = self._new_window(motion)
            if window.bounds["lbx"].size != self._reached.full.size:
                raise InputError(
                    f"{motion.name}: differs from the planned motion in structure; expected the "
                    "same segments and muscles. Use plan_motion."
                )
            self._sqp = ControlSQP(window) if can_condense(window) else None
            self._window, self._motion = window, motion
            return window
        return self._window.renumbered(motion)

    def _same_mesh(self, motion: Motion) -> bool:
        """Whether the mesh fits a motion's trunk: its segments, and where contact starts."""
        old, new = self._motion, motion
        return (
            old.trunk.length == new.trunk.length
            and list(old.trunk.edges) == list(new.trunk.edges)
            and old.contact_from == new.contact_from
        )

    def _new_window(self, motion: Motion) -> Window:
        return self._run(motion).window(0, motion.steps, DecidedSteps())

    def _run(self, motion: Motion) -> PlanningRun:
        count, gaps = len(motion.steps), rows_for(motion, self._gaps)
        options, optimizer = self._options, self._optimizer
        return PlanningRun(motion, self._mesh, "horizon", count, options, optimizer, gaps=gaps)

    def __getstate__(self) -> dict[str, Any]:
        """State for pickle and deepcopy: all but the solvers, which are built again."""
        derived = ("_lock", "_window", "_sqp")
        kept = {name: value for name, value in self.__dict__.items() if name not in derived}
        kept["_busy"] = False
        return {**kept, "_optimizer": replace(self._optimizer, solves=[])}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state, _lock=threading.RLock())
        self._window = self._new_window(self._motion)
        self._sqp = ControlSQP(self._window) if can_condense(self._window) else None


def _advanced(window: Window, point: _Point, count: int) -> _Point:
    """The point whose steps are those `count` later, and what is known of them."""
    full, sqp = window.advanced(point.full, count), point.sqp
    if sqp is not None:
        forces = None if sqp.forces is None else window.advanced(sqp.forces, count)
        sqp = replace(sqp, full=full, forces=forces)
    return _Point(full, sqp)

"""Sequential quadratic programming in the controls, for plans that start near a solution.

Each iteration solves one quadratic program (`control_qp`) with the exact Hessian, and brings the
rods to equilibrium again. So every iterate is a plan that can be used, objectives compare, and a
solve can be cut short at any time (real-time iteration: Diehl, Bock & Schloeder 2005).
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..reporting import Progress, Reporter
from ..rod.shape import Shape
from .condensed_rods import IllConditionedError
from .condensed_window import CondensedWindow
from .control_qp import ControlQP, InfeasibleQPError, QPError
from .ipopt import Optimizer
from .outcome import (
    CONVERGED_STATUSES,
    DEADLINE_PASSED,
    FEASIBILITY_TOL,
    USER_STOPPED,
    Outcome,
    Solve,
)
from .pace import Pace
from .step_search import SQPPoint, StepSearch
from .window import Window

LABEL = ("horizon", "re-plan")
"""Stage and detail of progress reports and records."""
MAX_ITERATIONS = 50
DECREASE_TOL = 1e-4
"""A solution: the decrease of the objective that a further iteration expects, over it."""
POSITION_TOL = 1e-3
"""The same in m of one target's error: others that are out of reach must not hide it."""
ROUND_OFF = 1e-10
"""Errors of objectives, relative: the equations are solved to `SETTLED_TOL`."""
ITERATIONS_EXCEEDED, INFEASIBLE = "Maximum_Iterations_Exceeded", "Infeasible_Problem_Detected"
STUCK = "Error_In_Step_Computation"
"""Messages, as Ipopt's; STUCK where the method does not apply, or makes no progress."""


class ControlSQP:
    """Solves windows of one layout; see the module.

    It does not apply to rods on which errors grow too much, such as thin tips under load, and may
    make no progress far from a solution; Ipopt may do better then.
    """

    def __init__(self, window: Window) -> None:
        self._condensed = CondensedWindow(window)
        self._qp = ControlQP(self._condensed)
        self._cautious = False  # whether to start within bounds, even if another start is better

    def shape(self, window: Window, full: np.ndarray) -> Shape:
        """Shapes (H,) of a window's steps at a decision vector in equilibrium."""
        return self._of(window).shape(full)

    def _of(self, window: Window) -> CondensedWindow:
        """The condensed window; the newest is kept."""
        if self._condensed.window is not window:
            self._condensed = self._condensed.renumbered(window)
        return self._condensed

    def start(self, full: np.ndarray) -> SQPPoint:
        """A point without knowledge from earlier solves."""
        return SQPPoint(full, np.zeros(self._condensed.held.size))

    def solve(
        self,
        window: Window,
        starts: Sequence[SQPPoint],
        deadline: float,
        records: Optimizer,
    ) -> tuple[Outcome, SQPPoint]:
        """Minimize from the best start, for a window that may differ in numbers from the first.

        Parameters
        ----------
        deadline : float
            Time of `time.perf_counter()` before which iterations after the first must end.
        records : Optimizer
            Keeps the record and the totals of the solve; has the reporter and the most iterations.
        """
        began, pace = time.perf_counter(), Pace(deadline)
        history: list[tuple[float, float, float]] = []
        condensed = self._of(window)
        point, safe = self._chosen(condensed, starts, math.isfinite(deadline))
        most, search = min(MAX_ITERATIONS, records.max_iterations), None
        message = ITERATIONS_EXCEEDED if most == records.max_iterations else STUCK
        while len(history) < most:
            if search and records.reporter.stop:
                message = USER_STOPPED
                break
            if search and not self._allows_another(condensed, point, pace):
                message, point = DEADLINE_PASSED, search.polished(point)
                break
            try:
                with pace.part("model"):
                    model = condensed.model(point.full, point.multipliers, point.forces)
                x = model.full[condensed.x]
                held = float(np.abs(model.held_rest).max(initial=0.0))
                point = replace(point, full=model.full, residual=max(model.rods.residual, held))
                violation = max(self._qp.violation(window, x), point.residual)
                _report(window, records.reporter, model.full, len(history), violation)
                history.append((model.objective, violation, math.nan))
                with pace.part("program"):
                    found = self._qp.solve(window, model, x)
            except (IllConditionedError, QPError) as failure:
                message = INFEASIBLE if isinstance(failure, InfeasibleQPError) else STUCK
                break
            feasible, expected = violation <= FEASIBILITY_TOL, model.change(found.step)
            if feasible and -expected <= _negligible(model.objective):
                message = CONVERGED_STATUSES[0]
                break
            # The first iteration is finished in any case.
            first, search = (
                search is None,
                StepSearch(self._qp, condensed, window, model, found, pace),
            )
            accepted = search.accepted(expected if feasible else math.inf, first)
            if accepted is None:
                message = STUCK if first or pace.allows("trial") else DEADLINE_PASSED
                break
            point = accepted
        if message == DEADLINE_PASSED and safe and not self._keeps_all(condensed, point):
            # There was no time to bring a better start within bounds, nor will there be next time.
            point, self._cautious = safe, True
        outcome = self._outcome(condensed, window, point, len(history), message)
        records.derivative_seconds += pace.seconds["model"]
        records.solve_seconds += time.perf_counter() - began
        records.iterations += len(history)
        records.solves.append(_record(window, outcome, history))
        return outcome, point

    def _chosen(
        self, condensed: CondensedWindow, starts: Sequence[SQPPoint], hurried: bool
    ) -> tuple[SQPPoint, SQPPoint | None]:
        """The start to follow, and the best one within bounds."""
        if len(starts) == 1:
            self._cautious = False
            return starts[0], None
        ranked = sorted((_updated(condensed, start) for start in starts), key=lambda pair: pair[1])
        best = ranked[0][0]
        safe = next((start for start, _ in ranked if self._keeps_all(condensed, start)), None)
        self._cautious = self._cautious and hurried and safe is not best
        return safe if safe and self._cautious else best, safe

    def _allows_another(self, condensed: CondensedWindow, point: SQPPoint, pace: Pace) -> bool:
        """Whether there is time for another iteration and, from within bounds, a correction.

        Which brings targets closer than an iteration that is cut short.
        """
        correction = ("program", "trial") if self._keeps_all(condensed, point) else ()
        return pace.allows("model", "program", "trial", *correction)

    def _keeps_all(self, condensed: CondensedWindow, point: SQPPoint) -> bool:
        """Whether a point is in equilibrium and within bounds."""
        beyond = self._qp.violation(condensed.window, point.full[condensed.x])
        return max(beyond, point.residual) <= FEASIBILITY_TOL

    def _outcome(
        self,
        condensed: CondensedWindow,
        window: Window,
        point: SQPPoint,
        iterations: int,
        message: str,
    ) -> Outcome:
        full = point.full
        violation = max(self._qp.violation(window, full[condensed.x]), point.residual)
        return Outcome(full, condensed.objective(full), violation, iterations, message)


def _updated(condensed: CondensedWindow, start: SQPPoint) -> tuple[SQPPoint, tuple[bool, float]]:
    """A start for another window, and its rank, best first.

    Objectives only compare where rods are in equilibrium; others may be far from it.
    """
    full, residual = condensed.updated(start.full)
    rank = residual > FEASIBILITY_TOL, condensed.objective(full)
    return replace(start, full=full, residual=residual), rank


def _report(
    window: Window, reporter: Reporter, full: np.ndarray, iteration: int, violation: float
) -> None:
    first, last = window.offset + 1, window.offset + len(window.steps)
    error = window.worst_error(full)
    reporter.iteration(Progress(*LABEL, first, last, iteration, error, violation))


def _record(
    window: Window, outcome: Outcome, history: Sequence[tuple[float, float, float]]
) -> Solve:
    stage, detail = LABEL
    return Solve(
        stage,
        detail,
        window.offset + 1,
        window.offset + len(window.steps),
        outcome.message,
        outcome.objective,
        outcome.infeasibility,
        tuple(history),
    )


def _negligible(objective: float) -> float:
    """Decrease of an objective that is not worth an iteration."""
    objective = abs(objective)
    return max(min(DECREASE_TOL * objective, POSITION_TOL**2), ROUND_OFF * objective)

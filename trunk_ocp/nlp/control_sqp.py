"""Sequential quadratic programming in the controls, for plans that start near a solution.

Each iteration solves one quadratic program (`control_qp`) with the exact Hessian, and brings the
rods to equilibrium again. So every iterate is a plan that can be used, objectives compare, and a
solve can be cut short at any time (real-time iteration: Diehl, Bock & Schloeder 2005).
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..reporting import Progress, Reporter
from ..rod.shape import Shape
from .condensed_rods import IllConditionedError
from .condensed_window import CondensedWindow
from .control_qp import ControlQP, InfeasibleQPError, QPError, QPStep
from .ipopt import Optimizer
from .outcome import (
    CONVERGED_STATUSES,
    DEADLINE_PASSED,
    FEASIBILITY_TOL,
    USER_STOPPED,
    Outcome,
    Solve,
)
from .quadratic_model import QuadraticModel
from .window import Window

LABEL = ("horizon", "re-plan")
"""Stage and detail of progress reports and records."""
MAX_ITERATIONS = 50
MAX_HALVINGS = 6
"""Of a step that does not lower the objective, or after which rods find no equilibrium."""
MAX_CORRECTIONS = 2
"""Second-order corrections of a step."""
DECREASE_TOL = 1e-4
"""A solution: the decrease of the objective that a further iteration expects, over it."""
POSITION_TOL = 1e-3
"""The same in m of one target's error: others that are out of reach must not hide it."""
ROUND_OFF = 1e-10
"""Errors of objectives, relative: the equations are solved to `SETTLED_TOL`."""
SUFFICIENT_DECREASE = 1e-4
ITERATIONS_EXCEEDED, INFEASIBLE = "Maximum_Iterations_Exceeded", "Infeasible_Problem_Detected"
STUCK = "Error_In_Step_Computation"
"""Messages, as Ipopt's; STUCK where the method does not apply, or makes no progress."""
RESERVE = 1.5
"""Time that must be left for another iteration, over that of the last one: some are longer."""


@dataclass(frozen=True, eq=False)
class SQPPoint:
    """A decision vector, with what the next solve needs.

    Attributes
    ----------
    full : (variables,)
    multipliers : (3 D,)
        Of the equations of held directions.
    forces : (variables,) or None
        As in `CondensedWindow.model`.
    residual : float
        Of the equations at `full`, for the window that it was found for.
    """

    full: np.ndarray
    multipliers: np.ndarray
    forces: np.ndarray | None = None
    residual: float = math.inf


class ControlSQP:
    """Solves windows of one layout; see the module.

    It does not apply to rods on which errors grow too much, such as thin tips under load, and may
    make no progress far from a solution; Ipopt may do better then.
    """

    def __init__(self, window: Window) -> None:
        self._condensed = CondensedWindow(window)
        self._qp = ControlQP(self._condensed)

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
        condensed, reporter = self._of(window), records.reporter
        point = starts[0]
        if len(starts) > 1:
            point = min((_updated(condensed, start) for start in starts), key=lambda p: p[1])[0]
        history: list[tuple[float, float, float]] = []
        start = time.perf_counter()
        most = min(MAX_ITERATIONS, records.max_iterations)
        message, seconds = ITERATIONS_EXCEEDED if most == records.max_iterations else STUCK, 0.0
        while len(history) < most:
            began = time.perf_counter()
            if seconds and (reporter.stop or began + RESERVE * seconds > deadline):
                message = USER_STOPPED if reporter.stop else DEADLINE_PASSED
                break
            try:
                model = condensed.model(point.full, point.multipliers, point.forces)
                records.derivative_seconds += time.perf_counter() - began
                x = model.full[condensed.x]
                held = float(np.abs(model.held_rest).max(initial=0.0))
                point = replace(point, full=model.full, residual=max(model.rods.residual, held))
                violation = max(self._qp.violation(window, x), point.residual)
                _report(window, reporter, model.full, len(history), violation)
                history.append((model.objective, violation, math.nan))
                found = self._qp.solve(window, model, x)
            except (IllConditionedError, QPError) as failure:
                message = INFEASIBLE if isinstance(failure, InfeasibleQPError) else STUCK
                break
            feasible, expected = violation <= FEASIBILITY_TOL, model.change(found.step)
            if feasible and -expected <= _negligible(model.objective):
                message = CONVERGED_STATUSES[0]
                break
            asked = expected if feasible else math.inf
            # The first iteration is finished in any case; others leave time to return.
            ends = deadline - seconds / 2 if seconds else math.inf
            accepted = self._accepted(condensed, window, model, found, asked, ends)
            if accepted is None:
                message = DEADLINE_PASSED if time.perf_counter() > ends else STUCK
                break
            point, seconds = accepted, time.perf_counter() - began
        outcome = self._outcome(condensed, window, point, len(history), message)
        records.solve_seconds += time.perf_counter() - start
        records.iterations += len(history)
        records.solves.append(_record(window, outcome, history))
        return outcome, point

    def _accepted(
        self,
        condensed: CondensedWindow,
        window: Window,
        model: QuadraticModel,
        found: QPStep,
        expected: float,
        deadline: float,
    ) -> SQPPoint | None:
        """The first point that is accepted: after the step, a corrected step, or a share of it.

        expected : change of the objective by the model, which the step must achieve in part;
            infinite if the step restores bounds, so that any is accepted.
        """
        for halving in range(MAX_HALVINGS + 1):
            if halving and time.perf_counter() > deadline:
                break
            share = 0.5**halving
            moved = condensed.moved(model, found.step, share)
            full, residual = condensed.settled(moved, model.rods)
            if not residual <= FEASIBILITY_TOL:
                continue
            most = model.objective + SUFFICIENT_DECREASE * share * expected
            if condensed.objective(full) <= most:
                forces = condensed.expected_forces(model, share * found.step)
                return SQPPoint(full, found.multipliers, forces, residual)
            late = time.perf_counter() > deadline
            if share < 1 or late:
                continue
            if point := self._corrected(condensed, window, model, full, most):
                return point
        return None

    def _corrected(
        self,
        condensed: CondensedWindow,
        window: Window,
        model: QuadraticModel,
        full: np.ndarray,
        most: float,
    ) -> SQPPoint | None:
        """The point after second-order corrections of a step that led to `full`.

        None if its objective is not `most` or less.
        """
        for _ in range(MAX_CORRECTIONS):
            again = condensed.recentered(model, full)
            try:
                found = self._qp.solve(window, again, full[condensed.x])
            except QPError:
                return None
            full, residual = condensed.settled(condensed.moved(again, found.step), model.rods)
            if not residual <= FEASIBILITY_TOL:
                return None
            if condensed.objective(full) <= most:
                forces = condensed.expected_forces(again, found.step)
                return SQPPoint(full, found.multipliers, forces, residual)
        return None

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

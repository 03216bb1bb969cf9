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
from .condensed_window import CondensedWindow, QuadraticModel
from .control_qp import ControlQP, QPError, QPStep
from .ipopt import Optimizer
from .outcome import (
    CONVERGED_STATUSES,
    DEADLINE_PASSED,
    FEASIBILITY_TOL,
    USER_STOPPED,
    Outcome,
    Solve,
)
from .window import Window

LABEL = ("horizon", "re-plan")
"""Stage and detail of progress reports and records."""
MAX_ITERATIONS = 50
MAX_HALVINGS = 6
"""Of a step that does not lower the objective, or after which rods find no equilibrium."""
DECREASE_TOL = 1e-4
"""A solution: the decrease of the objective that a further iteration expects, over it."""
POSITION_TOL = 1e-3
"""The same in m of one target's error: others that are out of reach must not hide it."""
ROUND_OFF = 1e-10
"""Errors of objectives, relative: the equations are solved to `SETTLED_TOL`."""
SUFFICIENT_DECREASE = 1e-4
STOPPED = "Maximum_Iterations_Exceeded"
IPOPT_SECONDS = 0.5
"""A solve that fails so long before its deadline is late: Ipopt needs this time to begin."""
RESERVE = 1.2
"""Time that must be left for another iteration, over that of the last one."""


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

    Raises
    ------
    IllConditionedError, QPError
        `solve` raises them where the method does not apply: thin tips under load, bounds that
        contradict each other. Ipopt may do better, or at least say why.
    """

    def __init__(self, window: Window) -> None:
        self._condensed = CondensedWindow(window)
        self._qp = ControlQP(self._condensed)

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
        condensed, reporter = self._condensed.renumbered(window), records.reporter
        starts = [replace(start, full=condensed.updated(start.full)) for start in starts]
        point = min(starts, key=lambda start: condensed.objective(start.full))
        message, seconds = STOPPED, 0.0
        history: list[tuple[float, float, float]] = []
        start = time.perf_counter()
        for iteration in range(min(MAX_ITERATIONS, records.max_iterations)):
            began = time.perf_counter()
            if seconds and (reporter.stop or began + RESERVE * seconds > deadline):
                message = USER_STOPPED if reporter.stop else DEADLINE_PASSED
                break
            model = condensed.model(point.full, point.multipliers, point.forces)
            x = model.full[condensed.x]
            records.derivative_seconds += time.perf_counter() - began
            held = float(np.abs(model.held_rest).max(initial=0.0))
            point = replace(point, full=model.full, residual=max(model.rods.residual, held))
            violation = max(self._qp.violation(window, x), point.residual)
            history.append((model.objective, violation, math.nan))
            _report(window, reporter, model.full, iteration, violation)
            feasible = violation <= FEASIBILITY_TOL
            try:
                found = self._qp.solve(window, model, x)
            except QPError:
                if deadline - time.perf_counter() > IPOPT_SECONDS:
                    raise
                message = DEADLINE_PASSED
                break
            expected = _change(model, found.step)
            if feasible and -expected <= _negligible(model.objective):
                message = CONVERGED_STATUSES[0]
                break
            trial = self._accepted(condensed, model, found, expected if feasible else math.inf)
            if trial is None:
                if deadline - time.perf_counter() <= IPOPT_SECONDS:
                    message = DEADLINE_PASSED
                break
            point, seconds = trial, time.perf_counter() - began
        outcome = self._outcome(condensed, window, point, len(history), message)
        records.solve_seconds += time.perf_counter() - start
        records.iterations += len(history)
        records.solves.append(_record(window, outcome, history))
        return outcome, point

    def _accepted(
        self, condensed: CondensedWindow, model: QuadraticModel, found: QPStep, expected: float
    ) -> SQPPoint | None:
        """The point after the largest share of a step that is accepted.

        expected : change of the objective by the model, which the step must achieve in part;
            infinite if the step restores bounds, so that any is accepted.
        """
        for halving in range(MAX_HALVINGS + 1):
            share = 0.5**halving
            moved = condensed.moved(model, found.step, share)
            full, residual = condensed.settled(moved, model.rods)
            if not residual <= FEASIBILITY_TOL:
                continue
            change = condensed.objective(full) - model.objective
            if change <= SUFFICIENT_DECREASE * share * expected:
                forces = condensed.expected_forces(model, share * found.step)
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


def _change(model: QuadraticModel, step: np.ndarray) -> float:
    """Change of a model's objective by a step in z."""
    H, n = model.links.shape
    own, held = step[: H * n].reshape(H, n), step[H * n :]
    local = np.concatenate([own, np.broadcast_to(held, (H, held.size))], axis=1)
    bent = (local[:, None] @ model.blocks @ local[..., None]).sum() / 2
    return float(model.gradient @ step + bent + np.sum(model.links[1:] * own[1:] * own[:-1]))

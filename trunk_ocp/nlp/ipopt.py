"""Ipopt on the NLP of a window, with our own derivatives, progress reports and early stops."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np
import scipy.sparse as sp

from .._support.deferred_signals import deferred_interrupts
from ..reporting import Progress, Reporter
from .idle_solvers import borrowed
from .ipopt_options import DEFAULT_OPTIONS, check_linear_solver
from .outcome import (
    CONVERGED_STATUSES,
    DEADLINE_PASSED,
    START_KEPT,
    USER_STOPPED,
    Derivatives,
    Outcome,
    Point,
    Solve,
    max_violation,
    point_of,
    rank,
)
from .violations import violations
from .window import Window


@dataclass
class Optimizer:
    """Solves windows, each with a solver that an earlier window of its structure has left idle.

    Attributes
    ----------
    ipopt : mapping
        Options, such as those of `ipopt_options`.
    warm : mapping
        Options instead, of solves that start from multipliers; by default the same.
    deadline : float
        Time of `time.perf_counter()` at which a solve stops.
    iterations : int
    setup_seconds, solve_seconds, derivative_seconds : float
        Totals over all solves; the last is the part of `solve_seconds` spent in objective,
        constraints and their derivatives.
    solves : list of Solve
        Records of all solves.
    """

    linear_solver: str = "mumps"
    max_iterations: int = 1000
    reporter: Reporter = field(default_factory=Reporter)
    ipopt: Mapping[str, Any] = field(default_factory=lambda: DEFAULT_OPTIONS, repr=False)
    deadline: float = math.inf
    warm: Mapping[str, Any] | None = field(default=None, repr=False)
    iterations: int = 0
    setup_seconds: float = 0.0
    solve_seconds: float = 0.0
    derivative_seconds: float = 0.0
    solves: list[Solve] = field(default_factory=list, repr=False)

    def __post_init__(self) -> None:
        check_linear_solver(self.linear_solver)

    @property
    def late(self) -> bool:
        """Whether the deadline has passed."""
        return time.perf_counter() > self.deadline

    @deferred_interrupts()
    def solve(
        self,
        window: Window,
        start: np.ndarray,
        stage: str,
        detail: str,
        multipliers: Mapping[str, ca.DM | np.ndarray] | None = None,
        return_last: bool = False,
    ) -> Outcome:
        """Minimize from a start vector; lack of convergence is reported, not raised.

        return_last : whether a solve that does not converge returns its last point, rather than
            the best point it visited, which may be the start.

        Raises
        ------
        BaseException
            Whatever the reporter or a Ctrl-C handler raised during the solve.
        """
        with self._solver(window, bool(multipliers)) as (solver, callback):
            began = time.perf_counter()
            with deferred_interrupts() as deferred:
                watch = _Watch(window, stage, detail, self.reporter, self.deadline, deferred)
                callback.watch = watch
                arguments = {"x0": start, "p": window.parameters, **window.bounds}
                result = solver(**arguments, **(multipliers or {}))
                callback.watch = None
            self.solve_seconds += time.perf_counter() - began
            stats = solver.stats()
        message = str(stats["return_status"])
        if message == USER_STOPPED and watch.late:
            message = DEADLINE_PASSED
        point = point_of(window, [result[ca.nlpsol_out(i)] for i in range(ca.nlpsol_n_out())])
        if message not in CONVERGED_STATUSES and not return_last:
            point = min(point, watch.best or point, key=rank)
        self._record(window, point, stage, detail, message, stats)
        return Outcome(
            point.full,
            point.objective,
            point.infeasibility,
            int(stats["iter_count"]),
            message,
            point.multipliers,
        )

    def _record(
        self,
        window: Window,
        point: Point,
        stage: str,
        detail: str,
        message: str,
        stats: dict[str, Any],
    ) -> None:
        """Add a solve to the record and to the totals."""
        self.iterations += int(stats["iter_count"])
        self.derivative_seconds += derivative_seconds(stats)
        iterates = stats.get("iterations", {})  # missing if the start already overflows
        history = zip(*(iterates.get(key, ()) for key in ("obj", "inf_pr", "inf_du")), strict=True)
        converged = message in CONVERGED_STATUSES
        self.solves.append(
            Solve(
                stage,
                detail,
                window.offset + 1,
                window.offset + len(window.steps),
                message,
                point.objective,
                point.infeasibility,
                tuple(history),
                () if converged else violations(window, point.full, point.g),
            )
        )

    @deferred_interrupts()
    def evaluate(self, window: Window, full: np.ndarray) -> Outcome:
        """Objective and infeasibility, including bounds on variables, of a decision vector."""
        at = (full, window.parameters)
        with self._solver(window) as (solver, _):
            f, g = (solver.get_function(name)(*at) for name in ("nlp_f", "nlp_g"))
        bounds = window.bounds
        violation = max(
            max_violation(np.asarray(g).ravel(), bounds["lbg"], bounds["ubg"]),
            max_violation(full, bounds["lbx"], bounds["ubx"]),
        )
        return Outcome(full, float(f), violation, 0, START_KEPT)

    @deferred_interrupts()
    def derivatives(self, window: Window, outcome: Outcome) -> Derivatives:
        """First and second derivatives of a window's NLP at an optimum."""
        lam_x, lam_g = outcome.multipliers["lam_x0"], outcome.multipliers["lam_g0"]
        at = (outcome.full, window.parameters)
        with self._solver(window) as (solver, _):
            _, gradient = solver.get_function("nlp_grad_f")(*at)
            g, jacobian = solver.get_function("nlp_jac_g")(*at)
            upper = solver.get_function("nlp_hess_l")(*at, 1.0, lam_g)
        triangle = upper.sparse()
        return Derivatives(
            np.asarray(g).ravel(),
            np.asarray(gradient).ravel(),
            sp.csr_matrix(jacobian.sparse()),
            sp.csr_matrix(triangle + triangle.T - sp.diags(triangle.diagonal())),
            np.asarray(lam_x).ravel(),
            np.asarray(lam_g).ravel(),
        )

    def _solver(
        self, window: Window, again: bool = False
    ) -> AbstractContextManager[tuple[ca.Function, _IterationCallback]]:
        """A solver of the window's NLP, with its callback; `again` if it gets multipliers."""
        ipopt = self.warm if again and self.warm is not None else self.ipopt
        choices = (self.linear_solver, self.max_iterations, *sorted(ipopt.items()))
        return borrowed((window.structure, choices), lambda: self._new_solver(window, ipopt))

    def _new_solver(
        self, window: Window, ipopt: Mapping[str, Any]
    ) -> tuple[ca.Function, _IterationCallback]:
        began = time.perf_counter()
        options = {f"ipopt.{name}": value for name, value in ipopt.items()} | {
            "ipopt.linear_solver": self.linear_solver,
            "ipopt.max_iter": self.max_iterations,
            "print_time": False,
            "record_time": True,
            "error_on_fail": False,
            **window.nlp.derivatives(),
        }
        with deferred_interrupts():  # CasADi calls back for the sizes
            callback = _IterationCallback(*window.nlp.size, window.parameters.size)
            options["iteration_callback"] = callback
            solver = ca.nlpsol("window", "ipopt", window.nlp.as_casadi(), options)
        self.setup_seconds += time.perf_counter() - began
        return solver, callback


def derivative_seconds(stats: dict[str, Any]) -> float:
    """Seconds that a solve spent in objective, constraints and their derivatives."""
    functions = ("nlp_f", "nlp_g", "nlp_grad_f", "nlp_jac_g", "nlp_hess_l")
    return float(sum(stats[f"t_wall_{name}"] for name in functions))


class _IterationCallback(ca.Callback):
    """Ipopt's iteration callback, for the `watch` of the solve that runs."""

    def __init__(self, variables: int, constraints: int, parameters: int) -> None:
        ca.Callback.__init__(self)
        self.watch: _Watch | None = None
        self._shapes = {
            "x": variables,
            "f": 1,
            "g": constraints,
            "lam_x": variables,
            "lam_g": constraints,
            "lam_p": parameters,
        }
        self.construct("watch", {})

    def get_n_in(self) -> int:
        return int(ca.nlpsol_n_out())

    def get_n_out(self) -> int:
        return 1

    def get_name_in(self, i: int) -> str:
        return str(ca.nlpsol_out(i))

    def get_name_out(self, i: int) -> str:
        return "stop"

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        return ca.Sparsity.dense(self._shapes[ca.nlpsol_out(i)], 1)

    def eval(self, arguments: Sequence[ca.DM]) -> list[int]:
        return [int(self.watch is None or self.watch.stops(arguments))]


class _Watch:
    """Watches one solve: reports progress, keeps the best point, and stops on request."""

    def __init__(
        self,
        window: Window,
        stage: str,
        detail: str,
        reporter: Reporter,
        deadline: float,
        deferred: deferred_interrupts,
    ) -> None:
        self._window, self._stage, self._detail = window, stage, detail
        self._reporter, self._deadline, self._deferred = reporter, deadline, deferred
        self._iteration = -1
        self.best: Point | None = None
        self.late = False

    def stops(self, arguments: Sequence[ca.DM]) -> bool:
        """Report an iterate; returns whether to stop. Errors wait for the end of the solve."""
        try:
            stop = self._report(arguments)
        except BaseException as error:  # CasADi would swallow it
            self._deferred.error = self._deferred.error or error
            stop = True
        return self._deferred.pending or stop

    def _report(self, arguments: Sequence[ca.DM]) -> bool:
        """Report an iterate; returns whether to stop."""
        window, reporter = self._window, self._reporter
        self._iteration += 1
        point = point_of(window, arguments)
        self.best = min(self.best or point, point, key=rank)
        reporter.iteration(
            Progress(
                self._stage,
                self._detail,
                window.offset + 1,
                window.offset + len(window.steps),
                self._iteration,
                window.worst_error(point.full),
                point.infeasibility,
            )
        )
        self.late = time.perf_counter() > self._deadline
        return bool(reporter.stop or self.late)

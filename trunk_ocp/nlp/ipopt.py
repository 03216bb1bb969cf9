"""Ipopt on the NLP of a window, with our derivatives, progress and a way to stop."""

from __future__ import annotations

import contextlib
import io
import math
import time
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import casadi as ca
import numpy as np
import scipy.sparse as sp

from .._support.deferred_signals import deferred_interrupts
from ..errors import SolverMissingError
from ..reporting import Progress, Reporter
from .violations import Violation, violations
from .window import Window

# One set for all motions, chosen by measurement on the three shipped ones. Most solves start
# from a good guess; a small first barrier and little push away from bounds stay near it, where
# Ipopt's defaults (0.1, 0.01) leave it and may end in a worse optimum.
IPOPT: dict[str, Any] = {
    "mu_init": 1e-6,
    "bound_push": 1e-5,
    "bound_frac": 1e-5,
    "mumps_pivot_order": 0,
    "mumps_scaling": 0,
    "print_level": 0,
    "sb": "yes",
}
# A re-plan starts at an optimum, multipliers included, of nearly the same problem: stay there.
WARM: dict[str, Any] = IPOPT | {
    "mu_init": 1e-8,
    "tol": 1e-6,
    "warm_start_init_point": "yes",
    "warm_start_bound_push": 1e-9,
    "warm_start_bound_frac": 1e-9,
    "warm_start_slack_bound_push": 1e-9,
    "warm_start_slack_bound_frac": 1e-9,
    "warm_start_mult_bound_push": 1e-9,
}
# A plan that another solve only starts from; feasible all the same, to be worth comparing.
ROUGH: dict[str, Any] = IPOPT | {"tol": 1e-5, "constr_viol_tol": 1e-7}
CONVERGED = ("Solve_Succeeded", "Solved_To_Acceptable_Level")
QUIET: dict[str, Any] = {"ipopt.sb": "yes", "print_time": False}
KEPT = "Start_Kept"
STOPPED = "User_Requested_Stop"
LATE = "Deadline_Passed"
FEASIBLE = 1e-6
"""Largest constraint violation, in the transcription's units, of a usable point."""
PENALTY = 100.0
"""What violating a constraint by 1, in the transcription's units, counts in the objective."""


@dataclass(frozen=True)
class Solve:
    """Record of one solve, for whoever asks how it went.

    Attributes
    ----------
    stage, detail : str
        As in `Progress`.
    first, last : int
        Time steps solved for, from 1.
    message : str
        Ipopt's return status, or `LATE`.
    objective, infeasibility : float
        Of the point that was returned; see `Optimizer.solve`.
    history : tuple of (objective, primal infeasibility, dual infeasibility)
        One entry for each iteration, the start included.
    violations : tuple of Violation
        What does not hold at the returned point; empty if the solve converged.
    """

    stage: str
    detail: str
    first: int
    last: int
    message: str
    objective: float
    infeasibility: float
    history: tuple[tuple[float, float, float], ...]
    violations: tuple[Violation, ...] = ()

    @property
    def what(self) -> str:
        """What was solved, wherever it started from."""
        return self.detail.partition(", from the ")[0]

    @property
    def iterations(self) -> int:
        """Number of iterations."""
        return max(len(self.history) - 1, 0)

    @property
    def converged(self) -> bool:
        """Whether Ipopt found a local optimum."""
        return self.message in CONVERGED


@dataclass(frozen=True, eq=False)
class Outcome:
    """What one solve of a window ended with; the multipliers are those at `full`."""

    full: np.ndarray
    objective: float
    infeasibility: float
    iterations: int
    message: str
    multipliers: dict[str, ca.DM] = field(default_factory=dict, repr=False)

    @property
    def converged(self) -> bool:
        """Whether Ipopt found a local optimum."""
        return self.message in CONVERGED

    @property
    def stopped(self) -> bool:
        """Whether the user or the deadline ended the solve."""
        return self.message in (STOPPED, LATE)


@dataclass(frozen=True, eq=False)
class Derivatives:
    """Constraints, gradient, sparse Jacobian, Hessian of the Lagrangian, and multipliers.

    CasADi's signs: positive at an upper bound, negative at a lower one.
    """

    g: np.ndarray
    gradient: np.ndarray
    jacobian: sp.csr_matrix
    hessian: sp.csr_matrix
    lam_x: np.ndarray
    lam_g: np.ndarray


@dataclass
class Optimizer:
    """Solves windows; keeps the solver of each structure, so that a later one starts at once.

    `ipopt` is one of the sets of options above. No solve goes on after `deadline`, a time of
    `time.perf_counter()`.
    """

    linear_solver: str = "mumps"
    max_iterations: int = 1000
    reporter: Reporter = field(default_factory=Reporter)
    ipopt: Mapping[str, Any] = field(default_factory=lambda: IPOPT, repr=False)
    deadline: float = math.inf
    iterations: int = 0
    setup_seconds: float = 0.0
    solve_seconds: float = 0.0
    derivative_seconds: float = 0.0  # of the solves: objective, constraints and derivatives
    solves: list[Solve] = field(default_factory=list, repr=False)
    _ready: dict[Hashable, tuple[ca.Function, _Watch]] = field(default_factory=dict, repr=False)

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
        multipliers: dict[str, ca.DM] | None = None,
        newest: bool = False,
    ) -> Outcome:
        """Minimize from a start vector; never raises for lack of convergence.

        newest : whether a solve that does not converge returns its last point rather than the
            best one it met, which may be the start.

        Raises
        ------
        BaseException
            What the reporter, or a handler of Ctrl-C, raised meanwhile.
        """
        solver, watch = self._solver(window)
        began = time.perf_counter()
        with deferred_interrupts() as deferred:
            watch.attend(window, stage, detail, self.reporter, self.deadline, deferred)
            result = solver(x0=start, p=window.parameters, **window.bounds, **(multipliers or {}))
        stats = solver.stats()
        self.iterations += int(stats["iter_count"])
        self.solve_seconds += time.perf_counter() - began
        self.derivative_seconds += derivative_seconds(stats)
        message = str(stats["return_status"])
        if message == STOPPED and watch.late:
            message = LATE
        point = _point(window, [result[ca.nlpsol_out(i)] for i in range(ca.nlpsol_n_out())])
        violated: tuple[Violation, ...] = ()
        if message not in CONVERGED:
            if not newest:
                point = min(point, watch.best or point, key=rank)
            violated = violations(window, point.full, point.g)
        record = stats.get("iterations", {})  # none where the start already overflows
        entries = (record.get(name, ()) for name in ("obj", "inf_pr", "inf_du"))
        history = zip(*entries, strict=True)
        steps = (window.offset + 1, window.offset + len(window.steps))
        self.solves.append(
            Solve(
                stage,
                detail,
                *steps,
                message,
                point.objective,
                point.infeasibility,
                tuple(history),
                violated,
            )
        )
        return Outcome(
            point.full,
            point.objective,
            point.infeasibility,
            int(stats["iter_count"]),
            message,
            point.multipliers,
        )

    @deferred_interrupts()
    def evaluate(self, window: Window, full: np.ndarray) -> Outcome:
        """Objective and infeasibility, bounds on variables included, of a given vector."""
        solver, _ = self._solver(window)
        f, g = (solver.get_function(name)(full, window.parameters) for name in ("nlp_f", "nlp_g"))
        bounds = window.bounds
        violation = max(
            _violation(np.asarray(g).ravel(), bounds["lbg"], bounds["ubg"]),
            _violation(full, bounds["lbx"], bounds["ubx"]),
        )
        return Outcome(full, float(f), violation, 0, KEPT)

    @deferred_interrupts()
    def derivatives(self, window: Window, outcome: Outcome) -> Derivatives:
        """First and second derivatives of a window's NLP at an optimum."""
        solver, _ = self._solver(window)
        lam_x, lam_g = outcome.multipliers["lam_x0"], outcome.multipliers["lam_g0"]
        at = (outcome.full, window.parameters)
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

    def _solver(self, window: Window) -> tuple[ca.Function, _Watch]:
        key = window.structure
        if key not in self._ready:
            began = time.perf_counter()
            options = {f"ipopt.{name}": value for name, value in self.ipopt.items()} | {
                "ipopt.linear_solver": self.linear_solver,
                "ipopt.max_iter": self.max_iterations,
                "print_time": False,
                "record_time": True,
                "error_on_fail": False,
                **window.nlp.derivatives(),
            }
            with deferred_interrupts():  # CasADi asks the callback for its size
                watch = _Watch(*window.nlp.size, window.parameters.size)
                options["iteration_callback"] = watch
                solver = ca.nlpsol("window", "ipopt", window.nlp.nlp(), options)
            self._ready[key] = (solver, watch)
            self.setup_seconds += time.perf_counter() - began
        return self._ready[key]


def derivative_seconds(stats: dict[str, Any]) -> float:
    """Seconds of a solve in objective, constraints and their derivatives."""
    functions = ("nlp_f", "nlp_g", "nlp_grad_f", "nlp_jac_g", "nlp_hess_l")
    return float(sum(stats[f"t_wall_{name}"] for name in functions))


@dataclass(frozen=True, eq=False)
class _Point:
    """A point of an NLP, with its multipliers as a later solve takes them."""

    full: np.ndarray
    g: np.ndarray
    objective: float
    infeasibility: float
    multipliers: dict[str, ca.DM]


def rank(point: _Point | Outcome | Solve) -> tuple[bool, float]:
    """The smaller the better: feasible points first, by objective, the others by a merit.

    A point on its way to a solution has rods a little out of balance, which is no worse than the
    trunk at rest that keeps every equation; hence not by infeasibility alone.
    """
    feasible = point.infeasibility <= FEASIBLE
    merit = point.objective + (0.0 if feasible else PENALTY * point.infeasibility)
    return not feasible, merit if np.isfinite(merit) else np.inf


def _point(window: Window, outputs: Sequence[ca.DM]) -> _Point:
    """A point from what CasADi's solvers and their callbacks tell: x, f, g, lam_x, lam_g, lam_p."""
    x, objective, g, lam_x, lam_g, _ = outputs
    constraints = np.asarray(g).ravel()
    bounds = window.bounds
    violation = _violation(constraints, bounds["lbg"], bounds["ubg"])
    multipliers = {"lam_x0": lam_x, "lam_g0": lam_g}
    return _Point(np.asarray(x).ravel(), constraints, float(objective), violation, multipliers)


class _Watch(ca.Callback):
    """Ipopt's iteration callback: reports progress, keeps the best point, stops when told to."""

    def __init__(self, variables: int, constraints: int, parameters: int) -> None:
        ca.Callback.__init__(self)
        self._shapes = {
            "x": variables,
            "f": 1,
            "g": constraints,
            "lam_x": variables,
            "lam_g": constraints,
            "lam_p": parameters,
        }
        self.construct("watch", {})

    def attend(
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
        self.best: _Point | None = None
        self.late = False

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
        try:
            stop = self._look(arguments)
        except BaseException as error:  # lost on its way through CasADi, if it left here
            self._deferred.error = self._deferred.error or error
            stop = True
        return [int(self._deferred.pending or stop)]

    def _look(self, arguments: Sequence[ca.DM]) -> bool:
        """Report an iterate; whether it shall be the last."""
        window, reporter = self._window, self._reporter
        self._iteration += 1
        point = _point(window, arguments)
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


@cache
def check_linear_solver(name: str) -> None:
    """Raise SolverMissingError if Ipopt does not have a linear solver.

    Ipopt itself would go on and return NaN with `Invalid_Option`.
    """
    x = ca.SX.sym("x")
    options: dict[str, Any] = {"ipopt.linear_solver": name, "ipopt.print_level": 0}
    message = "Invalid_Option"
    if name == "mumps":  # comes with CasADi
        return
    with contextlib.suppress(RuntimeError), contextlib.redirect_stdout(io.StringIO()):
        solver = ca.nlpsol("probe", "ipopt", {"x": x, "f": x**2}, options | QUIET)
        solver(x0=1.0)
        message = str(solver.stats()["return_status"])
    if message not in CONVERGED:
        raise SolverMissingError(
            f"linear solver {name!r} is not available to Ipopt here ({message}); expected one "
            "that is installed. Use mumps, which comes with CasADi, or install the library."
        )


def _violation(g: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> float:
    """Largest excess over bounds; infinite if a value is not a number."""
    excess = np.maximum(np.maximum(lower - g, g - upper), 0.0)
    return float(np.where(np.isnan(excess), np.inf, excess).max(initial=0.0))

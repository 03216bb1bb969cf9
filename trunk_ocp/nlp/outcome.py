"""Results of a solve: point, status, record and derivatives, and how points are ranked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import casadi as ca
import numpy as np
import scipy.sparse as sp

from .violations import Violation
from .window import Window

CONVERGED_STATUSES = ("Solve_Succeeded", "Solved_To_Acceptable_Level")
START_KEPT = "Start_Kept"
USER_STOPPED = "User_Requested_Stop"
DEADLINE_PASSED = "Deadline_Passed"
FEASIBILITY_TOL = 1e-6
"""Largest constraint violation of a usable point, in the NLP's units."""
INFEASIBILITY_PENALTY = 100.0
"""Cost of violating a constraint by 1, in the NLP's units, when points are compared."""


@dataclass(frozen=True)
class Solve:
    """Record of one solve, for diagnoses.

    Attributes
    ----------
    stage, detail : str
        As in `Progress`.
    first, last : int
        Time steps solved for, from 1.
    message : str
        Ipopt's return status, or `DEADLINE_PASSED`.
    objective, infeasibility : float
        Objective and largest violation of the returned point; see `Optimizer.solve`.
    history : tuple of (objective, primal infeasibility, dual infeasibility)
        One entry for each iteration, including the start.
    violations : tuple of Violation
        Violated constraints at the returned point; empty if the solve converged.
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
    def task(self) -> str:
        """What was solved, without where it started from."""
        return self.detail.partition(", from the ")[0]

    @property
    def iterations(self) -> int:
        """Number of iterations."""
        return max(len(self.history) - 1, 0)

    @property
    def converged(self) -> bool:
        """Whether Ipopt found a local optimum."""
        return self.message in CONVERGED_STATUSES


@dataclass(frozen=True, eq=False)
class Outcome:
    """Result of one solve of a window.

    Attributes
    ----------
    full : (variables,)
        Decision vector.
    objective, infeasibility : float
        Objective and largest violation there, in the NLP's units.
    iterations : int
    message : str
        Ipopt's return status, `START_KEPT` or `DEADLINE_PASSED`.
    multipliers : dict
        Multipliers there, as arguments of a later solve.
    """

    full: np.ndarray
    objective: float
    infeasibility: float
    iterations: int
    message: str
    multipliers: dict[str, ca.DM] = field(default_factory=dict, repr=False)

    @property
    def converged(self) -> bool:
        """Whether Ipopt found a local optimum."""
        return self.message in CONVERGED_STATUSES

    @property
    def late(self) -> bool:
        """Whether the deadline ended the solve."""
        return self.message == DEADLINE_PASSED

    @property
    def stopped(self) -> bool:
        """Whether the user or the deadline ended the solve."""
        return self.message in (USER_STOPPED, DEADLINE_PASSED)


@dataclass(frozen=True, eq=False)
class Derivatives:
    """Constraints, gradient, sparse Jacobian, Hessian of the Lagrangian, and multipliers.

    The multipliers have CasADi's signs: positive at an upper bound, negative at a lower one.
    """

    g: np.ndarray
    gradient: np.ndarray
    jacobian: sp.csr_matrix
    hessian: sp.csr_matrix
    lam_x: np.ndarray
    lam_g: np.ndarray


@dataclass(frozen=True, eq=False)
class Point:
    """A point of an NLP, with its multipliers as arguments of a later solve."""

    full: np.ndarray
    g: np.ndarray
    objective: float
    infeasibility: float
    multipliers: dict[str, ca.DM]


def rank(point: Point | Outcome | Solve) -> tuple[bool, float]:
    """Sort key, best first: feasible points by objective, then the others by merit.

    Not by infeasibility alone: the trunk at rest satisfies every equation, but an iterate near a
    solution, whose rods are slightly out of balance, is a better start.
    """
    feasible = point.infeasibility <= FEASIBILITY_TOL
    merit = point.objective + (0.0 if feasible else INFEASIBILITY_PENALTY * point.infeasibility)
    return not feasible, merit if np.isfinite(merit) else np.inf


def point_of(window: Window, outputs: Sequence[ca.DM]) -> Point:
    """Point from the outputs of CasADi's solvers and callbacks: x, f, g, lam_x, lam_g, lam_p."""
    x, objective, g, lam_x, lam_g, _ = outputs
    constraints, bounds = np.asarray(g).ravel(), window.bounds
    violation = max_violation(constraints, bounds["lbg"], bounds["ubg"])
    multipliers = {"lam_x0": lam_x, "lam_g0": lam_g}
    return Point(np.asarray(x).ravel(), constraints, float(objective), violation, multipliers)


def max_violation(g: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> float:
    """Largest violation of bounds; infinite if a value is not a number."""
    excess = np.maximum(np.maximum(lower - g, g - upper), 0.0)
    return float(np.where(np.isnan(excess), np.inf, excess).max(initial=0.0))

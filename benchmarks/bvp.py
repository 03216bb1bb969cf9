"""The forward problem with scipy's `solve_bvp`, all segments stacked on one unit interval.

On the whole trunk `solve_bvp` does not converge across the jumps between segments. Stacked,
all segments share one s in [0, 1], each with its own ten states (q, m, r), and are connected by
boundary conditions: base pose (7), free tip (3), continuity. The initial guess is the unloaded
shape, as in our solver.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import casadi as ca
import numpy as np
from scipy.integrate import solve_bvp

from trunk_ocp.model.activation import mean_extension, strains
from trunk_ocp.model.head import base_pose
from trunk_ocp.rod.equations import RATES, STATES, point_parameters, rates
from trunk_ocp.rod.unloaded import unloaded_states

from .common import (
    Cases,
    cases,
    coarsest,
    distance,
    median,
    reference_lines,
    run_part,
    sample_points,
    seconds,
)
from .forward import MAX_ERROR


@cache
def jacobian() -> ca.Function:
    w, p = ca.SX.sym("w", 15), ca.SX.sym("p", 11)
    slope = ca.jacobian(rates()(w, p), w)
    return ca.Function("jacobian", [w, p], [ca.vec(ca.densify(slope[:, :STATES]))])


class Stacked:
    """One loaded shape as a boundary value problem on [0, 1]."""

    def __init__(self, which: Cases, i: int, start: int = 8) -> None:
        self.trunk, self.loads = which.trunk, which.loads
        self.edges = np.asarray(self.trunk.edges)
        self.widths = np.diff(self.edges)
        strain = strains(self.trunk, which.activation[i])
        mean = mean_extension(self.trunk, strain)
        tip = np.asarray(self.loads.tip_force)
        self.known = [np.concatenate([row, [mean], tip]) for row in strain]
        r0, q0 = base_pose(self.trunk.head, *which.head[i])
        self.base = np.concatenate([np.stack(q0), np.stack(r0)])
        self.s = np.linspace(0, 1, start)
        self.guess = np.zeros((self.trunk.segments * RATES, start))
        for k in range(self.trunk.segments):
            Z = self.points(k, self.s)
            r, q = unloaded_states(self.trunk, which.activation[i], which.head[i], Z)
            self.guess[k * RATES : k * RATES + 4] = q.T
            self.guess[k * RATES + STATES : (k + 1) * RATES] = r.T

    def points(self, k: int, s: np.ndarray) -> np.ndarray:
        return np.clip(self.edges[k] + self.widths[k] * s, 0.0, self.trunk.length)

    def columns(self, k: int, s: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        state = y[k * RATES : k * RATES + STATES]
        fixed = np.repeat(self.known[k][:, None], s.size, axis=1)
        parameters = point_parameters(self.trunk, self.loads, self.points(k, s))
        return np.vstack([state, fixed]), parameters

    def slope(self, s: np.ndarray, y: np.ndarray) -> np.ndarray:
        parts = (
            self.widths[k] * np.asarray(rates()(*self.columns(k, s, y)))
            for k in range(self.trunk.segments)
        )
        return np.vstack(list(parts))

    def slope_jacobian(self, s: np.ndarray, y: np.ndarray) -> np.ndarray:
        result = np.zeros((y.shape[0], y.shape[0], s.size))
        for k in range(self.trunk.segments):
            block = np.asarray(jacobian()(*self.columns(k, s, y)))
            rows, first = slice(k * RATES, (k + 1) * RATES), k * RATES
            result[rows, first : first + STATES] = self.widths[k] * block.reshape(
                STATES, RATES, -1
            ).swapaxes(0, 1)
        return result

    def boundary(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        at_base = np.concatenate([a[:4], a[STATES:RATES]]) - self.base
        return np.concatenate([at_base, b[-RATES:][4:STATES], a[RATES:] - b[:-RATES]])

    def solve(self, tolerance: float, exact: bool) -> Any:
        return solve_bvp(
            self.slope,
            self.boundary,
            self.s,
            self.guess,
            fun_jac=self.slope_jacobian if exact else None,
            tol=tolerance,
            max_nodes=5000,
        )

    def position(self, solution: Any, Z: np.ndarray) -> np.ndarray:
        k = np.searchsorted(self.edges[1:-1], Z, side="left")
        values = solution.sol((Z - self.edges[k]) / self.widths[k])
        rows = k[:, None] * RATES + STATES + np.arange(3)
        return values[rows, np.arange(Z.size)[:, None]]


def error_of(problems: list[Stacked], exact: np.ndarray, tolerance: float) -> float:
    """Largest error in L; infinite if one did not converge."""
    Z = sample_points(problems[0].trunk)
    largest = 0.0
    for problem, line in zip(problems, exact, strict=True):
        solution = problem.solve(tolerance, True)
        if not solution.success:
            return float("inf")
        largest = max(largest, distance(problem.position(solution, Z), line))
    return largest / problems[0].trunk.length


def stacked(shapes: int = 12, repeats: int = 3) -> dict[str, Any]:
    """The loosest tolerance that is as accurate as our solver, and its time."""
    which = cases(shapes)
    problems = [Stacked(which, i) for i in range(shapes)]
    exact = reference_lines(which)
    _, ours = coarsest(which, MAX_ERROR)
    tolerance, error = 1e-2, float("inf")
    while error > ours and tolerance > 1e-10:
        tolerance /= 10**0.5
        error = error_of(problems, exact, tolerance)

    def timed(exact_jacobian: bool) -> float:
        work: list[Callable[[], Any]] = [
            lambda p=p: p.solve(tolerance, exact_jacobian) for p in problems
        ]
        return median([median(seconds(one, repeats)) for one in work])

    return {
        "tolerance": tolerance,
        "error_in_L": error,
        "our_error_in_L": ours,
        "nodes": int(np.median([p.solve(tolerance, True).x.size for p in problems])),
        "seconds_exact_jacobian": timed(True),
        "seconds_differenced": timed(False),
    }


def whole(shapes: int = 5) -> dict[str, Any]:
    """The same without stacking: ten states along the whole trunk, with jumps inside."""
    which = cases(shapes)
    converged = 0
    for i in range(shapes):
        problem = Stacked(which, i)
        pieces = [problem.columns(k, problem.s, problem.guess) for k in range(len(problem.widths))]
        knots = np.concatenate([problem.points(k, problem.s[:-1]) for k in range(len(pieces))])
        knots = np.append(knots, which.trunk.length)
        start = np.zeros((RATES, knots.size))
        r, q = unloaded_states(which.trunk, which.activation[i], which.head[i], knots)
        start[:4], start[STATES:] = q.T, r.T

        def slope(Z: np.ndarray, y: np.ndarray, problem: Stacked = problem) -> np.ndarray:
            k = np.searchsorted(problem.edges[1:-1], Z, side="left")
            w = np.vstack([y[:STATES], np.stack(problem.known)[k].T])
            return np.asarray(rates()(w, point_parameters(problem.trunk, problem.loads, Z)))

        def boundary(a: np.ndarray, b: np.ndarray, base: np.ndarray = problem.base) -> np.ndarray:
            return np.concatenate([np.concatenate([a[:4], a[STATES:]]) - base, b[4:STATES]])

        solution = solve_bvp(slope, boundary, knots, start, tol=1e-6, max_nodes=5000)
        converged += bool(solution.success)
    return {"shapes": shapes, "converged": converged, "tolerance": 1e-6, "max_nodes": 5000}


if __name__ == "__main__":
    run_part({"stacked": stacked, "whole": whole})

"""The same motion by other muscles: with least effort, least peak, fewest muscles.

The same at every time step, to round-off. In between, it is where interpolation is linear in the
activations ("cosine", "none"); the monotone slopes of "hermite" are not, and shapes differ by some
millimeters there.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import replace

import casadi as ca
import numpy as np
import scipy.sparse as sp
from scipy.optimize import Bounds, LinearConstraint, linprog, milp

from ...errors import InputError
from ...planning.plan import Plan
from .activation_sets import ACCURACY, ActivationSet, fibers

# A dual active-set method: ends at the exact vertex of the active bounds, and tells an empty
# set from one that is merely narrow. Its own tolerance for a violated bound is 1e-6.
DAQP = {"daqp": {"primal_tol": ACCURACY, "dual_tol": 1e-11, "iter_limit": 20_000}}
EMPTY = (0, -1)  # DAQP's words for a set without points: seen at once, or on the way


def least_effort(plan: Plan, off: Collection[str] = ()) -> Plan:
    """The same shapes with the least sum of squared activations over all steps.

    Unique, as the problem is strictly convex: a quadratic program for each segment.

    Parameters
    ----------
    off : names of muscles that stay at rest.

    Raises
    ------
    InputError
        If the plan is not a verified one of all time steps, a name is none of the trunk's, or
        the motion is impossible without the muscles `off`.
    """
    silent = _indices(plan, off)
    return _chosen(plan, lambda fiber: _least(plan, fiber.without(silent)))


def least_cost(plan: Plan, off: Collection[str] = ()) -> Plan:
    """The same shapes with the least effort and rates, weighted as the planner weighs them.

    A horizon plan that is optimal is its own: what it tracks is the same for all of these.
    Parameters and errors are those of `least_effort`.
    """
    silent, weights = _indices(plan, off), plan.weights
    if weights.effort <= 0:
        raise InputError("weights: expected an effort above 0, which makes the choice unique.")
    return _chosen(
        plan,
        lambda fiber: _least(plan, fiber.without(silent), weights.rate / weights.effort),
    )


def least_peak(plan: Plan) -> Plan:
    """The same shapes with the least largest activation, segment by segment.

    Of all with the smallest peak over the motion (a linear program), that of least effort.

    Raises
    ------
    InputError
        If the plan is not a verified one of all time steps.
    """

    def lowered(fiber: ActivationSet) -> np.ndarray | None:
        # Round-off in the peak must not leave the set empty.
        peak = _smallest_peak(fiber) + ACCURACY
        lower, upper = np.maximum(fiber.lower, -peak), np.minimum(fiber.upper, peak)
        return _least(plan, replace(fiber, lower=lower, upper=upper))

    return _chosen(plan, lowered)


def fewest_muscles(plan: Plan) -> Plan:
    """The same shapes with the fewest muscles that ever work; the others stay at exactly 0.

    The number is the least there is; other sets of as many muscles may do as well. Of this
    set's activations, those of least effort.

    Raises
    ------
    InputError
        If the plan is not a verified one of all time steps.
    """
    return _chosen(plan, lambda fiber: _fewest(plan, fiber))


def can_be_off(plan: Plan, muscles: Collection[str]) -> bool:
    """Whether these muscles could stay at rest together, the others keeping every shape.

    Raises
    ------
    InputError
        If the plan is not a verified one of all time steps, or a name is none of the trunk's.
    """
    silent = _indices(plan, muscles)
    touched = (f for f in fibers(plan, joint=True) if np.isin(f.muscles, silent).any())
    return all(_least(plan, fiber.without(silent)) is not None for fiber in touched)


def _indices(plan: Plan, names: Collection[str]) -> np.ndarray:
    known = plan.motion.trunk.muscles
    for name in names:
        if name not in known:
            raise InputError(f"{name}: no such muscle; expected one of {', '.join(known)}.")
    return np.array([known.index(name) for name in names], dtype=int)


def _chosen(plan: Plan, choose: Callable[[ActivationSet], np.ndarray | None]) -> Plan:
    """The plan with activations chosen anew in every segment."""
    x = plan.x.copy()
    for fiber in fibers(plan, joint=True):
        z = choose(fiber)
        if z is None:
            raise InputError(
                f"{plan.motion.name}: segment {_segment(plan, fiber)} cannot keep its shapes "
                "without these muscles; switch fewer off."
            )
        x[fiber.where] = fiber.table(z)
    return replace(plan, x=x)


def _segment(plan: Plan, fiber: ActivationSet) -> int:
    return plan.motion.trunk.subdomains[int(fiber.muscles[0])].segment + 1


def _least(plan: Plan, fiber: ActivationSet, rate: float = 0.0) -> np.ndarray | None:
    """Point of least |z|^2 + rate * integral of |dz/dt|^2 in a set; None if the set is empty."""
    duration = np.array([plan.motion.steps[t].duration for t in fiber.steps.tolist()])
    per_change = sp.diags_array(np.repeat(rate / duration, len(fiber.muscles)))
    D = fiber.difference
    hessian = sp.csc_array(sp.eye_array(len(fiber.lower)) + D.T @ per_change @ D)
    rows = sp.csc_array(sp.vstack([fiber.strain, fiber.change]))
    if np.any(fiber.lower > fiber.upper):
        return None
    h, a = _matrix(hessian / np.abs(hessian).max()), _matrix(rows)
    shape = {"h": h.sparsity(), "a": a.sparsity()}
    solver = ca.conic("least", "daqp", shape, DAQP | {"error_on_fail": False})
    result = solver(
        h=h,
        a=a,
        lba=np.concatenate([fiber.target, fiber.least]),
        uba=np.concatenate([fiber.target, fiber.most]),
        lbx=fiber.lower,
        ubx=fiber.upper,
    )
    stats = solver.stats()
    if not stats["success"]:
        if stats["return_status"] not in EMPTY:
            raise AssertionError(f"a quadratic program failed: {stats['return_status']}")
        return None
    # Bounds hold to round-off only; an activation of 1e-17 on the wrong side is none.
    return np.clip(np.array(result["x"]).ravel(), fiber.lower, fiber.upper)


def _matrix(matrix: sp.csc_array) -> ca.DM:
    return ca.DM(sp.csc_matrix(matrix))


def _smallest_peak(fiber: ActivationSet) -> float:
    """Least largest |z| in a set."""
    n, k = len(fiber.lower), len(fiber.bounded)
    one, none = np.ones((n, 1)), np.zeros((k, 1))
    unit = sp.eye_array(n)
    below = sp.block_array(
        [[unit, -one], [-unit, -one], [fiber.change, none], [-fiber.change, none]]
        if k
        else [[unit, -one], [-unit, -one]]
    )
    result = linprog(
        np.append(np.zeros(n), 1.0),
        A_ub=below,
        b_ub=np.concatenate([np.zeros(2 * n), fiber.most, -fiber.least]),
        A_eq=sp.hstack([fiber.strain, sp.csr_array((len(fiber.target), 1))]),
        b_eq=fiber.target,
        bounds=[*zip(fiber.lower, fiber.upper, strict=True), (0.0, None)],
        method="highs",
        options={"primal_feasibility_tolerance": 1e-10},
    )
    return float(result.fun)


def _fewest(plan: Plan, fiber: ActivationSet) -> np.ndarray:
    """Point of least effort with the fewest muscles of a set.

    Muscles are tried in the smallest sets that are not known to be too few. One that is too few
    is filled up as far as it stays so: of the muscles then missing, one has to work. Which sets
    those leave is a small integer nlp, and no bound has to be turned into a big number.
    """
    size = len(fiber.muscles)
    missing: list[np.ndarray] = []
    while True:
        works = _smallest(missing, size)
        z = _with(plan, fiber, works)
        if z is not None:
            return z
        for muscle in np.flatnonzero(~works):
            more = works.copy()
            more[muscle] = True
            if _with(plan, fiber, more) is None:
                works = more
        missing.append(~works)


def _with(plan: Plan, fiber: ActivationSet, works: np.ndarray) -> np.ndarray | None:
    """Point of least effort in which no other muscles of a set work; None if there is none."""
    return _least(plan, fiber.without(fiber.muscles[~works]))


def _smallest(groups: list[np.ndarray], size: int) -> np.ndarray:
    """Smallest set (size,) with a member of every group (size,), all of them masks."""
    if not groups:
        return np.zeros(size, dtype=bool)
    one_each = LinearConstraint(np.array(groups, dtype=float), 1.0, np.inf)
    result = milp(
        np.ones(size), constraints=one_each, bounds=Bounds(0, 1), integrality=np.ones(size)
    )
    chosen: np.ndarray = result.x > 0.5
    return chosen

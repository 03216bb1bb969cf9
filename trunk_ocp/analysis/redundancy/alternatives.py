"""The same motion by other muscles: with least effort, least peak, fewest muscles.

Shapes are equal at every time step, to round-off. Between steps they are equal where interpolation
is linear in the activations ("cosine", "none"); the monotone slopes of "hermite" are not linear,
and shapes then differ by a few millimeters.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import replace

import casadi as ca
import numpy as np
import scipy.sparse as sp
from scipy.optimize import Bounds, LinearConstraint, linprog, milp

from ..._support.wording import suggestion
from ...errors import InputError
from ...planning.plan import Plan
from .activation_sets import LP_TOL, ActivationSet, shape_preserving_sets

# A dual active-set method: it ends at the exact vertex of the active bounds, and distinguishes an
# empty set from a narrow one. Its default tolerance for a violated bound is 1e-6.
DAQP = {"daqp": {"primal_tol": LP_TOL, "dual_tol": 1e-11, "iter_limit": 20_000}}
EMPTY_SET = (0, -1)  # DAQP's return codes for an empty set: found at setup, or while solving


def least_effort(plan: Plan, off: Collection[str] = ()) -> Plan:
    """The same shapes with the least sum of squared activations over all steps.

    Unique, as the problem is strictly convex: a quadratic program for each segment.

    Parameters
    ----------
    off : collection of str
        Names of muscles that stay at rest.

    Raises
    ------
    InputError
        If the plan is not a verified one of all time steps, a name is unknown, or
        the motion is impossible without the muscles in `off`.
    """
    silent = _indices(plan, off)
    return _chosen(plan, lambda region: _least(plan, region.without(silent)))


def least_cost(plan: Plan, off: Collection[str] = ()) -> Plan:
    """The same shapes with the least effort and rates, weighted as the planner weighs them.

    An optimal horizon plan is its own least-cost version, since tracking is the same for all.
    Parameters and errors are those of `least_effort`.
    """
    silent, effort = _indices(plan, off), plan.weights.of_muscles(plan.motion.trunk.muscles)
    if np.any(effort <= 0):
        raise InputError(
            "weights: expected an effort above 0, without which the choice is not unique."
        )
    rate, relative = plan.weights.rate / effort.max(), effort / effort.max()
    return _chosen(
        plan,
        lambda region: _least(plan, region.without(silent), rate, relative[region.muscles]),
    )


def least_peak(plan: Plan) -> Plan:
    """The same shapes with the smallest peak activation, segment by segment.

    Among all with the smallest peak over the motion (a linear program), the one of least effort.

    Raises
    ------
    InputError
        If the plan is not a verified one of all time steps.
    """

    def lowered(region: ActivationSet) -> np.ndarray | None:
        # Round-off in the peak must not leave the set empty.
        peak = _smallest_peak(region) + LP_TOL
        lower, upper = np.maximum(region.lower, -peak), np.minimum(region.upper, peak)
        return _least(plan, replace(region, lower=lower, upper=upper))

    return _chosen(plan, lowered)


def fewest_muscles(plan: Plan) -> Plan:
    """The same shapes with the fewest working muscles; the others stay at exactly 0.

    The number is the global minimum; other sets of as many muscles may work as well. The
    activations are those of least effort for this set.

    Raises
    ------
    InputError
        If the plan is not a verified one of all time steps.
    """
    return _chosen(plan, lambda region: _fewest(plan, region))


def can_be_off(plan: Plan, muscles: Collection[str]) -> bool:
    """Whether these muscles could all rest while the others keep every shape.

    Raises
    ------
    InputError
        If the plan is not a verified one of all time steps, or a name is unknown.
    """
    silent = _indices(plan, muscles)
    touched = (
        f for f in shape_preserving_sets(plan, joint=True) if np.isin(f.muscles, silent).any()
    )
    return all(_least(plan, region.without(silent)) is not None for region in touched)


def _indices(plan: Plan, names: Collection[str]) -> np.ndarray:
    known = plan.motion.trunk.muscles
    for name in names:
        if name not in known:
            hint = suggestion(name, known)
            raise InputError(f"{name}: no such muscle; expected one of {', '.join(known)}.{hint}")
    return np.array([known.index(name) for name in names], dtype=int)


def _chosen(plan: Plan, choose: Callable[[ActivationSet], np.ndarray | None]) -> Plan:
    """The plan with new activations in every segment."""
    x = plan.x.copy()
    for region in shape_preserving_sets(plan, joint=True):
        z = choose(region)
        if z is None:
            segment = plan.motion.trunk.subdomains[int(region.muscles[0])].segment + 1
            raise InputError(
                f"{plan.motion.name}: segment {segment} cannot keep its shapes without these "
                "muscles; switch off fewer."
            )
        x[region.where] = region.table(z)
    return replace(plan, x=x)


def _least(
    plan: Plan,
    region: ActivationSet,
    rate: float = 0.0,
    effort: np.ndarray | float = 1.0,
) -> np.ndarray | None:
    """Minimizer of effort * z^2 + rate * integral of |dz/dt|^2 in a set; None if it is empty.

    effort : weight of each muscle, (muscles,), or of all.
    """
    duration = np.array([plan.motion.steps[t].duration for t in region.steps.tolist()])
    per_change = sp.diags_array(np.repeat(rate / duration, len(region.muscles)))
    D = region.difference
    of_each = np.tile(np.broadcast_to(effort, region.muscles.shape), len(duration))
    hessian = sp.csc_array(sp.diags_array(of_each) + D.T @ per_change @ D)
    scale = np.abs(hessian).max()
    rows = sp.csc_array(sp.vstack([region.strain, region.change]))
    if np.any(region.lower > region.upper):
        return None
    h, a = _matrix(hessian / scale), _matrix(rows)
    shape = {"h": h.sparsity(), "a": a.sparsity()}
    solver = ca.conic("least", "daqp", shape, DAQP | {"error_on_fail": False})
    result = solver(
        h=h,
        g=-(D.T @ per_change @ region.before) / scale,
        a=a,
        lba=np.concatenate([region.target, region.least]),
        uba=np.concatenate([region.target, region.most]),
        lbx=region.lower,
        ubx=region.upper,
    )
    stats = solver.stats()
    if not stats["success"]:
        if stats["return_status"] not in EMPTY_SET:
            raise AssertionError(f"a quadratic program failed: {stats['return_status']}")
        return None
    # Bounds hold to round-off only; clip activations of 1e-17 on the wrong side.
    return np.clip(np.array(result["x"]).ravel(), region.lower, region.upper)


def _matrix(matrix: sp.csc_array) -> ca.DM:
    return ca.DM(sp.csc_matrix(matrix))


def _smallest_peak(region: ActivationSet) -> float:
    """Smallest max |z| in a set."""
    n, k = len(region.lower), len(region.bounded)
    one, none = np.ones((n, 1)), np.zeros((k, 1))
    unit = sp.eye_array(n)
    below = [[unit, -one], [-unit, -one]]
    if k:
        below += [[region.change, none], [-region.change, none]]
    result = linprog(
        np.append(np.zeros(n), 1.0),
        A_ub=sp.block_array(below),
        b_ub=np.concatenate([np.zeros(2 * n), region.most, -region.least]),
        A_eq=sp.hstack([region.strain, sp.csr_array((len(region.target), 1))]),
        b_eq=region.target,
        bounds=[*zip(region.lower, region.upper, strict=True), (0.0, None)],
        method="highs",
        options={"primal_feasibility_tolerance": 1e-10},
    )
    return float(result.fun)


def _fewest(plan: Plan, region: ActivationSet) -> np.ndarray:
    """Point of least effort with the fewest muscles of a set.

    Implicit hitting sets: try the smallest set of muscles not yet ruled out. If it is too small,
    add muscles while it stays infeasible; at least one of the muscles still missing must then
    work. The smallest set that meets all such conditions is a small integer program, without the
    big-M constants that a direct formulation would need.
    """
    size = len(region.muscles)
    missing: list[np.ndarray] = []
    while True:
        works = _smallest(missing, size)
        z = _with(plan, region, works)
        if z is not None:
            return z
        for muscle in np.flatnonzero(~works):
            more = works.copy()
            more[muscle] = True
            if _with(plan, region, more) is None:
                works = more
        missing.append(~works)


def _with(plan: Plan, region: ActivationSet, works: np.ndarray) -> np.ndarray | None:
    """Least-effort point of a set in which only these muscles work; None if there is none."""
    return _least(plan, region.without(region.muscles[~works]))


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

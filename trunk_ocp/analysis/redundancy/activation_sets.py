"""All activations that leave a planned motion unchanged: polytopes, one for each segment.

Activation enters the rod through four strains per segment, linear in the activations
(`strain_matrix`). Two activations with the same strains give the same shape under any load, so
those that keep a planned shape satisfy four linear equations for each segment and step, within
the bounds. Segments share no muscle; time steps are coupled only by bounds on change.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
import scipy.sparse as sp
from scipy.optimize import linprog

from ...errors import InputError
from ...model.activation import strain_matrix
from ...planning.plan import Plan
from ...problem.motion import allowed

LP_TOL = 1e-9  # of the linear programs, in activations
NO_EFFECT = 1e-10  # singular values below this fraction of the largest are round-off


@dataclass(frozen=True, eq=False)
class ActivationSet:
    """Activations of one segment at consecutive steps that keep the planned strains.

    The set {z : strain @ z = target, least <= change @ z <= most, lower <= z <= upper} of
    vectors z (n,), n = steps * muscles, step by step.

    Attributes
    ----------
    steps, muscles : (steps,), (muscles,)
        Indices into the plan's activations.
    matrix : (rank, muscles)
        Orthonormal rows that fix the strains of one step; usually of rank 4.
    difference : (n, n)
        Change from the previous step, plus `before`.
    before : (n,)
        Activations of time step 0 at the first time step, 0 elsewhere.
    bounded : (k,)
        Rows of `difference` that have bounds, `least` and `most`.
    """

    steps: np.ndarray
    muscles: np.ndarray
    matrix: np.ndarray
    target: np.ndarray
    difference: sp.csr_array
    before: np.ndarray
    bounded: np.ndarray
    least: np.ndarray
    most: np.ndarray
    lower: np.ndarray
    upper: np.ndarray

    @cached_property
    def strain(self) -> sp.csr_array:
        """Rows that fix the strains of all steps, (rank * steps, n)."""
        return sp.csr_array(sp.block_diag([self.matrix] * len(self.steps)))

    @cached_property
    def change(self) -> sp.csr_array:
        """Rows of changes that have bounds, (k, n); see `difference`."""
        return self.difference[self.bounded]

    @property
    def where(self) -> tuple[np.ndarray, np.ndarray]:
        """Index of z, as (steps, muscles), in a plan's activations."""
        rows, columns = np.ix_(self.steps, self.muscles)
        return rows, columns

    def table(self, z: np.ndarray) -> np.ndarray:
        """Activations (steps, muscles) of a point z."""
        return z.reshape(len(self.steps), len(self.muscles))

    def without(self, off: np.ndarray) -> ActivationSet:
        """The part of the set, possibly empty, in which some of the plan's muscles rest."""
        resting = np.tile(np.isin(self.muscles, off), len(self.steps))
        return replace(
            self,
            lower=np.where(resting, np.maximum(self.lower, 0.0), self.lower),
            upper=np.where(resting, np.minimum(self.upper, 0.0), self.upper),
        )


def shape_preserving_sets(plan: Plan, joint: bool) -> list[ActivationSet]:
    """Sets whose product contains all activations that give the plan's shapes.

    The bounds are those that the plan itself must keep (`verify`): in a sequential plan, near the
    auxiliary solutions of appendix B. They are widened where the plan exceeds them by round-off.

    Parameters
    ----------
    joint : bool
        Whether the bounds on change apply, so that a set spans all steps; otherwise there is one
        set for each step.

    Raises
    ------
    InputError
        If the plan is not a verified one of all time steps.
    """
    if not plan.verified:
        raise InputError(
            f"{plan.motion.name}, {plan.mode}: {plan.check().value}. Expected a verified plan of "
            "all time steps; plan the motion first."
        )
    count = len(plan.x)
    runs = [np.arange(count)] if joint else [np.array([t]) for t in range(count)]
    segments = range(plan.motion.trunk.segments)
    regions = [
        _segment_region(plan, segment, steps, joint) for segment in segments for steps in runs
    ]
    return [region for region in regions if len(region.muscles)]


def independent_parts(region: ActivationSet) -> list[ActivationSet]:
    """A set over all steps as a product: split where no bound on change couples two steps."""
    size = len(region.muscles)
    joined = np.zeros(len(region.steps), dtype=bool)
    joined[region.bounded // size] = True
    starts = [0, *(t for t in range(1, len(joined)) if not joined[t]), len(joined)]
    return [_cut(region, a, b) for a, b in pairwise(starts)]


def _cut(region: ActivationSet, first: int, last: int) -> ActivationSet:
    """Steps first to last - 1 of a set, which no bound on change couples to the others."""
    rank, size = region.matrix.shape
    a, b = first * size, last * size
    inside = (region.bounded >= a) & (region.bounded < b)
    return replace(
        region,
        steps=region.steps[first:last],
        target=region.target[rank * first : rank * last],
        difference=region.difference[a:b, a:b],
        before=region.before[a:b],
        bounded=region.bounded[inside] - a,
        least=region.least[inside],
        most=region.most[inside],
        lower=region.lower[a:b],
        upper=region.upper[a:b],
    )


def _segment_region(plan: Plan, segment: int, steps: np.ndarray, joint: bool) -> ActivationSet:
    motion = plan.motion
    trunk = motion.trunk
    muscles = np.flatnonzero([muscle.segment == segment for muscle in trunk.subdomains])
    matrix = _rows(strain_matrix(trunk)[segment][:, muscles], trunk.base_radius)
    x = plan.activations[np.ix_(steps, muscles)]
    z = x.ravel()
    boxes = [allowed(motion, motion.steps[t], plan.auxiliary.get(t)) for t in steps.tolist()]
    n, m = len(z), len(muscles)
    difference = sp.csr_array(sp.eye_array(n) - sp.eye_array(n, k=-m))
    change = [motion.steps[t].change for t in steps.tolist()]
    held = np.array([joint and t not in plan.auxiliary for t in steps.tolist()])[:, None]
    before = np.zeros(n)
    if joint:
        before[:m] = motion.start[muscles]
    least = np.where(held, [box.lower[muscles] for box in change], -np.inf).ravel() + before
    most = np.where(held, [box.upper[muscles] for box in change], np.inf).ravel() + before
    bounded = np.flatnonzero(np.isfinite(least) | np.isfinite(most))
    dz = (difference @ z)[bounded]
    return ActivationSet(
        steps,
        muscles,
        matrix,
        (x @ matrix.T).ravel(),
        difference,
        before,
        bounded,
        np.minimum(least[bounded], dz),
        np.maximum(most[bounded], dz),
        np.minimum(np.array([box.lower[muscles] for box in boxes]).ravel(), z),
        np.maximum(np.array([box.upper[muscles] for box in boxes]).ravel(), z),
    )


def _rows(A: np.ndarray, radius: float) -> np.ndarray:
    """Orthonormal rows (rank, muscles) that fix a segment's strains A (4, muscles) @ gamma.

    Curvatures are multiplied by the base radius (m), to be comparable with extensions. Rows of
    round-off, such as twist of muscles that cannot twist, are dropped.
    """
    _, sizes, rows = np.linalg.svd(A * np.array([1.0, radius, radius, radius])[:, None])
    kept: np.ndarray = rows[: len(sizes)][sizes > NO_EFFECT * sizes.max(initial=0.0)]
    return kept


def minimize(parts: Sequence[tuple[np.ndarray, ActivationSet]]) -> list[np.ndarray]:
    """Points z (n,) of sets that minimize linear costs (n,): one sparse program for all."""
    sets = [region for _, region in parts]
    inequalities = sp.block_diag([sp.vstack([f.change, -f.change]) for f in sets], format="csr")
    result = linprog(
        np.concatenate([cost for cost, _ in parts]),
        A_ub=inequalities,
        b_ub=np.concatenate([np.concatenate([f.most, -f.least]) for f in sets]),
        A_eq=sp.block_diag([f.strain for f in sets], format="csr"),
        b_eq=np.concatenate([f.target for f in sets]),
        bounds=np.concatenate([np.stack([f.lower, f.upper], axis=1) for f in sets]),
        method="highs",
        options={"primal_feasibility_tolerance": LP_TOL, "dual_feasibility_tolerance": LP_TOL},
    )
    if result.status != 0:  # impossible: each set is bounded and contains the plan
        raise AssertionError(f"a linear program failed: {result.message}")
    return np.split(result.x, np.cumsum([len(cost) for cost, _ in parts])[:-1])

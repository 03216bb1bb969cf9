"""The range of activation of each muscle, at every time step, that leaves the motion unchanged."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...planning.plan import Plan
from .activation_sets import ActivationSet, independent_parts, minimize, shape_preserving_sets
from .alternatives import can_be_off

NARROW_RANGE = 1e-3
"""Width up to which a range counts as a single value."""
AT_REST = 1e-2
"""Activation up to which a muscle counts as resting.

An interior-point solver leaves up to about 4e-3 in muscles that could rest. The planned shapes
include it, so keeping them exactly takes as much: solver noise, not a need of the task.
"""
BATCH_UNKNOWNS = 3000
"""Unknowns of one linear program; small ones are solved together up to this size."""


def feasible_ranges(plan: Plan, joint: bool = False) -> np.ndarray:
    """Smallest and largest activation of each muscle that leave every shape unchanged.

    Exact, by linear programs. The head angles stay as planned.

    Parameters
    ----------
    joint : bool
        Whether all steps change together within the bounds on change; otherwise each step is
        considered alone.

    Returns
    -------
    (H, muscles, 2)
        Each value is attainable for one muscle at one step, not all values at once.

    Raises
    ------
    InputError
        If the plan is not a verified one of all time steps.
    """
    result = np.repeat(plan.activations[..., None], 2, axis=-1)
    regions = shape_preserving_sets(plan, joint)
    if joint:
        regions = [part for region in regions for part in independent_parts(region)]
    objectives = [
        (r, k, sign) for r in regions for k in range(len(r.lower)) for sign in (1.0, -1.0)
    ]
    while objectives:
        sizes = np.cumsum([len(region.lower) for region, _, _ in objectives])
        count = max(int(np.searchsorted(sizes, BATCH_UNKNOWNS, side="right")), 1)
        batch, objectives = objectives[:count], objectives[count:]
        points = minimize([(_unit(region, k, sign), region) for region, k, sign in batch])
        for (region, k, sign), z in zip(batch, points, strict=True):
            step, muscle = divmod(k, len(region.muscles))
            result[region.steps[step], region.muscles[muscle], int(sign < 0)] = z[k]
    return result


def _unit(region: ActivationSet, k: int, sign: float) -> np.ndarray:
    cost = np.zeros(len(region.lower))
    cost[k] = sign
    return cost


@dataclass(frozen=True, repr=False, eq=False)
class Freedom:
    """The freedom that a motion leaves each muscle.

    Attributes
    ----------
    alone, joint : (H, muscles, 2)
        Ranges, see `ranges`: each step alone, and all together within the bounds on change.
    off : (muscles,)
        Whether the muscle could stay at rest during the whole motion, the others doing its work.
    """

    alone: np.ndarray
    joint: np.ndarray
    off: np.ndarray

    @cached_property
    def width(self) -> np.ndarray:
        """Widths (H, muscles) of the joint ranges."""
        return self.joint[..., 1] - self.joint[..., 0]

    @property
    def determined(self) -> np.ndarray:
        """Muscles (muscles,) whose range is `NARROW_RANGE` or narrower at every step."""
        return self.width.max(axis=0) <= NARROW_RANGE

    @property
    def least_work(self) -> np.ndarray:
        """Smallest magnitude of each activation (H, muscles) in its range; 0 if it can rest."""
        return np.maximum(np.maximum(self.joint[..., 0], -self.joint[..., 1]), 0.0)

    @property
    def must_work(self) -> np.ndarray:
        """Steps at which each muscle (H, muscles) cannot rest: its least is above `AT_REST`."""
        return self.least_work > AT_REST

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kind of each muscle, the first that applies.

        "determined"; "can be off"; "must work" (at some step); "free": it could rest at any step,
        but not at all of them.
        """
        rows = zip(self.determined, self.off, self.least_work.max(axis=0) > AT_REST, strict=True)
        return tuple(
            "determined" if fixed else "can be off" if off else "must work" if must else "free"
            for fixed, off, must in rows
        )


def muscle_freedom(plan: Plan) -> Freedom:
    """Ranges of all muscles, and which single muscles could be switched off.

    Raises
    ------
    InputError
        If the plan is not a verified one of all time steps.
    """
    alone = feasible_ranges(plan)
    bounded = any(len(region.bounded) for region in shape_preserving_sets(plan, joint=True))
    joint = feasible_ranges(plan, joint=True) if bounded else alone
    off = [can_be_off(plan, (name,)) for name in plan.motion.trunk.muscles]
    return Freedom(alone, joint, np.array(off, dtype=bool))

"""What each muscle could do without changing the motion: its range at every time step."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...planning.plan import Plan
from .activation_sets import ActivationSet, chains, fibers, minimize
from .variants import can_be_off

NARROW = 1e-3
"""Width of a range that counts as none."""
AT_REST = 1e-2
"""Activation that counts as rest.

An interior-point solver leaves up to some 4e-3 in muscles that could rest. The planned shapes have
that in them, so to hold them exactly takes as much: noise of the solver, no need of the task.
"""
ALTOGETHER = 3000
"""Unknowns of one linear program, where several small ones are solved as one."""


def ranges(plan: Plan, joint: bool = False) -> np.ndarray:
    """Smallest and largest activation of each muscle that leave every shape as it is.

    Exact, by linear programs. The head angles stay as planned.

    Parameters
    ----------
    joint : bool
        Whether the other steps may follow within the bounds on change; otherwise each step
        is taken alone.

    Returns
    -------
    (H, muscles, 2)
        Each value can be taken by one muscle at one step; not all of them together.

    Raises
    ------
    InputError
        If the plan is not a verified one of all time steps.
    """
    found = np.repeat(plan.activations[..., None], 2, axis=-1)
    sets = fibers(plan, joint)
    if joint:
        sets = [chain for fiber in sets for chain in chains(fiber)]
    wanted = [(f, k, sign) for f in sets for k in range(len(f.lower)) for sign in (1.0, -1.0)]
    while wanted:
        sizes = np.cumsum([len(fiber.lower) for fiber, _, _ in wanted])
        count = max(int(np.searchsorted(sizes, ALTOGETHER, side="right")), 1)
        now, wanted = wanted[:count], wanted[count:]
        points = minimize([(_unit(fiber, k, sign), fiber) for fiber, k, sign in now])
        for (fiber, k, sign), z in zip(now, points, strict=True):
            step, muscle = divmod(k, len(fiber.muscles))
            found[fiber.steps[step], fiber.muscles[muscle], int(sign < 0)] = z[k]
    return found


def _unit(fiber: ActivationSet, k: int, sign: float) -> np.ndarray:
    cost = np.zeros(len(fiber.lower))
    cost[k] = sign
    return cost


@dataclass(frozen=True, repr=False, eq=False)
class Freedom:
    """What a motion leaves each muscle free to do.

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
        """Which muscles (muscles,) the motion leaves no choice: no range is wider than `NARROW`."""
        return self.width.max(axis=0) <= NARROW

    @property
    def least_work(self) -> np.ndarray:
        """Smallest size of each activation (H, muscles) in its range; 0 if it can be at rest."""
        return np.maximum(np.maximum(self.joint[..., 0], -self.joint[..., 1]), 0.0)

    @property
    def must_work(self) -> np.ndarray:
        """At which steps each muscle (H, muscles) cannot rest: does `AT_REST` or more."""
        return self.least_work > AT_REST

    @property
    def kinds(self) -> tuple[str, ...]:
        """One word or two for each muscle.

        "determined"; else "can be off"; else "must work" (at some step); else "free": it could
        rest at any step, but not at all of them.
        """
        rows = zip(self.determined, self.off, self.least_work.max(axis=0) > AT_REST, strict=True)
        return tuple(
            "determined" if fixed else "can be off" if off else "must work" if must else "free"
            for fixed, off, must in rows
        )


def freedom(plan: Plan) -> Freedom:
    """Ranges of all muscles, and which of them could be switched off, each by itself.

    Raises
    ------
    InputError
        If the plan is not a verified one of all time steps.
    """
    alone = ranges(plan)
    bounded = any(len(fiber.bounded) for fiber in fibers(plan, joint=True))
    joint = ranges(plan, joint=True) if bounded else alone
    off = [can_be_off(plan, (name,)) for name in plan.motion.trunk.muscles]
    return Freedom(alone, joint, np.array(off, dtype=bool))

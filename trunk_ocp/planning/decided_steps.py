"""The time steps of a plan in progress that are decided."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..problem.targets import HeldDirection


@dataclass(eq=False)
class DecidedSteps:
    """What a planning run has decided so far.

    Attributes
    ----------
    x : list of (muscles + 2,)
        Controls of each step.
    tip_forces : list of (3,)
        Tip force of each step in N.
    states : list of (elements, degree + 1, 7)
        Rod states of each step.
    held : dict
        Value (3,) of each held direction that these steps define.
    unloaded : (muscles + 2,) or None
        Solution of the last auxiliary problem.
    auxiliary : dict
        As in `Plan`.
    converged : bool
        Whether every solve converged.
    """

    x: list[np.ndarray] = field(default_factory=list)
    tip_forces: list[np.ndarray] = field(default_factory=list)
    states: list[np.ndarray] = field(default_factory=list)
    held: dict[HeldDirection, np.ndarray] = field(default_factory=dict)
    unloaded: np.ndarray | None = None
    auxiliary: dict[int, np.ndarray] = field(default_factory=dict)
    converged: bool = True

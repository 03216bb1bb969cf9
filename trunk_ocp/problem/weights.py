"""Weights of what a plan costs beside its distance to targets."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from .._support.ranges import check
from .muscle_patterns import muscles_of, pattern_matches
from .problem_file import DEFAULT_EFFORT, DEFAULT_RATE


@dataclass(frozen=True)
class Weights:
    """Weights of the costs other than tracking.

    Tracking is the weighted sum of squared distances of eq. (42). Positions count in m for a trunk
    of 1.75 m and in proportion to length for others (`Motion.position_scale`), so that weights
    have the same meaning at every size. Effort and rate are small: they select one of the many
    solutions that track equally well.

    Attributes
    ----------
    effort : float or dict
        Weight of the sum over time steps with targets of the squared activations. A dict has a
        weight for each name or pattern of muscles, such as {"*": 1e-5, "*1-dl": 1e-4}; later ones
        override earlier ones, and muscles without one have the default.
    rate : float
        Weight of the integral over time of the squared rates of activations (1/s) and head
        angles (rad/s).
    head_effort : float
        Weight of the sum over time steps with targets of the squared head angles (rad^2).
    """

    effort: float | Mapping[str, float] = field(default=DEFAULT_EFFORT, hash=False)
    rate: float = DEFAULT_RATE
    head_effort: float = 0.0

    def __post_init__(self) -> None:
        if isinstance(self.effort, Mapping):
            for name, value in self.effort.items():
                check(value, "weight", f"effort[{name!r}]")
            effort = {str(name): float(value) for name, value in self.effort.items()}
            object.__setattr__(self, "effort", effort)
        for name in ("effort", "rate", "head_effort"):
            value = getattr(self, name)
            if not isinstance(value, Mapping):
                check(value, "weight", name)
                object.__setattr__(self, name, float(value))  # as JSON takes it, not of NumPy

    def of_muscles(self, muscles: tuple[str, ...]) -> np.ndarray:
        """Weight (muscles,) of the effort of each muscle.

        Raises
        ------
        InputError
            If a pattern matches no muscle.
        """
        if not isinstance(self.effort, Mapping):
            return np.full(len(muscles), self.effort)
        weights = np.full(len(muscles), DEFAULT_EFFORT)
        matches = pattern_matches(self.effort, muscles, "weights.effort")
        for pattern, value in self.effort.items():
            weights[muscles_of(pattern, matches, muscles, "weights.effort")] = value
        return weights

"""A validation case: numbers computed in two ways, and their largest allowed difference."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

Values = tuple[np.ndarray, np.ndarray]
"""Computed, reference."""


def flat(computed: Sequence[np.ndarray], expected: Sequence[np.ndarray]) -> Values:
    """Arrays of several shapes as one vector, on both sides."""
    one, two = (np.concatenate([np.ravel(part) for part in side]) for side in (computed, expected))
    return one, two


@dataclass(frozen=True)
class Case:
    """A quantity computed by the package, and its reference.

    Attributes
    ----------
    subject : str
        Heading on the page.
    name : str
        What is compared; unique.
    source : str
        Source of the reference: citation with equation or table, or its derivation.
    values : () -> (computed, reference)
        Arrays of equal shape, in `unit`.
    tolerance : float
        Largest allowed difference between entries.
    reason : str
        Reason for the size of the tolerance.
    unit : str
        "" for numbers without a unit; relative errors are values divided by a scale.
    """

    subject: str
    name: str
    source: str
    values: Callable[[], Values]
    tolerance: float
    reason: str
    unit: str = ""

    def error(self) -> float:
        """Largest difference between computed and reference values; NaN if either contains one.

        Raises
        ------
        ValueError
            If their shapes differ.
        """
        computed, reference = (np.asarray(part, dtype=float) for part in self.values())
        if computed.shape != reference.shape:
            raise ValueError(f"{self.name}: {computed.shape} vs. {reference.shape}")
        return float(np.abs(computed - reference).max())


@dataclass(frozen=True)
class CoveredByTest:
    """A quantity that a separate test covers; the page refers to it.

    `test` is "file::function" relative to the root of the repository.
    """

    subject: str
    name: str
    source: str
    test: str

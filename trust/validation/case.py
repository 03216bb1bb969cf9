"""What a case is: two ways to the same numbers, and how far apart they may be."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

Values = tuple[np.ndarray, np.ndarray]
"""Computed, reference."""


def flat(found: Sequence[np.ndarray], expected: Sequence[np.ndarray]) -> Values:
    """Arrays of several shapes as one vector, on both sides."""
    computed, reference = (
        np.concatenate([np.ravel(part) for part in side]) for side in (found, expected)
    )
    return computed, reference


@dataclass(frozen=True)
class Case:
    """Something computed by the package beside a reference.

    Attributes
    ----------
    subject : str
        Heading under which the page has it.
    name : str
        What is compared; no two cases share one.
    source : str
        Where the reference is from: citation with equation or table, or how it is derived.
    values : () -> (computed, reference)
        Arrays of one shape, in `unit`.
    tolerance : float
        Largest difference of two entries.
    reason : str
        Why so much and no more.
    unit : str
        "" for numbers without unit; relative errors are values divided by a scale.
    """

    subject: str
    name: str
    source: str
    values: Callable[[], Values]
    tolerance: float
    reason: str
    unit: str = ""

    def error(self) -> float:
        """Largest difference between computed and reference values; NaN if either has one.

        Raises
        ------
        ValueError
            If their shapes differ.
        """
        computed, reference = (np.asarray(part, dtype=float) for part in self.values())
        if computed.shape != reference.shape:
            raise ValueError(f"{self.name}: {computed.shape} against {reference.shape}")
        return float(np.abs(computed - reference).max())


@dataclass(frozen=True)
class HeldByTest:
    """Something that a test of its own holds already, for the page to point at.

    `test` is "file::function" below the repository's root.
    """

    subject: str
    name: str
    source: str
    test: str

"""Ranges of all numbers that a user may choose, for the command line and Python."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from numbers import Integral, Real

from ..errors import InputError

MAX_SHOWN = 30  # characters of a value in a message


@dataclass(frozen=True)
class Range:
    """The values that an option may have, without `lowest` itself if `above`."""

    lowest: float
    highest: float
    whole: bool = True
    above: bool = False

    def __contains__(self, value: object) -> bool:
        if isinstance(value, bool) or not isinstance(value, Integral if self.whole else Real):
            return False
        if not isinstance(value, Integral) and math.isnan(value):
            return False
        number = int(value) if isinstance(value, Integral) else float(value)
        low = self.lowest < number if self.above else self.lowest <= number
        return low and number <= self.highest

    def __str__(self) -> str:
        kind = "a whole number" if self.whole else "a number"
        low, high = (f"{n:,}" if self.whole else f"{n:g}" for n in (self.lowest, self.highest))
        return f"{kind} {'above' if self.above else 'from'} {low} up to {high}"


RANGES = {
    "max_iterations": Range(1, 1_000_000),
    "starts": Range(1, 10_000),
    "random starts": Range(0, 100_000),
    "lookahead": Range(1, 1_000_000),
    "seed": Range(0, 2**63 - 1),
    "processes": Range(1, 1_000),
    "port": Range(0, 65_535),
    "elements": Range(1, 1_000),
    "degree": Range(1, 20),
    "activation limit": Range(0, 1e6, whole=False, above=True),
    "rate limit": Range(0, 1e9, whole=False, above=True),
    "time step": Range(0, 1e3, whole=False, above=True),
    "damping time": Range(0, 1e3, whole=False),
    "inertia ratio": Range(0, 1e6, whole=False, above=True),
    "weight": Range(0, 1e12, whole=False),
    "Z": Range(0, 1e6, whole=False),
}


def check(value: object, kind: str, name: str = "") -> None:
    """Raise InputError if a value is out of range.

    Parameters
    ----------
    value : object
    kind : str
        Key of `RANGES`.
    name : str, optional
        Name of the argument, if not `kind`.
    """
    if value not in RANGES[kind]:
        raise InputError(f"{name or kind} = {shown(value)}: expected {RANGES[kind]}.")


def shown(value: object, as_text: Callable[[object], str] = str) -> str:
    """A value for a message, shortened if it is long."""
    try:
        text = as_text(value)
    except ValueError:  # Python refuses to write whole numbers of thousands of digits
        return "a number of thousands of digits"
    return text if len(text) <= MAX_SHOWN else f"{text[:MAX_SHOWN]}... ({len(text):,} characters)"

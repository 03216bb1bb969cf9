"""A deadline, and whether more work would end before it."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager

RESERVE = 1.25
"""Time that must be left for a part, over the longest that it has taken: some take longer."""


class Pace:
    """Judges by the longest that the parts of this solve have taken so far.

    Parameters
    ----------
    deadline : float
        Time of `time.perf_counter()`.

    Attributes
    ----------
    seconds : dict
        Seconds spent in each part.
    """

    def __init__(self, deadline: float) -> None:
        self._deadline = deadline
        self._longest: defaultdict[str, float] = defaultdict(float)
        self.seconds: defaultdict[str, float] = defaultdict(float)

    @contextmanager
    def part(self, name: str) -> Iterator[None]:
        """Measure a part."""
        began = time.perf_counter()
        try:
            yield
        finally:
            seconds = time.perf_counter() - began
            self.seconds[name] += seconds
            self._longest[name] = max(self._longest[name], seconds)

    def allows(self, *parts: str) -> bool:
        """Whether these parts would end before the deadline."""
        seconds = sum(self._longest[part] for part in parts)
        return time.perf_counter() + RESERVE * seconds <= self._deadline

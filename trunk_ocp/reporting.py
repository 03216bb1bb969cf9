"""Progress reports of long computations; silent by default."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Progress:
    """State of a plan after one iteration of the optimizer.

    Attributes
    ----------
    stage : str
        Stage of the plan, such as "sequential" or "horizon".
    detail : str
        The current solve, such as "step 3 of 10, unloaded".
    first, last : int
        Time steps being solved, counted from 1.
    iteration : int
        Iterations of this solve so far.
    worst_error : float
        Largest distance in m of any target point of these steps.
    infeasibility : float
        Largest violation of a constraint, in units of the NLP.
    """

    stage: str
    detail: str
    first: int
    last: int
    iteration: int
    worst_error: float
    infeasibility: float


class Reporter:
    """Receives progress; the base class ignores it. Set `stop` to end a plan early."""

    stop: bool = False

    def iteration(self, progress: Progress) -> None:
        """Called after every iteration of the optimizer."""

    def note(self, text: str) -> None:
        """Called with one sentence about an event of the computation."""

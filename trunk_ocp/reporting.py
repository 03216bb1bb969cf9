"""What a long computation tells its caller; silent by default."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Progress:
    """Where a plan stands after one iteration of the optimizer.

    Attributes
    ----------
    stage : str
        Part of the plan, such as "sequential" or "horizon".
    detail : str
        What is being solved in it, such as "step 3 of 10, unloaded".
    first, last : int
        Time steps in work, counted from 1.
    iteration : int
        Of this solve.
    worst_error : float
        Largest distance in m of any target point of these steps.
    infeasibility : float
        Largest violation of a constraint, in the transcription's units.
    """

    stage: str
    detail: str
    first: int
    last: int
    iteration: int
    worst_error: float
    infeasibility: float


class Reporter:
    """Receives progress. The base class ignores it; set `stop` to end the plan early."""

    stop: bool = False

    def iteration(self, progress: Progress) -> None:
        """Called after every iteration of the optimizer."""

    def note(self, text: str) -> None:
        """Called with one sentence when something worth knowing happens."""

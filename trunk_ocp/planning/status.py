"""How a plan ended."""

from __future__ import annotations

import enum


class Status(enum.Enum):
    """How a plan ended; the value is the sentence shown to users. Only the first is a success."""

    SOLVED = "solved and verified"
    MISSED = "converged and verified, but a target is out of reach"
    UNSTABLE = "converged and verified, but unstable: the trunk would not stay in its shape"
    COLLIDING = "converged and verified, but the trunk collides with a body that it has to avoid"
    UNVERIFIED = "converged, but the independent check failed"
    UNCHECKED = "converged, but not checked yet"
    INFEASIBLE = "not converged: no motion was found that keeps all bounds"
    ITERATION_LIMIT = "not converged within the allowed iterations; what was reached is kept"
    TIME_LIMIT = "not converged by the deadline; what was reached is kept"
    NOT_CONVERGED = "not converged; what was reached is kept"
    INTERRUPTED = "interrupted; the best so far is kept"

    @property
    def exit_code(self) -> int:
        """Exit code of a command with this outcome: 0 solved, 4 interrupted, 3 anything else."""
        return {Status.SOLVED: 0, Status.INTERRUPTED: 4}.get(self, 3)


ACCEPTED = (Status.SOLVED, Status.UNCHECKED)
"""What planners return without an error."""

FAILURES = {
    "Infeasible_Problem_Detected": Status.INFEASIBLE,
    "Maximum_Iterations_Exceeded": Status.ITERATION_LIMIT,
}
"""Status for each message of Ipopt; NOT_CONVERGED for any other."""

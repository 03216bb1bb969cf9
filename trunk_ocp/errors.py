"""What can go wrong, each with a message that a user can act on."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .planning.plan import Plan


class TrunkError(Exception):
    """Base of every error this package raises on purpose."""


class InputError(TrunkError):
    """A file or an argument is not what was expected; nothing was computed."""


class StaticsError(TrunkError):
    """No equilibrium was found for a given activation and load.

    Attributes
    ----------
    load_fraction : float
        Largest fraction of the load for which an equilibrium was reached.
    """

    def __init__(self, message: str, load_fraction: float) -> None:
        super().__init__(message)
        self.load_fraction = load_fraction

    def __reduce__(self) -> tuple[type[StaticsError], tuple[str, float]]:
        # An exception is pickled as its class and `args`, which are those of its base: too few
        # here. Without this one such error breaks a whole pool of processes.
        return type(self), (str(self), self.load_fraction)


class SolverMissingError(TrunkError):
    """The requested linear solver is not part of this installation."""


class PlanError(TrunkError):
    """A plan is not solved and verified; the message is its status and what is wrong.

    Attributes
    ----------
    plan : Plan
        What was reached all the same.
    """

    def __init__(self, plan: Plan) -> None:
        violated = plan.failure.violations if plan.failure else ()
        problems = [*map(str, violated), *plan.verification.faults, *plan.missed, *plan.notes]
        first = f" {problems[0][0].upper()}{problems[0][1:]}." if problems else ""
        super().__init__(
            f"{plan.motion.name}, {plan.mode}: {plan.status.value}.{first} The plan is this "
            "error's `plan`; throw=False returns it instead, and explain(plan) says more."
        )
        self.plan = plan

    def __reduce__(self) -> tuple[type[PlanError], tuple[Plan]]:
        return type(self), (self.plan,)  # see StaticsError

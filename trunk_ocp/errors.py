"""What can go wrong, each with a message that a user can act on."""

from __future__ import annotations


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

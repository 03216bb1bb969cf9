"""Errors of this package; each message says what a user can do."""

from __future__ import annotations


class TrunkError(Exception):
    """Base class of all errors that this package raises on purpose."""


class InputError(TrunkError):
    """A file or an argument is not valid; nothing was computed."""


class StaticsError(TrunkError):
    """No equilibrium was found for an activation and load.

    Attributes
    ----------
    load_fraction : float
        Largest fraction of the load for which an equilibrium was reached.
    """

    def __init__(self, message: str, load_fraction: float) -> None:
        super().__init__(message)
        self.load_fraction = load_fraction

    def __reduce__(self) -> tuple[type[StaticsError], tuple[str, float]]:
        # By default an exception is pickled as its class and the `args` of its base, which are too
        # few here; one such error would break a whole pool of processes.
        return type(self), (str(self), self.load_fraction)


class SolverMissingError(TrunkError):
    """The requested linear solver is not part of this installation."""

"""An export request, and the errors of checking an export."""

from __future__ import annotations

from dataclasses import dataclass

from ..errors import TrunkError
from ..problem.motion import Motion
from .shape_model import Model


@dataclass(frozen=True)
class Request:
    """One export.

    Attributes
    ----------
    what : "shape", "jacobian" (the shape and its first derivatives) or "constraints"
        The last means the functions of the motion's NLP, and needs a motion.
    name : str
        Name of the anatomy or problem.
    second : bool
        Whether a Jacobian comes with its derivative along a direction.
    muscle : str or None
        Name of the muscle, for formulas.
    """

    model: Model
    what: str
    name: str
    second: bool = False
    muscle: str | None = None
    motion: Motion | None = None


class ToolMissingError(TrunkError):
    """A program that an export needs is not installed; the message says how to install it."""


class CheckError(TrunkError):
    """An export does not reproduce its check file; the message is the output of its check."""

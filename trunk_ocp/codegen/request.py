"""What a user asks to be exported, and what can go wrong when an export is checked."""

from __future__ import annotations

from dataclasses import dataclass

from ..errors import TrunkError
from ..problem.motion import Motion
from .model import Model


@dataclass(frozen=True)
class Request:
    """One export.

    Attributes
    ----------
    what : "shape", "jacobian" (the shape and its first derivatives) or "constraints"
        The last is the motion NLP's own functions, and needs a motion.
    second : bool
        Whether a Jacobian comes with its derivative along a direction.
    single : bool
        Single precision, where a format has a choice.
    muscle : str or None
        The muscle that formulas are for.
    name : str
        Name of the anatomy or problem.
    """

    model: Model
    what: str
    name: str
    second: bool = False
    single: bool = False
    muscle: str | None = None
    motion: Motion | None = None


class ToolMissingError(TrunkError):
    """A program that an export needs is not installed; the message says how to get it."""


class CheckError(TrunkError):
    """An export does not give the numbers of its check file; the message is what its check said."""

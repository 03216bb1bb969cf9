"""What saved files say, believed only as far as it is checked: JSON, records of solves, references.

A file may come from anybody. Whatever is in it, reading it ends soon, takes little memory, and
either with a value of the expected kind or with an `InputError`; nothing in it reaches a terminal
that a terminal would obey.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from .._support.toml_files import printable
from ..errors import InputError
from ..nlp.outcome import Solve
from ..nlp.violations import Violation
from ..problem.motion import Motion

MOST_TEXT = 8_000_000
MOST_NESTED, MOST_ENTRIES = 150_000, 600_000
"""Characters, brackets and commas of JSON texts; a solve has a bracket for each iteration."""
SLACK = 1e-6
"""By which an auxiliary solution may exceed a bound, as in `verification`."""


def json_of(text: str) -> Any:
    """JSON without anything in its strings that a terminal would obey.

    Raises
    ------
    InputError
        If it is too long or nested too deeply, or no JSON.
    """
    if not fits(text):
        raise InputError("its text is too large; expected the records of one plan")
    try:
        return _cleaned(json.loads(text))
    except RecursionError:
        raise InputError("its text is nested too deeply; expected a few levels") from None


def fits(*texts: str) -> bool:
    """Whether JSON texts are together of a size that is read."""
    nested = sum(text.count("[") + text.count("{") for text in texts)
    commas = sum(text.count(",") for text in texts)
    return sum(map(len, texts)) <= MOST_TEXT and nested <= MOST_NESTED and commas <= MOST_ENTRIES


def recorded(solves: Sequence[Solve], *others: str) -> str:
    """Records of solves in JSON; what does not fit beside others goes without its iterations."""
    text = json.dumps([asdict(solve) for solve in solves])
    if fits(text, *others):
        return text
    return json.dumps([asdict(replace(solve, history=solve.history[-1:])) for solve in solves])


def _cleaned(value: Any) -> Any:
    if isinstance(value, str):
        return printable(value)
    if isinstance(value, list):
        return [_cleaned(entry) for entry in value]
    if isinstance(value, dict):
        return {printable(key): _cleaned(entry) for key, entry in value.items()}
    return value


def number(value: Any) -> float:
    """A number; NaN and infinity are some, true and "1" are none."""
    if type(value) not in (int, float):
        raise InputError(f"{_shown(value)}: expected a number")
    return float(value)


def amount(value: Any) -> float:
    """A finite number from 0 on."""
    if not 0 <= number(value) < math.inf:
        raise InputError(f"{_shown(value)}: expected a finite number from 0 on")
    return float(value)


def count(value: Any, least: int = 0) -> int:
    """A whole number that an index or a counter may be."""
    if type(value) is not int or not least <= value < 2**31:
        raise InputError(f"{_shown(value)}: expected a whole number from {least} on")
    return value


def words(value: Any) -> str:
    """A text."""
    if not isinstance(value, str):
        raise InputError(f"{_shown(value)}: expected a text")
    return value


def flag(value: Any) -> bool:
    """True or false."""
    if type(value) is not bool:
        raise InputError(f"{_shown(value)}: expected true or false")
    return value


def entries(value: Any) -> list[Any]:
    """A list."""
    if not isinstance(value, list):
        raise InputError(f"{_shown(value)}: expected a list")
    return value


def table(value: Any) -> dict[str, Any]:
    """A table of named values."""
    if not isinstance(value, dict):
        raise InputError(f"{_shown(value)}: expected named values")
    return value


def solve_of(value: Any) -> Solve:
    """A record of a solve, from what `asdict` and JSON make of one."""
    record = table(value)
    return Solve(
        stage=words(record["stage"]),
        detail=words(record["detail"]),
        first=count(record["first"]),
        last=count(record["last"]),
        message=words(record["message"]),
        objective=number(record["objective"]),
        infeasibility=number(record["infeasibility"]),
        history=tuple(_iteration(entry) for entry in entries(record["history"])),
        violations=tuple(_violation(entry) for entry in entries(record["violations"])),
    )


def _iteration(value: Any) -> tuple[float, float, float]:
    objective, primal, dual = entries(value)
    return number(objective), number(primal), number(dual)


def _violation(value: Any) -> Violation:
    record = table(value)
    return Violation(
        step=count(record["step"]),
        what=words(record["what"]),
        Z=None if record["Z"] is None else number(record["Z"]),
        value=number(record["value"]),
        lower=number(record["lower"]),
        upper=number(record["upper"]),
        unit=words(record["unit"]),
        excess=number(record["excess"]),
        others=count(record["others"]),
    )


def check_near(motion: Motion, x: np.ndarray, near: Mapping[int, np.ndarray]) -> None:
    """Raise InputError unless auxiliary solutions are ones that the motion may have.

    A step that is near one is free of the bounds on change, so only steps that ask for it may be.
    The unloaded problems that they solve have bounds of their own (appendix B.1-B.2), on change
    from the solution before if there is one.

    x : (H, muscles + 2), unknowns of the first H time steps.
    """
    for t, unknowns in near.items():
        if not motion.steps[t].follows:
            raise InputError(f"near_step = {t + 1}: this time step has no auxiliary solution")
        box, change = motion.steps[t].box, motion.steps[t].change
        kept = np.all((box.lower - SLACK <= unknowns) & (unknowns <= box.upper + SLACK))
        if t - 1 in near and np.any(np.isfinite(change.upper)):
            step = unknowns - near[t - 1]
            kept &= np.all((change.lower - SLACK <= step) & (step <= change.upper + SLACK))
        if not kept:
            raise InputError(f"near_step = {t + 1}: an auxiliary solution is beyond its bounds")


def _shown(value: Any) -> str:
    text = repr(value) if not isinstance(value, list | dict) else type(value).__name__
    return printable(text if len(text) <= 40 else text[:37] + "...")

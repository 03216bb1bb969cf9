"""Validated reading of the records in saved files: JSON, solves, auxiliary solutions.

Files are untrusted. Reading any content is fast, takes little memory, and either gives a value of
the expected type or raises `InputError`; no control characters reach a terminal.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any, TypeVar

import numpy as np

from .._support.toml_files import printable
from ..contact.exchange import solids_at
from ..errors import InputError
from ..model.solids import SELF
from ..nlp.gap_rows import GapRow
from ..nlp.outcome import Solve
from ..nlp.violations import Violation
from ..problem.motion import Bounds, Motion
from .verification import BOUND_TOL

T = TypeVar("T")
MAX_TEXT = 8_000_000
MAX_BRACKETS, MAX_COMMAS = 150_000, 600_000
"""Characters, brackets and commas of JSON texts; a solve has a bracket for each iteration."""


def json_of(text: str) -> Any:
    """Values of a JSON text, without control characters in strings.

    Raises
    ------
    InputError
        If it is too long or nested too deeply.
    ValueError
        If it is not JSON.
    """
    if not fits(text):
        raise InputError("its text is too large; expected the records of one plan")
    try:
        return _cleaned(json.loads(text))
    except RecursionError:
        raise InputError("its text is nested too deeply; expected a few levels") from None


def fits(*texts: str) -> bool:
    """Whether JSON texts together are small enough to be read."""
    brackets = sum(text.count("[") + text.count("{") for text in texts)
    commas = sum(text.count(",") for text in texts)
    return sum(map(len, texts)) <= MAX_TEXT and brackets <= MAX_BRACKETS and commas <= MAX_COMMAS


def solves_json(solves: Sequence[Solve], *others: str) -> str:
    """Records of solves in JSON; without their iterations if these would not fit beside others."""
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
    """A number, NaN and infinity included; true and "1" are not numbers."""
    if type(value) not in (int, float):
        raise InputError(f"{_shown(value)}: expected a number")
    return float(value)


def finite_number(value: Any) -> float:
    """A finite number."""
    if not math.isfinite(number(value)):
        raise InputError(f"{_shown(value)}: expected a finite number")
    return float(value)


def amount(value: Any) -> float:
    """A finite number >= 0."""
    if not 0 <= number(value) < math.inf:
        raise InputError(f"{_shown(value)}: expected a finite number, at least 0")
    return float(value)


def count(value: Any, least: int = 0) -> int:
    """A whole number for an index or a counter."""
    if type(value) is not int or not least <= value < 2**31:
        raise InputError(f"{_shown(value)}: expected a whole number, at least {least}")
    return value


def words(value: Any) -> str:
    """A string."""
    return _of_type(str, value, "a string")


def flag(value: Any) -> bool:
    """True or false."""
    return _of_type(bool, value, "true or false")


def entries(value: Any) -> list[Any]:
    """A list."""
    return _of_type(list, value, "a list")


def table(value: Any) -> dict[str, Any]:
    """A table of named values."""
    return _of_type(dict, value, "named values")


def _of_type(kind: type[T], value: Any, expected: str) -> T:
    if not isinstance(value, kind):
        raise InputError(f"{_shown(value)}: expected {expected}")
    return value


def solve_of(value: Any) -> Solve:
    """A record of a solve from its JSON."""
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


def gaps_record(gaps: Mapping[int, Sequence[GapRow]]) -> list[list[Any]]:
    """Rows of gaps for JSON: time step (from 1), body, place, other place or null, least gap."""
    return [[t + 1, g.body, g.Z, g.other, g.least] for t, rows in gaps.items() for g in rows]


def gaps_of(value: Any, motion: Motion) -> dict[int, tuple[GapRow, ...]]:
    """Rows of gaps from their JSON."""
    gaps: dict[int, list[GapRow]] = {}
    for entry in entries(value):
        step, body, Z, other, least = entries(entry)
        t = count(step, 1) - 1
        if t >= len(motion.steps):
            raise InputError(f"gaps: time step {step}: expected one of the motion's")
        solids = {solid.name: solid for solid in solids_at(motion, t)}
        solid, at_itself = solids.get(words(body)), words(body) == SELF
        places = [number(Z), *([number(other)] if at_itself else [])]
        if (solid is None) != at_itself or not all(0 <= p <= motion.trunk.length for p in places):
            raise InputError(f"gaps: {_shown(entry)}: expected a solid of the step and a place")
        gaps.setdefault(t, []).append(
            GapRow(places[0], solid, places[1] if at_itself else None, finite_number(least))
        )
    return {t: tuple(rows) for t, rows in gaps.items()}


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


def check_auxiliary(motion: Motion, auxiliary: Mapping[int, np.ndarray]) -> None:
    """Raise InputError unless auxiliary solutions are possible for the motion.

    A step near an auxiliary solution is free of the bounds on change, so only steps that ask for
    one may have it. The unloaded problems have bounds of their own (appendix B.1-B.2), on change
    from the auxiliary solution of the step before if there is one.
    """
    for t, controls in auxiliary.items():
        if not motion.steps[t].follows:
            raise InputError(f"near_step = {t + 1}: this time step has no auxiliary solution")
        box, change = motion.steps[t].box, motion.steps[t].change
        keeps_bounds = _within(box, controls)
        if t - 1 in auxiliary and np.any(np.isfinite(change.upper)):
            keeps_bounds &= _within(change, controls - auxiliary[t - 1])
        if not keeps_bounds:
            raise InputError(f"near_step = {t + 1}: an auxiliary solution violates its bounds")


def _within(bounds: Bounds, x: np.ndarray) -> bool:
    return bool(np.all((bounds.lower - BOUND_TOL <= x) & (x <= bounds.upper + BOUND_TOL)))


def _shown(value: Any) -> str:
    text = repr(value) if not isinstance(value, list | dict) else type(value).__name__
    return printable(text if len(text) <= 40 else text[:37] + "...")

"""Variants of a problem: moved, mirrored, with tighter bounds. Each edits what the file says.

So a variant can be saved, shared and read back as the same thing. `motion.py` and `mirror.py`
change the built motion alike; that both agree is what `as_built` asks.
"""

from __future__ import annotations

import fnmatch
import math
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any, TypeVar

import numpy as np
from pydantic import ValidationError

from .._support.toml_files import SMALLEST_NUMBER
from ..errors import InputError
from .problem_file import (
    BoundsSpec,
    ChangeSpec,
    HeldSpec,
    LimitsSpec,
    LoadsSpec,
    PhaseSpec,
    ProblemSpec,
    TargetSpec,
    WrapSpec,
)

Numbers = tuple[float, ...]
Point = Callable[[np.ndarray], np.ndarray]
Section = TypeVar("Section", TargetSpec, WrapSpec)
Limits = TypeVar("Limits", LimitsSpec, BoundsSpec)
Angles = TypeVar("Angles", LimitsSpec, BoundsSpec, ChangeSpec)

MOST_MATCHES = 1_000_000
"""Muscles times different patterns of a problem's bounds: half a second's work."""
MOST_SHOWN, LONGEST_SHOWN = 100, 200  # muscles in a message, and characters of a pattern
POINTS, CURVES = ("position", "center"), ("path", "through")
"""Keys of one point, and of several; a row may have more numbers before its point."""


def shifted_spec(spec: ProblemSpec, offset: Sequence[float]) -> ProblemSpec:
    """The problem with every target position moved by `offset` (3,) in m.

    Raises
    ------
    InputError
        If the offset is not three finite numbers, or moves a target beyond all numbers of a file.
    """
    try:
        by = np.asarray(offset, dtype=float)
    except (TypeError, ValueError):
        by = np.zeros(0)
    if by.shape != (3,) or not np.all(np.isfinite(by)):
        raise InputError(f"offset = {offset!r}: expected three finite numbers in m.")
    return _valid(_with_points(spec, lambda point: point + by), f"offset = {by.tolist()}")


def limited_spec(
    spec: ProblemSpec, activation: float = math.inf, rate: float = math.inf
) -> ProblemSpec:
    """The problem with |gamma| up to `activation`, and its changes up to `rate` in 1/s.

    A pair of bounds that this leaves empty is one that no muscle has, as later ones override it.
    """
    bounds = spec.bounds
    muscles = {name: _cut(pair, activation) for name, pair in bounds.muscles.items()}
    cut = {"activation": _cut(bounds.activation, activation), "muscles": muscles}
    phases = [_slowed(phase, rate) for phase in spec.phases] if rate < math.inf else spec.phases
    edited = spec.model_copy(
        update={"bounds": bounds.model_copy(update=cut), "phases": tuple(phases)}
    )
    return _valid(edited, f"activation = {activation:g}, rate = {rate:g}")


def silenced_spec(spec: ProblemSpec, muscles: Sequence[str]) -> ProblemSpec:
    """The problem with some muscles at rest all the time."""

    def silenced(limits: Limits) -> Limits:
        others = {name: pair for name, pair in limits.muscles.items() if name not in muscles}
        off = others | dict.fromkeys(muscles, (0.0, 0.0))  # last, so that they override patterns
        return limits.model_copy(update={"muscles": off})

    phases = (
        phase.model_copy(update={"bounds": silenced(phase.bounds)})
        if phase.bounds.activation is not None or phase.bounds.muscles
        else phase
        for phase in spec.phases
    )
    edited = spec.model_copy(update={"bounds": silenced(spec.bounds), "phases": tuple(phases)})
    return _valid(edited, f"without {', '.join(muscles)}")


def unaided_spec(spec: ProblemSpec) -> ProblemSpec:
    """The problem without auxiliary problems."""
    phases = (phase.model_copy(update={"auxiliary": None}) for phase in spec.phases)
    return spec.model_copy(update={"phases": tuple(phases)})


def mirrored_spec(spec: ProblemSpec, muscles: tuple[str, ...]) -> ProblemSpec:
    """The problem in the mirror, the plane Y = 0; `muscles` are the names of the trunk's."""
    moved = _with_points(spec, _reflected)
    phases = (
        phase.model_copy(
            update={
                "targets": tuple(_turned(target) for target in phase.targets),
                "loads": _other_loads(phase.loads),
                "bounds": _other_limits(phase.bounds, muscles),
                "change": tuple(_other_angle(change) for change in phase.change),
            }
        )
        for phase in moved.phases
    )
    bounds = _other_limits(spec.bounds, muscles)
    return _valid(moved.model_copy(update={"bounds": bounds, "phases": tuple(phases)}), "mirror")


def _valid(spec: ProblemSpec, what: str) -> ProblemSpec:
    """The problem as it comes back from a file.

    Raises
    ------
    InputError
        If a file could not say it.
    """
    try:
        return ProblemSpec.model_validate_json(spec.model_dump_json())
    except ValidationError as error:
        fault = error.errors()[0]
        where = ".".join(str(part) for part in fault["loc"])
        raise InputError(
            f"{what}: gives a motion that no problem file can say ({where}: {fault['msg']})."
        ) from None


def _with_points(spec: ProblemSpec, change: Point) -> ProblemSpec:
    """The problem with every position of a target or a wrap changed."""
    phases = (
        phase.model_copy(
            update={
                "targets": tuple(_moved(target, change) for target in phase.targets),
                "wrap": None if phase.wrap is None else _moved(phase.wrap, change),
            }
        )
        for phase in spec.phases
    )
    return spec.model_copy(update={"phases": tuple(phases)})


def _moved(section: Section, change: Point) -> Section:
    update: dict[str, Any] = {}
    for name in POINTS:
        if (point := getattr(section, name, None)) is not None:
            update[name] = _row(point, change)
    for name in CURVES:
        if (rows := getattr(section, name, None)) is not None:
            update[name] = tuple(_row(row, change) for row in rows)
    return section.model_copy(update=update)


def _row(row: Numbers, change: Point) -> Numbers:
    """A point, or a time and a point, with the point changed."""
    point = change(np.array(row[-3:])).tolist()
    # A file has no numbers as near to zero as the rounding of a difference may be.
    return (*row[:-3], *(value if abs(value) >= SMALLEST_NUMBER else 0.0 for value in point))


def _reflected(vector: np.ndarray) -> np.ndarray:
    return np.array([1.0, -1.0, 1.0]) * vector


def _cut(pair: tuple[float, float], most: float) -> tuple[float, float]:
    lower, upper = max(pair[0], -most), min(pair[1], most)
    return (lower, upper) if lower <= upper else (upper, upper)


def _slowed(phase: PhaseSpec, rate: float) -> PhaseSpec:
    """A phase with changes of activation up to `rate` times the duration of a step."""
    most = rate * (phase.duration / phase.steps)
    entries = (
        change
        if change.activation is None
        else change.model_copy(update={"activation": min(change.activation, most)})
        for change in phase.change
    )
    return phase.model_copy(update={"change": (ChangeSpec(activation=most), *entries)})


def _turned(target: TargetSpec) -> TargetSpec:
    """Directions of a target in the mirror: d2, of a right-handed frame, is reversed as well."""
    update = {}
    for name, sign in (("d1", 1.0), ("d2", -1.0), ("d3", 1.0)):
        wanted = getattr(target, name)
        if wanted is not None and not isinstance(wanted, HeldSpec):
            update[name] = tuple((sign * _reflected(np.array(wanted))).tolist())
    return target.model_copy(update=update)


def _other_loads(loads: LoadsSpec) -> LoadsSpec:
    """Loads in the mirror; couples, which have a sense of turning, are reversed as well."""
    update: dict[str, Any] = {
        name: tuple((sign * _reflected(np.array(getattr(loads, name)))).tolist())
        for name, sign in (("tip_force", 1.0), ("contact_force", 1.0), ("contact_couple", -1.0))
    }
    if loads.log is not None:
        update["log"] = loads.log.model_copy(update={"offset": -loads.log.offset})
    if loads.pull is not None and loads.pull.along == "d2":
        update["pull"] = loads.pull.model_copy(update={"force": -loads.pull.force})
    return loads.model_copy(update=update)


def _other_limits(limits: Limits, muscles: tuple[str, ...]) -> Limits:
    """Bounds in the mirror: of the muscles on the other side, psi_Z the other way."""
    pairs: dict[str, tuple[float, float]] = {}
    for pattern, pair in limits.muscles.items():
        for name in _other_names(pattern, muscles):
            pairs.pop(name, None)  # later ones override, and so come later
            pairs[name] = pair
    return _other_angle(limits.model_copy(update={"muscles": pairs}))


def named_muscles(spec: ProblemSpec, muscles: tuple[str, ...]) -> dict[str, np.ndarray]:
    """Indices of the muscles that each pattern of a problem's bounds names.

    Raises
    ------
    InputError
        If there are too many patterns for that many muscles.
    """
    limits = (spec.bounds, *(phase.bounds for phase in spec.phases))
    every = {pattern for part in limits for pattern in part.muscles}
    patterns = {pattern for pattern in every if set(pattern) & set("*?[")}
    if len(patterns) * len(muscles) > MOST_MATCHES:
        raise InputError(
            f"bounds.muscles: {len(patterns):,} different patterns in all phases for "
            f"{len(muscles):,} muscles; expected at most {MOST_MATCHES // len(muscles):,}. Give "
            "the muscles' names, or let a pattern stand for more of them."
        )
    places = {name: [i] for i, name in enumerate(muscles)}
    found = {name: places.get(name, []) for name in every - patterns}
    for pattern in patterns:
        found[pattern] = [i for i, name in enumerate(muscles) if fnmatch.fnmatchcase(name, pattern)]
    return {pattern: np.array(indices, dtype=int) for pattern, indices in found.items()}


def listed(muscles: tuple[str, ...]) -> str:
    """Names of muscles, as many as one reads."""
    more = f" and {len(muscles) - MOST_SHOWN:,} more" if len(muscles) > MOST_SHOWN else ""
    return ", ".join(muscles[:MOST_SHOWN]) + more


@lru_cache(maxsize=10_000)  # the same few patterns in every phase
def _other_names(pattern: str, muscles: tuple[str, ...]) -> list[str]:
    """Patterns for the partners of the muscles that a pattern names."""
    other = {"R": "L", "L": "R"}
    if pattern[:1] in other:
        return [other[pattern[0]] + pattern[1:]]
    named = [name for name in muscles if fnmatch.fnmatchcase(name, pattern)]
    partners = [other[name[0]] + name[1:] for name in named]
    return [pattern] if set(partners) == set(named) else partners


def _other_angle(section: Angles) -> Angles:
    if section.head_z_deg is None:
        return section
    low, high = section.head_z_deg
    return section.model_copy(update={"head_z_deg": (-high, -low)})

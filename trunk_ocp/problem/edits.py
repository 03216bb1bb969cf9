"""Edits of a problem from Python: new targets, loads and weights.

They edit the spec as the data of a file, so that values are checked, and faults worded, as those of
a file are. Phases, like everything in messages, count from 1.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any

from .._support.toml_files import validated
from .._support.wording import suggestion
from ..errors import InputError
from .load_specs import LoadsSpec
from .problem_file import ProblemSpec

Data = dict[str, Any]
"""A section of a file."""

PLACES = ("position", "path", "through", "center")
DIRECTIONS = ("d1", "d2", "d3")
TARGET_KEYS = (
    *("position", "path", "through", "position_weight"),
    *(key for direction in DIRECTIONS for key in (direction, f"{direction}_weight")),
)
WRAP_KEYS = ("center", "path", "through", "angles_deg", "position_weights", "d3_weights")
DEFAULT_BOUNDS = {"activation": (-2.0, 0.0), "extension": (0.67, 1.35)}
"""Of a motion built in Python; the extension is the paper's."""


def built_spec(
    name: str, anatomy: str, phases: Iterable[Mapping[str, Any]], sections: Mapping[str, Any]
) -> ProblemSpec:
    """The problem with these phases and other sections; see `Motion.build`."""
    named = [{"name": f"phase {number}", **phase} for number, phase in enumerate(phases, 1)]
    bounds = sections.get("bounds", {})
    bounds = {**DEFAULT_BOUNDS, **bounds} if isinstance(bounds, Mapping) else bounds
    data = {**sections, "name": name, "anatomy": anatomy, "phases": named, "bounds": bounds}
    return validated(data, ProblemSpec, "motion")


def retargeted_spec(
    spec: ProblemSpec, phase: str | int | None, Z: float | None, keys: Data
) -> ProblemSpec:
    """The problem with other values of a phase's targets, or of its wrap; see `Motion.retarget`."""
    data = spec.model_dump(mode="json")
    names = [section.name for section in spec.phases]
    if phase is None and len(names) > 1:
        raise InputError(f"phase: missing; expected one of {', '.join(names)}.")
    for number in _numbers(names, phase):
        for where, section in _targets(data["phases"][number], f"phases[{number + 1}]", Z, keys):
            _retarget(section, where, keys)
    return validated(data, ProblemSpec, "retarget")


def loaded_spec(
    spec: ProblemSpec, phase: str | int | None, gravity: float | None, keys: Data
) -> ProblemSpec:
    """The problem with other loads in a phase, or in all; see `Motion.with_loads`."""
    data = spec.model_dump(mode="json")
    if gravity is not None:
        data["gravity"] = gravity
    _check_keys(keys, tuple(LoadsSpec.model_fields), "loads")
    numbers = _numbers([section.name for section in spec.phases], phase)
    sections = [data["phases"][number]["loads"] for number in numbers]
    for key, value in keys.items():
        if not isinstance(value, Mapping):
            for loads in sections:
                loads[key] = value
            continue
        tables = [loads for loads in sections if loads[key] is not None]
        if not tables:
            raise InputError(f"loads.{key}: missing in the motion; expected a phase that has one.")
        for loads in tables:
            loads[key] = {**loads[key], **value}
    return validated(data, ProblemSpec, "with_loads")


def weighted_spec(spec: ProblemSpec, weights: Data) -> ProblemSpec:
    """The problem with other `[weights]`; see `Motion.weighted`."""
    data = spec.model_dump(mode="json")
    data["weights"] |= weights
    return validated(data, ProblemSpec, "weighted")


def _numbers(names: list[str], phase: str | int | None) -> list[int]:
    """Indices of the phases of a name, of the one of a number from 1, or of all."""
    if phase is None:
        return list(range(len(names)))
    if isinstance(phase, str):
        numbers = [number for number, name in enumerate(names) if name == phase]
    else:
        numbers = [phase - 1] if 1 <= phase <= len(names) else []
    if not numbers:
        hint = suggestion(phase, names) if isinstance(phase, str) else ""
        raise InputError(
            f"phase = {phase!r}: expected a number from 1 to {len(names)}, or one of "
            f"{', '.join(names)}.{hint}"
        )
    return numbers


def _targets(phase: Data, where: str, Z: float | None, keys: Data) -> list[tuple[str, Data]]:
    """The targets of a phase at Z, or its wrap, each after its place in the file."""
    targets = [(f"{where}.targets[{n}]", target) for n, target in enumerate(phase["targets"], 1)]
    wraps = phase["wrap"] is not None and (not targets or {*keys} & ({*WRAP_KEYS} - {*TARGET_KEYS}))
    if wraps and Z is None:
        _check_keys(keys, WRAP_KEYS, f"{where}.wrap")
        return [(f"{where}.wrap", phase["wrap"])]
    _check_keys(keys, TARGET_KEYS, f"{where}.targets")
    at = [target["Z"] for _, target in targets]
    chosen = [
        (place, target)
        for place, target in targets
        if Z is None or math.isclose(target["Z"], Z, rel_tol=1e-9, abs_tol=1e-9)
    ]
    if not chosen or (Z is None and len(chosen) > 1):
        known = f"one of {', '.join(f'{z:g}' for z in at)} m" if at else "none, for a wrap"
        stated = "missing" if Z is None else f"{Z:g} m"
        raise InputError(f"Z: {stated}; expected that of a target of {where}: {known}.")
    return chosen


def _check_keys(keys: Data, known: tuple[str, ...], where: str) -> None:
    for key in keys:
        if key not in known:
            hint = suggestion(key, known)
            raise InputError(f"{where}.{key}: unknown key; expected {', '.join(known)}.{hint}")


def _retarget(section: Data, where: str, keys: Data) -> None:
    """Replace values of a target or a wrap by others of the same kind."""
    for key, value in keys.items():
        present = [key]
        if key in PLACES:
            present = [place for place in PLACES if section.get(place) is not None]
        elif key in DIRECTIONS and section[key] is not None:
            present = [key] * (isinstance(section[key], dict) == isinstance(value, Mapping))
        elif key in DIRECTIONS:
            present = []
        if not present:
            raise InputError(
                f"{where}.{key}: the motion has none of this kind to replace; expected the kinds "
                "of targets to stay. Edit the spec and use with_spec, or build another motion."
            )
        section.update({**dict.fromkeys(present), key: value})

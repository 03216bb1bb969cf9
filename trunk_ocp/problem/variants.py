"""Variants of a problem: shifted, mirrored, with tighter bounds. Each edits the spec.

`Motion.with_spec` builds the variant's motion, so that it can be saved, shared and read back as
the same thing.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar

import numpy as np
from pydantic import ValidationError

from .._support.ranges import shown
from .._support.toml_files import SMALLEST_NUMBER
from ..errors import InputError
from ..model.solid_specs import CONTACT_KINDS, ContactSpec, ObstacleSpec
from .bound_specs import BoundsSpec, ChangeSpec, LimitsSpec
from .load_specs import LoadsSpec
from .muscle_patterns import mirrored_pattern
from .problem_file import PhaseSpec, ProblemSpec, StartSpec, WeightsSpec
from .target_specs import HeldSpec, TargetSpec, WrapSpec

Numbers = tuple[float, ...]
Point = Callable[[np.ndarray], np.ndarray]
Update = dict[str, Any]
"""Sections of a phase by their keys."""
Value = TypeVar("Value")
Section = TypeVar("Section", TargetSpec, WrapSpec)
Limits = TypeVar("Limits", LimitsSpec, BoundsSpec)
Angles = TypeVar("Angles", LimitsSpec, BoundsSpec, ChangeSpec)

POINTS, CURVES = ("position", "center"), ("path", "through")
"""Keys of one point, and of several; a row may have a time before its point."""
VECTORS = ("from", "to", "center", "point", "normal")
"""Keys of an obstacle that are points or directions."""
HEAD_ANGLES = ("head_z_deg", "head_y_deg")


def shifted_spec(spec: ProblemSpec, offset: Sequence[float]) -> ProblemSpec:
    """The problem with every target position moved by `offset` (3,) in m.

    Targets in the head's frame, such as those at the mouth, move by it in that frame.

    Raises
    ------
    InputError
        If the offset is not three finite numbers, or moves a target beyond the numbers that a
        problem file may have.
    """
    try:
        by = np.asarray(offset, dtype=float)
    except (TypeError, ValueError):
        by = np.zeros(0)
    if by.shape != (3,) or not np.all(np.isfinite(by)):
        raise InputError(f"offset = {offset!r}: expected three finite numbers in m.")
    return valid_spec(_with_points(spec, lambda point: point + by), f"offset = {by.tolist()}")


def limited_spec(
    spec: ProblemSpec, activation: float = math.inf, rate: float = math.inf
) -> ProblemSpec:
    """The problem with |gamma| up to `activation`, and its changes up to `rate` in 1/s.

    The limit may leave nothing of a pair of bounds that later ones override for all muscles. Such
    a pair becomes its upper bound, which no muscle has.
    """
    bounds = spec.bounds
    muscles = {pattern: _cut(pair, activation) for pattern, pair in bounds.muscles.items()}
    cut = {"activation": _cut(bounds.activation, activation), "muscles": muscles}
    bounds = bounds.model_copy(update=cut)
    edited = _edited(spec, lambda phase: _slower_change(phase, rate), bounds=bounds)
    return valid_spec(edited, f"activation = {activation:g}, rate = {rate:g}")


def slowed_spec(spec: ProblemSpec, factors: Mapping[int, float]) -> ProblemSpec:
    """The problem with phases (from 0) that take `factors` times as long; others are as they are.

    Durations are rounded to six digits, for those who read the file.

    Raises
    ------
    InputError
        If that makes a phase longer than a problem file may have.
    """
    phases = list(spec.phases)
    for n, factor in factors.items():
        phase = phases[n]
        duration = float(f"{phase.duration * factor:.6g}")
        update: Update = {"duration": duration}
        factor = duration / phase.duration
        if phase.wrap is not None:
            update["wrap"] = _slowed(phase.wrap, factor)
        update["targets"] = tuple(_slowed(target, factor) for target in phase.targets)
        phases[n] = phase.model_copy(update=update)
    edited = spec.model_copy(update={"phases": tuple(phases)})
    return valid_spec(edited, f"factors = {dict(factors)}")


def _slowed(section: Section, factor: float) -> Section:
    """A target or a wrap whose way points, if they have times, come later by a factor."""
    if section.through is None or len(section.through[0]) == 3:
        return section
    later = tuple((time * factor, *point) for time, *point in section.through)
    return section.model_copy(update={"through": later})


def silenced_spec(spec: ProblemSpec, muscles: Sequence[str]) -> ProblemSpec:
    """The problem with some muscles at rest all the time."""

    def silenced(limits: Limits) -> Limits:
        others = {name: pair for name, pair in limits.muscles.items() if name not in muscles}
        off = others | dict.fromkeys(muscles, (0.0, 0.0))  # last, so that they override patterns
        return limits.model_copy(update={"muscles": off})

    def edit(phase: PhaseSpec) -> Update:
        limited = phase.bounds.activation is not None or phase.bounds.muscles
        return {"bounds": silenced(phase.bounds)} if limited else {}

    resting = dict.fromkeys(muscles, 0.0) if spec.start.activation else {}
    start = spec.start.model_copy(update={"activation": spec.start.activation | resting})
    edited = _edited(spec, edit, bounds=silenced(spec.bounds), start=start)
    return valid_spec(edited, f"without {', '.join(muscles)}")


def refined_spec(
    spec: ProblemSpec, changes: Mapping[int, tuple[float, float, float]]
) -> ProblemSpec | None:
    """The problem with twice as many time steps in some phases, the new ones free.

    None if that is more than a problem file may have.

    Parameters
    ----------
    changes : dict
        For each of these phases (from 0) that has no free steps yet, the largest change of any
        activation, psi_Z and psi_Y (rad) from one time step with targets to the next. The phase's
        own bounds override it.
    """
    phases = list(spec.phases)
    for n, (activation, *head) in changes.items():
        phase, (z, y) = phases[n], np.degrees(head).tolist()
        update: dict[str, Any] = {"free_steps": 2 * phase.free_steps + 1}
        if not phase.free_steps:
            limit = ChangeSpec(activation=activation, head_z_deg=(-z, z), head_y_deg=(-y, y))
            update["change"] = (limit, *phase.change)
        phases[n] = phase.model_copy(update=update)
    try:
        return valid_spec(spec.model_copy(update={"phases": tuple(phases)}), "free_steps")
    except InputError:
        return None


def held_head_spec(spec: ProblemSpec, angle: int) -> ProblemSpec:
    """The problem with a head angle (0: psi_Z, 1: psi_Y) held at 0, free to change to it at once.

    Raises
    ------
    InputError
        If its bounds exclude 0.
    """
    key = HEAD_ANGLES[angle]

    def held(limits: Limits) -> Limits:
        low, high = getattr(limits, key) or (0.0, 0.0)
        if not low <= 0 <= high:
            raise InputError(f"{key} = [{low:g}, {high:g}]: does not allow 0.")
        return limits.model_copy(update={key: (0.0, 0.0)})

    def edit(phase: PhaseSpec) -> Update:
        change = tuple(entry.model_copy(update={key: None}) for entry in phase.change)
        return {"bounds": held(phase.bounds), "change": change}

    return valid_spec(_edited(spec, edit, bounds=held(spec.bounds)), f"{key} = 0")


def contact_spec(spec: ProblemSpec, kinds: str) -> ProblemSpec:
    """The problem with "all", "none" or some kinds of contact, separated by commas.

    Raises
    ------
    InputError
        If it is none of these.
    """
    words = [word.strip() for word in kinds.split(",")]
    words = {"all": list(CONTACT_KINDS), "none": []}.get(kinds.strip(), words)
    if not set(words) <= set(CONTACT_KINDS):
        raise InputError(
            f"contact = {shown(kinds, repr)}: expected all, none, or some of "
            f"{', '.join(CONTACT_KINDS)}, separated by commas."
        )
    contact = ContactSpec(**dict.fromkeys(words, True))
    return spec.model_copy(update={"contact": contact})


def unaided_spec(spec: ProblemSpec) -> ProblemSpec:
    """The problem without auxiliary problems."""
    return _edited(spec, lambda _: {"auxiliary": None})


def mirrored_spec(spec: ProblemSpec, muscles: tuple[str, ...]) -> ProblemSpec:
    """The problem mirrored in the plane Y = 0; `muscles` are the names of the trunk's."""

    def edit(phase: PhaseSpec) -> Update:
        return {
            "targets": tuple(_mirrored_target(target) for target in phase.targets),
            "loads": _mirrored_loads(phase.loads),
            "bounds": _mirrored_limits(phase.bounds, muscles),
            "change": tuple(_mirrored_angle(change) for change in phase.change),
        }

    moved = _with_points(spec, _reflected)
    bounds = _mirrored_limits(spec.bounds, muscles)
    obstacles = tuple(_mirrored_obstacle(obstacle) for obstacle in spec.obstacles)
    start, weights = _mirrored_start(spec.start, muscles), _mirrored_weights(spec.weights, muscles)
    image = _edited(moved, edit, bounds=bounds, start=start, obstacles=obstacles, weights=weights)
    return valid_spec(image, "mirror")


def valid_spec(spec: ProblemSpec, variant: str) -> ProblemSpec:
    """The problem as it is read back from a file.

    Raises
    ------
    InputError
        If no problem file could have it.
    """
    try:
        read = ProblemSpec.model_validate_json(spec.model_dump_json())
    except ValidationError as error:
        fault = error.errors()[0]
        key = ".".join(str(part) for part in fault["loc"])
        raise InputError(
            f"{variant}: gives a motion that no problem file can have ({key}: {fault['msg']})."
        ) from None
    if read.model_dump(mode="json") != spec.model_dump(mode="json"):  # JSON has no inf and nan
        raise InputError(f"{variant}: gives a motion that no problem file can have.")
    return read


def _with_points(spec: ProblemSpec, change: Point) -> ProblemSpec:
    """The problem with every position of a target or a wrap changed."""

    def edit(phase: PhaseSpec) -> Update:
        targets = tuple(_moved(target, change) for target in phase.targets)
        return {"targets": targets, "wrap": phase.wrap and _moved(phase.wrap, change)}

    return _edited(spec, edit)


def _edited(spec: ProblemSpec, edit: Callable[[PhaseSpec], Update], **update: Any) -> ProblemSpec:
    """The problem with the sections of each phase that `edit` returns, and others of its own."""
    phases = tuple(phase.model_copy(update=edit(phase)) for phase in spec.phases)
    return spec.model_copy(update={"phases": phases, **update})


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
    # Rounding may leave a difference closer to zero than the numbers that a file may have.
    return (*row[:-3], *(value if abs(value) >= SMALLEST_NUMBER else 0.0 for value in point))


def _reflected(vector: np.ndarray) -> np.ndarray:
    return np.array([1.0, -1.0, 1.0]) * vector


def _cut(pair: tuple[float, float], largest: float) -> tuple[float, float]:
    lower, upper = max(pair[0], -largest), min(pair[1], largest)
    return (lower, upper) if lower <= upper else (upper, upper)


def _slower_change(phase: PhaseSpec, rate: float) -> Update:
    """The phase's changes of activation, up to `rate` times the duration of a step."""
    if rate == math.inf:
        return {}
    largest = rate * (phase.duration / phase.steps)
    entries = (
        change
        if change.activation is None
        else change.model_copy(update={"activation": min(change.activation, largest)})
        for change in phase.change
    )
    limit = ChangeSpec.model_construct(activation=largest)  # checked with the whole problem
    return {"change": (limit, *entries)}


def _mirrored_target(target: TargetSpec) -> TargetSpec:
    """A target with mirrored directions.

    The mirror image of a right-handed frame is left-handed; reversing d2 makes it right-handed.
    """
    update = {}
    for name, sign in (("d1", 1.0), ("d2", -1.0), ("d3", 1.0)):
        direction = getattr(target, name)
        if direction is not None and not isinstance(direction, HeldSpec):
            update[name] = tuple((sign * _reflected(np.array(direction))).tolist())
    return target.model_copy(update=update)


def _mirrored_loads(loads: LoadsSpec) -> LoadsSpec:
    """Loads in the mirror; couples, being axial vectors, are reversed as well."""
    update: dict[str, Any] = {
        name: tuple((sign * _reflected(np.array(getattr(loads, name)))).tolist())
        for name, sign in (("tip_force", 1.0), ("contact_force", 1.0), ("contact_couple", -1.0))
    }
    if loads.log is not None:
        update["log"] = loads.log.model_copy(update={"offset": -loads.log.offset})
    if loads.pull is not None and loads.pull.along == "d2":
        update["pull"] = loads.pull.model_copy(update={"force": -loads.pull.force})
    return loads.model_copy(update=update)


def _mirrored_obstacle(obstacle: ObstacleSpec) -> ObstacleSpec:
    """An obstacle in the mirror; angles about e_X and e_Z are reversed, as of axial vectors."""
    update = {
        key: tuple(_reflected(np.array(vector)).tolist())
        for key in VECTORS
        if (vector := getattr(obstacle, key)) is not None
    }
    x, y, z = obstacle.rotation_deg
    return obstacle.model_copy(update=update | {"rotation_deg": (-x, y, -z)})


def _mirrored_limits(limits: Limits, muscles: tuple[str, ...]) -> Limits:
    """Bounds in the mirror: those of the muscles on the other side, and psi_Z reversed."""
    pairs = _mirrored_table(limits.muscles, muscles)
    return _mirrored_angle(limits.model_copy(update={"muscles": pairs}))


def _mirrored_start(start: StartSpec, muscles: tuple[str, ...]) -> StartSpec:
    """A start in the mirror: activations of the muscles on the other side, and psi_Z reversed."""
    activation = _mirrored_table(start.activation, muscles)
    return start.model_copy(update={"activation": activation, "head_z_deg": 0.0 - start.head_z_deg})


def _mirrored_weights(weights: WeightsSpec, muscles: tuple[str, ...]) -> WeightsSpec:
    """Weights in the mirror: the efforts of the muscles on the other side."""
    if not isinstance(weights.effort, dict):
        return weights
    return weights.model_copy(update={"effort": _mirrored_table(weights.effort, muscles)})


def _mirrored_table(table: Mapping[str, Value], muscles: tuple[str, ...]) -> dict[str, Value]:
    """Values by patterns of muscles, for the muscles on the other side."""
    image: dict[str, Value] = {}
    for pattern, value in table.items():
        for name in mirrored_pattern(pattern, muscles):
            image.pop(name, None)  # keep the order, because later entries override
            image[name] = value
    return image


def _mirrored_angle(section: Angles) -> Angles:
    if section.head_z_deg is None:
        return section
    low, high = section.head_z_deg
    return section.model_copy(update={"head_z_deg": (-high, -low)})

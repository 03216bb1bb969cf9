"""What a person changes on the live page: places of targets, bounds of muscles, their speed.

A place that a motion comes back to is one place: the fruit that is reached, pulled and held, the
log that is wrapped around before it is lifted. `joints_of` finds such places; moving one moves all
sections of the problem that begin or end there, and a path between two follows both ends.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from .._support.toml_files import SMALLEST_NUMBER, validated
from ..errors import InputError
from ..problem.motion import Motion, Step
from ..problem.problem_file import ProblemSpec
from ..problem.target_specs import TargetSpec, WrapSpec
from ..problem.targets import way_points

SAME = 1e-9  # m; places closer than this are one
SOURCE = re.compile(r"phases\[(\d+)\]\.(?:targets\[(\d+)\]|wrap)")
LOG = "log"
Point = tuple[float, ...]
Part = tuple[int, int | None]
"""A section with a place: number of its phase, and of its target or None for the wrap (from 0)."""


@dataclass(frozen=True)
class Ends:
    """The joints at which a section begins and ends; equal if its place does not move."""

    first: int
    last: int


@dataclass(frozen=True, eq=False)
class Handle:
    """A point that can be dragged, at one time step.

    Attributes
    ----------
    name : str
        "STEP:TARGET", numbers from 0; or "STEP:log" for the middle of a log.
    position : (3,)
        In m.
    first, last : float
        When it is asked, in s.
    radius : float
        Of a log, in m; 0 for a target.
    """

    name: str
    position: np.ndarray
    first: float
    last: float
    radius: float = 0.0


@dataclass(frozen=True, eq=False)
class Edits:
    """All changes so far: offsets (3,) in m by joint, bounds by muscle pattern, a rate in 1/s."""

    offsets: Mapping[int, np.ndarray] = field(default_factory=dict)
    bounds: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    rate: float | None = None

    def moved(self, joints: set[int], by: np.ndarray) -> Edits:
        """The changes with joints moved on by `by` (3,) in m."""
        new = {joint: self.offsets.get(joint, np.zeros(3)) + by for joint in joints}
        return replace(self, offsets={**self.offsets, **new})

    def bounded(self, muscles: str, lower: float, upper: float) -> Edits:
        """The changes with other bounds of some muscles, by name or pattern."""
        others = {name: pair for name, pair in self.bounds.items() if name != muscles}
        return replace(self, bounds={**others, muscles: (lower, upper)})

    def limited(self, rate: float | None) -> Edits:
        """The changes with another largest rate of activations in 1/s; None: as the file says."""
        return replace(self, rate=rate)


class EditableMotion:
    """A motion, and its variants by `Edits`.

    Each variant is made from the motion itself, so that many small moves do not add up rounding.
    """

    def __init__(self, motion: Motion) -> None:
        self.motion = motion
        self._ends = joints_of(motion.spec)

    def edited(self, edits: Edits) -> Motion:
        """The motion with changes.

        Raises
        ------
        InputError
            If no problem file could have them.
        """
        data = self.motion.spec.model_dump(mode="json")
        for part, ends in self._ends.items():
            zero = np.zeros(3)
            first, last = (edits.offsets.get(joint, zero) for joint in (ends.first, ends.last))
            if first.any() or last.any():
                _move(data["phases"][part[0]], part, first, last)
        muscles = data["bounds"]["muscles"]
        for pattern, pair in edits.bounds.items():
            muscles.pop(pattern, None)  # later ones override earlier ones
            muscles[pattern] = list(pair)
        motion = self.motion.with_spec(validated(data, ProblemSpec, "live"))
        return motion if edits.rate is None else motion.limited(rate=edits.rate)

    def handles(self, motion: Motion) -> list[Handle]:
        """What can be dragged of a variant: targets and logs at a place fixed in space."""
        return [
            Handle(name, place, step.time - step.duration, step.time, _radius(name, step))
            for number, step in enumerate(motion.steps)
            for name, place, part in _places(number, step)
            if part in self._ends
        ]

    def dragged(self, motion: Motion, edits: Edits, name: str, position: Point) -> Edits:
        """The changes that put a handle of the variant `motion` at a position (3,) in m.

        The end of a path moves alone, and what begins there; any other point of it takes the whole
        path along.

        Raises
        ------
        InputError
            If there is no such handle.
        """
        number, _, _ = name.partition(":")
        steps = {str(number): step for number, step in enumerate(motion.steps)}
        at = _places(int(number), steps[number]) if number in steps else iter(())
        for known, place, part in at:
            if known == name and part in self._ends:
                ends = self._ends[part]
                joints = {ends.last}
                if not _is_last(motion, int(number)):
                    joints.add(ends.first)
                return edits.moved(joints, np.asarray(position) - place)
        raise InputError(f"name = {name[:40]!r}: expected the name of a target on the page.")


def joints_of(spec: ProblemSpec) -> dict[Part, Ends]:
    """The joints of all sections whose place is fixed in space; places are one if they coincide."""
    known: list[tuple[Any, np.ndarray]] = []

    def joint(kind: Any, point: np.ndarray) -> int:
        for number, (other, place) in enumerate(known):
            if other == kind and np.abs(place - point).max() < SAME:
                return number
        known.append((kind, point))
        return len(known) - 1

    ends = {}
    for number, phase in enumerate(spec.phases):
        sections: list[tuple[int | None, TargetSpec | WrapSpec]] = [*enumerate(phase.targets)]
        sections += [(None, phase.wrap)] if phase.wrap else []
        for n, section in sections:
            points = _points(section)
            if len(points) and not _turns(section):
                line = (
                    section.Z if n is not None else ("wrap", phase.wrap and phase.wrap.log_radius)
                )
                first, last = (joint((line, section.origin), points[i]) for i in (0, -1))
                ends[number, n] = Ends(first, last)
    return ends


def _points(section: TargetSpec | WrapSpec) -> np.ndarray:
    """Points (n, 3) in m that give a section's place; (0, 3) if it has none."""
    rows = section.path or section.through
    fixed = section.center if isinstance(section, WrapSpec) else section.position
    rows = rows or (fixed and (fixed,)) or ()
    return np.array([row[-3:] for row in rows], dtype=float).reshape(-1, 3)


def _turns(section: TargetSpec | WrapSpec) -> bool:
    """Whether a section's place turns with the head, so that nothing on the page can drag it."""
    return isinstance(section, TargetSpec) and (
        section.frame == "head" or section.origin == "mouth"
    )


def _places(number: int, step: Step) -> Iterator[tuple[str, np.ndarray, Part]]:
    """Name, position (3,) in m and section of the places of a time step."""
    wrap = None
    for n, target in enumerate(step.targets):
        match = SOURCE.fullmatch(target.source)
        if match and target.position is not None and target.position_weight > 0:
            part = (int(match[1]) - 1, int(match[2]) - 1 if match[2] else None)
            wrap = part if part[1] is None else wrap
            yield f"{number}:{n}", np.asarray(target.position), part
    if wrap is not None and step.log is not None and step.log.center is not None:
        yield f"{number}:{LOG}", np.asarray(step.log.center), wrap


def _radius(name: str, step: Step) -> float:
    return step.log.radius if step.log is not None and name.endswith(LOG) else 0.0


def _is_last(motion: Motion, number: int) -> bool:
    """Whether a time step (from 0) is the last of its phase."""
    steps = motion.steps
    return number + 1 == len(steps) or steps[number + 1].phase != steps[number].phase


def _move(phase: dict[str, Any], part: Part, first: np.ndarray, last: np.ndarray) -> None:
    """Move a section by offsets (3,) of its ends, in the data of its phase.

    Both curves of a problem file follow exactly: what is linear in time stays so in them.
    """
    section = phase["wrap"] if part[1] is None else phase["targets"][part[1]]
    for key in ("position", "center"):
        if section.get(key) is not None:
            section[key] = _sum(section[key], last)
    for key in ("path", "through"):
        if section.get(key) is not None:
            rows = section[key]
            shares = np.linspace(0, 1, len(rows))
            if key == "through":
                times, _ = way_points(rows, phase["duration"], phase["steps"])
                shares = (times - times[0]) / (times[-1] - times[0])
            section[key] = [
                [*row[:-3], *_sum(row[-3:], (1 - share) * first + share * last)]
                for row, share in zip(rows, shares.tolist(), strict=True)
            ]


def _sum(point: Any, offset: np.ndarray) -> list[float]:
    total = (np.asarray(point, dtype=float) + offset).tolist()
    # Rounding may leave a difference closer to zero than the numbers that a file may have.
    return [value if abs(value) >= SMALLEST_NUMBER else 0.0 for value in total]

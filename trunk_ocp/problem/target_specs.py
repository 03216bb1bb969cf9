"""Targets in a problem file: points and directions, curves followed over a phase, wraps."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Literal

from annotated_types import MaxLen, MinLen
from pydantic import Field, PositiveInt, model_validator

from .._support.toml_files import NonNegative, Number, Pair, Positive, Strict, Vec3

Origin = Literal["base", "passive-tip"]
TargetOrigin = Literal["base", "passive-tip", "mouth"]
Frame = Literal["space", "head"]

MAX_POINTS = 100
"""Most points of a wrap, and targets of a phase."""
MAX_CONTROL_POINTS = 50
"""Most control points of a Bezier curve; more would exceed double precision."""
MAX_WAY_POINTS = 1000
"""Most way points of a curve."""
ROUND_OFF = 1e-9
"""Share of a phase by which its last way point may be late; way points are further apart."""

STEP = "an earlier time step, counted from 1"


class HeldSpec(Strict):
    """A direction taken from the motion itself: the one reached at an earlier time step."""

    held_from_step: PositiveInt = Field(description=STEP)


WayPoint = Annotated[tuple[Number, ...], MinLen(3), MaxLen(4)]
"""[x, y, z] in m, or [t, x, y, z] with t in s from the start of the phase."""
WayPoints = Annotated[tuple[WayPoint, ...], MinLen(2), MaxLen(MAX_WAY_POINTS)]
ControlPoints = Annotated[tuple[Vec3, ...], MinLen(2), MaxLen(MAX_CONTROL_POINTS)]

# Descriptions that several keys share. The types above hold no Field: before pydantic 2.11.5 the
# default of one key became that of every key with the same Field.
THROUGH = (
    "way points on a smooth curve followed over the phase: rows [t, x, y, z] with t in s from the "
    "start of the phase, or [x, y, z] at equal time intervals"
)
PATH = (
    "Bezier control points, m; the curve is followed over the phase (eq. 53) and passes through "
    "the first and last point only"
)
ORIGIN = "what positions are measured from"
WEIGHT = "weight of this error in the objective"
DIRECTION = "wanted direction of a director"


def _check_rows(rows: tuple[WayPoint, ...]) -> None:
    """Raise ValueError unless all way points have a time or none has, and times increase."""
    if len({len(row) for row in rows}) > 1:
        raise ValueError("through: expected rows all [x, y, z] or all [t, x, y, z], not both")
    if len(rows[0]) == 3:
        return
    for number, (one, two) in enumerate(pairwise(rows), 2):
        if not one[0] < two[0]:
            raise ValueError(
                f"through[{number}] is at t = {two[0]:g} s, the row before at {one[0]:g} s; "
                "expected times that increase"
            )
    if rows[0][0] < 0:
        raise ValueError(
            f"through[1] is at t = {rows[0][0]:g} s; expected 0 or later, from the phase's start"
        )


def check_times(times: list[float], duration: float) -> None:
    """Raise ValueError unless times (s) of way points are within a phase and far enough apart."""
    if times[-1] > duration * (1 + ROUND_OFF):
        raise ValueError(
            f"through ends at t = {times[-1]:g} s, the phase at {duration:g} s; "
            "expected times in s from the phase's start, within its duration"
        )
    least = 2 * ROUND_OFF * duration  # so that at most one of them is beyond the phase's end
    for number, (one, two) in enumerate(pairwise(times), 2):
        if two - one < least:
            raise ValueError(
                f"through[{number}] is at t = {two:.12g} s, {two - one:.3g} s after the row before "
                f"it; expected at least {least:.3g} s between two way points. Remove one of them"
            )


class TargetSpec(Strict):
    """Desired position and directions of one point of the trunk (eq. 41)."""

    Z: NonNegative = Field(description="point of the trunk, m from the base")
    position: Vec3 | None = Field(default=None, description="wanted position of the point, m")
    path: ControlPoints | None = Field(default=None, description=PATH)
    through: WayPoints | None = Field(default=None, description=THROUGH)
    origin: TargetOrigin = Field(
        default="base", description=f'{ORIGIN}; "mouth" implies frame = "head"'
    )
    frame: Frame = Field(
        default="space",
        description='"head": position and directions are those at head angles 0, and turn with '
        "the head; directions held from a step stay fixed in space",
    )
    position_weight: NonNegative = Field(default=1.0, description=WEIGHT)
    d1: Vec3 | HeldSpec | None = Field(default=None, description=DIRECTION)
    d2: Vec3 | HeldSpec | None = Field(default=None, description=DIRECTION)
    d3: Vec3 | HeldSpec | None = Field(default=None, description=DIRECTION)
    d1_weight: NonNegative = Field(default=1.0, description=WEIGHT)
    d2_weight: NonNegative = Field(default=1.0, description=WEIGHT)
    d3_weight: NonNegative = Field(default=1.0, description=WEIGHT)

    @model_validator(mode="after")
    def _consistent(self) -> TargetSpec:
        places = [n for n in ("position", "path", "through") if getattr(self, n) is not None]
        if len(places) > 1:
            raise ValueError(f"a target takes {places[0]} or {places[1]}, not both")
        if not places and all(v is None for v in (self.d1, self.d2, self.d3)):
            raise ValueError("a target needs a position, a path, through or a direction d1, d2, d3")
        if self.through is not None:
            _check_rows(self.through)
        for name in ("d1", "d2", "d3"):
            if getattr(self, name) == (0.0, 0.0, 0.0):
                raise ValueError(f"{name} must not be the zero vector")
        return self


class WrapSpec(Strict):
    """Wrap around a log whose axis is e_Y (eqs. 46-52)."""

    Z: Pair = Field(description="first and last point of the trunk on the log, m")
    points: int = Field(
        default=6, ge=2, le=MAX_POINTS, description="number of target points on the log"
    )
    log_radius: Positive = Field(description="radius of the log, m")
    angles_deg: Pair = Field(description="angles of both ends on the log, from e_Z about e_Y")
    center: Vec3 | None = Field(default=None, description="center of the log, m")
    path: ControlPoints | None = Field(default=None, description=PATH)
    through: WayPoints | None = Field(default=None, description=THROUGH)
    origin: Origin = Field(default="base", description=ORIGIN)
    position_weights: tuple[NonNegative, ...] = Field(
        description="weight of the position error at each point"
    )
    d3_weights: tuple[NonNegative, ...] = Field(
        description="weight of the tangent error at each point"
    )

    @model_validator(mode="after")
    def _consistent(self) -> WrapSpec:
        if sum(v is not None for v in (self.center, self.path, self.through)) != 1:
            raise ValueError("a wrap has either a center or a path of the center, or through")
        if self.through is not None:
            _check_rows(self.through)
        if not self.Z[0] < self.Z[1]:
            raise ValueError(f"Z must increase, it is [{self.Z[0]:g}, {self.Z[1]:g}]")
        for name in ("position_weights", "d3_weights"):
            count = len(getattr(self, name))
            if count != self.points:
                raise ValueError(f"{name} must have one entry for each of {self.points} points")
        return self

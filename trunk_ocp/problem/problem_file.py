"""The format of a problem file.

Angles are in degrees and say so in their names; everything else is SI, in space axes, with
+Z pointing down. `build.py` turns a validated file into a motion; the JSON Schema for
editors is generated from these classes.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Any, Literal

from annotated_types import MaxLen, MinLen
from pydantic import Field, PositiveInt, model_validator

from .._support.toml_files import NonNegative, Number, Pair, Positive, Strict, Text, Vec3
from ..model.solid_specs import MAX_SOLIDS, ContactSpec, ObstacleSpec

Interpolation = Literal["cosine", "hermite", "none"]
Origin = Literal["base", "passive-tip"]
TargetOrigin = Literal["base", "passive-tip", "mouth"]
Frame = Literal["space", "head"]

MAX_STEPS = 1000
"""Most steps of a motion; as one NLP, more would take minutes and gigabytes."""
MAX_FREE_STEPS = 31
"""Most additional time steps before each time step of a phase."""
MAX_POINTS = 100
"""Most points of a wrap, and targets of a phase."""
MAX_CONTROL_POINTS = 50
"""Most control points of a Bezier curve; more would exceed double precision."""
MAX_WAY_POINTS = 1000
"""Most way points of a curve."""
MAX_ENTRIES = 1000
"""Most entries of any other list."""
DEFAULT_EFFORT, DEFAULT_RATE = 1e-5, 1e-5
"""Weights that a file leaves out."""
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
HEAD_Z = "bounds of the head angle psi_Z, degrees"
HEAD_Y = "bounds of the head angle psi_Y, degrees"


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


def _check_times(times: list[float], duration: float) -> None:
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


class PullSpec(Strict):
    """A tip force along a director that an earlier step reached (eq. 44)."""

    force: Number = Field(description="force at the last step of the phase, N")
    along: Literal["d1", "d2", "d3"] = Field(
        default="d3", description="director that gives the direction"
    )
    held_from_step: PositiveInt = Field(description=STEP)
    ramp: bool = Field(
        default=True, description="whether the force grows in equal steps over the phase"
    )


class LogSpec(Strict):
    """A cylinder that the trunk carries (eqs. 12, 13, 54)."""

    contact_from: NonNegative = Field(description="Z_w, where contact starts, m")
    radius: Positive = Field(description="m")
    length: Positive = Field(description="m")
    density: Positive = Field(description="kg/m^3")
    offset: Number = Field(
        default=0.0, description="distance from the log's middle to the grip, along e_Y, m"
    )
    hung: bool = Field(
        default=False,
        description="whether the offset turns with the trunk, along -d2, so that the weight has a "
        "potential; otherwise it makes a couple fixed in space (eq. 54)",
    )


class JumpSpec(Strict):
    """Which loads change abruptly at the start of their phase; others are interpolated in time.

    Right after the start, a load that jumps has the value of the phase (a ramped pull: zero), and
    that of the previous phase is gone.
    """

    tip_force: bool = Field(default=False, description="whether tip_force jumps")
    tip_mass: bool = Field(default=True, description="whether tip_mass jumps")
    pull: bool = Field(default=True, description="whether pull jumps")
    contact: bool = Field(
        default=False, description="whether the log, or contact_force and contact_couple, jump"
    )


class LoadsSpec(Strict):
    """Loads besides the trunk's own weight, during one phase."""

    tip_force: Vec3 = Field(default=(0.0, 0.0, 0.0), description="force at the tip, N")
    tip_mass: NonNegative = Field(default=0.0, description="mass carried at the tip, kg")
    pull: PullSpec | None = Field(default=None, description="pull at the tip (eq. 44)")
    contact_from: NonNegative | None = Field(
        default=None, description="Z_w, where contact loads start, m"
    )
    contact_force: Vec3 = Field(
        default=(0.0, 0.0, 0.0), description="total force spread from contact_from to the tip, N"
    )
    contact_couple: Vec3 = Field(
        default=(0.0, 0.0, 0.0), description="total couple spread from contact_from to the tip, N m"
    )
    log: LogSpec | None = Field(default=None, description="log that the trunk carries")
    jump: JumpSpec = Field(
        default=JumpSpec(), description="which loads change abruptly at the start of the phase"
    )

    @model_validator(mode="after")
    def _consistent(self) -> LoadsSpec:
        contact = any((*self.contact_force, *self.contact_couple))
        if self.log is not None and (contact or self.contact_from is not None):
            raise ValueError("give either a log or contact_from, contact_force, contact_couple")
        if contact and self.contact_from is None:
            raise ValueError("contact_force and contact_couple need contact_from")
        return self


class LimitsSpec(Strict):
    """Bounds of one phase; those left out are as in the motion's [bounds]."""

    activation: Pair | None = Field(
        default=None, description="bounds of all activations; negative contracts"
    )
    muscles: dict[str, Pair] = Field(
        default_factory=dict,
        description="bounds of muscles by name or pattern (R1-dl, *3-dl, L*); later ones "
        "override earlier ones",
        max_length=MAX_ENTRIES,
    )
    head_z_deg: Pair | None = Field(default=None, description=HEAD_Z)
    head_y_deg: Pair | None = Field(default=None, description=HEAD_Y)

    @model_validator(mode="after")
    def _ordered(self) -> LimitsSpec:
        pairs = {name: getattr(self, name) for name in ("activation", "head_z_deg", "head_y_deg")}
        pairs |= {f'muscles."{name}"': pair for name, pair in self.muscles.items()}
        for name, pair in pairs.items():
            if pair is not None and not pair[0] <= pair[1]:
                raise ValueError(
                    f"{name} = [{pair[0]:g}, {pair[1]:g}]: the lower bound is above the upper"
                )
        return self


class BoundsSpec(LimitsSpec):
    """Bounds of the whole motion."""

    activation: Pair = Field(description="bounds of all activations; negative contracts")
    extension: Pair = Field(
        description="bounds of the extension of the unloaded, activated trunk (eq. 42)"
    )

    @model_validator(mode="after")
    def _extension(self) -> BoundsSpec:
        low, high = self.extension
        if not 0 < low <= high:
            raise ValueError(f"extension = [{low:g}, {high:g}]: expected 0 < lower <= upper")
        return self


class StartSpec(Strict):
    """Where the motion starts: activations and head angles at time 0, instead of rest.

    The first step's bounds on change and the cost of rates count from there. At time 0 the trunk
    carries its weight alone, as at rest.
    """

    activation: dict[str, Number] = Field(
        default_factory=dict,
        description="activations of muscles by name or pattern (R1-dl, *3-dl, L*); later ones "
        "override earlier ones, and those left out are 0",
    )
    head_z_deg: Number = Field(default=0.0, description="head angle psi_Z, degrees")
    head_y_deg: Number = Field(default=0.0, description="head angle psi_Y, degrees")


class ChangeSpec(Strict):
    """Bounds on the change from one time step to the next (appendix B)."""

    steps: tuple[PositiveInt, PositiveInt] | None = Field(
        default=None,
        description="first and last step of the phase that they apply to; default: all",
    )
    activation: NonNegative | None = Field(
        default=None, description="largest change of any activation per step"
    )
    head_z_deg: Pair | None = Field(
        default=None, description="bounds of the change of psi_Z per step, degrees"
    )
    head_y_deg: Pair | None = Field(
        default=None, description="bounds of the change of psi_Y per step, degrees"
    )

    @model_validator(mode="after")
    def _ordered(self) -> ChangeSpec:
        for name in ("head_z_deg", "head_y_deg"):
            pair = getattr(self, name)
            if pair is not None and not pair[0] <= pair[1]:
                raise ValueError(
                    f"{name} = [{pair[0]:g}, {pair[1]:g}]: the lower bound is above the upper"
                )
        return self


class AuxiliarySpec(Strict):
    """In sequential mode, first solve each step without loads (appendix B).

    The unloaded optimum is the initial guess of the loaded one, which must stay near it if a
    deviation is given.
    """

    activation_deviation: NonNegative | None = Field(
        default=None, description="largest deviation of any activation from it"
    )
    head_deviation_deg: NonNegative | None = Field(
        default=None, description="largest deviation of the head angles from it"
    )


class PhaseSpec(Strict):
    """A part of the motion with its own targets, loads and bounds."""

    name: Text = Field(description="name for tables and messages")
    duration: Positive = Field(description="s")
    steps: PositiveInt = Field(
        default=1, le=MAX_STEPS, description="time steps, at equal intervals"
    )
    free_steps: int = Field(
        default=0,
        ge=0,
        le=MAX_FREE_STEPS,
        description="additional time steps without targets before each time step, at equal "
        "intervals: shapes on the way that the plan chooses freely, to get around bodies. Bounds "
        "on change are divided among them, and cosine interpolation becomes hermite",
    )
    interpolation: Interpolation = Field(
        default="cosine", description="of activations and head angles between time steps"
    )
    targets: tuple[TargetSpec, ...] = Field(
        default=(), max_length=MAX_POINTS, description="targets at each time step of the phase"
    )
    wrap: WrapSpec | None = Field(default=None, description="targets around a log")
    loads: LoadsSpec = Field(default=LoadsSpec(), description="loads during the phase")
    bounds: LimitsSpec = Field(default=LimitsSpec(), description="bounds during the phase")
    change: tuple[ChangeSpec, ...] = Field(
        default=(), max_length=MAX_ENTRIES, description="bounds on the change per time step"
    )
    auxiliary: AuxiliarySpec | None = Field(
        default=None, description="unloaded solve before each sequential step"
    )

    @model_validator(mode="after")
    def _consistent(self) -> PhaseSpec:
        if not self.targets and self.wrap is None:
            raise ValueError("a phase needs targets or a wrap")
        for place in (*self.targets, self.wrap):
            if place is not None and place.through and len(place.through[0]) == 4:
                _check_times([row[0] for row in place.through], self.duration)
        for change in self.change:
            first, last = change.steps or (1, self.steps)
            if not first <= last <= self.steps:
                raise ValueError(
                    f"change.steps = [{first}, {last}]: this phase has steps 1 to {self.steps}"
                )
        return self


class ToleranceSpec(Strict):
    """When a target counts as reached; a motion that misses a target is not solved."""

    position: Positive | None = Field(
        default=None,
        description="largest position error, m; default: 0.02 for a trunk of 1.75 m, in "
        "proportion for others",
    )
    direction: Positive = Field(
        default=0.05, description="largest length of the difference of directors"
    )


class WeightsSpec(Strict):
    """Costs of a plan beside its distance to targets; options of the command line override them."""

    effort: NonNegative | Annotated[dict[str, NonNegative], MaxLen(MAX_ENTRIES)] = Field(
        default=DEFAULT_EFFORT,
        description="of the squared activations, at each time step with targets; or a table of "
        'muscles by name or pattern, { "*" = 1e-5, "*1-dl" = 1e-4 }, in which later ones override '
        "earlier ones",
    )
    rate: NonNegative = Field(
        default=DEFAULT_RATE,
        description="of the squared rates of activations and head angles, 1/s and rad/s, "
        "integrated over time",
    )
    head_effort: NonNegative = Field(
        default=0.0,
        description="of the squared head angles, rad^2, at each time step with targets",
    )
    terminal: Positive = Field(
        default=1.0, description="factor of the weights of all targets of the last time step"
    )
    symmetric: bool = Field(
        default=False,
        description="of a motion that is its own mirror image: both sides contract alike, and "
        "psi_Z is 0",
    )


class ProblemSpec(Strict):
    """A problem file."""

    name: str = Field(
        pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$",
        max_length=100,
        description="short name, also of the folder of results",
    )
    title: Text = Field(default="", description="title for tables and figures")
    anatomy: Text = Field(
        default="asian-elephant",
        description="shipped name, or path of an anatomy file relative to this file",
    )
    gravity: Number = Field(default=9.8, description="m/s^2, along +Z (down)")
    bounds: BoundsSpec = Field(description="bounds during the whole motion")
    start: StartSpec = Field(
        default=StartSpec(), description="where the motion starts, instead of rest"
    )
    tolerance: ToleranceSpec = Field(
        default=ToleranceSpec(), description="when targets count as reached"
    )
    weights: WeightsSpec = Field(
        default=WeightsSpec(), description="costs of a plan beside its distance to targets"
    )
    phases: tuple[PhaseSpec, ...] = Field(
        min_length=1, max_length=MAX_STEPS, description="phases of the motion, in order"
    )
    obstacles: tuple[ObstacleSpec, ...] = Field(
        default=(), max_length=MAX_SOLIDS, description="solids in the way"
    )
    contact: ContactSpec = Field(
        default=ContactSpec(), description="which solids the plan keeps out of"
    )

    @model_validator(mode="after")
    def _planned_together(self) -> ProblemSpec:
        count = sum(phase.steps * (phase.free_steps + 1) for phase in self.phases)
        if count > MAX_STEPS:
            raise ValueError(
                f"phases have {count} steps together; expected at most {MAX_STEPS}, as they are "
                "planned as one NLP. Split the motion into several files"
            )
        return self

    @model_validator(mode="after")
    def _known_phases(self) -> ProblemSpec:
        names = tuple(dict.fromkeys(phase.name for phase in self.phases))
        for number, obstacle in enumerate(self.obstacles, 1):
            unknown = [name for name in obstacle.phases or () if name not in names]
            if unknown:
                raise ValueError(
                    f'obstacles[{number}].phases: no phase is named "{unknown[0]}"; expected '
                    f"names among {', '.join(names)}"
                )
        return self


def problem_schema() -> dict[str, Any]:
    """JSON Schema of a problem file, for editors."""
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **ProblemSpec.model_json_schema(),
    }

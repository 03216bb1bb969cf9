"""The format of a problem file.

Angles are in degrees and say so in their names; everything else is SI, in space axes, with
+Z pointing down. `build.py` turns a validated file into a motion; the JSON Schema for
editors is generated from these classes.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from annotated_types import MaxLen
from pydantic import Field, PositiveInt, model_validator

from .._support.toml_files import NonNegative, Number, Positive, Strict, Text
from ..model.solid_specs import MAX_SOLIDS, ContactSpec, ObstacleSpec
from .bound_specs import MAX_ENTRIES, BoundsSpec, ChangeSpec, LimitsSpec
from .load_specs import LoadsSpec
from .target_specs import MAX_POINTS, TargetSpec, WrapSpec, check_times

Interpolation = Literal["cosine", "hermite", "none"]

MAX_STEPS = 1000
"""Most steps of a motion; as one NLP, more would take minutes and gigabytes."""
MAX_FREE_STEPS = 31
"""Most additional time steps before each time step of a phase."""
DEFAULT_EFFORT, DEFAULT_RATE = 1e-5, 1e-5
"""Weights that a file leaves out."""


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
                check_times([row[0] for row in place.through], self.duration)
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

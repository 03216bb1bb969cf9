"""Loads in a problem file: forces and masses at the tip, a pull, a log, and which of them jump."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, PositiveInt, model_validator

from .._support.toml_files import NonNegative, Number, Positive, Strict, Vec3
from .target_specs import STEP


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

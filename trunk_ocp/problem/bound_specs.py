"""Bounds in a problem file: of controls, of the extension, and of changes between steps."""

from __future__ import annotations

from pydantic import Field, PositiveInt, model_validator

from .._support.toml_files import NonNegative, Pair, Strict

MAX_ENTRIES = 1000
"""Most entries of any other list."""
HEAD_Z = "bounds of the head angle psi_Z, degrees"
HEAD_Y = "bounds of the head angle psi_Y, degrees"


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

"""Solids as written in problem and anatomy files, and the solid that each of them is.

One key of a capsule is `from`, a keyword of Python: `getattr` reads it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

from annotated_types import MinLen
from pydantic import Field, create_model, model_validator

from .._support.toml_files import NonNegative, Pair, Positive, Strict, Text, Vec3

MAX_SOLIDS = 50
"""Most obstacles of a motion, and parts of a head."""

Shape = Literal["sphere", "capsule", "half-space", "box", "ellipsoid"]
Frame = Literal["space", "head"]

KEYS: dict[str, tuple[str, ...]] = {
    "sphere": ("center", "radius"),
    "capsule": ("from", "to", "radius"),
    "half-space": ("point", "normal"),
    "box": ("center", "half_sizes"),
    "ellipsoid": ("center", "half_axes"),
}
"""Keys that a solid needs; no other solid may have them."""
RESERVED_NAMES = ("itself", "log")
"""What messages and saved plans call the trunk and the log; no other solid has these names."""
ROTATION = "rotation_deg"
ROTATED = ("box", "ellipsoid")


class _Start(Strict):
    name: Text = Field(description="name for messages and pictures")
    shape: Shape = Field(description="which keys it has follows from the shape")
    center: Vec3 | None = Field(default=None, description="center, m")


if TYPE_CHECKING:
    _WithFrom = _Start
else:
    _WithFrom = create_model(
        "_WithFrom",
        __base__=_Start,
        **{
            "from": (
                Vec3 | None,
                Field(default=None, description="where the axis of a capsule starts, m"),
            )
        },
    )


class SolidSpec(_WithFrom):
    """A convex solid.

    A sphere has `center`, `radius`; a capsule `from`, `to`, `radius`; a half-space `point`,
    `normal`; a box `center`, `half_sizes`; an ellipsoid `center`, `half_axes`. A box and an
    ellipsoid may have a `rotation_deg`.
    """

    to: Vec3 | None = Field(default=None, description="where the axis of a capsule ends, m")
    radius: Positive | None = Field(default=None, description="of a sphere or a capsule, m")
    point: Vec3 | None = Field(default=None, description="a point of a half-space's surface, m")
    normal: Vec3 | None = Field(
        default=None, description="direction out of a half-space, of any length"
    )
    half_sizes: tuple[Positive, Positive, Positive] | None = Field(
        default=None, description="half the sides of a box, along its own axes, m"
    )
    half_axes: tuple[Positive, Positive, Positive] | None = Field(
        default=None, description="half the axes of an ellipsoid, m"
    )
    rotation_deg: Vec3 = Field(
        default=(0.0, 0.0, 0.0),
        description="angles by which a box or an ellipsoid is turned about its center: first about "
        "e_X, then about e_Y, then about e_Z, degrees",
    )
    clearance: NonNegative = Field(
        default=0.0, description="distance that the trunk keeps from it, m"
    )
    Z: Pair | None = Field(
        default=None,
        description="part of the trunk that must keep clear of it, m from the base; default: all",
    )

    @model_validator(mode="after")
    def _consistent(self) -> SolidSpec:
        needed = KEYS[self.shape]
        keys = dict.fromkeys(key for shape in KEYS for key in KEYS[shape])
        missing = [key for key in needed if getattr(self, key) is None]
        extra = [k for k in keys if k not in needed and getattr(self, k) is not None]
        if any(self.rotation_deg) and self.shape not in ROTATED:
            extra.append(ROTATION)
        if missing or extra:
            has = ", ".join((*needed, ROTATION) if self.shape in ROTATED else needed)
            fault = f"{missing[0]} is missing" if missing else f"it has no {extra[0]}"
            raise ValueError(f'shape = "{self.shape}" takes {has}; {fault}')
        if self.normal == (0.0, 0.0, 0.0):
            raise ValueError("normal must not be the zero vector")
        if self.shape == "capsule" and self.to == getattr(self, "from"):
            raise ValueError(
                'from and to are the same point; expected two points, or shape = "sphere"'
            )
        if self.Z is not None and not 0 <= self.Z[0] < self.Z[1]:
            raise ValueError(
                f"expected 0 <= first < second in Z = [{self.Z[0]:g}, {self.Z[1]:g}], in m"
            )
        return self


class ObstacleSpec(SolidSpec):
    """Something in the way, in some phases or all the time.

    A sphere has `center`, `radius`; a capsule `from`, `to`, `radius`; a half-space `point`,
    `normal`; a box `center`, `half_sizes`; an ellipsoid `center`, `half_axes`. A box and an
    ellipsoid may have a `rotation_deg`.
    """

    frame: Frame = Field(
        default="space",
        description='"space", or "head": it turns with the head, from where it is at head angles 0',
    )
    phases: Annotated[tuple[Text, ...], MinLen(1)] | None = Field(
        default=None, description="names of the phases in which it is there; default: all"
    )


class MouthSpec(Strict):
    """The mouth, where the head is at angles 0."""

    point: Vec3 = Field(description="position, m; on the surface of the body, if there is one")
    direction: Vec3 = Field(description="direction out of the mouth, of any length")

    @model_validator(mode="after")
    def _consistent(self) -> MouthSpec:
        if self.direction == (0.0, 0.0, 0.0):
            raise ValueError("direction must not be the zero vector")
        return self


class ContactSpec(Strict):
    """What the trunk must not enter; all of it is checked, whether or not the plan must obey."""

    self: bool = Field(default=False, description="the trunk itself")
    head: bool = Field(default=False, description="the body of the head, from the anatomy")
    log: bool = Field(default=False, description="the log that the trunk wraps around")
    obstacles: bool = Field(default=False, description="the obstacles of the problem file")


CONTACT_KINDS = ("self", "head", "log", "obstacles")

"""The trunk's anatomy: segments, muscles, material and head, read from a data file.

Equations 16-23, 26 and 29 of the paper define the anatomy; Table 1 and section 3.6 give the
numbers of the Asian elephant, which ship as a data file. Any other trunk of the same kind is
another file.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np
from pydantic import Field, model_validator

from .._support.arguments import check_arguments, real_array
from .._support.outputs import Displayed, outputs
from .._support.toml_files import (
    NonNegative,
    Number,
    Pair,
    Positive,
    Strict,
    Text,
    Vec3,
    read_toml,
    shipped,
)
from ..errors import InputError
from .solid_specs import MAX_SOLIDS, RESERVED_NAMES, MouthSpec, SolidSpec

if TYPE_CHECKING:
    from anywidget import AnyWidget

Architecture = Literal["longitudinal", "helical", "radial"]
Side = Literal["R", "L"]

ROUNDED_PI = 3.1416  # Table 1 prints pi with four decimals
END_TOL = 1e-12
"""By how much of the trunk's length a point may lie beyond an end."""
MAX_PARTS = 50
"""Segments of a trunk, and muscle groups of a segment; each segment needs elements of its own."""


class MuscleSpec(Strict):
    """One muscle group of a segment, as written in an anatomy file."""

    group: str = Field(
        pattern=r"^[A-Za-z][A-Za-z0-9_]*$",
        max_length=40,
        description="name of the group, such as dl; R1-dl is its right side in segment 1",
    )
    architecture: Architecture = Field(description="arrangement of the fibers")
    radii_over_length: Pair = Field(
        description="inner and outer radius at Z = 0, divided by the trunk's length"
    )
    sector: Pair = Field(description="angles of both edges on the right side, from dorsal, radians")
    helix_deg: Number = Field(
        default=0.0, gt=-90, lt=90, description="helical angle of the outermost fibers, right side"
    )
    sides: tuple[Side, ...] = Field(
        default=("R", "L"), min_length=1, max_length=2, description="sides that have it"
    )

    @model_validator(mode="after")
    def _consistent(self) -> MuscleSpec:
        inner, outer = self.radii_over_length
        if not 0 <= inner < outer:
            raise ValueError("radii_over_length must satisfy 0 <= inner < outer")
        low, high = self.sector
        if not 0 <= low < high <= 2 * ROUNDED_PI:
            message = "sector must satisfy 0 <= first < second <= 2 pi, in radians"
            if 0 <= low < high <= 360:
                radians = f"[{math.radians(low):.4f}, {math.radians(high):.4f}]"
                message += f"; these look like degrees: [{low:g}, {high:g}] would be {radians}"
            raise ValueError(message)
        if (self.architecture == "helical") != (self.helix_deg != 0.0):
            raise ValueError("helix_deg must be non-zero for helical muscles, and 0 for others")
        if len(set(self.sides)) != len(self.sides):
            raise ValueError("sides names a side twice")
        return self


class SegmentSpec(Strict):
    """A part of the trunk with its own muscles."""

    Z_over_length: Pair = Field(
        description="where it starts and ends, divided by the trunk's length"
    )
    muscles: tuple[MuscleSpec, ...] = Field(
        default=(), max_length=MAX_PARTS, description="its muscle groups"
    )


class MaterialSpec(Strict):
    """Homogeneous, isotropic tissue."""

    youngs_modulus: Positive = Field(description="Pa")
    poisson_ratio: Number = Field(gt=-1, le=0.5, description="0.5: incompressible")
    density: NonNegative = Field(description="kg/m^3")


class HeadSpec(Strict):
    """Position of the base and how the head moves it (eqs. 35-39).

    The default is a clamp along +Z that rotates about the base itself.
    """

    pivot_radius: NonNegative = Field(
        default=0.0, description="distance from the pivot of the head to the base, m"
    )
    xi_z_deg: Number = Field(
        default=0.0, description="angle of the pivot-to-base line and the trunk about e_Z"
    )
    xi_y_deg: Number = Field(default=0.0, description="angle of the pivot-to-base line about e_Y")
    xi_d_deg: Number = Field(default=0.0, description="angle of the trunk at the base about e_Y")
    body: tuple[SolidSpec, ...] = Field(
        default=(),
        max_length=MAX_SOLIDS,
        description="what the head consists of, at head angles 0, with the base as the origin",
    )
    mouth: MouthSpec | None = Field(default=None, description="where the mouth is")


class AnatomySpec(Strict):
    """An anatomy file."""

    name: Text = Field(description="name for messages and exports")
    length: Positive = Field(description="length of the passive trunk, m")
    base_radius_over_length: Positive = Field(
        description="radius at the base, divided by the length"
    )
    taper_deg: Number = Field(default=0.0, ge=0, lt=90, description="angle of the surface (eq. 26)")
    material: MaterialSpec = Field(description="elastic constants and density")
    head: HeadSpec = Field(default=HeadSpec(), description="how the head holds the base")
    segments: tuple[SegmentSpec, ...] = Field(
        min_length=1, max_length=MAX_PARTS, description="segments from base to tip"
    )

    @model_validator(mode="after")
    def _consistent(self) -> AnatomySpec:
        if self.base_radius_over_length <= math.tan(math.radians(self.taper_deg)):
            raise ValueError("taper_deg is so large that the radius reaches 0 before the tip")
        names = [*RESERVED_NAMES, *(solid.name for solid in self.head.body)]
        if twice := [name for name in names if names.count(name) > 1]:
            raise ValueError(f"head.body: {twice[0]} is the name of another solid")
        edge = 0.0
        for number, segment in enumerate(self.segments, 1):
            start, end = segment.Z_over_length
            if start != edge or end <= start:
                raise ValueError(
                    f"segments[{number}].Z_over_length must start at {edge:g}, where the previous "
                    f"segment ends, and end beyond; it is [{start:g}, {end:g}]"
                )
            edge = end
            names = [muscle.group for muscle in segment.muscles]
            for muscle in segment.muscles:
                if muscle.radii_over_length[1] > self.base_radius_over_length:
                    raise ValueError(
                        f"segments[{number}] {muscle.group}: outer radius "
                        f"{muscle.radii_over_length[1]:g} is outside the trunk "
                        f"(base_radius_over_length {self.base_radius_over_length:g})"
                    )
                if names.count(muscle.group) > 1:
                    raise ValueError(f"segments[{number}] names muscle {muscle.group} twice")
        if edge != 1.0:
            raise ValueError(f"the last segment must end at 1, it ends at {edge:g}")
        for number, solid in enumerate(self.head.body, 1):
            if solid.Z is not None and solid.Z[1] > self.length:
                raise ValueError(
                    f"head.body[{number}].Z = [{solid.Z[0]:g}, {solid.Z[1]:g}]: expected at most "
                    f"the trunk's length, {self.length:g} m"
                )
        return self


@dataclass(frozen=True)
class Muscle:
    """One muscular subdomain (eq. 16): an annular sector of one segment on one side.

    Radii are those at Z = 0 in meters (eq. 29), `sector` is in radians, `helix` is the
    signed helical angle on the outer surface in radians (eq. 21), zero unless helical.
    """

    name: str
    group: str
    side: Side
    segment: int
    architecture: Architecture
    radii: Pair
    sector: Pair
    helix: float


@dataclass(frozen=True)
class Head:
    """Geometry of the head (eqs. 35-39): radius in meters, angles in radians.

    `body` is as in the anatomy file; `mouth` is its point in m and its unit direction. Both are at
    head angles 0, with the base as the origin.
    """

    pivot_radius: float
    xi_z: float
    xi_y: float
    xi_d: float
    body: tuple[SolidSpec, ...] = ()
    mouth: tuple[Vec3, Vec3] | None = None


@dataclass(frozen=True, repr=False)
class Trunk(Displayed):
    """A trunk ready for computation. Lengths in m, E in Pa, density in kg/m^3.

    Attributes
    ----------
    edges : tuple of float
        Segment boundaries, from 0 to `length`.
    subdomains : tuple of Muscle
        In the order of the unknowns of eq. (42): right side from base to tip, then left.
    """

    name: str
    length: float
    base_radius: float
    tan_taper: float
    youngs_modulus: float
    poisson_ratio: float
    density: float
    head: Head
    edges: tuple[float, ...]
    subdomains: tuple[Muscle, ...]

    def __hash__(self) -> int:
        # A few fields only: caches look trunks up in every call, and hashing all muscles is slow.
        # The numbers that are identified from recordings, so that candidates have different hashes.
        numbers = (self.length, self.base_radius, self.youngs_modulus, self.density)
        return hash((self.name, *numbers, self.edges))

    def __repr__(self) -> str:
        return f"<Trunk {self.name}: {self.segments} segments, {len(self.subdomains)} muscles>"

    @property
    def muscles(self) -> tuple[str, ...]:
        """Names of the muscles, such as "R1-dl", in the order of an activation vector."""
        return tuple(muscle.name for muscle in self.subdomains)

    @property
    def segments(self) -> int:
        """Number of segments."""
        return len(self.edges) - 1

    @property
    def taper_rate(self) -> float:
        """Rate k = tan(phi_0) / R_0(0) in 1/m, so that f(Z) = 1 - k Z (eq. 29)."""
        return self.tan_taper / self.base_radius

    def taper(self, Z: np.ndarray | float) -> np.ndarray:
        """Scale f(Z) of every radius (eq. 29)."""
        return 1.0 - self.taper_rate * np.asarray(Z, dtype=float)

    def radius(self, Z: np.ndarray | float) -> np.ndarray:
        """Outer radius R_0(Z) in m (eq. 26)."""
        return self.base_radius * self.taper(Z)

    def clipped(self, Z: np.ndarray | Sequence[float] | float) -> np.ndarray:
        """Points Z in m, with rounding errors beyond the ends, up to 1e-12 L, cut off."""
        Z = np.asarray(Z, dtype=float)
        clipped = np.clip(Z, 0.0, self.length)
        return np.where(np.abs(Z - clipped) <= END_TOL * self.length, clipped, Z)

    def view(self, height: int = 600) -> AnyWidget:
        """A page to contract muscles, turn the head and pull the tip, as a widget.

        In Jupyter, marimo and VS Code. `time` (s), `activation` (muscles) and `head` (psi_Z, psi_Y
        in rad) of the widget are those on the page; set them to move the page. It needs the
        package anywidget: `pip install 'trunk_ocp[notebook]'`.

        Parameters
        ----------
        height : int
            In pixels.

        Raises
        ------
        TrunkError
            If anywidget is not installed.
        """
        return outputs().view(self, height)


def unknown_architecture(muscle: Muscle) -> InputError:
    """The error of code that meets a muscle of an architecture it has no equations for."""
    names = ", ".join(get_args(Architecture))
    stated = f"muscle {muscle.name}: architecture = {muscle.architecture!r}"
    return InputError(f"{stated}: expected one of {names}.")


@check_arguments
def load_anatomy(name_or_path: str | Path) -> Trunk:
    """Read an anatomy: a shipped name ("asian-elephant") or a path to a TOML file.

    Raises
    ------
    InputError
        If it is neither, or if the file is invalid; names file, key, value and expectation.
    """
    return build_trunk(read_anatomy(name_or_path))


def read_anatomy(name_or_path: str | Path) -> AnatomySpec:
    """Read and validate an anatomy file; see `load_anatomy`."""
    return read_toml(shipped(str(name_or_path), anatomies_folder()), AnatomySpec)


def anatomies_folder() -> Path:
    """Folder of the shipped anatomy files."""
    return Path(str(files("trunk_ocp"))) / "data" / "anatomies"


def build_trunk(spec: AnatomySpec) -> Trunk:
    """Turn a validated anatomy file into a trunk: sides expanded, units SI and radians."""
    by_side: dict[str, list[Muscle]] = {"R": [], "L": []}
    for number, segment in enumerate(spec.segments):
        for muscle in segment.muscles:
            for side in muscle.sides:
                by_side[side].append(_subdomain(muscle, side, number, spec.length))
    return Trunk(
        name=spec.name,
        length=spec.length,
        base_radius=spec.base_radius_over_length * spec.length,
        tan_taper=math.tan(math.radians(spec.taper_deg)),
        youngs_modulus=spec.material.youngs_modulus,
        poisson_ratio=spec.material.poisson_ratio,
        density=spec.material.density,
        head=Head(
            spec.head.pivot_radius,
            math.radians(spec.head.xi_z_deg),
            math.radians(spec.head.xi_y_deg),
            math.radians(spec.head.xi_d_deg),
            spec.head.body,
            _mouth(spec.head.mouth),
        ),
        edges=(*(spec.length * each.Z_over_length[0] for each in spec.segments), spec.length),
        subdomains=tuple(by_side["R"] + by_side["L"]),
    )


def _mouth(spec: MouthSpec | None) -> tuple[Vec3, Vec3] | None:
    """Point and unit direction of a mouth."""
    if spec is None:
        return None
    (x, y, z), size = spec.direction, math.hypot(*spec.direction)
    return spec.point, (x / size, y / size, z / size)


def _subdomain(spec: MuscleSpec, side: Side, segment: int, length: float) -> Muscle:
    """The muscle on one side; the left mirrors the right (eqs. 18, 19)."""
    low, high = spec.sector
    mirrored = side == "L"
    return Muscle(
        name=f"{side}{segment + 1}-{spec.group}",
        group=spec.group,
        side=side,
        segment=segment,
        architecture=spec.architecture,
        radii=(spec.radii_over_length[0] * length, spec.radii_over_length[1] * length),
        sector=(2 * math.pi - high, 2 * math.pi - low) if mirrored else (low, high),
        helix=math.radians(spec.helix_deg) * (-1 if mirrored else 1),
    )


def check_activation(trunk: Trunk, activation: np.ndarray) -> np.ndarray:
    """Return `activation` as a float array (..., muscles).

    Raises
    ------
    InputError
        If its last axis is not the number of muscles or a value is not a finite number.
    """
    array = real_array(activation, "activation")
    count = len(trunk.subdomains)
    if array.ndim == 0 or array.shape[-1] != count:
        raise InputError(
            f"activation: expected an array (..., {count}), one value per muscle of "
            f"{trunk.name}, got shape {array.shape}."
        )
    if not np.all(np.isfinite(array)):
        raise InputError("activation: every value must be finite.")
    return array

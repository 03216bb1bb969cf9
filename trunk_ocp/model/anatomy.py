"""The trunk's anatomy: segments, muscles, material and head, read from a data file.

Equations 16-23, 26 and 29 of the paper define what a trunk is made of; Table 1 and
section 3.6 give the numbers of the Asian elephant, which ship as a data file. Any other
trunk of the same kind is another file.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from .._support.arguments import check_arguments, real_array
from .._support.toml_files import (
    NonNegative,
    Number,
    Pair,
    Positive,
    Strict,
    Text,
    read_toml,
    shipped,
)
from ..errors import InputError

Architecture = Literal["longitudinal", "helical", "radial"]
Side = Literal["R", "L"]

ROUNDED_PI = 3.1416  # Table 1 prints pi with four decimals
ROUND_OFF = 1e-12
"""Of the trunk's length, by which a point may lie beyond an end."""
MOST_PARTS = 50
"""Segments of a trunk, and muscle groups of a segment; each segment needs elements of its own."""


class MuscleSpec(Strict):
    """One muscle group of a segment, as written in an anatomy file."""

    group: Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]*$", max_length=40)]
    architecture: Architecture
    radii_over_length: Pair
    sector: Pair
    helix_deg: Annotated[Number, Field(gt=-90, lt=90)] = 0.0
    sides: Annotated[tuple[Side, ...], Field(min_length=1, max_length=2)] = ("R", "L")

    @model_validator(mode="after")
    def _consistent(self) -> MuscleSpec:
        inner, outer = self.radii_over_length
        if not 0 <= inner < outer:
            raise ValueError("radii_over_length must satisfy 0 <= inner < outer")
        low, high = self.sector
        if not 0 <= low < high <= 2 * ROUNDED_PI:
            told = "sector must satisfy 0 <= first < second <= 2 pi, in radians"
            if 0 <= low < high <= 360:
                radians = f"[{math.radians(low):.4f}, {math.radians(high):.4f}]"
                told += f"; these look like degrees: [{low:g}, {high:g}] would be {radians}"
            raise ValueError(told)
        if (self.architecture == "helical") != (self.helix_deg != 0.0):
            raise ValueError("helix_deg is for helical muscles, and they need a non-zero one")
        if len(set(self.sides)) != len(self.sides):
            raise ValueError("sides names a side twice")
        return self


class SegmentSpec(Strict):
    """A stretch of the trunk with its own muscles."""

    Z_over_length: Pair
    muscles: Annotated[tuple[MuscleSpec, ...], Field(max_length=MOST_PARTS)] = ()


class MaterialSpec(Strict):
    """Homogeneous, isotropic tissue."""

    youngs_modulus: Positive
    poisson_ratio: Annotated[Number, Field(gt=-1, le=0.5)]
    density: NonNegative


class HeadSpec(Strict):
    """Where the base sits and how the head moves it (eqs. 35-39).

    The default is a clamp along +Z that turns about the base itself.
    """

    pivot_radius: NonNegative = 0.0
    xi_z_deg: Number = 0.0
    xi_y_deg: Number = 0.0
    xi_d_deg: Number = 0.0


class AnatomySpec(Strict):
    """A whole anatomy file."""

    name: Text
    length: Positive
    base_radius_over_length: Positive
    taper_deg: Annotated[Number, Field(ge=0, lt=90)] = 0.0
    material: MaterialSpec
    head: HeadSpec = HeadSpec()
    segments: Annotated[tuple[SegmentSpec, ...], Field(min_length=1, max_length=MOST_PARTS)]

    @model_validator(mode="after")
    def _consistent(self) -> AnatomySpec:
        if self.base_radius_over_length <= math.tan(math.radians(self.taper_deg)):
            raise ValueError("taper_deg is so large that the trunk ends before its length does")
        edge = 0.0
        for number, segment in enumerate(self.segments, 1):
            start, end = segment.Z_over_length
            if start != edge or end <= start:
                raise ValueError(
                    f"segments[{number}].Z_over_length must start at {edge:g}, where the one "
                    f"before ends, and end further on; it is [{start:g}, {end:g}]"
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
    """Geometry of the head (eqs. 35-39): radius in meters, angles in radians."""

    pivot_radius: float
    xi_z: float
    xi_y: float
    xi_d: float


@dataclass(frozen=True, repr=False)
class Trunk:
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
        # A few fields: a trunk's constants are cached by it, and looked up in every call.
        return hash((self.name, self.length, self.edges))

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
        """K = tan(phi_0) / R_0(0) in 1/m, so that f(Z) = 1 - k Z (eq. 29)."""
        return self.tan_taper / self.base_radius

    def taper(self, Z: np.ndarray | float) -> np.ndarray:
        """Scale f(Z) of every radius (eq. 29)."""
        return 1.0 - self.taper_rate * np.asarray(Z, dtype=float)

    def radius(self, Z: np.ndarray | float) -> np.ndarray:
        """Outer radius R_0(Z) in m (eq. 26)."""
        return self.base_radius * self.taper(Z)

    def clipped(self, Z: np.ndarray | Sequence[float] | float) -> np.ndarray:
        """Points Z in m, with what rounding adds beyond the ends, up to 1e-12 L, cut off."""
        given = np.asarray(Z, dtype=float)
        within = np.clip(given, 0.0, self.length)
        return np.where(np.abs(given - within) <= ROUND_OFF * self.length, within, given)


@check_arguments
def load_anatomy(name_or_path: str | Path) -> Trunk:
    """Read an anatomy: a shipped name ("asian-elephant") or a path to a TOML file.

    Raises
    ------
    InputError
        If it is neither, or if the file is faulty; names file, key, value, expectation.
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
    for segment, part in enumerate(spec.segments):
        for muscle in part.muscles:
            for side in muscle.sides:
                by_side[side].append(_subdomain(muscle, side, segment, spec.length))
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
        ),
        edges=(*(spec.length * part.Z_over_length[0] for part in spec.segments), spec.length),
        subdomains=tuple(by_side["R"] + by_side["L"]),
    )


def _subdomain(spec: MuscleSpec, side: Side, segment: int, length: float) -> Muscle:
    """One side of a muscle group; the left mirrors the right (eqs. 18, 19)."""
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

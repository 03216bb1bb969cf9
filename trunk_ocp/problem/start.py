"""Where a motion starts: the controls of time step 0, rest by default."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from pydantic import ValidationError

from .._support.arguments import real_array
from .._support.toml_files import SMALLEST_NUMBER
from ..errors import InputError
from ..model.activation import strains
from ..model.anatomy import Trunk
from .muscle_patterns import muscles_of
from .problem_file import StartSpec


def start_of(spec: StartSpec, trunk: Trunk, matches: Mapping[str, np.ndarray]) -> np.ndarray:
    """Activations and head angles (muscles + 2,), in rad, of a `[start]` section.

    Parameters
    ----------
    matches : dict
        Indices of the muscles that each name or pattern matches; see `matching_muscles`.

    Raises
    ------
    InputError
        If a pattern matches no muscle, or the activations collapse a segment.
    """
    count = len(trunk.muscles)
    x0 = np.zeros(count + 2)
    for pattern, value in spec.activation.items():
        x0[muscles_of(pattern, matches, trunk.muscles, "start.activation")] = value
    x0[count:] = math.radians(spec.head_z_deg), math.radians(spec.head_y_deg)
    extension = strains(trunk, x0[:count])[:, 0]
    for segment in np.flatnonzero(~(extension > 0)).tolist():
        raise InputError(
            f"start.activation: makes segment {segment + 1} {extension[segment]:.4g} times as "
            "long; expected more than 0."
        )
    return x0


def start_spec(x0: np.ndarray, trunk: Trunk) -> StartSpec:
    """The `[start]` section of activations and head angles (muscles + 2,), in rad.

    `start_of` gives back the same activations to the last bit; angles, which a file has in
    degrees, may differ in it. Numbers too small for a file become 0.

    Raises
    ------
    InputError
        For a wrong shape, or values that no problem file can have.
    """
    x, size = real_array(x0, "start"), len(trunk.muscles) + 2
    if x.shape != (size,) or not np.all(np.isfinite(x)):
        raise InputError(
            f"start: expected {size} finite values, activations and then psi_Z and psi_Y in rad, "
            f"got shape {x.shape}."
        )
    *activation, psi_z, psi_y = np.where(np.abs(x) < SMALLEST_NUMBER, 0.0, x).tolist()
    active = {name: value for name, value in zip(trunk.muscles, activation, strict=True) if value}
    try:
        return StartSpec(activation=active, head_z_deg=_degrees(psi_z), head_y_deg=_degrees(psi_y))
    except ValidationError as error:
        fault = error.errors()[0]
        key = ".".join(str(part) for part in fault["loc"])
        raise InputError(f"start: no problem file can have it ({key}: {fault['msg']}).") from None


def _degrees(angle: float) -> float:
    """The angle in degrees that comes closest to an angle in rad when it is converted back."""
    near = math.degrees(angle)
    around = (near, math.nextafter(near, -math.inf), math.nextafter(near, math.inf))
    return min(around, key=lambda degrees: abs(math.radians(degrees) - angle))

"""Rods used in the cases."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from trunk_ocp.model.activation import strain_matrix
from trunk_ocp.model.anatomy import AnatomySpec, Trunk, build_trunk, load_anatomy
from trunk_ocp.model.loads import Loads

NONE = np.zeros(0)  # activation of a rod without muscles
HORIZONTAL = (0.0, math.pi / 2)  # head angles: the default clamp turned from +Z to +X
CONTACT = 1.4  # m, where contact begins
EVERYTHING = Loads(9.8, (20.0, -30.0, 40.0), CONTACT, (10.0, 20.0, 100.0), (-60.0, 20.0, 10.0))
"""All kinds of load on the elephant's trunk, as large as in the motions."""


def rod(
    segments: tuple[dict[str, Any], ...] = ({"Z_over_length": (0.0, 1.0)},),
    material: dict[str, float] | None = None,
    **changes: Any,
) -> Trunk:
    """A rod of length 1 m, E = 1 MPa and R = 5 cm, without taper or muscles, clamped along +Z."""
    spec: dict[str, Any] = {
        "name": "rod",
        "length": 1.0,
        "base_radius_over_length": 0.05,
        "material": {"youngs_modulus": 1e6, "poisson_ratio": 0.5, "density": 1000.0}
        | (material or {}),
        "segments": segments,
    }
    return build_trunk(AnatomySpec.model_validate(spec | changes))


@cache
def wire(radius: float = 1e-5) -> Trunk:
    """A rod with E I = 1 N m^2, L = 1 m, 1 kg/m and E A = 4 / R^2: almost inextensible."""
    material = {
        "youngs_modulus": 4 / (math.pi * radius**4),
        "poisson_ratio": 0.3,
        "density": 1 / (math.pi * radius**2),
    }
    return rod(base_radius_over_length=radius, material=material)


@cache
def elephant() -> Trunk:
    """The trunk of the paper."""
    return load_anatomy("asian-elephant")


def contractions(trunk: Trunk, count: int, seed: int, strongest: float = 1.0) -> np.ndarray:
    """Random contractions (count, muscles) within the paper's 0.67 <= extension <= 1.35."""
    rng = np.random.default_rng(seed)
    activation = -strongest * rng.random((count, len(trunk.muscles)))
    change = np.einsum("sm,bm->bs", strain_matrix(trunk)[:, 0], activation)
    room = np.where(change < 0, -0.33, 0.35) / np.where(change == 0, 1e-9, change)
    return activation * np.minimum(1.0, room.min(axis=1))[:, None]


def heads(count: int, seed: int) -> np.ndarray:
    """Random head angles (count, 2) in radians."""
    return np.random.default_rng(seed).uniform(-0.6, 0.6, (count, 2))


def bender(length: float = 1.0, radius: float = 0.05, **material: float) -> Trunk:
    """An untapered rod with enough muscles for any extension, curvature and twist."""
    ring = {"radii_over_length": (0.5 * radius / length, radius / length)}
    straight = {"architecture": "longitudinal"} | ring
    muscles = (
        straight | {"group": "dorsal", "sector": (0.0, math.pi / 2)},
        straight | {"group": "ventral", "sector": (math.pi / 2, math.pi)},
        ring
        | {"group": "oblique", "architecture": "helical", "sector": (0.0, math.pi)}
        | {"helix_deg": 30.0},
    )
    return rod(
        ({"Z_over_length": (0.0, 1.0), "muscles": muscles},),
        material,
        length=length,
        base_radius_over_length=radius / length,
    )


def activation_for(trunk: Trunk, extension: float, curvature: tuple[float, float, float]) -> Any:
    """Smallest activation of a `bender` that gives an extension and a curvature in 1/m."""
    wanted = np.array([extension - 1, *curvature])
    return np.linalg.lstsq(strain_matrix(trunk)[0], wanted, rcond=None)[0]


def untapered(trunk: Trunk, taper: float = 0.0) -> Trunk:
    """The same trunk with another taper, in radians."""
    return replace(trunk, name=f"{trunk.name}, taper {taper:g}", tan_taper=math.tan(taper))

"""Names, units and scales of the numbers of an NLP, for its unknowns and its constraint rows."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ..model.anatomy import Trunk

AXES = ("X", "Y", "Z")


@dataclass(frozen=True)
class Units:
    """The NLP's units in SI: length L in m, moment E I(0) / L in N m, force E I(0) / L^2 in N."""

    length: float
    moment: float
    force: float


@dataclass(frozen=True)
class Component:
    """One number of a quantity; times `scale` it is in `unit`."""

    name: str
    unit: str
    scale: float


@dataclass(frozen=True)
class Quantity:
    """A vector of unknowns or of constraint residuals."""

    name: str
    components: tuple[Component, ...]


@dataclass(frozen=True)
class Meaning:
    """What the rows of a block state.

    Attributes
    ----------
    name : str
        Name of the constraint.
    quantity : Quantity
        Its components, along the last axis of the rows.
    labels : tuple of str
        Name of each component's constraint in messages; empty if `name` stands for all.
    place : str
        What the other axis of the rows counts, such as "segment", if messages should say it.
    """

    name: str
    quantity: Quantity
    labels: tuple[str, ...] = ()
    place: str = ""


def scalar(name: str) -> Meaning:
    """Meaning of dimensionless rows of one component."""
    return Meaning(name, Quantity(name, (Component(name, "1", 1.0),)))


@lru_cache(maxsize=64)
def units_of(trunk: Trunk) -> Units:
    """Units of the NLPs of a trunk."""
    length = trunk.length
    moment = trunk.youngs_modulus * np.pi / 4 * trunk.base_radius**4 / length
    return Units(length, moment, moment / length)


@lru_cache(maxsize=64)
def quantities(trunk: Trunk) -> dict[str, Quantity]:
    """All quantities in the NLPs of a trunk, by name."""
    units = units_of(trunk)
    L = units.length
    activations = [(name, "1", 1.0) for name in trunk.muscles]
    angles = [("psi_Z", "rad", 1.0), ("psi_Y", "rad", 1.0)]
    q = [(f"q{i}", "1", 1.0) for i in range(4)]
    r = [(axis, "m", L) for axis in AXES]
    parts = {
        "activations": activations,
        "head angles": angles,
        "controls": activations + angles,
        "strains": [("zeta_hat", "1", 1.0), *((f"c{i}", "1/m", 1 / L) for i in (1, 2, 3))],
        "extension": [("mean zeta_hat", "1", 1.0)],
        "force": [(axis, "N", units.force) for axis in AXES],
        "state": [*q, *((f"m{i}", "N m", units.moment) for i in (1, 2, 3))],
        "orientation": q,
        "position": r,
        "pose": [*r, *q],
        "direction": [(axis, "1", 1.0) for axis in AXES],
    }
    return {
        name: Quantity(name, tuple(Component(*part) for part in components))
        for name, components in parts.items()
    }

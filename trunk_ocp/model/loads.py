"""Loads on the trunk: weight, tip force, contact force and contact couple (section 2.2)."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .._support.arguments import real_array
from .._support.ranges import shown
from ..errors import InputError
from .anatomy import Trunk

Vector = tuple[float, float, float]
ZERO: Vector = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Loads:
    """Dead loads, fixed in space but for the lever of the contact force. +Z points down.

    Attributes
    ----------
    gravity : float
        Acceleration along +e_Z in m/s^2.
    tip_force : (3,)
        V in N, at Z = L.
    contact_from : float or None
        Z_w in m; contact force and couple are spread uniformly over [Z_w, L] (eqs. 12, 13).
    contact_force : (3,)
        W in N.
    contact_couple : (3,)
        L in N m, per unit of initial length when spread.
    contact_lever : float
        In m: the contact force acts at r + contact_lever d_2, which turns with the trunk, so that a
        weight hung from there has a potential. 0: it acts on the centerline.
    """

    gravity: float = 9.8
    tip_force: Vector = ZERO
    contact_from: float | None = None
    contact_force: Vector = ZERO
    contact_couple: Vector = ZERO
    contact_lever: float = 0.0

    def __post_init__(self) -> None:
        for name in ("tip_force", "contact_force", "contact_couple"):
            object.__setattr__(self, name, vector(_numbers(self, name, (3,))))
        for name in ("gravity", "contact_from", "contact_lever"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, float(_numbers(self, name, ())))
        if self.contact_from is None and (
            self.contact_force != ZERO or self.contact_couple != ZERO or self.contact_lever != 0
        ):
            raise InputError(
                "loads.contact_from: missing; a contact force or couple needs the Z in m where "
                "contact starts."
            )

    def scaled(self, fraction: float) -> Loads:
        """All loads times `fraction`, gravity included."""
        return Loads(
            self.gravity * fraction,
            _times(self.tip_force, fraction),
            self.contact_from,
            _times(self.contact_force, fraction),
            _times(self.contact_couple, fraction),
            self.contact_lever,
        )


def _numbers(loads: Loads, name: str, shape: tuple[int, ...]) -> np.ndarray:
    """A field of loads as finite numbers of a shape, or InputError."""
    value, count = getattr(loads, name), "three finite numbers" if shape else "a finite number"
    with contextlib.suppress(InputError):
        array = real_array(value, name)
        if array.shape == shape and np.all(np.isfinite(array)):
            return array
    raise InputError(f"loads.{name} = {shown(value, repr)}: expected {count}.")


def vector(v: np.ndarray) -> Vector:
    """Three numbers as a hashable tuple of floats."""
    return (float(v[0]), float(v[1]), float(v[2]))


def _times(vector: Vector, factor: float) -> Vector:
    return (vector[0] * factor, vector[1] * factor, vector[2] * factor)


def mass_beyond(trunk: Trunk, Z: np.ndarray | float) -> np.ndarray:
    """Mass in kg of the part of the trunk beyond Z (eq. 28)."""
    Z = np.asarray(Z, dtype=float)
    L, a, b = trunk.length, trunk.base_radius, float(trunk.radius(trunk.length))
    frustum = (L - Z) ** 3 * a**2 + (L - Z) ** 2 * (L + 2 * Z) * a * b + (L**3 - Z**3) * b**2
    return np.pi * trunk.density / (3 * L**2) * frustum


def check_contact(trunk: Trunk, Z_w: float) -> None:
    """Raise InputError unless contact starts on the trunk."""
    if not 0 <= Z_w < trunk.length:
        raise InputError(
            f"loads.contact_from = {Z_w:g}: expected 0 <= Z_w < L = {trunk.length:g} m."
        )


def contact_share(loads: Loads, trunk: Trunk, Z: np.ndarray) -> np.ndarray:
    """Share of the contact force that acts beyond Z (eq. 15), from 1 up to Z_w to 0 at L."""
    if loads.contact_from is None:
        return np.zeros_like(Z)
    L, Z_w = trunk.length, loads.contact_from
    check_contact(trunk, Z_w)
    return (L - np.maximum(Z, Z_w)) / (L - Z_w)


def internal_force(loads: Loads, trunk: Trunk, Z: np.ndarray) -> np.ndarray:
    """Internal force n(Z), (n, 3) N, in space axes: the sum of all forces beyond Z (eq. 15)."""
    Z = np.asarray(Z, dtype=float)
    weight = loads.gravity * mass_beyond(trunk, Z)
    return (
        np.asarray(loads.tip_force)
        + weight[:, None] * np.array([0.0, 0, 1])
        + contact_share(loads, trunk, Z)[:, None] * np.asarray(loads.contact_force)
    )


def internal_forces(loads: Sequence[Loads], trunk: Trunk, Z: np.ndarray) -> np.ndarray:
    """Internal forces (loads, n, 3) of several loads at once; see `internal_force`."""
    tip, contact = (
        np.reshape([getattr(load, name) for load in loads], (len(loads), 1, 3))
        for name in ("tip_force", "contact_force")
    )
    share = np.reshape([contact_share(load, trunk, Z) for load in loads], (len(loads), Z.size, 1))
    force = np.asarray(tip + share * contact)
    force[..., 2] += np.multiply.outer([load.gravity for load in loads], mass_beyond(trunk, Z))
    return force


def couple_density(loads: Loads, trunk: Trunk, Z: np.ndarray) -> np.ndarray:
    """Couple per unit initial length at Z, (n, 3) N, in space axes (eq. 13)."""
    Z = np.asarray(Z, dtype=float)
    if loads.contact_from is None:
        return np.zeros((Z.size, 3))
    inside = Z >= loads.contact_from
    return inside[:, None] * np.asarray(loads.contact_couple) / (trunk.length - loads.contact_from)


def lever_density(loads: Loads, trunk: Trunk, Z: np.ndarray) -> np.ndarray:
    """Lever times contact force per unit initial length at Z, (n, 3) N, in space axes.

    Its couple on the section is d_2 x this vector.
    """
    Z = np.asarray(Z, dtype=float)
    if loads.contact_from is None:
        return np.zeros((Z.size, 3))
    force = loads.contact_lever * np.asarray(loads.contact_force)
    return (Z >= loads.contact_from)[:, None] * force / (trunk.length - loads.contact_from)

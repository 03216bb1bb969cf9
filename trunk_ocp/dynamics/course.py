"""What a simulated trunk is given at each instant: activations, head angles, loads, masses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..model.activation import segment_at, segment_fractions, stiffness, strain_matrix, strains
from ..model.anatomy import Trunk
from ..model.head import base_pose
from ..model.loads import Loads, couple_density
from ..problem.interpolation import interpolate_all, loads_before
from ..problem.motion import Motion
from ..rod.collocation import Mesh, gauss
from .inertia import carried_masses

SPREAD = 1e-3
"""Distance of the points from whose polynomial rates are taken, as a share of a time step."""


@dataclass(frozen=True, eq=False)
class Instant:
    """What is given at one instant.

    Attributes
    ----------
    time : float
        In s.
    strain, strain_rate : (segments, 4)
        Strain numbers, and their rates in 1/s.
    loads : Loads
    base : (4,)
        Orientation of the base.
    position, velocity, acceleration : (3,)
        Of the base, in m, m/s and m/s^2.
    spin : (3,)
        Angular velocity of the base, in the directors, in rad/s.
    contact_mass, tip_mass : float
        That the trunk carries, in kg.
    """

    time: float
    strain: np.ndarray
    strain_rate: np.ndarray
    loads: Loads
    base: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    spin: np.ndarray
    contact_mass: float
    tip_mass: float


def course(
    motion: Motion, x: np.ndarray, loads: Sequence[Loads], step: int, times: np.ndarray
) -> list[Instant]:
    """The way to a time step (from 0), at times (m,) from its start to its end.

    x : (H, muscles + 2) and loads as in a plan. The end is the limit from before: where a phase
    has no interpolation, its step is taken after it.
    """
    knots = np.append(0.0, motion.times[: len(x)])
    start, end = knots[step], knots[step + 1]
    inside = np.minimum(times, np.nextafter(end, start))
    e = SPREAD * (end - start)
    centers = np.clip(times, start + 2.5 * e, end - 2.5 * e)
    offsets = np.arange(-2.0, 3.0)
    around = centers[:, None] + e * offsets
    controls = interpolate_all(motion, np.vstack([motion.start, x]), around.ravel())
    controls = controls.reshape(*around.shape, -1)
    at = (times - centers) / e
    inverse = np.linalg.inv(np.vander(offsets, increasing=True))
    powers = np.arange(5.0)
    value = at[:, None] ** powers @ inverse
    rate = (powers[1:] * at[:, None] ** powers[:-1]) @ inverse[1:] / e
    second = (powers[2:] * powers[1:-1] * at[:, None] ** powers[:-2]) @ inverse[2:] / e**2
    r, q = (
        np.stack(p, -1) for p in base_pose(motion.trunk.head, controls[..., -2], controls[..., -1])
    )
    now, change = (np.einsum("mk,mkx->mx", weights, controls) for weights in (value, rate))
    position, velocity, acceleration = (
        np.einsum("mk,mkx->mx", weights, r) for weights in (value, rate, second)
    )
    base, turning = (np.einsum("mk,mkx->mx", weights, q) for weights in (value, rate))
    spin = 2 * (base[:, :1] * turning[:, 1:] - turning[:, :1] * base[:, 1:]
                - np.cross(base[:, 1:], turning[:, 1:]))  # fmt: skip
    strain = strains(motion.trunk, now[:, :-2])
    strain_rate = np.einsum("sim,tm->tsi", strain_matrix(motion.trunk), change[:, :-2])
    given = loads_before(motion, loads, step + 1, inside)
    contact, tip = carried_masses(motion, motion.steps[step])
    return [
        Instant(
            t,
            strain[i],
            strain_rate[i],
            given[i],
            base[i],
            position[i],
            velocity[i],
            acceleration[i],
            spin[i],
            contact,
            tip,
        )
        for i, t in enumerate(times.tolist())
    ]


@dataclass(frozen=True, eq=False)
class Sections:
    """Sections of a trunk at the n Gauss points of a mesh, which do not change with time."""

    trunk: Trunk
    Z: np.ndarray
    weights: np.ndarray
    segment: np.ndarray
    taper: np.ndarray
    K: np.ndarray
    mu: np.ndarray
    J: np.ndarray

    @classmethod
    def of(cls, trunk: Trunk, mesh: Mesh) -> Sections:
        """The sections on a mesh."""
        Z = mesh.points.ravel()
        weights = (mesh.widths[:, None] * gauss(mesh.degree).quadrature).ravel()
        mu, radius = trunk.density * np.pi * trunk.radius(Z) ** 2, trunk.radius(Z)
        J = (mu * radius**2 / 4)[:, None] * np.array([1.0, 1.0, 2.0])
        segment = segment_at(trunk, Z)
        return cls(trunk, Z, weights, segment, trunk.taper(Z), stiffness(trunk, Z), mu, J)

    def material(self, strain: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        """zeta_hat (n,), u_hat (n, 3) and the mean extension of strain numbers (segments, 4)."""
        at = strain[self.segment]
        return (
            at[:, 0],
            at[:, 1:] / self.taper[:, None],
            segment_fractions(self.trunk) @ strain[:, 0],
        )

    def density(self, instant: Instant) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Weight and force of contact (n, 3) N/m, couple (n, 3) N, mass in contact (n,) kg/m."""
        load, force = instant.loads, np.zeros((self.Z.size, 3))
        weight, mass = np.zeros_like(force), np.zeros(self.Z.size)
        weight[:, 2] = load.gravity * self.mu
        if load.contact_from is not None:
            touches = (self.Z > load.contact_from) / (self.trunk.length - load.contact_from)
            force, mass = np.outer(touches, load.contact_force), touches * instant.contact_mass
        return weight, force, couple_density(load, self.trunk, self.Z), mass

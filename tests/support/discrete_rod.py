"""A chain of rotations with the energy of the rod: what stability is compared with.

Neighboring frames differ by a Rodrigues vector, taken as the bending over an interval; forces work
at its middle, where the frame is the mean of both. The error is of second order in the interval.
Nothing here calls the package but for the shape to start from; derivatives are CasADi's, so exact.
"""

import math
from dataclasses import dataclass

import casadi as ca
import numpy as np
from scipy.linalg import eigh
from scipy.spatial.transform import Rotation

from trust import reference


@dataclass(frozen=True)
class Chain:
    """An equilibrium: `stiffness` is the tangent stiffness, `bending` that of bending alone.

    residual : largest moment out of balance at its start in the rod's own shape, N m.
    """

    stiffness: np.ndarray
    bending: np.ndarray
    residual: float

    @property
    def eigenvalues(self):
        """Of the symmetric part of the stiffness relative to bending, rising."""
        return eigh((self.stiffness + self.stiffness.T) / 2, self.bending, eigvals_only=True)


def product(p, q):
    return ca.vertcat(
        p[0] * q[0] - ca.dot(p[1:], q[1:]), p[0] * q[1:] + q[0] * p[1:] + ca.cross(p[1:], q[1:])
    )


def turned(q, v):
    """Components in the frame q of a vector v in space: R^T v."""
    t = 2 * ca.cross(v, q[1:])
    return v + q[0] * t + ca.cross(t, q[1:])


def chain(trunk, activation, load, shape, intervals):
    """The equilibrium next to a shape of the rod, by Newton's method."""
    Z = np.linspace(0, trunk.length, intervals + 1)
    functions = _functions(trunk, activation, load, Z)
    frames = Rotation.from_matrix(shape.directors(Z).swapaxes(-1, -2))
    q = _scalar_first(frames).T
    residuals = []
    for _ in range(8):
        residual, stiffness, bending = (part.full() for part in functions(q))
        residuals.append(np.abs(residual).max())
        turn = np.linalg.solve(stiffness, -residual).reshape(-1, 3) / 2
        by = np.vstack([[1.0, 0, 0, 0], np.hstack([np.ones((intervals, 1)), turn])])
        by /= np.linalg.norm(by, axis=1, keepdims=True)
        frames = _rotation(q.T) * _rotation(by)
        q = _scalar_first(frames).T
    assert residuals[-1] < 1e-9 * max(1.0, residuals[0])
    return Chain(stiffness, bending, residuals[0])


def _functions(trunk, activation, load, Z):
    """(frames (4, n + 1)) -> residual (3 n,), its Jacobian, the bending part of it."""
    n, h = len(Z) - 1, Z[1] - Z[0]
    middle, L = (Z[1:] + Z[:-1]) / 2, trunk.length
    strain = reference.strains(trunk, activation[None])[0]
    mean = strain[:, 0] @ np.diff(trunk.edges) / L
    q, eta = ca.SX.sym("q", 4, n + 1), ca.SX.sym("eta", 3, n)
    now = [q[:, 0]]
    for i in range(n):
        by = ca.vertcat(1, eta[:, i] / 2)
        now.append(product(q[:, i + 1], by / ca.norm_2(by)))
    energy, bent, force = 0, 0, [ca.SX(3, 1) for _ in range(n + 1)]
    for i, at in enumerate(middle):
        radius = trunk.base_radius - at * trunk.tan_taper
        area, E = math.pi * radius**2, trunk.youngs_modulus
        K1 = E * area * radius**2 / 4
        K = np.array([K1, K1, K1 / (1 + trunk.poisson_ratio)]) / mean**2
        K0 = E * area / mean
        zeta_hat, *c = strain[np.searchsorted(trunk.edges[1:-1], at)]
        u_hat = np.array(c) * trunk.base_radius / radius

        def bending(frames, i=i):
            step = product(frames[i] * np.array([1, -1, -1, -1]), frames[i + 1])
            return 2 * step[1:] / step[0] / h

        kappa = bending(now)
        before = bending([q[:, j] for j in range(n + 1)])
        energy += h / 2 * ca.dot(K / zeta_hat, (kappa - zeta_hat * u_hat) ** 2)
        bent += h / 2 * ca.dot(K / zeta_hat, (kappa - before) ** 2)
        weight = load.gravity * reference.weight_beyond(trunk, at)
        N = np.array(load.tip_force) + np.array([0, 0, weight])
        if load.contact_from is not None:
            spread = L - load.contact_from
            N = N + (L - max(at, load.contact_from)) / spread * np.array(load.contact_force)
            if at > load.contact_from:
                couple = np.array(load.contact_couple) * h / spread / 2
                force[i] += couple
                force[i + 1] += couple
        half = now[i] + now[i + 1]
        n3 = turned(half / ca.norm_2(half), ca.DM(N))[2]
        energy -= h * zeta_hat * (n3 + n3**2 / (2 * K0))
    # The couple's work on a change of eta: its body components on the spin, which is
    # (d eta - eta x d eta / 2) / (1 + |eta|^2 / 4) for a Rodrigues vector.
    work = []
    for i in range(n):
        e, couple = eta[:, i], turned(now[i + 1], force[i + 1])
        work.append((couple + ca.cross(e, couple) / 2) / (1 + ca.sumsqr(e) / 4))
    residual = ca.gradient(energy, ca.vec(eta)) - ca.vertcat(*work)
    outputs = [residual, ca.jacobian(residual, eta), ca.hessian(bent, ca.vec(eta))[0]]
    return ca.Function(
        "chain", [q], [ca.substitute(part, eta, ca.DM.zeros(3, n)) for part in outputs]
    )


def _scalar_first(rotation):
    """Quaternions (..., 4) with the scalar first; as_quat has an option for it since SciPy 1.14."""
    return np.roll(rotation.as_quat(), 1, axis=-1)


def _rotation(q):
    """Rotation of quaternions with the scalar first."""
    return Rotation.from_quat(np.roll(q, -1, axis=-1))

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
    frames : quaternions (4, n + 1).
    """

    stiffness: np.ndarray
    bending: np.ndarray
    residual: float
    frames: np.ndarray

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
    return Chain(stiffness, bending, residuals[0], q)


@dataclass(frozen=True)
class Interval:
    """Material and load of one interval: stiffness, strain without moment, force, half couple.

    hung : force of the interval on the load's lever, times the lever, N m.
    mass, inertia : of the trunk; carried : kg, on the lever.
    """

    K: np.ndarray
    K0: float
    zeta_hat: float
    u_hat: np.ndarray
    force: np.ndarray
    couple: np.ndarray
    hung: np.ndarray
    mass: float
    carried: float
    inertia: np.ndarray


def _intervals(trunk, activation, load, Z, contact_mass=0.0):
    h, L = Z[1] - Z[0], trunk.length
    strain = reference.strains(trunk, activation[None])[0]
    mean = strain[:, 0] @ np.diff(trunk.edges) / L
    parts = []
    for at in (Z[1:] + Z[:-1]) / 2:
        radius = trunk.base_radius - at * trunk.tan_taper
        area, E = math.pi * radius**2, trunk.youngs_modulus
        K1 = E * area * radius**2 / 4
        zeta_hat, *c = strain[np.searchsorted(trunk.edges[1:-1], at)]
        weight = load.gravity * reference.weight_beyond(trunk, at)
        N = np.array(load.tip_force) + np.array([0, 0, weight])
        couple, hung, mass, carried = np.zeros(3), np.zeros(3), trunk.density * area * h, 0.0
        if load.contact_from is not None:
            spread = L - load.contact_from
            N = N + (L - max(at, load.contact_from)) / spread * np.array(load.contact_force)
            if at > load.contact_from:
                couple = np.array(load.contact_couple) * h / spread / 2
                hung = load.contact_lever * np.array(load.contact_force) * h / spread
                carried = contact_mass * h / spread
        K = np.array([K1, K1, K1 / (1 + trunk.poisson_ratio)]) / mean**2
        u_hat = np.array(c) * trunk.base_radius / radius
        inertia = mass * radius**2 / mean / 4 * np.array([1, 1, 2])
        values = K, E * area / mean, zeta_hat, u_hat, N, couple, hung, mass, carried, inertia
        parts.append(Interval(*values))
    return parts


def _moved(q, eta):
    """Frames after Rodrigues vectors eta (3, n) in the frames q (4, n + 1), the first clamped."""
    now = [q[:, 0]]
    for i in range(eta.shape[1]):
        by = ca.vertcat(1, eta[:, i] / 2)
        now.append(product(q[:, i + 1], by / ca.norm_2(by)))
    return now


def _bending(frames, i, h):
    step = product(frames[i] * np.array([1, -1, -1, -1]), frames[i + 1])
    return 2 * step[1:] / step[0] / h


def _work(now, eta, parts):
    """Generalized forces (3 n) of the couples.

    Their work on a change of eta: body components on the spin, which is
    (d eta - eta x d eta / 2) / (1 + |eta|^2 / 4) for a Rodrigues vector.
    """
    work = []
    for i in range(eta.shape[1]):
        beyond = parts[i + 1].couple if i + 1 < len(parts) else np.zeros(3)
        e, couple = eta[:, i], turned(now[i + 1], ca.DM(parts[i].couple + beyond))
        work.append((couple + ca.cross(e, couple) / 2) / (1 + ca.sumsqr(e) / 4))
    return ca.vertcat(*work)


def _functions(trunk, activation, load, Z):
    """(frames (4, n + 1)) -> residual (3 n,), its Jacobian, the bending part of it."""
    n, h = len(Z) - 1, Z[1] - Z[0]
    q, eta = ca.SX.sym("q", 4, n + 1), ca.SX.sym("eta", 3, n)
    now, parts = _moved(q, eta), _intervals(trunk, activation, load, Z)
    energy, bent = 0, 0
    for i, part in enumerate(parts):
        kappa = _bending(now, i, h)
        before = _bending([q[:, j] for j in range(n + 1)], i, h)
        energy += h / 2 * ca.dot(part.K / part.zeta_hat, (kappa - part.zeta_hat * part.u_hat) ** 2)
        bent += h / 2 * ca.dot(part.K / part.zeta_hat, (kappa - before) ** 2)
        half = now[i] + now[i + 1]
        n3 = turned(half / ca.norm_2(half), ca.DM(part.force))[2]
        energy -= h * part.zeta_hat * (n3 + n3**2 / (2 * part.K0))
        energy -= turned(half / ca.norm_2(half), ca.DM(part.hung))[1]
    residual = ca.gradient(energy, ca.vec(eta)) - _work(now, eta, parts)
    outputs = [residual, ca.jacobian(residual, eta), ca.hessian(bent, ca.vec(eta))[0]]
    return ca.Function(
        "chain", [q], [ca.substitute(part, eta, ca.DM.zeros(3, n)) for part in outputs]
    )


def vibrations(trunk, activation, load, frames, contact_mass=0.0, tip_mass=0.0):
    """Rates (6 n,) in 1/s of small vibrations of a chain about its equilibrium, slowest first.

    Each interval stretches by itself. Its mass is at its middle, and its rotary inertia with the
    frames of both ends.
    """
    n = frames.shape[1] - 1
    Z = np.linspace(0, trunk.length, n + 1)
    h = Z[1]
    parts = _intervals(trunk, activation, load, Z, contact_mass)
    eta, zeta, q = ca.SX.sym("eta", 3, n), ca.SX.sym("zeta", n), ca.DM(frames)
    now, energy, r, places, levers, start = _moved(q, eta), 0, ca.SX(3, 1), [], [], []
    for i, part in enumerate(parts):
        kappa = _bending(now, i, h)
        energy += h / 2 * ca.dot(part.K / part.zeta_hat, (kappa - part.zeta_hat * part.u_hat) ** 2)
        half = now[i] + now[i + 1]
        half /= ca.norm_2(half)
        d3 = turned(half * np.array([1, -1, -1, -1]), ca.DM([0, 0, 1]))
        energy += h * part.K0 / part.zeta_hat / 2 * (zeta[i] - part.zeta_hat) ** 2
        energy -= h * zeta[i] * ca.dot(d3, part.force)
        d2 = turned(half * np.array([1, -1, -1, -1]), ca.DM([0, 1, 0]))
        energy -= ca.dot(d2, part.hung)
        places.append(r + h / 2 * zeta[i] * d3)
        levers.append(places[-1] + load.contact_lever * d2)
        r += h * zeta[i] * d3
        n3 = turned(_scalar_half(frames, i), ca.DM(part.force))[2]
        start.append(part.zeta_hat * (1 + float(n3) / part.K0))
    unknowns = ca.vertcat(ca.vec(eta), zeta)
    forces = ca.gradient(energy, unknowns) - ca.vertcat(_work(now, eta, parts), ca.SX(n, 1))
    slopes = [ca.jacobian(forces, unknowns), ca.jacobian(ca.vertcat(*places, *levers, r), unknowns)]
    outputs = ca.Function("vibrations", [unknowns], [forces, *slopes])
    residual, K, J = (x.full() for x in outputs(np.append(np.zeros(3 * n), start)))
    assert np.abs(residual).max() < 1e-8 * np.abs(K).max()
    mass = np.array([*(part.mass for part in parts), *(part.carried for part in parts), tip_mass])
    M = J.T @ (np.repeat(mass, 3)[:, None] * J)
    for i, part in enumerate(parts):
        for j in {i - 1, i} - {-1}:
            M[range(3 * j, 3 * j + 3), range(3 * j, 3 * j + 3)] += part.inertia / 2
    values = np.linalg.eigvals(np.linalg.solve(K, M)).astype(complex)
    rates = np.sqrt(-1 / values)
    rates = np.abs(rates.real) + 1j * np.abs(rates.imag)
    return rates[np.argsort(np.abs(rates), kind="stable")]


def _scalar_half(frames, i):
    half = frames[:, i] + frames[:, i + 1]
    return ca.DM(half / np.linalg.norm(half))


def _scalar_first(rotation):
    """Quaternions (..., 4) with the scalar first; as_quat has an option for it since SciPy 1.14."""
    return np.roll(rotation.as_quat(), 1, axis=-1)


def _rotation(q):
    """Rotation of quaternions with the scalar first."""
    return Rotation.from_quat(np.roll(q, -1, axis=-1))

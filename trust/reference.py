"""An independent implementation of the paper in NumPy and scipy, for comparisons in tests.

Nothing here calls the package; it only reads the data of trunks and loads. The frame is
a rotation matrix with rows d_i (the package uses quaternions), strains come from adaptive
quadrature (the package uses a Gauss rule), and the rod is integrated by a Runge-Kutta code.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cache
from itertools import pairwise

import numpy as np
from scipy.integrate import quad, solve_ivp
from scipy.optimize import root
from scipy.spatial.transform import Rotation

from trunk_ocp.model.anatomy import Muscle, Trunk
from trunk_ocp.model.loads import Loads

Array = np.ndarray


def fiber_angles(trunk: Trunk, muscle: Muscle, R: float, Z: float) -> tuple[float, float]:
    """(cos 2 alpha, cos beta sin 2 alpha) by eqs. (10), (19)-(22), (27), (29)."""
    taper = 1 - Z * trunk.tan_taper / trunk.base_radius
    phi = math.atan(R / (trunk.base_radius * taper) * trunk.tan_taper)
    if muscle.architecture == "radial":
        a, b = math.pi / 2 + phi, math.pi / 2
    else:
        a, b = math.atan(R / (muscle.radii[1] * taper) * math.tan(muscle.helix)), 0.0
    sin_a, cos_a, sin_b, cos_b = math.sin(a), math.cos(a), math.sin(b), math.cos(b)
    cos_2_alpha = (
        math.sin(2 * a) * sin_b * math.sin(2 * phi)
        - sin_a**2 * (sin_b**2 * math.cos(2 * phi) + cos_b**2)
        + cos_a**2 * math.cos(2 * phi)
    )
    cos_beta_sin_2_alpha = (
        2 * sin_a * cos_b * (sin_a * sin_b * math.sin(phi) + cos_a * math.cos(phi))
    )
    return cos_2_alpha, cos_beta_sin_2_alpha


@cache
def strain_matrix(trunk: Trunk) -> Array:
    """(segments, 4, muscles): eqs. (5)-(7) at Z = 0 for unit activations."""
    nu, R0 = trunk.poisson_ratio, trunk.base_radius
    K0, K1 = math.pi * R0**2, math.pi / 4 * R0**4
    matrix = np.zeros((len(trunk.edges) - 1, 4, len(trunk.subdomains)))
    for column, muscle in enumerate(trunk.subdomains):

        def axial(R: float, power: int, muscle: Muscle = muscle) -> float:
            return 0.5 * (1 - nu + (1 + nu) * fiber_angles(trunk, muscle, R, 0.0)[0]) * R**power

        def shear(R: float, muscle: Muscle = muscle) -> float:
            return 0.5 * fiber_angles(trunk, muscle, R, 0.0)[1] * R**2

        first, second = muscle.sector
        d0, d1 = (quad(axial, *muscle.radii, args=(n,), epsabs=0, epsrel=1e-13)[0] for n in (1, 2))
        d3 = quad(shear, *muscle.radii, epsabs=1e-20, epsrel=1e-13)[0]
        sines = quad(math.sin, first, second, epsabs=0, epsrel=1e-13)[0]
        cosines = quad(math.cos, first, second, epsabs=0, epsrel=1e-13)[0]
        matrix[muscle.segment, :, column] = (
            d0 * (second - first) / K0,
            d1 * sines / K1,
            -d1 * cosines / K1,
            d3 * (second - first) * (1 + nu) / K1,
        )
    return matrix


def strains(trunk: Trunk, activation: Array) -> Array:
    """(B, segments, 4): extension and curvature at the scale of Z = 0."""
    return np.array([1.0, 0, 0, 0]) + np.einsum("sim,bm->bsi", strain_matrix(trunk), activation)


def base(trunk: Trunk, psi: Sequence[float] | Array) -> tuple[Array, Array]:
    """Base position and frame (rows d_i) by eqs. (35)-(39)."""
    head = trunk.head
    turn = Rotation.from_euler("ZY", psi)
    s = turn * Rotation.from_euler("ZY", [head.xi_z, head.xi_y])
    s_default = Rotation.from_euler("ZY", [head.xi_z, head.xi_y])
    S = -head.pivot_radius * s_default.apply([0, 0, 1])
    clamp = turn * Rotation.from_euler("ZY", [head.xi_z, head.xi_d])
    return S + head.pivot_radius * s.apply([0, 0, 1]), clamp.as_matrix().T


def weight_beyond(trunk: Trunk, Z: float) -> float:
    """Mass in kg beyond Z: the volume of a cone cut off at both ends, by its two radii."""
    a = trunk.base_radius - Z * trunk.tan_taper
    b = trunk.base_radius - trunk.length * trunk.tan_taper
    return trunk.density * math.pi / 3 * (trunk.length - Z) * (a * a + a * b + b * b)


def slope(
    trunk: Trunk, strain: Array, segment: int, touching: bool, loads: Sequence[Loads]
) -> Callable[[float, Array], Array]:
    """Right-hand side of eqs. (14), (15) for B rods on a stretch without jumps; y is (B * 15,)."""
    L, E, nu = trunk.length, trunk.youngs_modulus, trunk.poisson_ratio
    lengths = np.diff(trunk.edges)
    mean = strain[:, :, 0] @ lengths / L
    extension, c = strain[:, segment, 0], strain[:, segment, 1:]

    def right(Z: float, y: Array) -> Array:
        y = y.reshape(-1, 15)
        frame, m = y[:, 3:12].reshape(-1, 3, 3), y[:, 12:]
        radius = trunk.base_radius - Z * trunk.tan_taper
        rates = np.empty_like(y)
        for rod, load in enumerate(loads):
            # Stiffness of the activated shape: radius scaled by 1 / sqrt(mean), eq. (30).
            star = radius / math.sqrt(mean[rod])
            K0, K1 = E * math.pi * star**2, E * math.pi / 4 * star**4
            weight = np.array([0, 0, load.gravity * weight_beyond(trunk, Z)])
            force = np.asarray(load.tip_force) + weight
            couple = np.zeros(3)
            if load.contact_from is not None:
                Z_w = load.contact_from
                force = force + (L - max(Z, Z_w)) / (L - Z_w) * np.asarray(load.contact_force)
                if touching:
                    couple = np.asarray(load.contact_couple) / (L - Z_w)
            n, couple_in, d = frame[rod] @ force, frame[rod] @ couple, frame[rod]
            zeta_hat, m_rod = extension[rod], m[rod]
            zeta = zeta_hat * (1 + n[2] / K0)
            u = c[rod] * trunk.base_radius / radius + m_rod / [K1, K1, K1 / (1 + nu)]
            u1, u2, u3 = u
            m1, m2, m3 = m_rod
            rates[rod, :3] = zeta * d[2]
            darboux = u @ d  # in space axes
            rates[rod, 3:12] = zeta_hat * np.concatenate([np.cross(darboux, row) for row in d])
            rates[rod, 12] = zeta_hat * (u3 * m2 - u2 * m3) + zeta * n[1] - couple_in[0]
            rates[rod, 13] = zeta_hat * (u1 * m3 - u3 * m1) - zeta * n[0] - couple_in[1]
            rates[rod, 14] = zeta_hat * (u2 * m1 - u1 * m2) - couple_in[2]
        return rates.ravel()

    return right


def march(
    trunk: Trunk,
    activation: Array,
    head: Sequence[float] | Array,
    loads: Sequence[Loads],
    moment: Array,
    Z: Sequence[float] | Array,
    method: str = "DOP853",
    rtol: float = 1e-11,
    atol: float = 1e-11,
) -> tuple[Array, Array, Array]:
    """Integrate B rods from the base with m(0) = moment; position, frame, moment at Z (sorted).

    Shapes (B, n, 3), (B, n, 3, 3), (B, n, 3). All loads share one contact_from.
    """
    activation, head, moment = np.atleast_2d(activation), np.atleast_2d(head), np.atleast_2d(moment)
    strain, Z = strains(trunk, activation), np.asarray(Z, dtype=float)
    start = [base(trunk, psi) for psi in head]
    y = np.array([[*r, *d.ravel(), *m] for (r, d), m in zip(start, moment, strict=True)])
    Z_w = loads[0].contact_from
    jumps = sorted({*trunk.edges, *([] if Z_w is None else [Z_w])})
    out = np.empty((Z.size, len(y), 15))
    out[Z <= 0] = y
    for left, right in pairwise(jumps):
        inside = (Z > left) & (Z <= right)
        segment = int(np.searchsorted(trunk.edges, left, side="right")) - 1
        touching = Z_w is not None and left >= Z_w
        rhs = slope(trunk, strain, segment, touching, loads)
        stops = np.append(Z[inside], right)
        path = solve_ivp(
            rhs,
            (left, right),
            y.ravel(),
            method=method,
            t_eval=np.unique(stops),
            rtol=rtol,
            atol=atol,
        )
        assert path.success, path.message
        y = path.y[:, -1].reshape(-1, 15)
        out[inside] = path.y.T[: inside.sum()].reshape(-1, len(y), 15)
    out = out.swapaxes(0, 1)
    return out[..., :3], out[..., 3:12].reshape(*out.shape[:2], 3, 3), out[..., 12:]


def shoot(
    trunk: Trunk,
    activation: Array,
    head: Sequence[float] | Array,
    load: Loads,
    guess: Array,
    rtol: float = 1e-12,
) -> Array:
    """m(0) of one rod such that m(L) = 0, by scipy's root finder on `march`."""

    def tip_moment(moment: Array) -> Array:
        ends = march(trunk, activation, head, [load], moment, [trunk.length], rtol=rtol, atol=rtol)
        return ends[2][0, -1]

    found = root(tip_moment, guess, method="hybr", options={"xtol": 1e-13})
    assert np.linalg.norm(found.fun) < 1e-9 * np.linalg.norm(found.x)
    return found.x


# Computed by two independent codes, to six decimals.
UNIT_RESPONSES = {
    "R1-dl": (0.126081, 2.487782, -2.124715, 0),
    "R1-ovo": (0.032572, 0.679031, 0.679039, -0.981985),
    "R1-ivo": (0.031759, 0.511982, 0.599473, 0.808201),
    "R1-dr": (-0.037277, -0.496254, 0.496252, 0),
    "R1-vr": (-0.031888, -0.362551, -0.362555, 0),
    "R2-dl": (0.087489, 1.968056, -1.136252, 0),
    "R2-ivo": (0.116442, 1.932661, 1.115835, 2.181250),
    "R3-ovo": (0.031108, 0.513011, 0.767785, -0.934996),
}

"""From muscle activation to intrinsic strain (eqs. 5-10, 19-30 and appendix A).

With linear taper and the compatibility condition (29), every radius scales with
f(Z) = 1 - k Z. So the extension of the activated trunk is constant within a segment, and
its curvature is a constant divided by f. The whole effect of activation is therefore one
constant matrix: four strain numbers (extension, and the curvature at the scale of Z = 0)
for each segment, linear in the activations.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from .anatomy import Muscle, Trunk, unknown_architecture

# Gauss-Legendre rule for the radial integrals. Their integrands are smooth, with poles at
# R = i R_2 / tan(helix) only: 64 nodes reach round-off for helices up to 89 degrees, and
# need no special case where the closed forms (A.4) have 0/0 or an imaginary A.
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(64)


def radial_integrals(trunk: Trunk, muscle: Muscle) -> tuple[float, float, float]:
    """Radial factors (delta_0, delta_1, delta_3) of eq. (A.4) at Z = 0, in m^2, m^3, m^3.

    With D_Z the axial component of the fiber direction (eq. 9), eq. (6) has the integrands
    (1 - nu + (1 + nu) cos 2 alpha) / 2 = (1 + nu) D_Z^2 - nu and
    cos(beta) sin(2 alpha) / 2 = D_Theta D_Z.

    Raises
    ------
    InputError
        For a muscle of an unknown architecture.
    """
    inner, outer = muscle.radii
    R = 0.5 * (outer + inner) + 0.5 * (outer - inner) * _NODES
    weights = 0.5 * (outer - inner) * _WEIGHTS
    cos_taper = 1 / np.hypot(1, trunk.taper_rate * R)  # tan(phi) = k R, eq. (27)
    if muscle.architecture == "radial":
        D_Z, D_Theta = np.zeros_like(R), np.zeros_like(R)  # eq. (19) undoes the taper
    elif muscle.architecture not in ("longitudinal", "helical"):
        raise unknown_architecture(muscle)
    else:
        tan_helix = math.tan(muscle.helix) * R / outer  # eq. (21); zero if longitudinal
        cos_helix = 1 / np.hypot(1, tan_helix)
        D_Z, D_Theta = cos_helix * cos_taper, tan_helix * cos_helix
    nu = trunk.poisson_ratio
    axial = (1 + nu) * D_Z**2 - nu
    delta_0 = float(weights @ (axial * R))
    delta_1 = float(weights @ (axial * R**2))
    delta_3 = float(weights @ (D_Theta * D_Z * R**2))
    return delta_0, delta_1, delta_3


@lru_cache(maxsize=64)
def strain_matrix(trunk: Trunk) -> np.ndarray:
    """Matrix A, (segments, 4, muscles), of the strain map.

    Segment i has (zeta_hat, c_1, c_2, c_3) = (1, 0, 0, 0) + A[i] @ gamma with the extension
    zeta_hat (eq. 5, no unit) and the curvature c = u_hat f(Z) at the scale of Z = 0 in 1/m.
    """
    R0, nu = trunk.base_radius, trunk.poisson_ratio
    K0, K1 = math.pi * R0**2, math.pi / 4 * R0**4  # eq. (7) over E, which cancels
    K3 = K1 / (1 + nu)
    A = np.zeros((trunk.segments, 4, len(trunk.subdomains)))
    for column, muscle in enumerate(trunk.subdomains):
        first, second = muscle.sector
        d0, d1, d3 = radial_integrals(trunk, muscle)
        A[muscle.segment, :, column] = (
            d0 * (second - first) / K0,
            d1 * (math.cos(first) - math.cos(second)) / K1,
            -d1 * (math.sin(second) - math.sin(first)) / K1,
            d3 * (second - first) / K3,
        )
    A.setflags(write=False)  # shared by every caller
    return A


def strains(trunk: Trunk, activation: np.ndarray) -> np.ndarray:
    """Strain numbers (..., segments, 4) of activations (..., muscles); see `strain_matrix`."""
    A = strain_matrix(trunk)
    change = np.asarray(activation) @ A.reshape(4 * trunk.segments, A.shape[2]).T
    return np.array([1.0, 0, 0, 0]) + change.reshape(*change.shape[:-1], trunk.segments, 4)


def segment_fractions(trunk: Trunk) -> np.ndarray:
    """Each segment's share of the trunk's length, (segments,)."""
    return np.diff(trunk.edges) / trunk.length


def mean_extension(trunk: Trunk, strain: np.ndarray) -> np.ndarray:
    """Mean of zeta_hat over [0, L], (...,): the volume factor of eq. (30).

    The paper prints the integral without 1/L, which leaves R_0* without the unit of a length.
    """
    return np.asarray(strain)[..., 0] @ segment_fractions(trunk)


def segment_at(trunk: Trunk, Z: np.ndarray | float) -> np.ndarray:
    """Index of the segment that contains Z; a boundary belongs to the segment that it ends."""
    return np.searchsorted(np.asarray(trunk.edges[1:-1]), np.asarray(Z, dtype=float), side="left")


def intrinsic_strain(
    trunk: Trunk, activation: np.ndarray, Z: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Extension zeta_hat (..., n), curvature u_hat (..., n, 3) in 1/m at points Z (n,) (eq. 5)."""
    strain = strains(trunk, activation)[..., segment_at(trunk, Z), :]
    return strain[..., 0], strain[..., 1:] / trunk.taper(Z)[:, None]


def torsion(trunk: Trunk, activation: np.ndarray, Z: np.ndarray) -> np.ndarray:
    """Torsion tau_hat (..., n) in 1/m of the activated centerline (eq. 40).

    Eq. (40) divides all of its terms by zeta_hat. Only the derivative along Z needs that: by
    eq. (1), u is per activated length already. u_1 and u_2 share the factor 1/f(Z), so that
    derivative is zero here, and u_3 remains. NaN where the centerline is straight, so that torsion
    is undefined.
    """
    _, u = intrinsic_strain(trunk, activation, Z)
    bent = np.hypot(u[..., 0], u[..., 1]) > 0
    return np.where(bent, u[..., 2], np.nan)


def stiffness(trunk: Trunk, Z: np.ndarray | float) -> np.ndarray:
    """Stiffness (..., 4): K_0 in N, K_1 = K_2 and K_3 in N m^2, of the initial shape (eq. 7)."""
    R0 = trunk.radius(Z)
    K0 = trunk.youngs_modulus * math.pi * R0**2
    K1 = trunk.youngs_modulus * math.pi / 4 * R0**4
    return np.stack([K0, K1, K1, K1 / (1 + trunk.poisson_ratio)], axis=-1)

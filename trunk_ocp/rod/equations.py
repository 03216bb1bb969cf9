"""The loaded rod: balance and kinematics (eqs. 14, 15) at one point Z, as a CasADi function.

Statics, transcription and derivatives all evaluate this one function, at many points. The state
is x = (q, m): the director frame as a quaternion, and the internal moment in the directors. The
centerline is an integral of the state and is kept outside it.
"""

from __future__ import annotations

from functools import cache, lru_cache

import casadi as ca
import numpy as np

from ..model.activation import stiffness
from ..model.anatomy import Trunk
from ..model.loads import Loads, Vector, couple_density, internal_force, lever_density
from ..model.quaternions import Scalar, directors, dot, product
from .collocation import Mesh

# The state, and the rates, which add r'.
STATES, RATES = 7, 10
ORIENTATION, MOMENT, POSITION = slice(0, 4), slice(4, 7), slice(7, 10)

# Arguments w of `rates`: state, strain numbers of the segment, mean extension, tip force.
ARGUMENTS, STRAINS = 15, 5
STRAIN, MEAN, TIP_FORCE = slice(7, 11), 11, slice(12, 15)

# Parameters p of `rates`.
PARAMETERS = 11
TAPER, STIFFNESS, FORCE, COUPLE = 0, slice(1, 5), slice(5, 8), slice(8, 11)

# And where the contact force acts on a lever.
HUNG_PARAMETERS, LEVER = 14, slice(11, 14)


@cache
def rates(hung: bool = False) -> ca.Function:
    """Right-hand side (w, p) -> (q', m', r') of the boundary value problem (14), per meter of Z.

    w (15): q (4), m (3) in N m; zeta_hat, c (3) in 1/m, mean extension; tip force V (3) in N.
    p (11): f(Z); K_0, K_1, K_2, K_3 of the initial shape; force (3) in N on the section
    apart from V and couple density (3) in N, both in space axes. Of hung rods p has 14: lever times
    contact force per length (3) in N, in space axes, which acts as the couple density d_2 x it.
    """
    w, p = rate_arguments(hung)
    q, m = ca.vertsplit(w[ORIENTATION]), ca.vertsplit(w[MOMENT])
    (zeta_hat, *c), mean = ca.vertsplit(w[STRAIN]), w[MEAN]
    taper, (K0, *K) = p[TAPER], ca.vertsplit(p[STIFFNESS])
    force, couple = ca.vertsplit(w[TIP_FORCE] + p[FORCE]), ca.vertsplit(p[COUPLE])

    d = directors(q)
    n1, n2, n3 = (dot(d_i, force) for d_i in d)
    l1, l2, l3 = (dot(d_i, couple) for d_i in d)
    if hung:
        lever = ca.vertsplit(p[LEVER])
        l1, l3 = l1 + dot(d[2], lever), l3 - dot(d[0], lever)
    zeta = loaded_extension(zeta_hat, mean, n3, K0)
    u1, u2, u3 = (
        loaded_curvature(c_i / taper, mean, m_i, K_i) for c_i, m_i, K_i in zip(c, m, K, strict=True)
    )
    spin = (0, zeta_hat * u1, zeta_hat * u2, zeta_hat * u3)
    dq = [rate / 2 for rate in product(q, spin)]
    dm = [
        zeta_hat * (u3 * m[1] - u2 * m[2]) + zeta * n2 - l1,
        zeta_hat * (u1 * m[2] - u3 * m[0]) - zeta * n1 - l2,
        zeta_hat * (u2 * m[0] - u1 * m[1]) - l3,
    ]
    dr = [zeta * d3 for d3 in d[2]]
    return ca.Function("rates", [w, p], [ca.vertcat(*dq, *dm, *dr)], ["w", "p"], ["rates"])


def rate_arguments(hung: bool = False) -> tuple[ca.SX, ca.SX]:
    """Symbols (w, p) for `rates`."""
    return ca.SX.sym("w", ARGUMENTS), ca.SX.sym("p", HUNG_PARAMETERS if hung else PARAMETERS)


def loaded_extension(zeta_hat: Scalar, mean: Scalar, n3: Scalar, K0: Scalar) -> Scalar:
    """Extension zeta under the axial force n_3 in N (eq. 15); numbers, arrays or symbols.

    K_0 is that of the initial shape. By R_0*^2 = R_0^2 / mean (eq. 30) the activated shape, whose
    extension averages `mean`, has K_0 / mean.
    """
    return zeta_hat * (1 + n3 * mean / K0)


def loaded_curvature(u_hat: Scalar, mean: Scalar, m: Scalar, K: Scalar) -> Scalar:
    """Curvature or twist u_i in 1/m under the moment m_i in N m (eq. 15), as `loaded_extension`.

    K_i goes with R_0^4, so that of the activated shape is K_i / mean^2.
    """
    return u_hat + m * mean**2 / K


def is_hung(loads: Loads) -> bool:
    """Whether the contact force acts on a lever, so that `rates` needs more parameters."""
    return loads.contact_lever != 0


def point_parameters(trunk: Trunk, loads: Loads, Z: np.ndarray, hung: bool = False) -> np.ndarray:
    """Parameters p of `rates` (11, n) at points Z (n,), without the tip force, which is in w.

    Of hung rods (14, n).
    """
    force = internal_force(loads, trunk, Z) - np.asarray(loads.tip_force)
    rows = [trunk.taper(Z), stiffness(trunk, Z).T, force.T, couple_density(loads, trunk, Z).T]
    return np.vstack([*rows, lever_density(loads, trunk, Z).T] if hung else rows)


def mesh_parameters(trunk: Trunk, loads: Loads, mesh: Mesh, hung: bool = False) -> np.ndarray:
    """`point_parameters` at the Gauss points of a mesh, in order along the trunk; read-only.

    Kept, because a control loop asks for the same loads again and again. Only the tip force, which
    is not among the parameters, changes from one plan to the next.
    """
    contact = (loads.contact_from, loads.contact_force, loads.contact_couple, loads.contact_lever)
    return _kept_parameters(trunk, mesh, hung, loads.gravity, *contact)


@lru_cache(maxsize=64)
def _kept_parameters(
    trunk: Trunk,
    mesh: Mesh,
    hung: bool,
    gravity: float,
    contact_from: float | None,
    contact_force: Vector,
    contact_couple: Vector,
    contact_lever: float,
) -> np.ndarray:
    loads = Loads(
        gravity,
        contact_from=contact_from,
        contact_force=contact_force,
        contact_couple=contact_couple,
        contact_lever=contact_lever,
    )
    parameters = point_parameters(trunk, loads, mesh.points.ravel(), hung)
    parameters.setflags(write=False)
    return parameters

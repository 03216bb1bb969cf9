"""The loaded rod: balance and kinematics of eqs. (14), (15), symbolic, at one point Z.

Everything else - statics, transcription, derivatives - evaluates this one function at many
points. The state is x = (q, m): the director frame as a quaternion and the internal moment
in the directors. The centerline is a quadrature of the state and stays outside it.
"""

from __future__ import annotations

from functools import cache

import casadi as ca
import numpy as np

from ..model.activation import stiffness
from ..model.anatomy import Trunk
from ..model.loads import Loads, couple_density, internal_force
from ..model.quaternions import directors, dot, product

STATES = 7  # q (4) and m (3)
STRAINS = 5  # zeta_hat and c (3) of the segment, mean of zeta_hat over the trunk
RATES = 10  # q', m', r'


@cache
def rates() -> ca.Function:
    """Right-hand side (w, p) -> (q', m', r') of the boundary value problem (14), per meter of Z.

    w (15): q (4), m (3) in N m; zeta_hat, c (3) in 1/m, mean extension; tip force V (3) in N.
    p (11): f(Z); K_0, K_1, K_2, K_3 of the initial shape; force (3) in N on the section
    apart from V and couple density (3) in N, both in space axes.
    """
    w, p = ca.SX.sym("w", STATES + STRAINS + 3), ca.SX.sym("p", 11)
    q, m = ca.vertsplit(w[0:4]), ca.vertsplit(w[4:7])
    zeta_hat, c, mean = w[7], ca.vertsplit(w[8:11]), w[11]
    taper, K0, K1, K2, K3 = ca.vertsplit(p[0:5])
    force, couple = ca.vertsplit(w[12:15] + p[5:8]), ca.vertsplit(p[8:11])

    d = directors(q)
    n1, n2, n3 = (dot(d_i, force) for d_i in d)
    l1, l2, l3 = (dot(d_i, couple) for d_i in d)
    # Stiffness of the activated shape: R_0*^2 = R_0^2 / mean(zeta_hat), eq. (30).
    zeta = zeta_hat * (1 + n3 * mean / K0)
    u1, u2, u3 = (
        c_i / taper + m_i * mean**2 / K_i for c_i, m_i, K_i in zip(c, m, (K1, K2, K3), strict=True)
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


def point_parameters(trunk: Trunk, loads: Loads, Z: np.ndarray) -> np.ndarray:
    """Parameters p of `rates` at points Z (n,), as (11, n); the tip force is not in them."""
    Z = np.asarray(Z, dtype=float)
    force = internal_force(loads, trunk, Z) - np.asarray(loads.tip_force)
    return np.vstack(
        [trunk.taper(Z), stiffness(trunk, Z).T, force.T, couple_density(loads, trunk, Z).T]
    )

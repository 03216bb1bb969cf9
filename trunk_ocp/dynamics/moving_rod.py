"""The rod with inertia and damping at one point Z and one instant, as a CasADi function.

Balance of the moving rod, in initial length Z and in the directors for moments:

    N' = mu a - f,    m' = m x w + zeta (n_2, -n_1, 0) - l + d(J omega)/dt + omega x J omega,

with the acceleration a of the centerline, a' = d^2/dt^2 (zeta d_3), and q' = q w / 2. The force N
and the acceleration are states, so that nothing is an integral over other points. Stretch zeta and
spin w follow from force and moment by the material law of `rod.equations` with a dashpot beside
each spring (Kelvin-Voigt), which resists the change of shape:

    n_3 = K_0 / mean (zeta / zeta_hat - 1 + tau zeta' / zeta_hat),
    m_i = K_i / mean^2 (w_i / zeta_hat - u_hat_i + tau w_i' / zeta_hat).

An implicit method in time gives each quantity y that changes with time as y = y_known + c y', c a
part of the time step. Rotations are counted from the frame q_n at the start of the time step, as the
Gibbs vector g of q = q_n (1, g) / |(1, g)|.
"""

from __future__ import annotations

from functools import cache

import casadi as ca

from ..model.quaternions import directors, product

STATES = 13
Q, M, N, A = slice(0, 4), slice(4, 7), slice(7, 10), slice(10, 13)
"""Orientation, moment in N m in the directors, force in N and acceleration in m/s^2 in space."""

CHANGING = 11
G, G_RATE, ZETA, ZETA_RATE, W = slice(0, 3), slice(3, 6), 6, 7, slice(8, 11)
"""What changes with time: Gibbs vector, its rate, stretch, its rate, spin in 1/m."""

GIVEN = {
    "q_n": 4,
    "known": CHANGING,
    "c": 1,
    "tau": 1,
    "zeta_hat": 1,
    "u_hat": 3,
    "mean": 1,
    "mean_rate": 1,
    "K": 4,
    "mu": 1,
    "J": 3,
    "force": 3,
    "couple": 3,
    "hung_mu": 1,
    "lever": 1,
    "hung_force": 3,
}
"""What is given at a point, and how many numbers each has.

q_n : orientation at the start of the time step. known, c : of the method in time, c in s.
tau : damping time in s. zeta_hat, u_hat, mean, mean_rate : of the activation, rates in 1/s.
K : K_0 to K_3 of the initial shape. mu : mass per length of the trunk and of what moves with its
centerline, kg/m. J : rotary inertia per length of the initial shape, kg m.
force, couple : per length in N/m and N, in space. hung_mu : mass per length on the lever in kg/m;
lever in m; hung_force : on the lever, N/m.
"""


@cache
def moving_rod() -> ca.Function:
    """(x, p) -> (x' along Z (13), Jacobian of x' by x row by row (169), changing (11)).

    x (13) : see `Q`, `M`, `N`, `A`; p : the numbers of `GIVEN`, in order. The third output has
    what changes with time, as in `G`, `G_RATE`, `ZETA`, `ZETA_RATE`, `W`.
    """
    x = ca.SX.sym("x", STATES)
    p = {name: ca.SX.sym(name, count) for name, count in GIVEN.items()}
    q, m, force, a = x[Q], x[M], x[N], x[A]
    c, known = p["c"], p["known"]
    R = ca.vertcat(*(ca.horzcat(*d) for d in directors(ca.vertsplit(q))))  # rows are directors
    n = R @ force
    share = 1 + p["tau"] / c
    elastic = p["zeta_hat"] * (1 + n[2] * p["mean"] / p["K"][0])
    zeta = (elastic + p["tau"] / c * known[ZETA]) / share
    curvature = p["zeta_hat"] * (p["u_hat"] + m * p["mean"] ** 2 / p["K"][1:])
    w = (curvature + p["tau"] / c * known[W]) / share

    start = ca.vertsplit(p["q_n"])
    turn = product((start[0], -start[1], -start[2], -start[3]), ca.vertsplit(q))
    g = ca.vertcat(*turn[1:]) / turn[0]
    g_rate = (g - known[G]) / c
    g_second = (g_rate - known[G_RATE]) / c
    omega, alpha = _spin(g, g_rate, g_second)
    zeta_rate = (zeta - known[ZETA]) / c
    zeta_second = (zeta_rate - known[ZETA_RATE]) / c

    def turned(e: ca.SX) -> tuple[ca.SX, ca.SX]:
        """First and second derivative in time of a direction e fixed in the directors."""
        rate = ca.cross(omega, e)
        return rate, ca.cross(alpha, e) + ca.cross(omega, rate)

    e2, e3 = ca.SX([0, 1, 0]), ca.SX([0, 0, 1])
    rate, second = turned(e3)
    stretch = zeta_second * e3 + 2 * zeta_rate * rate + zeta * second
    # What hangs from the lever moves with r + lever d_2; forces and couples in the directors.
    hung = p["hung_mu"] * (R @ a + p["lever"] * turned(e2)[1])
    on_lever = ca.cross(p["lever"] * e2, R @ p["hung_force"] - hung)
    J = p["J"] / p["mean"]
    spin_change = J * (alpha - p["mean_rate"] / p["mean"] * omega) + ca.cross(omega, J * omega)
    couple = R @ p["couple"] + on_lever - spin_change
    dm = ca.cross(m, w) + zeta * ca.vertcat(n[1], -n[0], 0) - couple
    dN = p["mu"] * a + R.T @ hung - p["force"] - p["hung_force"]
    dq = [part / 2 for part in product(ca.vertsplit(q), (0, *ca.vertsplit(w)))]
    value = ca.vertcat(*dq, dm, dN, R.T @ stretch)
    slope = ca.vec(ca.densify(ca.jacobian(value, x)).T)
    changing = ca.vertcat(g, g_rate, zeta, zeta_rate, w)
    given = ca.vertcat(*p.values())
    return ca.Function("moving_rod", [x, given], [value, slope, changing])


def _spin(g: ca.SX, rate: ca.SX, second: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Angular velocity and acceleration, in the directors, of a Gibbs vector and its rates."""
    scale = 2 / (1 + ca.dot(g, g))
    omega = scale * (rate - ca.cross(g, rate))
    alpha = scale * (second - ca.cross(g, second)) - scale * ca.dot(g, rate) * omega
    return omega, alpha

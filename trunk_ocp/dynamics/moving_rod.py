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
part of the time step. Rotations are counted from the frame q_n at the start of the time step, as
the Gibbs vector g of q = q_n (1, g) / |(1, g)|. With its slope h along Z, which changes in time as
g does, the spin is w = S (h - g x h) + P^T w_n, S = 2 / (1 + g . g), where P turns by g, and its
rate follows from those of g and h.
"""

from __future__ import annotations

from functools import cache

import casadi as ca

from ..model.quaternions import directors, product

STATES = 13
Q, M, N, A = slice(0, 4), slice(4, 7), slice(7, 10), slice(10, 13)
"""Orientation, moment in N m in the directors, force in N and acceleration in m/s^2 in space."""

CHANGING = 11
G, G_RATE, ZETA, ZETA_RATE, G_SLOPE = slice(0, 3), slice(3, 6), 6, 7, slice(8, 11)
"""What changes with time: Gibbs vector g, its rate, stretch, its rate, slope of g in 1/m."""

GIVEN = {
    "q_n": 4,
    "w_n": 3,
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

q_n, w_n : orientation and spin in 1/m at the start of the time step.
known, c : of the method in time, c in s.
tau : damping time in s. zeta_hat, u_hat, mean, mean_rate : of the activation, rates in 1/s.
K : K_0 to K_3 of the initial shape. mu : mass per length of the trunk and of what moves with its
centerline, kg/m. J : rotary inertia per length of the initial shape, kg m.
force, couple : per length in N/m and N, in space. hung_mu : mass per length on the lever in kg/m;
lever in m; hung_force : on the lever, N/m.
"""


@cache
def moving_rod() -> ca.Function:
    """(x, p) -> (x' along Z (13), changing (11), bend (6)).

    x (13) : see `Q`, `M`, `N`, `A`; p : the numbers of `GIVEN`, in order. `changing` has what
    changes with time, as in `G`, `G_RATE`, `ZETA`, `ZETA_RATE`, `G_SLOPE`; `bend` the spin w and
    its rate.
    """
    x = ca.SX.sym("x", STATES)
    p = {name: ca.SX.sym(name, count) for name, count in GIVEN.items()}
    q, m, force, a = x[Q], x[M], x[N], x[A]
    c, known = p["c"], p["known"]
    R = ca.vertcat(*(ca.horzcat(*d) for d in directors(ca.vertsplit(q))))  # rows are directors
    n = R @ force
    elastic = p["zeta_hat"] * (1 + n[2] * p["mean"] / p["K"][0])
    zeta = (elastic + p["tau"] / c * known[ZETA]) / (1 + p["tau"] / c)

    start = ca.vertsplit(p["q_n"])
    turn = product((start[0], -start[1], -start[2], -start[3]), ca.vertsplit(q))
    g = ca.vertcat(*turn[1:]) / turn[0]
    g_rate = (g - known[G]) / c
    g_second = (g_rate - known[G_RATE]) / c
    omega, alpha = _spin(g, g_rate, g_second)
    curvature = p["zeta_hat"] * (p["u_hat"] + m * p["mean"] ** 2 / p["K"][1:])
    h, w, w_rate = _bend(g, g_rate, omega, known[G_SLOPE], c, p["tau"], p["w_n"], curvature)
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
    changing = ca.vertcat(g, g_rate, zeta, zeta_rate, h)
    given = ca.vertcat(*p.values())
    return ca.Function("moving_rod", [x, given], [value, changing, ca.vertcat(w, w_rate)])


@cache
def moving_rod_slope() -> ca.Function:
    """(x, p) -> Jacobian of x' along Z by x, row by row (169); see `moving_rod`."""
    x, given = ca.SX.sym("x", STATES), ca.SX.sym("p", sum(GIVEN.values()))
    slope = ca.jacobian(moving_rod()(x, given)[0], x)
    return ca.Function("moving_rod_slope", [x, given], [ca.vec(ca.densify(slope).T)])


def _spin(g: ca.SX, rate: ca.SX, second: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Angular velocity and acceleration, in the directors, of a Gibbs vector and its rates."""
    scale = 2 / (1 + ca.dot(g, g))
    omega = scale * (rate - ca.cross(g, rate))
    alpha = scale * (second - ca.cross(g, second)) - scale * ca.dot(g, rate) * omega
    return omega, alpha


def _bend(
    g: ca.SX,
    rate: ca.SX,
    omega: ca.SX,
    known: ca.SX,
    c: ca.SX,
    tau: ca.SX,
    w_n: ca.SX,
    curvature: ca.SX,
) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Slope h of g, spin w and its rate, so that w + tau w' is a given curvature.

    known : of h. All is linear in h; w' = omega' + w x omega, omega' being the slope along Z.
    """
    scale = 2 / (1 + ca.dot(g, g))
    along = w_n + scale * ca.cross(ca.cross(w_n, g), g) + scale * ca.cross(w_n, g)
    h = ca.SX.sym("h", 3)
    h_rate = (h - known) / c
    w = scale * (h - ca.cross(g, h)) + along
    slope = scale * (h_rate - ca.cross(h, rate) - ca.cross(g, h_rate) - ca.dot(g, h) * omega)
    w_rate = slope + ca.cross(w, omega)
    law = w + tau * w_rate
    matrix, rest = ca.jacobian(law, h), curvature - ca.substitute(law, h, ca.SX.zeros(3))
    columns = ca.horzsplit(matrix)
    found = ca.vertcat(
        ca.dot(rest, ca.cross(columns[1], columns[2])),
        ca.dot(columns[0], ca.cross(rest, columns[2])),
        ca.dot(columns[0], ca.cross(columns[1], rest)),
    ) / ca.dot(columns[0], ca.cross(columns[1], columns[2]))
    w, w_rate = ca.substitute([w, w_rate], [h], [found])
    return found, w, w_rate

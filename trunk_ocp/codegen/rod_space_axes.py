"""The rod with its moment in space axes: kernels of the exported programs.

In space axes the moment M is a quadrature of the orientation alone,

    M' = -zeta d_3 x N - l,

so the unknowns of a collocated element are only the orientations at its Gauss points: four per
point instead of seven. N is the force on the section, l the couple density. The equations are those
of `rod.equations` (eqs. 7, 14, 15, 28, 30), which has the moment in the directors.

Each kernel is a CasADi function (w, p) of scalar operations, differentiated with respect to w; p
has the numbers of a point of the trunk.
"""

from __future__ import annotations

import math
from functools import cache, lru_cache

import casadi as ca

from ..model.anatomy import Head
from ..model.head import base_pose
from ..model.quaternions import Scalar, cross, directors, dot, product
from ..rod.equations import loaded_curvature, loaded_extension

TERMS = 10  # of a series in theta^2 <= 1: the next one is 1 / 20! of the first
MOMENTS = 2 * TERMS + 1


@cache
def rates() -> ca.Function:
    """Right-hand side (w, p) -> (q', M', r'), per meter of Z.

    w (18): q (4), M (3) in N m; zeta_hat, c (3) in 1/m, mean extension; N (3) in N, l (3) in N.
    p (5): f(Z); K_0, K_1, K_2, K_3 of the initial shape.
    """
    w, p = ca.SX.sym("w", 18), ca.SX.sym("p", 5)
    q, zeta_hat, N = ca.vertsplit(w[0:4]), w[7], ca.vertsplit(w[12:15])
    d, zeta, u = _strains(w[:15], p)
    dq = [rate / 2 for rate in product(q, (0, *(zeta_hat * u_i for u_i in u)))]
    couple = ca.vertsplit(w[15:18])
    dM = [-zeta * a - b for a, b in zip(cross(d[2], N), couple, strict=True)]
    dr = [zeta * d3 for d3 in d[2]]
    return _kernel("rates", w, p, [*dq, *dM, *dr])


@cache
def report() -> ca.Function:
    """Outputs at a section: (w, p) -> d_1, d_2, d_3 (9); zeta, u (4); m (3) in the directors.

    w (15) and p (5) are the first ones of `rates`. The directors are normalized.
    """
    w, p = ca.SX.sym("w", 15), ca.SX.sym("p", 5)
    d, zeta, u = _strains(w, p)
    norm = ca.sumsqr(w[0:4])
    m = [dot(d_i, ca.vertsplit(w[4:7])) for d_i in d]
    return _kernel("report", w, p, [*(x / norm for d_i in d for x in d_i), zeta, *u, *m])


def _strains(w: ca.SX, p: ca.SX) -> tuple[tuple[tuple[ca.SX, ...], ...], ca.SX, tuple[ca.SX, ...]]:
    """Directors, extension zeta and curvature u of the loaded section."""
    M, zeta_hat, c, mean = ca.vertsplit(w[4:7]), w[7], ca.vertsplit(w[8:11]), w[11]
    N, (taper, K0, *K) = ca.vertsplit(w[12:15]), ca.vertsplit(p)
    d = directors(ca.vertsplit(w[0:4]))
    zeta = loaded_extension(zeta_hat, mean, dot(d[2], N), K0)
    u = tuple(loaded_curvature(c[i] / taper, mean, dot(d[i], M), K[i]) for i in range(3))
    return d, zeta, u


@lru_cache(maxsize=64)
def base(head: Head) -> ca.Function:
    """Orientation q (4) and position r (3) of the base from psi_Z, psi_Y; p is empty."""
    return _base(head, ca.SX.sym("p", 0))


@cache
def base_of_any_head() -> ca.Function:
    """The same, where p (4) has the head: pivot radius in m; xi_z, xi_y, xi_d in rad."""
    p = ca.SX.sym("p", 4)
    numbers: list[Scalar] = ca.vertsplit(p)
    return _base(Head(*numbers), p)


def _base(head: Head, p: ca.SX) -> ca.Function:
    psi = ca.SX.sym("psi", 2)
    r, q = base_pose(head, psi[0], psi[1])
    return _kernel("base", psi, p, [*q, *r])


@cache
def turn() -> ca.Function:
    """Rotation of the unloaded trunk along a piece of a segment, in the frame where it starts.

    w (4): zeta_hat, c (3) in 1/m.  p (1): stretched length l = int dZ / f in m.
    Returns exp(l zeta_hat c / 2) as a quaternion (4).
    """
    w, p = ca.SX.sym("w", 4), ca.SX.sym("p", 1)
    v = [w[0] * c for c in ca.vertsplit(w[1:])]
    half = p[0] / 2
    theta2, small, theta = _angle(v, half)
    cos = _either(small, _series(theta2, 0), ca.cos(theta))
    sinc = _either(small, _series(theta2, 1), ca.sin(theta) / theta)
    return _kernel("turn", w, p, [cos, *(half * sinc * v_i for v_i in v)])


@cache
def spiral() -> ca.Function:
    """Centerline of the unloaded trunk along a piece of a segment: its end, from its own start.

    With v = zeta_hat c and kappa = |v|, the piece is the integral of exp(l(Z) v) e_3 over Z:

        rho = zeta_hat [ g_0 e_3 + g_1 (v . e_3) v + g_2 v x e_3 ],
        g_0 = Re W,  g_1 = (int dZ - Re W) / kappa^2,  g_2 = Im W / kappa,
        W = int exp(i kappa l) dZ.

    w (4): zeta_hat, c (3) in 1/m.
    p (4 + 21): l in m; f at the start and at the end; k in 1/m; int l^j dZ for j = 0 ... 20.
    Returns rho (3) in m. Series in kappa^2 where kappa l < 1.
    """
    w, p = ca.SX.sym("w", 4), ca.SX.sym("p", 4 + MOMENTS)
    length, start, end, k = ca.vertsplit(p[:4])
    moments = ca.vertsplit(p[4:])
    zeta, v = w[0], [w[0] * c for c in ca.vertsplit(w[1:])]
    theta2, small, theta = _angle(v, length)
    kappa2, kappa = theta2 / length**2, theta / length
    real = k * (start - end * ca.cos(theta)) + end * kappa * ca.sin(theta)
    imaginary = kappa * (start - end * ca.cos(theta)) - k * end * ca.sin(theta)
    square = k**2 + kappa**2
    g0 = _either(small, _moment_series(kappa2, moments, 0), real / square)
    g1 = _either(small, _moment_series(kappa2, moments, 2), (moments[0] - real / square) / kappa**2)
    g2 = _either(small, _moment_series(kappa2, moments, 1), imaginary / square / kappa)
    along = [g1 * v[2] * v_i for v_i in v]
    across = [g2 * v[1], -g2 * v[0]]  # v x e_3
    rho = [along[0] + across[0], along[1] + across[1], along[2] + g0]
    return _kernel("spiral", w, p, [zeta * x for x in rho])


def _angle(v: list[ca.SX], length: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Square of theta = |v| l, whether it is below 1, and theta, replaced by 1 where it is.

    The replacement keeps the unused closed form, and its derivatives, free of 0 / 0.
    """
    theta2 = dot(v, v) * length**2
    small = theta2 < 1
    return theta2, small, ca.sqrt(ca.if_else(small, 1, theta2))


def _either(small: ca.SX, series: ca.SX, closed: ca.SX) -> ca.SX:
    return ca.if_else(small, series, closed)


def _series(theta2: ca.SX, first: int) -> ca.SX:
    """Sum of (-theta^2)^n / (2 n + first)!, by Horner's rule."""
    value = ca.SX(0)
    for n in range(TERMS, -1, -1):
        value = 1 / math.factorial(2 * n + first) - theta2 * value
    return value


def _moment_series(kappa2: ca.SX, moments: list[ca.SX], first: int) -> ca.SX:
    """Sum of (-kappa^2)^n m_{2n + first} / (2 n + first)!."""
    value = ca.SX(0)
    last = first + 2 * ((MOMENTS - 1 - first) // 2)
    for j in range(last, first - 1, -2):
        value = moments[j] / math.factorial(j) - kappa2 * value
    return value


def _kernel(name: str, w: ca.SX, p: ca.SX, outputs: list[ca.SX]) -> ca.Function:
    return ca.Function(name, [w, p], [ca.vertcat(*outputs)], ["w", "p"], [name])


@lru_cache(maxsize=64)
def with_slopes(kernel: ca.Function) -> ca.Function:
    """(w, p) -> the kernel's outputs (m) and their derivatives with respect to w (m, n), dense."""
    w, p, value = _symbols(kernel)
    slopes = ca.densify(ca.jacobian(value, w))
    name = f"{kernel.name()}_slopes"
    return ca.Function(name, [w, p], [value, slopes], ["w", "p"], ["value", "slopes"])


@lru_cache(maxsize=64)
def second_along(kernel: ca.Function) -> ca.Function:
    """(w, p, a, b) -> second derivative (m) of the kernel along two directions (n) of w."""
    w, p, value = _symbols(kernel)
    a, b = ca.SX.sym("a", w.size1()), ca.SX.sym("b", w.size1())
    along = ca.jtimes(ca.jtimes(value, w, a), w, b)
    name = f"{kernel.name()}_second"
    return ca.Function(name, [w, p, a, b], [ca.densify(along)], ["w", "p", "a", "b"], ["second"])


def _symbols(kernel: ca.Function) -> tuple[ca.SX, ca.SX, ca.SX]:
    w, p = ca.SX.sym("w", kernel.size1_in(0)), ca.SX.sym("p", kernel.size1_in(1))
    return w, p, kernel(w, p)

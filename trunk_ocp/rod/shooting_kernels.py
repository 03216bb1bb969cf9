"""Compiled equilibrium shapes: multiple shooting along the trunk, in microseconds. Needs numba.

The unknowns are the states at the edges of integration steps, each one step of the eighth-order
method of Dormand & Prince; Newton's method starts from the unloaded shape, known in closed form.
Marching from base to tip carries only four directions of the state (Schloeder's trick: Bock &
Plitt 1984; Schloeder 1988): the three of m(0), and one for the gaps between steps. So a Newton
step costs as little as in single shooting, and converges from as far away as collocation does.

The rod's equations and their derivatives are translated from the instructions of
`equations.rates`, so that they are written once. Two kernels need a few of its terms alone and
repeat them: `_unloaded`, and `_least_stretch` with the strain law of eq. (15). Numba cannot call
CasADi, nor take slices as constants: 0-3 are q, 4-6 m and 7-9 r, as in `equations`.

Loops are written out because numba then allocates nothing; calls on small arrays would take
longer than their arithmetic.
"""

from __future__ import annotations

import inspect
import math
import sys
from typing import Any

import casadi as ca
import numba
import numpy as np

from .._support.casadi_to_python import python_source
from .._support.compiled import compiler
from .dormand_prince import STAGES, A, B, C
from .equations import ARGUMENTS, MEAN, PARAMETERS, RATES, STATES, STRAINS, rate_arguments, rates

PATH = RATES  # q, m, r at a step's edge
COLUMNS = 4  # tangents marched together
VARIED = STATES + STRAINS  # the arguments that tangents vary
NODES = C

MAX_ITERATIONS = 25
STEP_TOL = 1e-4  # on the last Newton step, relative; the error after it is its square
DIVERGED = 1e6  # size of a step
FIRST_LOAD_STEP = 0.25
MIN_LOAD_STEP = 1e-4

# Not "nnan" and "ninf": NaN and infinity must keep their meaning, as they reveal a Newton iteration
# that diverges. Division by zero gives infinity instead of raising.
_OPTIONS: dict[str, Any] = {
    "error_model": "numpy",
    "nogil": True,
    "fastmath": {"reassoc", "contract", "nsz", "arcp"},
}


def _source() -> str:
    """Source of directional_rates: (w, p, D) -> rates (10) and their derivatives (10 x 4) along D.

    D (12 x 4), by columns: four directions of the state (7) and the strains (5).
    """
    (w, p), D = rate_arguments(), ca.SX.sym("D", VARIED, COLUMNS)
    value = rates()(w, p)
    along = ca.densify(ca.mtimes(ca.jacobian(value, w)[:, :VARIED], D))
    function = ca.Function("directional_rates", [w, p, D], [value, along])
    return python_source(function, "directional_rates")


_RATES = _source()
_namespace: dict[str, Any] = {}
exec(_RATES, _namespace)  # source made just above

# Kernels have a copy of all that they call. Otherwise functions that two of them call would come
# from whichever was loaded first, and last digits would depend on that.
_compile: Any = numba.njit(forceinline=True, **_OPTIONS)
_kernel: Any = compiler(inspect.getsource(sys.modules[__name__]) + _RATES, _OPTIONS)
directional_rates = _compile(_namespace["directional_rates"])


@_compile
def _march(x, T, end, T_end, D, w, points, fraction, h, k, kT, p):
    """One step from x (10) with tangents T (4, 10) to `end` (10) with T_end (4, 10).

    D (48): the directions for `directional_rates`; the caller sets those of the strains.
    w (15): the caller sets strains and mean extension. The load, in p from its sixth entry on and
    tip force included, is scaled by `fraction`; w's own tip force stays zero.
    """
    for s in range(STAGES):
        for i in range(STATES):
            value = x[i]
            for j in range(s):
                value += h * A[s, j] * k[j, i]
            w[i] = value
        for c in range(COLUMNS):
            for i in range(STATES):
                value = T[c, i]
                for j in range(s):
                    value += h * A[s, j] * kT[j, c * RATES + i]
                D[c * VARIED + i] = value
        for i in range(5):
            p[i] = points[s, i]
        for i in range(5, 11):
            p[i] = fraction * points[s, i]
        directional_rates(w, p, D, k[s], kT[s])
    for i in range(PATH):
        value = x[i]
        for s in range(STAGES):
            value += h * B[s] * k[s, i]
        end[i] = value
        for c in range(COLUMNS):
            value = T[c, i]
            for s in range(STAGES):
                value += h * B[s] * kT[s, c * RATES + i]
            T_end[c, i] = value


@_compile
def _newton(path, fraction, w, points, h, strain, segment, floor):
    """Newton's method on the path (n + 1, 10) of one rod, in place; whether it converged.

    Each tangent T[e, c] is the change of the path at edge e per unit of dm1, dm2, dm3 (the
    change of m(0)), and for the last, c = 3, the change that closes all gaps up to e.
    """
    n = h.size
    T, end, D = np.zeros((n + 1, COLUMNS, PATH)), np.empty(PATH), np.zeros(COLUMNS * VARIED)
    k, kT, p = np.empty((STAGES, RATES)), np.empty((STAGES, COLUMNS * RATES)), np.empty(PARAMETERS)
    for c in range(3):
        T[0, c, 4 + c] = 1.0
    for _ in range(MAX_ITERATIONS):
        for e in range(n):
            for i in range(4):
                w[STATES + i] = strain[segment[e], i]
            _march(path[e], T[e], end, T[e + 1], D, w, points[e], fraction, h[e], k, kT, p)
            for i in range(PATH):
                T[e + 1, 3, i] += end[i] - path[e + 1, i]
        # m(L) = 0 after the step: three equations for the change of m(0), by Cramer's rule, which
        # needs no pivots and no memory.
        m1, m2, m3 = T[n, 0, 4:7], T[n, 1, 4:7], T[n, 2, 4:7]
        rest = -path[n, 4:7] - T[n, 3, 4:7]
        volume = _triple(m1, m2, m3)
        dm1, dm2, dm3 = _triple(rest, m2, m3), _triple(m1, rest, m3), _triple(m1, m2, rest)
        dm1, dm2, dm3 = dm1 / volume, dm2 / volume, dm3 / volume
        if not abs(dm1) + abs(dm2) + abs(dm3) < np.inf:
            return False  # max() below would ignore NaN
        turn, moment, largest = 0.0, 0.0, floor
        for e in range(n + 1):
            for i in range(PATH):
                change = dm1 * T[e, 0, i] + dm2 * T[e, 1, i] + dm3 * T[e, 2, i] + T[e, 3, i]
                path[e, i] += change
                if i < 4:
                    turn = max(turn, abs(change))
                elif i < STATES:
                    moment = max(moment, abs(change))
                    largest = max(largest, abs(path[e, i]))
        size = turn + moment / largest
        if size < STEP_TOL:
            return True
        if not size < DIVERGED:
            return False
    return False


@_compile
def _triple(a, b, c):
    """Determinant of three columns."""
    return (
        a[0] * (b[1] * c[2] - b[2] * c[1])
        + a[1] * (b[2] * c[0] - b[0] * c[2])
        + a[2] * (b[0] * c[1] - b[1] * c[0])
    )


@_compile
def _unloaded(path, strain, segment, edges, taper, k):
    """Unloaded path from its first point on: one conical spiral per step; see `unloaded`."""
    for e in range(edges.size - 1):
        zeta, c1, c2, c3 = strain[segment[e]]
        width, f = edges[e + 1] - edges[e], taper[e]
        length = -math.log1p(-k * width / f) / k if k > 0.0 else width
        bend = math.sqrt(c1 * c1 + c2 * c2 + c3 * c3)
        scale = 1.0 / bend if bend > 0.0 else 0.0
        a1, a2, a3 = scale * c1, scale * c2, scale * c3
        angle = bend * zeta * length
        real, imaginary = _expm1_over(-k * length, angle)
        real, imaginary = f * length * real, f * length * imaginary
        # In the body frame at the start: the axis's share of e_3, and a wave across the axis.
        along = a3 * (width - real)
        r1 = zeta * (along * a1 + imaginary * a2)
        r2 = zeta * (along * a2 - imaginary * a1)
        r3 = zeta * (along * a3 + real)
        s, v = math.cos(angle / 2), math.sin(angle / 2)
        v1, v2, v3 = v * a1, v * a2, v * a3
        q0, q1, q2, q3 = path[e, 0], path[e, 1], path[e, 2], path[e, 3]
        path[e + 1, 0] = q0 * s - q1 * v1 - q2 * v2 - q3 * v3
        path[e + 1, 1] = q0 * v1 + q1 * s + q2 * v3 - q3 * v2
        path[e + 1, 2] = q0 * v2 + q2 * s + q3 * v1 - q1 * v3
        path[e + 1, 3] = q0 * v3 + q3 * s + q1 * v2 - q2 * v1
        # Rotation of r by q: r + 2 q0 (q x r) + 2 q x (q x r).
        t1, t2, t3 = q2 * r3 - q3 * r2, q3 * r1 - q1 * r3, q1 * r2 - q2 * r1
        path[e + 1, 7] = path[e, 7] + r1 + 2 * (q0 * t1 + q2 * t3 - q3 * t2)
        path[e + 1, 8] = path[e, 8] + r2 + 2 * (q0 * t2 + q3 * t1 - q1 * t3)
        path[e + 1, 9] = path[e, 9] + r3 + 2 * (q0 * t3 + q1 * t2 - q2 * t1)


@_compile
def _expm1_over(x, y):
    """(exp(z) - 1) / z of z = x + i y, real and imaginary part."""
    square = x * x + y * y
    if square < 0.01:  # twelve terms of the series: exp(z) - 1 would lose digits
        real, imaginary = 1.0, 0.0
        for n in range(12, 1, -1):
            real, imaginary = 1.0 + (x * real - y * imaginary) / n, (x * imaginary + y * real) / n
        return real, imaginary
    size = math.exp(x)
    u, v = size * math.cos(y) - 1.0, size * math.sin(y)
    return (u * x + v * y) / square, (v * x - u * y) / square


@_kernel
def unloaded_paths(paths, strain, segment, edges, taper, k):
    """Unloaded paths (B, n + 1, 10) from the first point of each, in place."""
    for b in range(paths.shape[0]):
        _unloaded(paths[b], strain[b], segment, edges, taper, k)


@_compile
def _load(path, trial, w, points, h, strain, segment, floor):
    """Raise the load on a path without load, in place; returns the share of the load reached.

    First all at once, from the guess `trial`; then in steps, as `continuation.raise_load` does.
    """
    reached, ahead, target = 0.0, 2 * FIRST_LOAD_STEP, 1.0
    while ahead >= MIN_LOAD_STEP:
        found = _newton(trial, target, w, points, h, strain, segment, floor)
        if found and _least_stretch(trial, target, w[MEAN], points) > 0.0:
            _copy(trial, path)
            reached, ahead = target, 2 * ahead
            if reached == 1.0:
                break
        else:
            ahead /= 2
        target = min(1.0, reached + ahead)
        _copy(path, trial)
    return reached


@_compile
def _least_stretch(path, fraction, mean, points):
    """Least zeta / zeta_hat (eq. 15) along a path, at the stages of its steps.

    Quaternions are interpolated linearly within a step. That is enough to find a compressed trunk,
    as zeta varies less than they do; `size` makes up for the norm that interpolation loses.
    """
    least = np.inf
    for e in range(path.shape[0] - 1):
        for s in range(STAGES):
            t = NODES[s]
            q0, q1 = _mix(path, e, 0, t), _mix(path, e, 1, t)
            q2, q3 = _mix(path, e, 2, t), _mix(path, e, 3, t)
            size = q0 * q0 + q1 * q1 + q2 * q2 + q3 * q3
            V1, V2, V3 = points[e, s, 5], points[e, s, 6], points[e, s, 7]
            along = 2 * (q1 * q3 + q0 * q2) * V1 + 2 * (q2 * q3 - q0 * q1) * V2
            along += (q0 * q0 - q1 * q1 - q2 * q2 + q3 * q3) * V3
            stretch = 1.0 + fraction * along * mean / (size * points[e, s, 1])
            if not stretch >= least:  # true for NaN, which must not pass
                least = stretch
    return least


@_compile
def _mix(path, e, i, t):
    return (1.0 - t) * path[e, i] + t * path[e + 1, i]


@_compile
def _copy(source, target):
    for e in range(source.shape[0]):
        for i in range(source.shape[1]):
            target[e, i] = source[e, i]


@_kernel
def loaded_paths(paths, starts, mean, points, h, strain, segment, floor, reached):
    """Equilibrium paths (B, n + 1, 10) from guesses, in place.

    starts : unloaded paths, from which the load is raised where a guess does not converge
    points : (n, 12, 11), parameters p of `rates` at the stages of every step, tip force included
    floor : moment in N m; Newton steps of smaller moments are measured against it
    reached : (B,), share of the load at which an equilibrium was found; set here
    """
    w, trial = np.zeros(ARGUMENTS), np.empty(paths.shape[1:])
    for b in range(paths.shape[0]):
        w[MEAN] = mean[b]
        _copy(paths[b], trial)
        _copy(starts[b], paths[b])
        reached[b] = _load(paths[b], trial, w, points, h, strain[b], segment, floor)


@_kernel
def tangent_paths(paths, mean, points, h, strain, segment, base_slopes, T, gap):
    """Tangents T (B, groups, n + 1, 4, 10) along converged paths (B, n + 1, 10).

    The groups of four columns: m(0) and the mean extension; both head angles, by
    `base_slopes` (B, 2, 10), and two of zeros; then each segment's four strains.
    gap : (B,), set to the largest mismatch in q between a step's end and the path: the error of a
    step.

    Groups of four, as `_march` is compiled for four columns.
    """
    end, w, D = np.empty(PATH), np.zeros(ARGUMENTS), np.zeros(COLUMNS * VARIED)
    k, kT, p = np.empty((STAGES, RATES)), np.empty((STAGES, COLUMNS * RATES)), np.empty(PARAMETERS)
    for b in range(paths.shape[0]):
        w[MEAN], gap[b] = mean[b], 0.0
        for group in range(T.shape[1]):
            _first_tangents(T[b, group, 0], D, group, base_slopes[b])
            for e in range(h.size):
                for i in range(4):
                    w[STATES + i] = strain[b, segment[e], i]
                    D[VARIED * i + STATES + i] = 1.0 if group == segment[e] + 2 else 0.0
                at, to = T[b, group, e], T[b, group, e + 1]
                _march(paths[b, e], at, end, to, D, w, points[e], 1.0, h[e], k, kT, p)
                for i in range(4):
                    gap[b] = max(gap[b], abs(end[i] - paths[b, e + 1, i]))


@_compile
def _first_tangents(T, D, group, base_slopes):
    """Tangents (4, 10) at the base, and strain directions of the columns, for one group."""
    for c in range(COLUMNS):
        for i in range(PATH):
            T[c, i] = base_slopes[c, i] if group == 1 and c < 2 else 0.0
        for i in range(VARIED):
            D[VARIED * c + i] = 0.0
    if group == 0:
        for c in range(3):
            T[c, 4 + c] = 1.0
        D[VARIED * 3 + STATES + 4] = 1.0

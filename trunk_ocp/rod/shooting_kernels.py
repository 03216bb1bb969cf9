"""Compiled equilibrium shapes: multiple shooting along the trunk, in microseconds. Needs numba.

The unknowns are the states at the edges of integration steps, each one step of the eighth-order
method of Dormand & Prince; Newton's method starts from the unloaded shape, known in closed form.
Marching from base to tip carries only four directions of the state (Schloeder's trick: Bock &
Plitt 1984; Schloeder 1988): the three of m(0), and one for the gaps between steps. So a Newton
step costs as little as in single shooting, and converges from as far away as collocation does.

Four rods, or four groups of tangents of one rod, go side by side in the lanes of vector registers;
see `step_source`, where the rod's equations come from. Two kernels need a few of their terms alone
and repeat them: `_unloaded`, and `_least_stretch` with the strain law of eq. (15). Numba cannot
take slices as constants: 0-3 are q, 4-6 m and 7-9 r, as in `equations`.

Loops are written out because numba then allocates nothing; calls on small arrays would take
longer than their arithmetic.
"""

from __future__ import annotations

import inspect
import math
import sys
from typing import Any

import numba
import numpy as np

from .._support.compiled import compiler
from . import step_source
from .dormand_prince import STAGES
from .dormand_prince import C as NODES
from .equations import PARAMETERS, STATES, STRAINS
from .step_source import (
    COLUMNS,
    KEPT,
    LANES,
    NUMBERS,
    PATH,
    POINT,
    RATE,
    SIZE,
    STAGE,
    START,
    STRAIN,
    TURNED,
)

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

_SOURCE = step_source.python()
_namespace: dict[str, Any] = {}
exec(_SOURCE, _namespace)  # source made just above

# Kernels have a copy of all that they call. Otherwise functions that two of them call would come
# from whichever was loaded first, and last digits would depend on that.
_compile: Any = numba.njit(forceinline=True, **_OPTIONS)
_TEXT = inspect.getsource(sys.modules[__name__]) + inspect.getsource(step_source) + _SOURCE
_kernel: Any = compiler(_TEXT, _OPTIONS)
directional_rates, combine = map(_compile, (_namespace["directional_rates"], _namespace["combine"]))


@_compile
def _march(edge, b, points, fraction, h):
    """One step from an edge (200); leaves its end at STAGE in the array b.

    The caller sets the strains and their derivatives in b. The load, in points (12, 11) from the
    sixth column on and tip force included, is scaled by fraction (4); the tip force in b stays 0.
    """
    for i in range(LANES * NUMBERS):
        b[LANES * START + i] = edge[i]
    for s in range(STAGES):
        combine(b, s, h)
        for i in range(PARAMETERS):
            for lane in range(LANES):
                scale = fraction[lane] if i >= 5 else 1.0
                b[LANES * (POINT + i) + lane] = scale * points[s, i]
        directional_rates(b)
        for i in range(LANES * NUMBERS):
            b[LANES * (KEPT + s * NUMBERS) + i] = b[LANES * RATE + i]
    combine(b, STAGES, h)


@_compile
def _newton(edges, active, fraction, b, points, h, strain, segment, floor):
    """Newton's method on the paths of active lanes, in place; leaves those active that converged.

    edges : (n + 1, 200), paths, and tangents that are set here. Each is the change of the path at
    an edge per unit of dm1, dm2, dm3 (the change of m(0)), and for the last, the change that
    closes all gaps up to there.
    """
    n, step, moving = h.size, np.zeros((COLUMNS, LANES)), np.empty(LANES, dtype=np.bool_)
    turn, moment, largest = np.empty(LANES), np.empty(LANES), np.empty(LANES)
    for lane in range(LANES):
        moving[lane] = active[lane]
    for i in range(LANES * COLUMNS * STRAINS):
        b[LANES * TURNED + i] = 0.0
    for i in range(LANES * PATH, LANES * NUMBERS):
        edges[0, i] = 0.0
    for c in range(3):
        for lane in range(LANES):
            edges[0, LANES * (PATH * (1 + c) + 4 + c) + lane] = 1.0
    for _ in range(MAX_ITERATIONS):
        for e in range(n):
            for i in range(4):
                for lane in range(LANES):
                    b[LANES * (STRAIN + i) + lane] = strain[lane, segment[e], i]
            _march(edges[e], b, points[e], fraction, h[e])
            for i in range(LANES * PATH, LANES * NUMBERS):
                edges[e + 1, i] = b[LANES * STAGE + i]
            for i in range(LANES * PATH):
                edges[e + 1, LANES * PATH * COLUMNS + i] += b[LANES * STAGE + i] - edges[e + 1, i]
        for lane in range(LANES):
            _solve_tip(edges[n], step, moving, active, lane)
            turn[lane], moment[lane], largest[lane] = 0.0, 0.0, floor
        for e in range(n + 1):
            for i in range(PATH):
                for lane in range(LANES):
                    if moving[lane]:
                        at, change = LANES * i + lane, 0.0
                        for c in range(COLUMNS):
                            change += step[c, lane] * edges[e, at + LANES * PATH * (1 + c)]
                        edges[e, at] += change
                        if i < 4:
                            turn[lane] = max(turn[lane], abs(change))
                        elif i < STATES:
                            moment[lane] = max(moment[lane], abs(change))
                            largest[lane] = max(largest[lane], abs(edges[e, at]))
        left = False
        for lane in range(LANES):
            if moving[lane]:
                size = turn[lane] + moment[lane] / largest[lane]
                active[lane] = size < DIVERGED
                moving[lane] = active[lane] and not size < STEP_TOL
                left = left or moving[lane]
        if not left:
            return
    for lane in range(LANES):
        active[lane] = active[lane] and not moving[lane]


@_compile
def _solve_tip(tip, step, moving, active, lane):
    """Set a lane's step so that m(L) = 0 after it: three equations for the change of m(0).

    By Cramer's rule, which needs no pivots and no memory. A lane without a finite solution stops.
    """
    m1, m2, m3 = _moment(tip, 1, lane), _moment(tip, 2, lane), _moment(tip, 3, lane)
    m, gap = _moment(tip, 0, lane), _moment(tip, 4, lane)
    rest = (-m[0] - gap[0], -m[1] - gap[1], -m[2] - gap[2])
    volume = _triple(m1, m2, m3)
    step[0, lane] = _triple(rest, m2, m3) / volume
    step[1, lane] = _triple(m1, rest, m3) / volume
    step[2, lane] = _triple(m1, m2, rest) / volume
    step[3, lane] = 1.0
    finite = abs(step[0, lane]) + abs(step[1, lane]) + abs(step[2, lane]) < np.inf
    if moving[lane] and not finite:  # max() would ignore NaN
        moving[lane] = active[lane] = False


@_compile
def _moment(edge, vector, lane):
    """Moment of a lane's path (0) or of one of its tangents (1 to 4) at an edge."""
    at = LANES * (PATH * vector + 4) + lane
    return edge[at], edge[at + LANES], edge[at + 2 * LANES]


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
def _raise_load(paths, edges, reached, b, points, h, strain, segment, floor):
    """Raise the load on four paths (4, n + 1, 10) without load, in place, from guesses in `edges`.

    First all at once; then in steps, as `continuation.raise_load` does. Sets the share of the load
    that is reached, (4,).
    """
    ahead, target = np.empty(LANES), np.empty(LANES)
    active, left = np.empty(LANES, dtype=np.bool_), True
    for lane in range(LANES):
        ahead[lane], target[lane], active[lane] = 2 * FIRST_LOAD_STEP, 1.0, True
    while left:
        _newton(edges, active, target, b, points, h, strain, segment, floor)
        left = False
        for lane in range(LANES):
            if reached[lane] == 1.0 or ahead[lane] < MIN_LOAD_STEP:
                active[lane] = False
                continue
            mean = b[LANES * (STRAIN + 4) + lane]
            if active[lane] and _least_stretch(edges, lane, target[lane], mean, points) > 0.0:
                _copy_out(edges, paths[lane], lane)
                reached[lane], ahead[lane] = target[lane], 2 * ahead[lane]
            else:
                ahead[lane] /= 2
            target[lane] = min(1.0, reached[lane] + ahead[lane])
            _copy_in(paths[lane], edges, lane)
            active[lane] = reached[lane] < 1.0 and ahead[lane] >= MIN_LOAD_STEP
            left = left or active[lane]


@_compile
def _least_stretch(edges, lane, fraction, mean, points):
    """Least zeta / zeta_hat (eq. 15) along a lane's path, at the stages of its steps.

    Quaternions are interpolated linearly within a step. That is enough to find a compressed trunk,
    as zeta varies less than they do; `size` makes up for the norm that interpolation loses.
    """
    least = np.inf
    for e in range(edges.shape[0] - 1):
        for s in range(STAGES):
            t = NODES[s]
            q0, q1 = _mix(edges, e, lane, t), _mix(edges, e, LANES + lane, t)
            q2, q3 = _mix(edges, e, 2 * LANES + lane, t), _mix(edges, e, 3 * LANES + lane, t)
            size = q0 * q0 + q1 * q1 + q2 * q2 + q3 * q3
            V1, V2, V3 = points[e, s, 5], points[e, s, 6], points[e, s, 7]
            along = 2 * (q1 * q3 + q0 * q2) * V1 + 2 * (q2 * q3 - q0 * q1) * V2
            along += (q0 * q0 - q1 * q1 - q2 * q2 + q3 * q3) * V3
            stretch = 1.0 + fraction * along * mean / (size * points[e, s, 1])
            if not stretch >= least:  # true for NaN, which must not pass
                least = stretch
    return least


@_compile
def _mix(edges, e, i, t):
    return (1.0 - t) * edges[e, i] + t * edges[e + 1, i]


@_compile
def _copy(source, target):
    for i in range(source.shape[0]):
        for j in range(source.shape[1]):
            target[i, j] = source[i, j]


@_compile
def _copy_in(path, edges, lane):
    for e in range(path.shape[0]):
        for i in range(PATH):
            edges[e, LANES * i + lane] = path[e, i]


@_compile
def _copy_out(edges, path, lane):
    for e in range(path.shape[0]):
        for i in range(PATH):
            path[e, i] = edges[e, LANES * i + lane]


@_kernel
def loaded_paths(paths, starts, mean, points, h, strain, segment, floor, reached):
    """Equilibrium paths (B, n + 1, 10) from guesses, in place.

    starts : unloaded paths, from which the load is raised where a guess does not converge
    points : (n, 12, 11), parameters p of `rates` at the stages of every step, tip force included
    floor : moment in N m; Newton steps of smaller moments are measured against it
    reached : (B,), share of the load at which an equilibrium was found; set here
    """
    n, last = h.size, paths.shape[0] - 1
    b, edges = np.zeros(LANES * SIZE), np.zeros((n + 1, LANES * NUMBERS))
    four, share = np.empty((LANES, n + 1, PATH)), np.empty(LANES)
    strains = np.empty((LANES, strain.shape[1], 4))
    for first in range(0, last + 1, LANES):
        for lane in range(LANES):
            rod = min(first + lane, last)
            _copy_in(paths[rod], edges, lane)
            _copy(starts[rod], four[lane])
            _copy(strain[rod], strains[lane])
            share[lane] = 0.0
            b[LANES * (STRAIN + 4) + lane] = mean[rod]
        _raise_load(four, edges, share, b, points, h, strains, segment, floor)
        for lane in range(min(LANES, last + 1 - first)):
            _copy(four[lane], paths[first + lane])
            reached[first + lane] = share[lane]


@_kernel
def tangent_paths(paths, mean, points, h, strain, segment, base_slopes, T, gap):
    """Tangents T (B, groups, n + 1, 4, 10) along converged paths (B, n + 1, 10).

    The groups of four columns: m(0) and the mean extension; both head angles, by
    `base_slopes` (B, 2, 10), and two of zeros; then each segment's four strains. One group per
    lane.
    gap : (B,), set to the largest mismatch in q between a step's end and the path: the error of a
    step.
    """
    b, edge, whole = np.zeros(LANES * SIZE), np.empty(LANES * NUMBERS), np.ones(LANES)
    groups = T.shape[1]
    for rod in range(paths.shape[0]):
        gap[rod] = 0.0
        for first in range(0, groups, LANES):
            for lane in range(min(LANES, groups - first)):
                _first_tangents(T[rod, first + lane, 0], b, first + lane, lane, base_slopes[rod])
            for e in range(h.size):
                for lane in range(LANES):
                    group = min(first + lane, groups - 1)
                    _set_group(edge, b, paths[rod, e], T[rod, group, e], lane)
                    b[LANES * (STRAIN + 4) + lane] = mean[rod]
                    for i in range(4):
                        b[LANES * (STRAIN + i) + lane] = strain[rod, segment[e], i]
                        own = 1.0 if group == segment[e] + 2 else 0.0
                        b[LANES * (TURNED + STRAINS * i + i) + lane] = own
                _march(edge, b, points[e], whole, h[e])
                for lane in range(min(LANES, groups - first)):
                    for i in range(COLUMNS * PATH):
                        T[rod, first + lane, e + 1, i // PATH, i % PATH] = b[
                            LANES * (STAGE + PATH + i) + lane
                        ]
                for i in range(4):
                    off = b[LANES * (STAGE + i)] - paths[rod, e + 1, i]
                    gap[rod] = max(gap[rod], abs(off))


@_compile
def _set_group(edge, b, path, T, lane):
    """Put a path (10) and a group of its tangents (4, 10) in a lane of an edge."""
    for i in range(PATH):
        edge[LANES * i + lane] = path[i]
    for c in range(COLUMNS):
        for i in range(PATH):
            edge[LANES * (PATH * (1 + c) + i) + lane] = T[c, i]


@_compile
def _first_tangents(T, b, group, lane, base_slopes):
    """Tangents (4, 10) at the base, and in b the strain directions of the columns, for a group."""
    for c in range(COLUMNS):
        for i in range(PATH):
            T[c, i] = base_slopes[c, i] if group == 1 and c < 2 else 0.0
        for i in range(STRAINS):
            b[LANES * (TURNED + STRAINS * c + i) + lane] = 0.0
    if group == 0:
        for c in range(3):
            T[c, 4 + c] = 1.0
        b[LANES * (TURNED + STRAINS * 3 + 4) + lane] = 1.0

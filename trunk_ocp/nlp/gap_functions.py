"""Gaps between cross-sections of the trunk and solids, and between two sections, for the NLP.

A cross-section is a disc with center r, normal d_3 and radius R. By (*) in `model.solids`, and
because a disc reaches R sqrt(1 - (n . d_3)^2) along a unit vector n,

    gap = distance(r) - R sqrt(1 - (n . d_3)^2)

is never more than the disc's distance from a convex solid. It equals it where n is perpendicular
to d_3, as at a minimum of the gap along the trunk, and for a flat surface. For two discs, the
projection on the line between their centers gives such a bound. Gaps in contact are therefore
exact, and those at the edge of the tip on the safe side.

Lengths are in units of L. The normals of a box, a capsule and a cylinder turn without a jump, but
their derivatives jump where the nearest point passes an edge or an end. So does the first
derivative of a gap there, unless n is perpendicular to d_3, as in contact; the motions tried
converged as fast as with spheres.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, lru_cache

import casadi as ca

from ..model.head import turn_quaternion
from ..model.quaternions import directors
from ..rod.equations import RATES, rate_arguments
from .point_functions import scaled_rates

TILT = 0.02
"""Smooths sqrt(1 - c^2) at c = 1, where a section faces a solid; the gap loses 2 % of R there."""
TINY = 1e-24
"""Keeps derivatives of lengths finite at 0; changes no gap that may be in contact."""
NEWTON_STEPS = 12
"""Of the distance from an ellipsoid; the error is below 1e-12 for axes in a ratio up to 10."""
OFF_SYMMETRY = 1e-7
"""How far points are moved off an ellipsoid's planes of symmetry, over its half axes."""

SIZES = {"sphere": 1, "capsule": 2, "cylinder": 2, "half-space": 0, "box": 3, "ellipsoid": 3}
Signed = Callable[[ca.SX, ca.SX], tuple[ca.SX, ca.SX]]


@cache
def solid_gap(shape: str, in_head: bool) -> ca.Function:
    """Gap of a section from a solid.

    w: r (3), q (4), volume ratio (1); for a solid that moves with the head, head angles (2) too.
    p: center (3), axes (9, row by row), pivot of the head (3), radius R_0(Z), sizes.
    """
    w = ca.SX.sym("w", 10 if in_head else 8)
    p = ca.SX.sym("p", 16 + SIZES[shape])
    r, d3, volume = w[:3], _tangent(w[3:7]), w[7]
    center, axes, pivot, radius, sizes = (
        p[:3], ca.reshape(p[3:12], 3, 3).T, p[12:15], p[15], p[16:],
    )  # fmt: skip
    if in_head:  # see the trunk from the head
        rows = [ca.vertcat(*d) for d in directors(turn_quaternion(w[8], w[9]))]
        back = ca.horzcat(*rows).T
        r, d3 = pivot + ca.mtimes(back, r - pivot), ca.mtimes(back, d3)
    distance, normal = _SIGNED[shape](ca.mtimes(axes, r - center), sizes)
    along = ca.dot(normal, ca.mtimes(axes, d3))
    return ca.Function("solid_gap", [w, p], [distance - _reach(radius, volume, along)])


@cache
def section_gap() -> ca.Function:
    """Gap between two sections.

    w: r (3), q (4) of one, r (3), q (4) of the other, volume ratio (1). p: their radii R_0(Z).
    """
    w, p = ca.SX.sym("w", 15), ca.SX.sym("p", 2)
    between = w[:3] - w[7:10]
    length = _length(between)
    normal, volume = between / length, w[14]
    gap = length
    for radius, q in ((p[0], w[3:7]), (p[1], w[10:14])):
        gap = gap - _reach(radius, volume, ca.dot(normal, _tangent(q)))
    return ca.Function("section_gap", [w, p], [gap])


@lru_cache(maxsize=64)
def scaled_stretch(length: float, moment: float) -> ca.Function:
    """Extension zeta of the loaded rod, with the arguments of `scaled_rates`."""
    w, p = rate_arguments()
    d3 = ca.vertcat(*directors(ca.vertsplit(w[:4]))[2])
    slope = scaled_rates(length, moment)(w, p)[RATES - 3 :]
    return ca.Function("stretch", [w, p], [ca.dot(slope, d3) / ca.sumsqr(d3)])


def _tangent(q: ca.SX) -> ca.SX:
    """Unit vector d_3; inside elements |q| is not exactly 1."""
    return ca.vertcat(*directors(ca.vertsplit(q))[2]) / ca.sumsqr(q)


def _reach(radius: ca.SX, volume: ca.SX, along: ca.SX) -> ca.SX:
    """How far a section reaches along a unit vector with component `along` in d_3.

    The factor 1 / sqrt(volume) keeps the volume of the trunk (eq. 30, for the loaded trunk).
    """
    return radius / ca.sqrt(volume) * ca.sqrt(1 - along**2 + TILT**2)


def _length(x: ca.SX) -> ca.SX:
    return ca.sqrt(ca.sumsqr(x) + TINY)


def _with_gradient(distance: Callable[[ca.SX, ca.SX], ca.SX]) -> Signed:
    def signed(x: ca.SX, sizes: ca.SX) -> tuple[ca.SX, ca.SX]:
        at, of = ca.SX.sym("x", 3), ca.SX.sym("sizes", sizes.numel())
        symbolic = distance(at, of)
        both = ca.Function("both", [at, of], [symbolic, ca.gradient(symbolic, at)])
        value, gradient = both(x, sizes)
        return value, gradient

    return signed


def _capsule(x: ca.SX, sizes: ca.SX) -> ca.SX:
    on_axis = ca.fmin(ca.fmax(x[2], -sizes[1]), sizes[1])
    return _length(ca.vertcat(x[0], x[1], x[2] - on_axis)) - sizes[0]


def _from_faces(beyond: ca.SX) -> ca.SX:
    """Distance from a box, or from a cylinder, given how far a point is beyond each face."""
    inside = beyond[0]
    for i in range(1, beyond.numel()):
        inside = ca.fmax(inside, beyond[i])
    return _length(ca.fmax(beyond, 0)) + ca.fmin(inside, 0)


def _ellipsoid(x: ca.SX, sizes: ca.SX) -> tuple[ca.SX, ca.SX]:
    """As in `model.solids`, with a fixed number of steps.

    Inside, derivatives do not exist on planes of symmetry, in which a symmetric motion may lie;
    it steps off them by so little that distances outside change by 1e-14 only.
    """
    off = OFF_SYMMETRY * sizes
    x = x + ca.if_else(ca.fabs(x) < off, 2 * off, 0)
    a2 = sizes**2
    first = sizes * ca.fabs(x) - a2
    t = ca.fmax(ca.fmax(first[0], first[1]), first[2])
    for _ in range(NEWTON_STEPS):
        terms = (sizes * x / (a2 + t)) ** 2
        t = t + (ca.sum1(terms) - 1) / (2 * ca.sum1(terms / (a2 + t)))
    toward = x / (a2 + t)
    length = _length(toward)
    return t * length, toward / length


_SIGNED: dict[str, Signed] = {
    "sphere": _with_gradient(lambda x, sizes: _length(x) - sizes[0]),
    "capsule": _with_gradient(_capsule),
    "cylinder": _with_gradient(
        lambda x, s: _from_faces(ca.vertcat(_length(x[:2]) - s[0], ca.fabs(x[2]) - s[1]))
    ),
    "half-space": lambda x, sizes: (x[2], ca.SX([0, 0, 1])),
    "box": _with_gradient(lambda x, sizes: _from_faces(ca.fabs(x) - sizes)),
    "ellipsoid": _ellipsoid,
}

"""The small symbolic functions that a window's NLP consists of.

Each takes (w, p), unknowns and parameters of one place. Lengths are in units of L, moments in
E I(0) / L; see `window`.
"""

from __future__ import annotations

from functools import cache, lru_cache

import casadi as ca

from ..model.anatomy import Trunk
from ..model.head import base_pose
from ..model.quaternions import Scalar, about_y, about_z, directors, product
from ..model.solids import pivot
from ..rod.equations import rate_arguments, rates


@lru_cache(maxsize=64)
def scaled_rates(length: float, moment: float, hung: bool = False) -> ca.Function:
    """`rates` in the NLP's units (lengths in L, moments in E I(0) / L), per L of Z."""
    w, p = rate_arguments(hung)
    name = "hung_rates" if hung else "rates"
    return ca.Function(name, [w, p], [_in_units(w, p, length, moment, hung)])


@cache
def rates_in_units(hung: bool = False) -> ca.Function:
    """The same with length and moment as last parameters: one function, whatever the trunk."""
    w, p = rate_arguments(hung)
    units = ca.SX.sym("units", 2)
    rates = _in_units(w, p, units[0], units[1], hung)
    return ca.Function("rates_in_units", [w, ca.vertcat(p, units)], [rates])


def _in_units(w: ca.SX, p: ca.SX, length: Scalar, moment: Scalar, hung: bool) -> ca.SX:
    to_si = ca.vertcat(*4 * [1], *3 * [moment], 1, *3 * [1 / length], 1, *3 * [moment / length])
    to_units = ca.vertcat(*4 * [length], *3 * [length / moment], 1, 1, 1)
    return to_units * rates(hung)(to_si * w, p)


@lru_cache(maxsize=64)
def base(trunk: Trunk) -> ca.Function:
    """Base position in units of L, and orientation, from the head angles."""
    psi = ca.SX.sym("psi", 2)
    r, q = base_pose(trunk.head, psi[0], psi[1])
    pose = ca.vertcat(*(x / trunk.length for x in r), *q)
    return ca.Function("base", [psi, ca.SX.sym("p", 0)], [pose])


@cache
def director(j: int) -> ca.Function:
    """Director j of an orientation q (4), normalized: inside an element |q| is not exactly 1."""
    q = ca.SX.sym("q", 4)
    unit = ca.vertcat(*_d(q, j)) / ca.sumsqr(q)
    return ca.Function("director", [q, ca.SX.sym("p", 0)], [unit])


def _d(q: ca.SX, j: int) -> tuple[ca.SX, ...]:
    return directors(ca.vertsplit(q))[j]


@cache
def scaled_vector() -> ca.Function:
    """A held direction (3) times the strength of a pull."""
    D, p = ca.SX.sym("D", 3), ca.SX.sym("p")
    return ca.Function("scaled_vector", [D, p], [p * D])


@lru_cache(maxsize=64)
def squared_distance(length: float) -> ca.Function:
    """Weighted squared distance in m^2 of r (3) from p = (target in m, weight)."""
    r, p = ca.SX.sym("r", 3), ca.SX.sym("p", 4)
    return ca.Function("squared_distance", [r, p], [p[3] * ca.sumsqr(length * r - p[:3])])


@lru_cache(maxsize=64)
def squared_distance_in_head(trunk: Trunk) -> ca.Function:
    """`squared_distance` for w = (r, head angles) from a target that turns with the head."""
    w, p = ca.SX.sym("w", 5), ca.SX.sym("p", 4)
    S = ca.DM(pivot(trunk))
    difference = trunk.length * w[:3] - S - _turned(p[:3] - S, w[3:])
    return ca.Function("squared_distance_in_head", [w, p], [p[3] * ca.sumsqr(difference)])


def _turned(v: ca.SX, psi: ca.SX) -> ca.SX:
    """A vector (3) of the head's frame in space, at head angles psi (2)."""
    turn = directors(product(about_z(psi[0]), about_y(psi[1])))
    return ca.vertcat(*(sum(v[i] * turn[i][k] for i in range(3)) for k in range(3)))


@cache
def squared_direction(j: int) -> ca.Function:
    """Weighted squared error of director j of q (4) against p = (direction, weight)."""
    q, p = ca.SX.sym("q", 4), ca.SX.sym("p", 4)
    difference = ca.vertcat(*_d(q, j)) - p[:3]
    return ca.Function("squared_direction", [q, p], [p[3] * ca.sumsqr(difference)])


@cache
def squared_direction_in_head(j: int) -> ca.Function:
    """`squared_direction` for w = (q, head angles) from a direction that turns with the head."""
    w, p = ca.SX.sym("w", 6), ca.SX.sym("p", 4)
    difference = ca.vertcat(*_d(w[:4], j)) - _turned(p[:3], w[4:])
    return ca.Function("squared_direction_in_head", [w, p], [p[3] * ca.sumsqr(difference)])


@cache
def squared_held_direction(j: int) -> ca.Function:
    """The same against a direction that is itself unknown, w = (q, direction)."""
    w, p = ca.SX.sym("w", 7), ca.SX.sym("p")
    difference = ca.vertcat(*_d(w[:4], j)) - w[4:]
    return ca.Function("squared_held_direction", [w, p], [p * ca.sumsqr(difference)])


@cache
def square() -> ca.Function:
    """Weighted square."""
    x, p = ca.SX.sym("x"), ca.SX.sym("p")
    return ca.Function("square", [x, p], [p * x**2])


@cache
def squared_change() -> ca.Function:
    """Weighted square of the difference of two unknowns."""
    x, p = ca.SX.sym("x", 2), ca.SX.sym("p")
    return ca.Function("squared_change", [x, p], [p * (x[1] - x[0]) ** 2])


@cache
def weighted() -> ca.Function:
    """An unknown times its weight."""
    x, p = ca.SX.sym("x"), ca.SX.sym("p")
    return ca.Function("weighted", [x, p], [p * x])

"""Rods without muscles against the closed forms of beam theory."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from scipy.integrate import quad

from trunk_ocp.model.loads import Loads, vector
from trunk_ocp.rod.collocation import mesh_for
from trunk_ocp.rod.shape import Shape
from trunk_ocp.rod.statics import solve_statics

from .case import Case, Values, flat
from .rods import HORIZONTAL, NONE, activation_for, bender, rod, wire

SUBJECT = "Beams"
SMALL_EI = 1e6 * math.pi / 4 * 0.05**4  # of `rod()`, in N m^2

COUPLES = (1.0, 3.0, -5.0, 2 * math.pi)  # M L / E I


def small_tip_force() -> Values:
    """Deflection, slope and base moment along X and Y, divided by their tip values."""
    EI, F, Z, found, expected = SMALL_EI, 1e-4, np.array([0.3, 0.7, 1.0]), [], []
    for axis, sign in ((0, 1.0), (1, -1.0)):
        force = np.zeros(3)
        force[axis] = F
        shape = solve_statics(rod(), NONE, loads=Loads(0.0, vector(force)))
        found += [
            shape.position(Z)[:, axis] * 3 * EI / F,
            shape.directors(Z)[:, 2, axis] * 2 * EI / F,
            shape.moment(np.zeros(1))[0, [1 - axis]] / F,
        ]
        expected += [Z**2 * (3 - Z) / 2, Z * (2 - Z), np.array([sign])]
    return flat(found, expected)


def small_weight() -> Values:
    """Sag of a horizontal rod, divided by w L^4 / 8 E I."""
    g = 1e-5
    w = 1000 * math.pi * 0.05**2 * g
    sag = solve_statics(rod(), NONE, HORIZONTAL, Loads(g)).position(np.array([1.0]))[0, 2]
    return np.array([sag * 8 * SMALL_EI / w]), np.ones(1)


def small_spread_force() -> Values:
    """Tip deflection, divided by that of the same force at the tip."""
    W, a = 1e-4, 0.6
    load = Loads(0.0, contact_from=a, contact_force=(W, 0, 0))
    x = solve_statics(rod(), NONE, loads=load).position(np.array([1.0]))[0, 0]
    # Point loads W ds / (1 - a) at s in [a, 1], each with the tip deflection s^2 (3 - s) / 6 E I.
    expected = ((1 - a**3) - (1 - a**4) / 4) / (2 * (1 - a))
    return np.array([x * 3 * SMALL_EI / W]), np.array([expected])


def beam_column() -> Values:
    """Tip deflection by a side force under thrust, divided by the closed form."""
    side, found = 1e-6, []
    for part in (0.5, 0.9, 0.99):
        a = math.sqrt(part) * math.pi / 2
        load = Loads(0.0, (side, 0, -(a**2)))
        x = solve_statics(wire(), NONE, loads=load).position(np.array([1.0]))[0, 0]
        found.append(x / (side * (math.tan(a) - a) / a**3))
    return np.array(found), np.ones(3)


def hanging() -> Values:
    """Tips of rods that hang straight down, pulled and heavy."""
    found, expected = [], []
    for taper in (0.0, 1.5):
        hung = rod(taper_deg=taper)
        shape = solve_statics(hung, NONE, loads=Loads(9.8, (0, 0, 50.0)))
        slope = math.tan(math.radians(taper))
        b = 0.05 - slope

        def strain(Z: float, slope: float = slope, b: float = b) -> float:
            a = 0.05 - Z * slope
            weight = 9.8 * 1000 * math.pi / 3 * (1 - Z) * (a * a + a * b + b * b)
            return (50 + weight) / (1e6 * math.pi * a**2)

        found.append(shape.position(np.array([1.0]))[0])
        expected.append([0, 0, 1 + quad(strain, 0, 1, epsrel=1e-13)[0]])
    return np.array(found), np.array(expected)


@cache
def rolled(couple: float, Z_w: float) -> Shape:
    """The wire under a couple about Y, spread over [Z_w, L]."""
    load = Loads(0.0, contact_from=Z_w, contact_couple=(0.0, couple, 0.0))
    return solve_statics(wire(), NONE, loads=load, mesh=mesh_for(wire(), Z_w, elements=12))


def arcs() -> Values:
    """Positions before Z_w, which lie on a circle."""
    Z_w, found, expected = 0.6, [], []
    Z = np.array([0.2, 0.4, Z_w])
    for couple in COUPLES:
        found.append(rolled(couple, Z_w).position(Z))
        arc = [1 - np.cos(couple * Z), 0 * Z, np.sin(couple * Z)]
        expected.append(np.stack(arc, axis=1) / couple)
    return np.array(found), np.array(expected)


def roll_up() -> Values:
    """Tips under 2 pi E I / L spread over a span that shrinks to the tip."""
    couple, found, expected = 2 * math.pi, [], []
    for Z_w in (0.6, 0.9, 0.99, 0.999):

        def angle(Z: float, Z_w: float = Z_w) -> float:
            return couple * (Z - max(0.0, Z - Z_w) ** 2 / (2 * (1 - Z_w)))

        found.append(rolled(couple, Z_w).position(np.array([1.0]))[0, [0, 2]])
        expected.append(
            [
                quad(lambda Z, f=f: f(angle(Z)), 0, 1, points=[Z_w], epsabs=1e-13)[0]
                for f in (math.sin, math.cos)
            ]
        )
    return np.array(found), np.array(expected)


def closed_circle() -> Values:
    """Tip and tangent of rods whose intrinsic curvature makes one or two whole turns."""
    ring, found = bender(), []
    for turns, extension in ((1, 1.0), (2, 0.8), (-1, 1.2)):
        curvature = (0.0, 2 * math.pi * turns / extension, 0.0)
        activation = activation_for(ring, extension, curvature)
        mesh = mesh_for(ring, elements=12)
        shape = solve_statics(ring, activation, loads=Loads(0.0), mesh=mesh)
        tip = np.array([1.0])
        found.append([*shape.position(tip)[0], *shape.directors(tip)[0, 2]])
    return np.array(found), np.tile([0.0, 0, 0, 0, 0, 1], (3, 1))


CASES = (
    Case(
        SUBJECT,
        "Small tip force: deflection, slope and moment along X and Y",
        "Euler-Bernoulli, F z^2 (3 L - z) / 6 E I",
        small_tip_force,
        1e-8,
        "bending by 7e-6 L; geometry enters squared",
    ),
    Case(
        SUBJECT,
        "Small own weight: sag of the tip",
        "Euler-Bernoulli, w L^4 / 8 E I",
        small_weight,
        1e-8,
        "sag 2e-6 L, squared",
    ),
    Case(
        SUBJECT,
        "Small force spread over [0.6 L, L]: deflection of the tip",
        "superposition of point loads",
        small_spread_force,
        1e-8,
        "deflection 7e-6 L, squared",
    ),
    Case(
        SUBJECT,
        "Side force under 50, 90 and 99 % of Euler's thrust: deflection",
        "F (tan a - a) / a^3, a^2 = P L^2 / E I (Timoshenko & Gere 1961, beam columns)",
        beam_column,
        2e-6,
        "deflection up to 4e-5 L, squared, amplified",
    ),
    Case(
        SUBJECT,
        "Stretch of hanging rods, with and without taper, heavy and pulled",
        "integral of force / E A by adaptive quadrature",
        hanging,
        1e-12,
        "collocation, round-off",
        "m",
    ),
    Case(
        SUBJECT,
        "Couple spread over [0.6 L, L], M L / E I = 1, 3, -5, 2 pi: arc before it",
        "curvature M / E I",
        arcs,
        1e-9,
        "collocation; Newton's last step",
        "L",
    ),
    Case(
        SUBJECT,
        "Roll-up: M = 2 pi E I / L over [Z_w, L] as Z_w -> L, position of the tip",
        "angle M (Z - (Z - Z_w)^2 / 2 (L - Z_w)) / E I, adaptive quadrature",
        roll_up,
        1e-10,
        "collocation; quadrature at 1e-13",
        "L",
    ),
    Case(
        SUBJECT,
        "Roll-up by intrinsic curvature, -1, 1 and 2 turns at three extensions: tip meets base",
        "closed circles",
        closed_circle,
        1e-10,
        "12 elements of degree 6 for two turns",
        "L",
    ),
)

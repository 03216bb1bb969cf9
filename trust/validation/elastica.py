"""Large deflections: published figures, elliptic integrals, scalar equations, a spatial bend."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from scipy.integrate import solve_bvp, solve_ivp
from scipy.linalg import eigvalsh_tridiagonal
from scipy.optimize import brentq, root
from scipy.special import ellipe, ellipeinc, ellipk, ellipkinc

from trunk_ocp.model.loads import Loads
from trunk_ocp.rod.collocation import mesh_for
from trunk_ocp.rod.shape import Shape
from trunk_ocp.rod.statics import solve_statics

from .case import Case, Values
from .rods import NONE, activation_for, bender, wire

SUBJECT = "Large deflections"

# K. Mattiasson, Int. J. Numer. Meth. Engng 17 (1981) 145-153: P L^2 / E I, then w / L, u / L and
# theta of the tip of a cantilever under a transverse tip load. Each line was checked against the
# elliptic integrals, which round to the same digits.
MATTIASSON = np.array(
    [
        (1, 0.30172, 0.05643, 0.46135),
        (2, 0.49346, 0.16064, 0.78175),
        (3, 0.60325, 0.25442, 0.98602),
        (4, 0.66996, 0.32894, 1.12124),
        (5, 0.71379, 0.38763, 1.21537),
        (6, 0.74457, 0.43459, 1.28370),
        (7, 0.76737, 0.47293, 1.33496),
        (8, 0.78498, 0.50483, 1.37443),
        (9, 0.79906, 0.53182, 1.40547),
        (10, 0.81061, 0.55500, 1.43029),
    ]
)
LEVEL, RAISED = math.pi / 2, 3 * math.pi / 4  # clamps, from straight down
HEAVY = [(LEVEL, w) for w in (1.0, 5.0, 20.0, 50.0)] + [(RAISED, w) for w in (1.0, 5.0, 20.0)]


def tilt(shape: Shape, Z: float) -> float:
    """Angle of d_3 from +Z toward +X, in radians."""
    d3 = shape.directors(np.array([Z]))[0, 2]
    return math.atan2(d3[0], d3[2])


def elastica(tip_angle: float) -> tuple[float, float, float]:
    """Load P L^2 / E I of a transversely loaded cantilever, deflection and height of its tip / L.

    E I theta'' = -P cos theta with theta(L) given: with k^2 = (1 + sin theta_L) / 2 and
    sin phi = 1 / (k sqrt 2), sqrt(P L^2 / E I) = K(k) - F(phi, k).
    """
    s = math.sin(tip_angle)
    k2 = (1 + s) / 2
    phi = math.asin(1 / math.sqrt(2 * k2))
    root = ellipk(k2) - ellipkinc(phi, k2)
    across = 1 - 2 * (ellipe(k2) - ellipeinc(phi, k2)) / root
    return root**2, across, math.sqrt(2 * s) / root


def elastica_angle(load: float) -> float:
    """Tip angle of a cantilever under P L^2 / E I."""
    return float(brentq(lambda angle: elastica(angle)[0] - load, 1e-6, 1.5707, xtol=1e-15))


@cache
def loaded(force: float) -> Shape:
    """The wire, clamped along +Z, under a tip force along +X."""
    mesh = mesh_for(wire(), elements=12)
    return solve_statics(wire(), NONE, loads=Loads(0.0, (force, 0, 0)), mesh=mesh)


def printed_elastica() -> Values:
    """Tips of the wire, and the published ones."""
    found = []
    for load in MATTIASSON[:, 0]:
        x, _, z = loaded(load).position(np.array([1.0]))[0]
        found.append((x, 1 - z, tilt(loaded(load), 1.0)))
    return np.array(found), MATTIASSON[:, 1:]


def exact_elastica() -> Values:
    """The same tips and base moments, and their elliptic integrals."""
    found, expected = [], []
    for load in MATTIASSON[:, 0]:
        shape, angle = loaded(load), elastica_angle(load)
        _, across, along = elastica(angle)
        x, _, z = shape.position(np.array([1.0]))[0]
        moment = shape.moment(np.array([0.0]))[0, 1] / load
        found.append((x, z, tilt(shape, 1.0), moment))
        expected.append((across, along, angle, along))
    return np.array(found), np.array(expected)


def heavy(weight: float, clamp: float, start: np.ndarray | None = None) -> np.ndarray:
    """Tip (x, z) over L and moment over w L^2 of a heavy elastica, by a scalar equation.

    theta, from straight down, with E I theta'' = w (L - s) sin theta, theta(0) = clamp,
    theta'(L) = 0. `start` (41,) is an initial guess of theta; the default droops.
    """
    s = np.linspace(0, 1, 41)
    angle = clamp * (1 - s) if start is None else start

    def slope(s: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.array([y[1], weight * (1 - s) * np.sin(y[0]), np.sin(y[0]), np.cos(y[0])])

    def ends(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return np.array([a[0] - clamp, b[1], a[2], a[3]])

    guess = np.array([angle, np.gradient(angle, s), s, 0 * s])
    solution = solve_bvp(slope, ends, s, guess, tol=1e-10, max_nodes=200_000)
    if not solution.success:
        raise RuntimeError(solution.message)
    return np.array([solution.y[2, -1], solution.y[3, -1], solution.y[1, 0] / weight])


@cache
def sagging(weight: float, clamp: float) -> Shape:
    """The wire under its own weight, its clamp at an angle from straight down."""
    mesh = mesh_for(wire(), elements=16)
    return solve_statics(wire(), NONE, (0.0, clamp), Loads(weight), mesh)


def drooped(weight: float, clamp: float) -> np.ndarray:
    """Tip (x, z) over L and base moment over w L^2 of the wire."""
    shape = sagging(weight, clamp)
    x, _, z = shape.position(np.array([1.0]))[0]
    return np.array([x, z, shape.moment(np.array([0.0]))[0, 1] / weight])


def heavy_elastica() -> Values:
    """Tips and base moments under own weight."""
    found = [drooped(weight, clamp) for clamp, weight in HEAVY]
    return np.array(found), np.array([heavy(weight, clamp) for clamp, weight in HEAVY])


def other_branch() -> Values:
    """The same with a raised clamp and so much weight that another equilibrium is found."""
    d3 = sagging(50.0, RAISED).directors(np.linspace(0, 1, 41))[:, 2]
    start = np.unwrap(np.arctan2(d3[:, 0], d3[:, 2]))
    return drooped(50.0, RAISED), heavy(50.0, RAISED, start)


def second_variation(weight: float, clamp: float, pieces: int = 2000) -> float:
    """Lowest eigenvalue, in E I / L^2, of the energy's second variation in the plane.

    phi -> -phi'' + w (1 - s) cos(theta) phi with phi(0) = phi'(1) = 0, by second differences.
    Negative: the shape is unstable.
    """
    s = np.linspace(0, 1, pieces + 1)
    cosine = sagging(weight, clamp).directors(s)[1:, 2, 2]
    diagonal = np.full(pieces, 2.0 * pieces**2) + weight * (1 - s[1:]) * cosine
    beside = np.full(pieces - 1, -1.0 * pieces**2)
    beside[-1] *= math.sqrt(2)  # phi(1 + h) = phi(1 - h), made symmetric
    values = eigvalsh_tridiagonal(diagonal, beside, select="i", select_range=(0, 0))
    return float(values[0])


BEND = 100.0  # in, radius of the 45-degree bend
FORCE = 600.0  # lb, along Y


def bend_45() -> np.ndarray:
    """Displacement (3,) of the tip of the 45-degree bend, in inches."""
    section = 1 / math.sqrt(3)  # radius of the disk whose E I / E A is that of a unit square
    material = {"youngs_modulus": 1e7 / (math.pi * section**2), "poisson_ratio": 0.0}
    arm = bender(math.pi / 4 * BEND, section, **material)
    activation = activation_for(arm, 1.0, (0.0, 1 / BEND, 0.0))
    mesh = mesh_for(arm, elements=12)
    shape = solve_statics(arm, activation, loads=Loads(0.0, (0.0, FORCE, 0.0)), mesh=mesh)
    return shape.position(np.array([arm.length]))[0] - bend_start()


def bend_start() -> np.ndarray:
    """Tip (3,) of the bend before it is loaded."""
    return BEND * np.array([1 - math.cos(math.pi / 4), 0.0, math.sin(math.pi / 4)])


def shearing_bend(shear: float) -> np.ndarray:
    """The same for a shear-deformable rod (stiffness in lb), by shooting with DOP853."""
    force = np.array([0.0, FORCE, 0.0])
    stiff_force, stiff_moment = np.array([shear, shear, 1e7]), 1e7 / 12  # E I = G J

    def slope(s: float, y: np.ndarray) -> np.ndarray:
        d, m = y[3:12].reshape(3, 3), y[12:]
        n = d @ force
        v, u = n / stiff_force + [0, 0, 1], m / stiff_moment + [0, 1 / BEND, 0]
        turns = np.cross(u @ d, d).ravel()
        return np.concatenate([v @ d, turns, -np.cross(u, m) - np.cross(v, n)])

    def tip(moment: np.ndarray) -> np.ndarray:
        start = np.concatenate([np.zeros(3), np.eye(3).ravel(), moment])
        span = (0.0, math.pi / 4 * BEND)
        return solve_ivp(slope, span, start, method="DOP853", rtol=1e-11, atol=1e-9).y[:, -1]

    found = root(lambda moment: tip(moment)[12:], FORCE * np.array([-60.0, 0, 20.0]))
    return tip(found.x)[:3] - bend_start()


CASES = (
    Case(
        SUBJECT,
        "Tip of a cantilever under P L^2 / E I = 1 ... 10: deflections and slope",
        "Mattiasson 1981, table of a cantilever under transverse load; the problem of "
        "Bisshopp & Drucker 1945",
        printed_elastica,
        5.1e-6,
        "half a unit of the last published digit",
        "L, rad",
    ),
    Case(
        SUBJECT,
        "The same tips and base moments, unrounded",
        "elliptic integrals, Bisshopp & Drucker 1945",
        exact_elastica,
        1e-9,
        "the wire stretches by 2.5e-11 P, collocation",
        "L, rad, P L",
    ),
    Case(
        SUBJECT,
        "Heavy elastica, level (w L^3 / E I to 50) or raised 45 degrees (to 20): tip, moment",
        "E I theta'' = w (L - s) sin theta (Rohde 1953; Wang 1986) by scipy's solve_bvp",
        heavy_elastica,
        2e-8,
        "solve_bvp at 1e-10 per interval; the wire stretches by 2.5e-11 w",
        "L, w L^2",
    ),
    Case(
        SUBJECT,
        "Heavy elastica raised 45 degrees, w L^3 / E I = 50: one of several equilibria",
        "the same equation, starting from the shape found",
        other_branch,
        2e-8,
        "as above",
        "L, w L^2",
    ),
    Case(
        SUBJECT,
        "45-degree bend under 600 lb: displacement of the tip in space",
        "Bathe & Bolourchi 1979: (-13.4, 53.4, -23.5) in",
        lambda: (bend_45(), np.array([-13.4, 53.4, -23.5])),
        0.25,
        "three published digits of a finite element model; others scatter as much",
        "in",
    ),
    Case(
        SUBJECT,
        "The same bend, compared with a shear-deformable rod",
        "Simo-Reissner rod, k G A = 4.17e6 lb, by shooting with DOP853",
        lambda: (bend_45(), shearing_bend(5 / 6 * 5e6)),
        5e-3,
        "effect of shear",
        "in",
    ),
    Case(
        SUBJECT,
        "The same bend, compared with a rod that hardly shears",
        "the same rod, k G A = 1e13 lb",
        lambda: (bend_45(), shearing_bend(1e13)),
        1e-6,
        "DOP853 at 1e-9 per step; collocation",
        "in",
    ),
)

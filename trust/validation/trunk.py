"""The elephant's trunk vs. independent integrators and independently computed figures."""

from __future__ import annotations

import math

import numpy as np
from scipy.integrate import quad, solve_bvp

from trunk_ocp.model.activation import strain_matrix
from trunk_ocp.model.loads import mass_beyond
from trunk_ocp.rod.collocation import mesh_for
from trunk_ocp.rod.statics import solve_statics
from trust import reference

from .case import Case, CoveredByTest, Values, flat
from .rods import CONTACT, EVERYTHING, contractions, elephant, heads

SUBJECT = "The trunk"
REST = np.zeros(28)
TIP, BASE = np.array([1.75]), np.zeros(1)

# The passive trunk under its own weight, g = 9.8 m/s^2, by two independent codes and to the
# digits on which they agree.
PASSIVE_TIP = (0.6720968, 0.0, 1.6202937)
PASSIVE_TANGENT = (0.312892, 0.0, 0.949789)
PASSIVE_MOMENT = -284.972715
MASS, TIP_RADIUS = 114.743, 0.0601158


def passive_tip() -> Values:
    """Tip, tangent, moment, mass and tip radius in units of the last known digit."""
    trunk = elephant()
    shape = solve_statics(trunk, REST, mesh=mesh_for(trunk, elements=12, degree=8))
    found = [
        *(shape.position(TIP)[0] / 1e-7),
        *(shape.directors(TIP)[0, 2] / 1e-6),
        shape.moment(BASE)[0, 1] / 1e-6,
        float(mass_beyond(trunk, 0.0)) / 1e-3,
        float(trunk.radius(trunk.length)) / 1e-7,
    ]
    printed = [
        *(np.array(PASSIVE_TIP) / 1e-7),
        *(np.array(PASSIVE_TANGENT) / 1e-6),
        PASSIVE_MOMENT / 1e-6,
        MASS / 1e-3,
        TIP_RADIUS / 1e-7,
    ]
    return np.array(found), np.array(printed)


def passive_scalar() -> Values:
    """The passive trunk as a plane rod: tip (x, z) in m, and angle of its tangent."""
    trunk = elephant()
    L, E = trunk.length, trunk.youngs_modulus

    def radius(Z: np.ndarray) -> np.ndarray:
        return trunk.base_radius - Z * trunk.tan_taper

    def slope(Z: np.ndarray, y: np.ndarray) -> np.ndarray:
        R, end = radius(Z), radius(np.array(L))
        N = 9.8 * trunk.density * math.pi / 3 * (L - Z) * (R * R + R * end + end * end)
        zeta = 1 + N * np.cos(y[0]) / (E * math.pi * R**2)
        bend = y[1] / (E * math.pi / 4 * R**4)
        return np.array([bend, zeta * N * np.sin(y[0]), zeta * np.sin(y[0]), zeta * np.cos(y[0])])

    def ends(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return np.array([a[0] - math.radians(30), b[1], a[2], a[3]])

    Z = np.linspace(0, L, 41)
    start = np.stack([0 * Z + 0.4, -285 * (1 - Z / L), 0.4 * Z, 0.9 * Z])
    solution = solve_bvp(slope, ends, Z, start, tol=1e-10, max_nodes=200_000)
    shape = solve_statics(trunk, REST, mesh=mesh_for(trunk, elements=12, degree=8))
    x, _, z = shape.position(TIP)[0]
    d3 = shape.directors(TIP)[0, 2]
    return np.array([x, z, math.atan2(d3[0], d3[2])]), solution.y[[2, 3, 0], -1]


def hanging() -> Values:
    """Stretch in m of the trunk hung straight down, its head turned by -30 degrees."""
    trunk = elephant()
    shape = solve_statics(trunk, REST, (0.0, -trunk.head.xi_d))
    stretch = shape.position(TIP)[0] - shape.position(BASE)[0]
    L, end = trunk.length, float(trunk.radius(trunk.length))

    def strain(Z: float) -> float:
        R = trunk.base_radius - Z * trunk.tan_taper
        weight = 9.8 * trunk.density / 3 * (L - Z) * (R * R + R * end + end * end)
        return weight / (trunk.youngs_modulus * R**2)

    return stretch, np.array([0.0, 0.0, L + quad(strain, 0, L, epsrel=1e-13)[0]])


def unit_responses() -> Values:
    """Extension and curvatures times L for unit activations."""
    trunk, found = elephant(), []
    for name in reference.UNIT_RESPONSES:
        column = strain_matrix(trunk)[int(name[1]) - 1, :, trunk.muscles.index(name)]
        found.append(column * [1, 1.75, 1.75, 1.75])
    return np.array(found), np.array(list(reference.UNIT_RESPONSES.values()), dtype=float)


def marched(fine: bool) -> Values:
    """Positions in m, and directors and free-tip moment scaled to m, of 20 shapes."""
    trunk, count = elephant(), 20
    activation, psi = contractions(trunk, count, seed=40), heads(count, 41)
    Z = np.linspace(0, 1.75, 15)
    mesh = mesh_for(trunk, CONTACT, elements=12, degree=8) if fine else None
    shape = solve_statics(trunk, activation, psi, EVERYTHING, mesh)
    start = shape.moment(BASE)[:, 0]
    r, d, m = reference.march(trunk, activation, psi, [EVERYTHING] * count, start, Z)
    # Directors are per 1, not per 1.75 m, and of a lower order inside elements; the moment of
    # the free tip, zero, is beside hundreds of N m.
    found = [shape.position(Z), shape.directors(Z) / 10, np.zeros_like(m[:, -1])]
    expected = [r, d / 10, m[:, -1] / 1e4]
    return flat(found, expected)


CASES = (
    Case(
        SUBJECT,
        "Passive trunk under its weight: tip, tangent, base moment; mass, tip radius",
        "computed independently by two codes, six to nine digits",
        passive_tip,
        1.0,
        "known digits",
        "in the last digit",
    ),
    Case(
        SUBJECT,
        "The same tip and its slope, as a planar rod",
        "scalar equation of the angle, extension included, scipy's solve_bvp",
        passive_scalar,
        1e-10,
        "solve_bvp at 1e-10 per interval",
        "m, rad",
    ),
    Case(
        SUBJECT,
        "Trunk hung straight down: stretch under its own weight",
        "integral of weight / E A of the tapered trunk, adaptive quadrature",
        hanging,
        1e-12,
        "collocation, round-off",
        "m",
    ),
    Case(
        SUBJECT,
        "Extension and curvatures of eight single muscles of all kinds",
        "computed independently by two codes, six decimals",
        unit_responses,
        5.1e-7,
        "half a unit of the last digit",
        "1, 1/L",
    ),
    Case(
        SUBJECT,
        "20 random contractions and heads under every load, 12 elements of degree 8",
        "eqs. (14), (15) implemented independently, DOP853 at 1e-11 from the same m(0)",
        lambda: marched(fine=True),
        1e-9,
        "1e-11 per step, amplified along the trunk; Newton's last step",
        "m",
    ),
    Case(
        SUBJECT,
        "The same on the default mesh",
        "the same",
        lambda: marched(fine=False),
        1e-5,
        "specified accuracy of the default mesh",
        "m",
    ),
    CoveredByTest(
        SUBJECT,
        "Signs of every muscle's effects; their rankings in each segment",
        "the paper, Tables 2 and 3",
        "tests/model/test_muscle_effects.py::test_every_sign_of_table_2",
    ),
    CoveredByTest(
        SUBJECT,
        "Derivatives of the tip by 28 muscles and the head",
        "fourth-order differences of shapes",
        "tests/rod/test_tip_jacobian.py::test_it_agrees_with_differences_of_shapes",
    ),
    CoveredByTest(
        SUBJECT,
        "The integrator that verifies every plan",
        "LSODA on the independent implementation",
        "tests/planning/test_verification.py::test_the_equilibria_of_the_check_are_those_of_a_third_integrator",
    ),
)

"""The forward problem against the closed forms of beam theory, on rods without muscles."""

import math

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import ellipe, ellipeinc, ellipk, ellipkinc

from trunk_ocp.collocation import mesh_for
from trunk_ocp.loads import Loads
from trunk_ocp.statics import solve_statics

NONE = np.zeros(0)
HORIZONTAL = (0.0, math.pi / 2)  # the default head turns the clamp from +Z to +X
SECOND_MOMENT = math.pi / 4 * 0.05**4  # of the rod of `build`, in m^4; L = 1 m, E = 1 MPa
STEEL = {"youngs_modulus": 4e16 / math.pi, "poisson_ratio": 0.3, "density": 0.0}


@pytest.fixture(scope="module")
def wire(build):
    """A rod with E I = 1 N m^2, L = 1 m and so thin (R = 0.1 mm) that it cannot stretch.

    Its strain under a force F is F / (E A) = 2.5e-9 F.
    """
    return build(base_radius_over_length=1e-4, material=STEEL)


@pytest.mark.parametrize(("axis", "moment"), [(0, (0, 1)), (1, (-1, 0))])
def test_a_small_tip_force_bends_as_euler_and_bernoulli_say(build, axis, moment):
    rod, EI, F = build(), 1e6 * SECOND_MOMENT, 1e-4
    force = np.zeros(3)
    force[axis] = F
    shape = solve_statics(rod, NONE, loads=Loads(0.0, tuple(force)))
    Z = np.array([0.3, 0.7, 1.0])
    # Deflection 7e-6 of the length: geometric terms are its square.
    deflection = F * Z**2 * (3 - Z) / (6 * EI)
    np.testing.assert_allclose(shape.position(Z)[:, axis], deflection, rtol=1e-8)
    assert deflection[-1] == pytest.approx(F / (3 * EI))
    np.testing.assert_allclose(
        shape.directors(Z)[:, 2, axis], F * Z * (2 - Z) / (2 * EI), rtol=1e-8
    )
    np.testing.assert_allclose(shape.moment([0.0])[0, :2], F * np.array(moment), atol=1e-8 * F)


def test_a_horizontal_rod_sags_under_its_weight_by_w_l4_over_8_ei(build):
    rod, g = build(), 1e-5
    shape = solve_statics(rod, NONE, HORIZONTAL, Loads(g))
    w = 1000 * math.pi * 0.05**2 * g
    # +Z is down. Sag 2e-6 of the length.
    assert shape.position([1.0])[0, 2] == pytest.approx(w / (8 * 1e6 * SECOND_MOMENT), rel=1e-8)


@pytest.mark.parametrize("taper", [0.0, 1.5])
def test_a_hanging_rod_stretches_by_the_integral_of_its_strain(build, taper):
    rod = build(taper_deg=taper)
    shape = solve_statics(rod, NONE, loads=Loads(9.8, (0, 0, 50.0)))
    b = 0.05 - math.tan(math.radians(taper))

    def strain(Z):
        a = 0.05 - Z * math.tan(math.radians(taper))
        weight = 9.8 * 1000 * math.pi / 3 * (1 - Z) * (a * a + a * b + b * b)
        return (50 + weight) / (1e6 * math.pi * a**2)

    stretch = quad(strain, 0, 1, epsrel=1e-13)[0]
    np.testing.assert_allclose(shape.position([1.0])[0], [0, 0, 1 + stretch], atol=1e-10)


@pytest.mark.parametrize("tip_angle", [30, 60, 85])
def test_a_large_tip_force_bends_the_elastica(wire, tip_angle):
    # E I theta'' = -F cos theta from the clamp along Z, force along X, theta(L) given:
    # sqrt(F L^2 / E I) = K(k) - F(phi, k) with k^2 = (1 + sin theta_L) / 2, sin phi = 1 / (k
    # sqrt 2), then x/L = 1 - 2 (E(k) - E(phi, k)) / sqrt(..), z/L = sqrt(2 sin theta_L / F).
    s = math.sin(math.radians(tip_angle))
    k2 = (1 + s) / 2
    phi = math.asin(1 / math.sqrt(2 * k2))
    root = ellipk(k2) - ellipkinc(phi, k2)
    F = root**2
    x = 1 - 2 * (ellipe(k2) - ellipeinc(phi, k2)) / root
    z = math.sqrt(2 * s) / root
    shape = solve_statics(wire, NONE, loads=Loads(0.0, (F, 0, 0)), mesh=mesh_for(wire, elements=12))
    # The wire stretches by less than 2.5e-9 F, F < 6 N.
    np.testing.assert_allclose(shape.position([1.0])[0], [x, 0, z], atol=3e-8)
    d3 = shape.directors([1.0])[0, 2]
    assert math.degrees(math.atan2(d3[0], d3[2])) == pytest.approx(tip_angle, abs=1e-5)
    assert shape.moment([0.0])[0, 1] == pytest.approx(F * z, rel=1e-7)


@pytest.mark.parametrize("part", [0.5, 0.9, 0.99])
def test_thrust_amplifies_a_side_force_without_bound_towards_eulers_load(wire, part):
    # Beam column: x = F (tan a - a) / a^3 in units of L^3 / E I, a = sqrt(P L^2 / E I), which
    # grows without bound at Euler's load of a clamped-free column, a = pi / 2.
    a, side = math.sqrt(part) * math.pi / 2, 1e-6
    load = Loads(0.0, (side, 0, -(a**2)))
    x = solve_statics(wire, NONE, loads=load).position([1.0])[0, 0]
    # Deflection up to 4e-5 of the length, squared; the wire shortens by 6e-9, times 1 / 0.01.
    assert x == pytest.approx(side * (math.tan(a) - a) / a**3, rel=2e-6)


@pytest.mark.parametrize("couple", [1.0, 3.0, -5.0])
def test_a_couple_bends_the_free_span_into_a_circular_arc(wire, couple):
    # Spread over [Z_w, L] it leaves m_2 = M before Z_w: curvature M / E I there, falling
    # linearly to 0 after. All in the plane of X and Z.
    Z_w = 0.6
    load = Loads(0.0, contact_from=Z_w, contact_couple=(0.0, couple, 0.0))
    shape = solve_statics(wire, NONE, loads=load, mesh=mesh_for(wire, Z_w, elements=12))
    Z = np.array([0.2, 0.4, Z_w])
    arc = np.stack([1 - np.cos(couple * Z), 0 * Z, np.sin(couple * Z)], axis=1) / couple
    np.testing.assert_allclose(shape.position(Z), arc, atol=1e-9)
    np.testing.assert_allclose(shape.moment(Z), [[0, couple, 0]] * 3, atol=1e-9)

    def angle(at):
        return couple * (at - max(0.0, at - Z_w) ** 2 / (2 * (1 - Z_w)))

    tip = [quad(lambda at, f=f: f(angle(at)), 0, 1, points=[Z_w])[0] for f in (math.sin, math.cos)]
    np.testing.assert_allclose(shape.position([1.0])[0], [tip[0], 0, tip[1]], atol=1e-9)


def test_a_couple_along_the_rod_twists_it_by_its_torsional_stiffness(wire):
    load = Loads(0.0, contact_from=0.5, contact_couple=(0.0, 0.0, 0.4))
    shape = solve_statics(wire, NONE, loads=load)
    # K_3 = E I / (1 + nu): 0.4 over half the length, falling linearly over the other half.
    twist = 0.4 * 1.3 * (0.5 + 0.25)
    d1 = shape.directors([1.0])[0, 0]
    np.testing.assert_allclose(d1, [math.cos(twist), math.sin(twist), 0], atol=1e-9)
    np.testing.assert_allclose(shape.position([1.0])[0], [0, 0, 1], atol=1e-9)


def test_a_spread_force_sags_as_a_partly_loaded_cantilever(build):
    rod, EI, W, a = build(), 1e6 * SECOND_MOMENT, 1e-4, 0.6
    shape = solve_statics(rod, NONE, loads=Loads(0.0, contact_from=a, contact_force=(W, 0, 0)))
    # Superpose point loads W ds / (1 - a) at s in [a, 1]: tip deflection s^2 (3 - s) / 6 E I.
    expected = W / (1 - a) * ((1 - a**3) - (1 - a**4) / 4) / (6 * EI)
    assert shape.position([1.0])[0, 0] == pytest.approx(expected, rel=1e-8)

"""Stability against buckling loads in closed form, focal points and a chain of rotations."""

import dataclasses
import math
import sys
from itertools import pairwise

import numpy as np
import pytest
from discrete_rod import chain
from plans import MOTIONS, planned
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.special import ellipj, ellipk, jn_zeros, jv

from trunk_ocp.errors import InputError
from trunk_ocp.model.activation import strains
from trunk_ocp.model.loads import Loads
from trunk_ocp.planning.verification import integrate
from trunk_ocp.rod.buckling import NEUTRAL_MARGIN, all_stable, buckling_margin
from trunk_ocp.rod.collocation import mesh_for
from trunk_ocp.rod.newton import newton
from trunk_ocp.rod.rod_batch import RodBatch, shape_of_states
from trunk_ocp.rod.statics import solve_statics
from trust import reference

pytestmark = pytest.mark.slow

NONE, REST = np.zeros(0), np.zeros(28)
EULER = math.pi**2 / 4  # P L^2 / E I of a column clamped at one end, free at the other
STEEL = {"youngs_modulus": 4e16 / math.pi, "poisson_ratio": 0.3, "density": 0.0}


@pytest.fixture(scope="module")
def wire(build):
    """E I = 1 N m^2, L = 1 m, and so thin that a force F strains it by 2.5e-9 F only."""

    def make(**changes):
        material = STEEL | {"density": changes.pop("density", 0.0)}
        return build(base_radius_over_length=1e-4, material=material, **changes)

    return make


def thrust(P, side=0.0):
    """A load that presses a rod along +Z at its tip, with a little force sideways."""
    return Loads(0.0, (side, 0.0, -P))


def margin(rod, load, mesh=None):
    """Margin of a rod without muscles."""
    return float(
        buckling_margin(solve_statics(rod, NONE, loads=load, mesh=mesh), NONE, load).margin
    )


# --- Columns -------------------------------------------------------------------------------


def test_a_column_buckles_under_eulers_load(wire):
    # The wire shortens to 1 - P / E A before it buckles, which raises the load by 6e-9.
    assert brentq(lambda P: margin(wire(), thrust(P)), 1, 5, xtol=1e-12) == pytest.approx(
        EULER, rel=1e-8
    )


def test_a_thick_column_buckles_a_little_later_as_it_shortens(build):
    # Its stiffness stays, its length becomes (1 - P / E A) L: P (1 - P / E A) = P_Euler.
    EA = 1e6 * math.pi * 0.05**2
    euler = EULER * 1e6 * math.pi / 4 * 0.05**4
    expected = EA / 2 * (1 - math.sqrt(1 - 4 * euler / EA))
    assert expected / euler == pytest.approx(1.0015, abs=1e-4)
    found = brentq(lambda P: margin(build(), thrust(P)), 0.5 * euler, 2 * euler, xtol=1e-12)
    assert found == pytest.approx(expected, rel=1e-9)


# Clamped-free columns buckle at the squares of odd numbers, in both planes at once.
@pytest.mark.parametrize(
    ("part", "index"), [(0, 0), (0.5, 0), (0.99, 0), (1.01, 2), (8.9, 2), (9.1, 4), (25.1, 6)]
)
def test_the_margin_of_a_column_is_what_euler_leaves(wire, part, index):
    rod, load = wire(), thrust(part * EULER)
    result = buckling_margin(solve_statics(rod, NONE, loads=load), NONE, load)
    assert result.margin == pytest.approx(1 - part, abs=2e-8 * (1 + part) ** 2)
    assert result.index == index
    assert result.stable == (index == 0)


def test_an_active_column_buckles_by_its_own_length_and_thickness_however_twisted(build):
    ring = {"sector": (0.0, 2 * math.pi), "sides": ("R",), "radii_over_length": (0.03, 0.05)}
    muscles = (
        ring | {"group": "long", "architecture": "longitudinal"},
        ring | {"group": "oblique", "architecture": "helical", "helix_deg": 40.0},
    )
    rod = build(segments=({"Z_over_length": (0.0, 1.0), "muscles": muscles},))
    activation = np.array([[0.4, 0.0], [0.0, 1.0], [-0.3, -0.8]])
    zeta_hat, _, _, twist = strains(rod, activation)[:, 0].T
    assert np.all(np.abs(zeta_hat - 1) > 0.1)
    assert np.abs(twist).max() > 5
    # Length zeta_hat L, radius by eq. (30) R / sqrt(zeta_hat): E I / zeta_hat^2, E A / zeta_hat.
    EA, EI = 1e6 * math.pi * 0.05**2 / zeta_hat, 1e6 * math.pi / 4 * 0.05**4 / zeta_hat**2
    P = 5.0
    expected = 1 - P * (1 - P / EA) * zeta_hat**2 / (EULER * EI)
    shape = solve_statics(rod, activation, loads=thrust(P))
    result = buckling_margin(shape, activation, thrust(P))
    np.testing.assert_allclose(result.margin, expected, rtol=0, atol=1e-9)
    assert np.all((expected > 0) == (result.index == 0))


def test_an_upright_rod_buckles_under_its_weight_where_greenhill_says(wire):
    # Greenhill, Proc. Camb. Phil. Soc. 4 (1881): J_{-1/3}((2/3) sqrt(q L^3 / E I)) = 0.
    zero = brentq(lambda x: jv(-1 / 3, x), 1, 3, xtol=1e-14)
    expected = (1.5 * zero) ** 2
    assert expected == pytest.approx(7.8373, abs=1e-4)
    rod = wire(density=1e8 / math.pi)  # 1 kg/m
    mesh = mesh_for(rod, elements=6)
    # Clamped along +Z, which is down; upside down it stands.
    found = brentq(lambda g: margin(rod, Loads(-g), mesh), 5, 10, xtol=1e-12)
    assert found == pytest.approx(expected, rel=1e-7)  # the wire's strain is below 2e-8
    assert margin(rod, Loads(-2 * found), mesh) == pytest.approx(-1, abs=1e-6)


def test_an_upright_cone_buckles_under_its_weight_where_greenhill_says(wire):
    # x theta'' + 4 theta' + k theta = 0 from the tip, k = 4 rho g / (3 E tan^2 phi): theta =
    # x^(-3/2) J_3(2 sqrt(k x)), zero at the clamp (Greenhill 1881). The tip is cut off at 0.1 %.
    taper = 0.999e-4
    rod = wire(density=1.0, taper_deg=math.degrees(math.atan(taper)))
    k = jn_zeros(3, 1)[0] ** 2 / 4 * 0.999
    expected = k * 3 * rod.youngs_modulus * taper**2 / 4
    mesh = mesh_for(rod, elements=12)
    found = brentq(
        lambda g: margin(rod, Loads(-g), mesh), 0.5 * expected, 2 * expected, xtol=1e-12 * expected
    )
    assert found == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("tip", [0.8, 0.3])
def test_a_tapered_column_buckles_where_its_closed_form_says(wire, tip):
    # With x from the apex, E I ~ x^4 and x^4 w'' + b^2 w = 0: w = x sin(b / x_tip - b / x), upright
    # at the clamp: tan(b / x_tip - b / x_0) = -b / x_0 (Dinnik 1929); P = E I_0 b^2 / x_0^4.
    rod = wire(taper_deg=math.degrees(math.atan(1e-4 * (1 - tip))))
    x_0 = 1 / (1 - tip)

    def at_the_clamp(a):  # a = b / x_0
        angle = a * (1 / tip - 1)
        return math.sin(angle) + a * math.cos(angle)

    far = math.pi / (1 / tip - 1)
    expected = (brentq(at_the_clamp, far / 2, far) / x_0) ** 2
    found = brentq(lambda P: margin(rod, thrust(P)), 0.5 * expected, 2 * expected, xtol=1e-13)
    assert found == pytest.approx(expected, rel=1e-6)


# --- After buckling ------------------------------------------------------------------------


def elastica(rod, mode, tip_angle, load=None):
    """The wire's planar shape bent by thrust alone, and its load.

    theta'' = -P sin theta, theta(0) = 0, theta'(1) = 0: sin(theta / 2) = k sn(a Z), a^2 = P,
    a = (2 mode - 1) K(k), k = sin(tip_angle / 2) (Love, Mathematical Theory of Elasticity, 262).
    """
    k = math.sin(math.radians(tip_angle) / 2)
    a = (2 * mode - 1) * ellipk(k**2)
    mesh = mesh_for(rod, elements=12, degree=8)
    Z = np.hstack([np.array(mesh.edges[:-1])[:, None], mesh.points])
    sn, cn, dn, _ = ellipj(a * Z, k**2)
    states = np.zeros((1, *Z.shape, 7))
    states[0, ..., 0], states[0, ..., 2] = dn, k * sn  # cos and sin of theta / 2 about Y
    states[0, ..., 5] = 2 * a * k * cn
    load = thrust(a**2)
    x = np.zeros((1, 2))
    shape = shape_of_states(rod, mesh, x, [load], states)
    path = integrate(rod, x, [load], shape.moment([0.0])[:, 0], np.array([1.0]))
    np.testing.assert_allclose(path.position, shape.position([1.0]), atol=1e-7)
    np.testing.assert_allclose(path.moment, 0, atol=1e-6)  # it is an equilibrium
    return shape, load


@pytest.mark.parametrize("tip_angle", [20, 90, 150])
def test_a_buckled_column_is_neutral_about_its_axis_and_stable_otherwise(wire, tip_angle):
    # A round column may bend in any plane through the axis. Turning from one to the next it
    # costs nothing: e_Z turns the shape, -d_3 turns the sections back, and nothing at the clamp.
    rod = wire()
    shape, load = elastica(rod, 1, tip_angle)
    result = buckling_margin(shape, NONE, load)
    assert result.margin[0] == pytest.approx(0, abs=1e-7)
    assert result.index[0] == 0
    assert not result.stable[0]
    # A little push in the plane of the bend settles it; from the other side, it swings round.
    for side, index in ((1e-3, 0), (-1e-3, 1)):
        pushed = thrust(-load.tip_force[2], side)
        # From the bent shape, where `solve_statics` would start from the straight one.
        problem = RodBatch(rod, shape.mesh, np.zeros((1, 0)), np.zeros((1, 2)), [pushed])
        states, converged = newton(problem, shape.states)
        assert converged[0]
        settled = buckling_margin(problem.shape(states, (1,)), NONE, pushed)
        points = focal_points(problem.shape(states, (1,)), np.zeros((1, 0)), [pushed])
        assert settled.index[0] == points[0] == index
        assert settled.stable[0] == (index == 0)
        assert 0 < np.sign(side) * settled.margin[0] < 0.01


@pytest.mark.parametrize("tip_angle", [20, 90, 150])
def test_a_column_bent_in_its_second_mode_is_unstable(wire, tip_angle):
    shape, load = elastica(wire(), 2, tip_angle)
    assert -load.tip_force[2] > 9 * EULER
    result = buckling_margin(shape, NONE, load)
    assert result.margin[0] < -1
    assert result.index[0] >= 1
    np.testing.assert_array_equal(result.index, focal_points(shape, np.zeros((1, 0)), [load]))


# --- The trunk -----------------------------------------------------------------------------


def test_the_hanging_trunk_is_stable(trunk):
    shape = solve_statics(trunk, REST)
    result = buckling_margin(shape, REST, Loads())
    assert result.margin.shape == result.index.shape == ()
    assert result.stable
    assert 0.9 < result.margin < 1


def test_without_loads_nothing_is_lost(trunk, draw):
    activation = draw(trunk, 3, seed=70)
    shape = solve_statics(trunk, activation, loads=Loads(0.0))
    np.testing.assert_allclose(buckling_margin(shape, activation, Loads(0.0)).margin, 1, atol=1e-9)


def test_tension_does_not_raise_the_margin_above_one(wire):
    # Fine waves of bending feel no force: the least share is never more than 1.
    assert margin(wire(), Loads(0.0, (0.0, 0.0, 5.0))) == pytest.approx(1, abs=1e-12)


def focal_points(shape, activation, loads):
    """Morse index (H,) of shapes (H,) as the number of focal points from the free end (Morse).

    Jacobi's equations in the directors, for (eta, p) with p = B gamma - m x eta / 2,

        eta' = gamma - kappa x eta,  p' = m x gamma / 2 - kappa x p + H eta,

    start from eta = I, p = 0 at the tip. Where eta is singular the part beyond is neutral. There
    an eigenvalue of (eta + i p)(eta - i p)^{-1}, on the unit circle, passes -1, always the same
    way: sum of phases and phases at the base tell how many did, however many at once.
    """
    trunk, count = shape.trunk, len(loads)
    strain = reference.strains(trunk, activation)
    mean = strain[:, :, 0] @ np.diff(trunk.edges) / trunk.length
    tip = np.array([load.tip_force for load in loads])
    scale = trunk.youngs_modulus * math.pi / 4 * trunk.base_radius**4 / trunk.length

    def slope(segment):
        zeta_hat, c = strain[:, segment, 0], strain[:, segment, 1:]

        def right(Z, y):
            eta, p = y.reshape(2, count, 3, 3)  # solutions are columns
            radius = trunk.base_radius - Z * trunk.tan_taper
            K1 = trunk.youngs_modulus * math.pi / 4 * radius**4 / mean**2
            K = K1[:, None] / np.array([1, 1, 1 + trunk.poisson_ratio])
            K0 = trunk.youngs_modulus * math.pi * radius**2 / mean
            state_m = shape.moment([Z])[:, 0]
            force = tip.copy()
            for load, row in zip(loads, force, strict=True):
                row[2] += load.gravity * reference.weight_beyond(trunk, Z)
                if (at := load.contact_from) is not None:
                    share = (trunk.length - max(Z, at)) / (trunk.length - at)
                    row += share * np.array(load.contact_force)
            n = np.einsum("hij,hj->hi", shape.directors([Z])[:, 0], force)
            kappa = zeta_hat[:, None] * (c * trunk.base_radius / radius + state_m / K)
            zeta = zeta_hat * (1 + n[:, 2] / K0)
            across = np.stack([n[:, 1], -n[:, 0], 0 * n[:, 0]], axis=-1)
            e3 = np.array([0.0, 0, 1])
            H = zeta[:, None, None] * (
                n[:, 2, None, None] * np.eye(3)
                - (e3[:, None] * n[:, None] + n[:, :, None] * e3) / 2
            ) - (zeta_hat / K0)[:, None, None] * (across[:, :, None] * across[:, None])
            m, k = (np.cross(v[:, None], np.eye(3)).swapaxes(1, 2) for v in (state_m, kappa))
            gamma = (p + m @ eta / 2) * (zeta_hat[:, None] / K)[..., None]
            return np.stack([gamma - k @ eta, m @ gamma / 2 - k @ p + H @ eta]).ravel()

        return right

    y = np.stack([np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 3, 3))]).ravel()
    phases = [np.zeros(count)]
    jumps = sorted({*trunk.edges} | {x.contact_from for x in loads if x.contact_from is not None})
    for start, end in reversed(list(pairwise(jumps))):
        segment = int(np.searchsorted(trunk.edges, start, side="right")) - 1
        start = max(start, 1e-5 * trunk.length)  # at the clamp itself, neutral turns are singular
        samples = np.linspace(end, start, 400)
        path = solve_ivp(
            slope(segment), (end, start), y, method="DOP853", rtol=1e-8, atol=1e-8, t_eval=samples
        )
        y = path.y[:, -1]
        eta, p = np.moveaxis(path.y.reshape(2, count, 3, 3, -1), -1, 1)
        phases += list(2 * np.angle(np.linalg.det(eta + 1j * p / scale)))
    eta, p = y.reshape(2, count, 3, 3)
    unitary = (eta + 1j * p / scale) @ np.linalg.inv(eta - 1j * p / scale)
    last = np.angle(np.linalg.eigvals(unitary)).sum(axis=-1)
    total = np.unwrap(phases, axis=0)[-1]
    return np.abs(np.round((total - last) / (2 * math.pi))).astype(int)


def pressed(count, seed, strength):
    """Loads of every kind, with a tip force mostly upward."""
    rng = np.random.default_rng(seed)
    up = strength * rng.uniform((-0.15, -0.15, -1), (0.15, 0.15, 0), (count, 3))
    return [Loads(9.8, tuple(force), 1.4, (0.0, 0.0, 100.0), (-60.0, 20.0, 10.0)) for force in up]


@pytest.fixture(scope="module")
def many(trunk, draw):
    """Twenty active shapes under large loads: shapes, activations, loads."""
    activation, loads = draw(trunk, 20, seed=1), pressed(20, 3, 3000.0)
    mesh = mesh_for(trunk, 1.4, elements=12, degree=8)
    return solve_statics(trunk, activation, loads=loads, mesh=mesh), activation, loads


def test_the_index_is_the_number_of_focal_points(many):
    index = buckling_margin(*many).index
    assert np.count_nonzero(index) >= 4
    assert np.count_nonzero(index == 0) >= 4
    np.testing.assert_array_equal(index, focal_points(*many))


def test_default_and_fine_meshes_agree(trunk, many):
    _, activation, loads = many
    coarse = buckling_margin(solve_statics(trunk, activation, loads=loads), activation, loads)
    fine = buckling_margin(*many)
    np.testing.assert_allclose(coarse.margin, fine.margin, rtol=0, atol=1e-5)
    np.testing.assert_array_equal(coarse.index, fine.index)


def test_the_error_falls_with_twice_the_degree(build):
    rod, load = build(), Loads(9.8, (5.0, 3.0, -20.0))

    def at(elements, degree):
        mesh = mesh_for(rod, elements=elements, degree=degree)
        return margin(rod, load, mesh)

    exact = at(12, 8)
    for degree in (2, 3):
        errors = [abs(at(n, degree) - exact) for n in (8, 16)]
        assert math.log2(errors[0] / errors[1]) == pytest.approx(2 * degree, abs=0.3)


def test_the_margin_does_not_depend_on_where_the_clamp_points(trunk, draw):
    activation, force = draw(trunk, 1, seed=73)[0], np.array([30.0, -50.0, -150.0])
    margins = []
    for psi in ((0.0, 0.0), (0.9, 0.0), (0.4, -0.7)):
        _, d = reference.base(trunk, psi)
        load = Loads(0.0, tuple(force @ d), 1.4, tuple(force[::-1] @ d), (20.0, 10.0, -40.0) @ d)
        shape = solve_statics(trunk, activation, psi, load)
        margins.append(float(buckling_margin(shape, activation, load).margin))
    assert abs(margins[0] - 1) > 0.05
    np.testing.assert_allclose(margins, margins[0], rtol=0, atol=1e-9)


# With a couple, the stiffness of the chain is not symmetric; Q is its symmetric part.
@pytest.mark.parametrize(("which", "intervals", "tolerance"), [(0, 40, 1e-5), (1, 80, 1e-3)])
def test_a_chain_of_rotations_is_as_stable(trunk, draw, which, intervals, tolerance):
    activation = draw(trunk, 20, seed=1)[3 + which]
    load = Loads(
        9.8, ((90.0, -100.0, -200.0), (200.0, 700.0, -3500.0))[which], 1.4, (0.0, 0.0, 100.0),
        (-60.0, 20.0, 10.0),
    )  # fmt: skip
    mesh = mesh_for(trunk, 1.4, elements=12, degree=8)
    shape = solve_statics(trunk, activation, loads=load, mesh=mesh)
    result = buckling_margin(shape, activation, load)
    coarse, fine = (chain(trunk, activation, load, shape, n) for n in (intervals, 2 * intervals))
    assert np.abs(fine.stiffness - fine.stiffness.T).max() > 1
    least = (4 * fine.eigenvalues[0] - coarse.eigenvalues[0]) / 3  # Richardson: of fourth order
    assert result.margin == pytest.approx(least, abs=tolerance * (1 + abs(least)))
    assert result.index == np.count_nonzero(fine.eigenvalues < 0)
    assert (result.index == 0) == (which == 0)


@pytest.mark.parametrize("name", MOTIONS)
def test_every_planned_shape_of_the_shipped_motions_is_stable(name):
    plan = planned(name, "sequential")
    result = buckling_margin(plan.shape, plan.activations, plan.loads)
    assert np.all(result.stable)
    assert result.margin.shape == (len(plan.x),)


def test_long_meshes_are_judged_as_by_one_matrix(trunk, draw, monkeypatch):
    activation, loads = draw(trunk, 8, seed=1), pressed(8, 3, 3000.0)
    mesh = mesh_for(trunk, 1.4, elements=14)
    shape = solve_statics(trunk, activation, loads=loads, mesh=mesh)
    chained = buckling_margin(shape, activation, loads)
    monkeypatch.setattr(sys.modules["trunk_ocp.rod.buckling"], "MAX_DENSE_UNKNOWNS", 10**6)
    whole = buckling_margin(shape, activation, loads)
    assert 0 < np.count_nonzero(whole.index) < 8
    np.testing.assert_allclose(chained.margin, whole.margin, rtol=1e-8, atol=1e-8)
    np.testing.assert_array_equal(chained.index, whole.index)


def test_on_long_meshes_a_column_buckles_under_eulers_load_and_infinite_loads_are_unstable(wire):
    rod, mesh = wire(), mesh_for(wire(), elements=40)
    assert margin(rod, thrust(0.5 * EULER), mesh) == pytest.approx(0.5, abs=2e-8)
    assert margin(rod, thrust(0.0), mesh) == margin(rod, thrust(-5.0), mesh) == 1
    load = thrust(25.1 * EULER)
    shape = solve_statics(rod, NONE, loads=load, mesh=mesh)
    assert buckling_margin(shape, NONE, load).index == 6
    for moment in (np.nan, 1e300):
        states = shape.states.copy()
        states[3, 2, 5] = moment
        assert not buckling_margin(dataclasses.replace(shape, states=states), NONE, load).stable


def test_a_batch_is_its_shapes_one_by_one(trunk, many):
    shape, activation, loads = many
    every = buckling_margin(shape, activation, loads)
    for i in (0, 7):
        alone = dataclasses.replace(
            shape, states=shape.states[i], edges=shape.edges[i], slopes=shape.slopes[i]
        )
        one = buckling_margin(alone, activation[i], loads[i])
        assert one.margin == pytest.approx(every.margin[i], abs=1e-12)
        assert one.index == every.index[i]
    crossed = solve_statics(trunk, activation[:2, None], loads=loads[:3], mesh=shape.mesh)
    grid = buckling_margin(crossed, activation[:2, None], loads[:3])
    assert grid.margin.shape == (2, 3)
    assert grid.margin[1, 1] == pytest.approx(every.margin[1], abs=1e-9)


def test_shapes_are_certified_stable_exactly_where_every_margin_is_positive(wire, many):
    shape, activations, loads = many
    for i in range(len(loads)):
        one = shape[i], activations[i], loads[i]
        assert all_stable(*one) == bool(buckling_margin(*one).stable)
    assert all_stable(*many) == bool(np.all(buckling_margin(*many).stable))
    for share, stable in ((1 - 1e-4, True), (1 - 0.1 * NEUTRAL_MARGIN, False), (1.01, False)):
        rod, load = wire(), thrust(share * EULER)
        assert all_stable(solve_statics(rod, NONE, loads=load), NONE, load) == stable


def test_what_is_not_a_number_is_not_stable(trunk, many):
    shape, activations, loads = many
    states = shape.states.copy()
    states[0, -1, -1] = np.nan
    assert not all_stable(dataclasses.replace(shape, states=states), activations, loads)
    enormous = [Loads(tip_force=(0.0, 0.0, 1e300))] * len(loads)
    with np.errstate(all="ignore"):
        assert not all_stable(shape, activations, enormous)


def test_loads_or_activations_that_do_not_match_the_shape_are_refused(trunk):
    shape = solve_statics(trunk, np.zeros((2, 28)))
    for activation, loads in ((np.zeros((3, 28)), Loads()), (REST, [Loads()] * 3)):
        with pytest.raises(InputError, match="leading axes that match those of the shape"):
            buckling_margin(shape, activation, loads)
    with pytest.raises(InputError, match="one value per muscle"):
        buckling_margin(shape, NONE, Loads())
    with pytest.raises(InputError, match="leading axes"):
        buckling_margin(solve_statics(trunk, REST), REST, [Loads()] * 3)
    with pytest.raises(InputError, match="leading axes"):
        buckling_margin(solve_statics(trunk, REST), REST, [])

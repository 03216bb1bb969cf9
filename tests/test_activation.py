"""The strain map against the integrals it stands for, the printed closed forms and the tables."""

import math

import mpmath as mp
import numpy as np
import pytest
import reference
from scipy.integrate import dblquad, quad

from trunk_ocp.activation import (
    intrinsic_strain,
    mean_extension,
    radial_integrals,
    segment_at,
    stiffness,
    strain_matrix,
    strains,
    torsion,
)
from trunk_ocp.anatomy import Muscle

ALL = range(28)
ROUND_OFF = 1e-12  # relative; quadratures and closed forms below are good to 1e-13 or better


def unit(trunk, name, value=1.0):
    activation = np.zeros(len(trunk.muscles))
    activation[trunk.muscles.index(name)] = value
    return activation


@pytest.mark.parametrize("index", ALL)
def test_extension_and_curvature_are_the_integrals_of_eq_6_anywhere_in_the_segment(trunk, index):
    muscle = trunk.subdomains[index]
    start, end = trunk.edges[muscle.segment : muscle.segment + 2]
    nu = trunk.poisson_ratio
    for Z in (start + 1e-9, 0.3 * start + 0.7 * end):
        f = 1 - Z * trunk.tan_taper / trunk.base_radius
        bounds = (*muscle.sector, muscle.radii[0] * f, muscle.radii[1] * f)

        def axial(R, Theta, weight, power, Z=Z):
            cos_2_alpha, _ = reference.fibre_angles(trunk, muscle, R, Z)
            return 0.5 * (1 - nu + (1 + nu) * cos_2_alpha) * weight(Theta) * R**power

        def shear(R, Theta, Z=Z):
            return 0.5 * reference.fibre_angles(trunk, muscle, R, Z)[1] * R**2

        def over(integrand, *args, bounds=bounds):
            return dblquad(integrand, *bounds, args=args, epsabs=1e-18, epsrel=1e-13)[0]

        R0 = trunk.base_radius * f
        K0, K1 = math.pi * R0**2, math.pi / 4 * R0**4
        expected = (
            over(axial, lambda Theta: 1.0, 1) / K0,
            over(axial, math.sin, 2) / K1,
            -over(axial, math.cos, 2) / K1,
            over(shear) / (K1 / (1 + nu)),
        )
        zeta, u = intrinsic_strain(trunk, unit(trunk, muscle.name), np.array([Z]))
        # cos(pi / 2) of radial fibres leaves 1e-16 where the exact value is 0; and the
        # extension is 1 + something, rounded at 1e-16.
        assert np.array([zeta[0] - 1, *u[0]]) == pytest.approx(expected, rel=ROUND_OFF, abs=2e-15)


def printed_deltas(trunk, muscle):
    """delta_0, delta_1, delta_3 exactly as eq. (A.4) prints them, in complex arithmetic."""
    with mp.workdps(40):
        R1, R2 = (mp.mpf(R) for R in muscle.radii)
        nu = mp.mpf(trunk.poisson_ratio)
        c_phi = mp.mpf(trunk.tan_taper) / mp.mpf(trunk.base_radius)

        def B(R):
            return mp.sqrt(1 + c_phi**2 * R**2)

        if muscle.architecture == "radial":
            return nu / 2 * (R1**2 - R2**2), nu / 3 * (R1**3 - R2**3), mp.mpf(0)
        if muscle.architecture == "longitudinal":
            delta_0 = nu * (R1**2 - R2**2) - (1 + nu) / c_phi**2 * mp.log(B(R1) ** 2 / B(R2) ** 2)
            delta_1 = (
                nu / 3 * (R1**3 - R2**3)
                + (1 + nu) / c_phi**2 * (R2 - R1)
                + (1 + nu) / c_phi**3 * (mp.atan(c_phi * R1) - mp.atan(c_phi * R2))
            )
            return delta_0 / 2, delta_1, mp.mpf(0)
        c_alpha = mp.tan(mp.mpf(muscle.helix)) / R2
        A = mp.sqrt(mp.mpc(c_phi**2 - c_alpha**2))  # imaginary for this anatomy

        def C(R):
            return 1 + c_alpha**2 * R**2

        log = mp.log(B(R1) ** 2 * C(R2) / (B(R2) ** 2 * C(R1)))
        delta_0 = (nu * (R1**2 - R2**2) - (1 + nu) / A**2 * log) / 2
        bracket = (
            c_phi * mp.atan(c_alpha * R1)
            - c_alpha * mp.atan(c_phi * R1)
            - c_phi * mp.atan(c_alpha * R2)
            + c_alpha * mp.atan(c_phi * R2)
        )
        delta_1 = (R1**3 - R2**3) * nu / 3 - (1 + nu) / (c_alpha * c_phi * A**2) * bracket
        turns = mp.atan(c_alpha * B(R1) / A) - mp.atan(c_alpha * B(R2) / A)
        delta_3 = (B(R2) - B(R1)) / (c_alpha * c_phi**2) + turns / (c_alpha**2 * A)
        return delta_0, delta_1, delta_3


@pytest.mark.parametrize("index", ALL)
def test_radial_integrals_are_the_closed_forms_a_4(trunk, index):
    muscle = trunk.subdomains[index]
    for ours, printed in zip(
        radial_integrals(trunk, muscle), printed_deltas(trunk, muscle), strict=True
    ):
        assert abs(mp.im(printed)) < 1e-30  # the imaginary A leaves a real delta_3
        assert ours == pytest.approx(float(mp.re(printed)), rel=ROUND_OFF)


# taper in degrees, helix in degrees, inner over outer radius. The fourth makes A of (A.4)
# vanish; near it and near taper 0 or helix 0 the printed forms are 0/0.
CORNERS = [
    (0.0, 30.0, 0.8),
    (1e-6, 30.0, 0.8),
    (4.81, 1e-6, 0.8),
    (4.81, 4.81, 0.8),
    (2.0, 85.0, 0.8),
    (2.0, -89.0, 0.8),
    (2.0, 89.0, 0.0),
    (20.0, 45.0, 0.1),
    (4.81, 60.0, 0.0),
]


@pytest.mark.parametrize(("taper", "helix", "inner"), CORNERS)
def test_helical_integrals_hold_where_a_4_is_indefinite(build, taper, helix, inner):
    rod = build(taper_deg=taper, base_radius_over_length=0.5)
    R0 = rod.base_radius
    muscle = Muscle("R1-x", "x", "R", 0, "helical", (inner * R0, R0), (0, 1), math.radians(helix))
    with mp.workdps(30):
        cos_taper = lambda R: 1 / mp.sqrt(1 + (R / R0 * rod.tan_taper) ** 2)
        tan_helix = lambda R: mp.tan(muscle.helix) * R / R0
        D_Z = lambda R: cos_taper(R) / mp.sqrt(1 + tan_helix(R) ** 2)
        D_T = lambda R: tan_helix(R) / mp.sqrt(1 + tan_helix(R) ** 2)
        axial = lambda R: 1.5 * D_Z(R) ** 2 - 0.5
        # Split: at 89 degrees the integrands peak within R0 / 57 of the axis.
        cuts = mp.linspace(*muscle.radii, 9)
        expected = (
            mp.quad(lambda R: axial(R) * R, cuts),
            mp.quad(lambda R: axial(R) * R**2, cuts),
            mp.quad(lambda R: D_T(R) * D_Z(R) * R**2, cuts),
        )
    assert radial_integrals(rod, muscle) == pytest.approx([float(x) for x in expected], rel=ROUND_OFF)


def test_without_taper_and_helix_a_muscle_acts_through_the_moments_of_its_area(build):
    rod = build(base_radius_over_length=0.5)
    muscle = Muscle("R1-x", "x", "R", 0, "longitudinal", (0.2, 0.5), (0, 1), 0.0)
    # cos 2 alpha = 1: the integrands of eq. (6) are R and R^2.
    expected = ((0.5**2 - 0.2**2) / 2, (0.5**3 - 0.2**3) / 3, 0.0)
    assert radial_integrals(rod, muscle) == pytest.approx(expected, rel=1e-14)


def test_the_left_side_mirrors_the_right(trunk):
    # Eqs. (18), (25): extension and u_2 alike, u_1 and (by the opposite hand) u_3 reversed.
    right, left = np.split(strain_matrix(trunk), 2, axis=2)
    mirror = np.array([1.0, -1.0, 1.0, -1.0])[:, None]
    # 2 pi - Theta rounds at 1e-15.
    np.testing.assert_allclose(left, mirror * right, rtol=0, atol=1e-14)


# DESIGN section 2: computed by two independent codes, printed to six decimals.
UNIT_RESPONSES = {
    "R1-dl": (0.126081, 2.487782, -2.124715, 0),
    "R1-ovo": (0.032572, 0.679031, 0.679039, -0.981985),
    "R1-ivo": (0.031759, 0.511982, 0.599473, 0.808201),
    "R1-dr": (-0.037277, -0.496254, 0.496252, 0),
    "R1-vr": (-0.031888, -0.362551, -0.362555, 0),
    "R2-dl": (0.087489, 1.968056, -1.136252, 0),
    "R2-ivo": (0.116442, 1.932661, 1.115835, 2.181250),
    "R3-ovo": (0.031108, 0.513011, 0.767785, -0.934996),
}


@pytest.mark.parametrize("name", UNIT_RESPONSES)
def test_unit_responses_of_the_design_notes(trunk, name):
    zeta, u1, u2, u3 = UNIT_RESPONSES[name]
    column = strain_matrix(trunk)[int(name[1]) - 1, :, trunk.muscles.index(name)]
    expected = (zeta, u1 / 1.75, u2 / 1.75, u3 / 1.75)
    assert column * [1, 1.75, 1.75, 1.75] == pytest.approx((zeta, u1, u2, u3), abs=5.1e-7), expected


# Table 2, for a contraction: signs of extension, u_1, u_2, u_3 and isolated torsion.
TABLE_2 = {
    "dl": {"R": (-1, -1, 1, 0, 0), "L": (-1, 1, 1, 0, 0)},
    "ovo": {"R": (-1, -1, -1, 1, 1), "L": (-1, 1, -1, -1, -1)},
    "ivo": {"R": (-1, -1, -1, -1, -1), "L": (-1, 1, -1, 1, 1)},
    "dr": {"R": (1, 1, -1, 0, 0), "L": (1, -1, -1, 0, 0)},
    "vr": {"R": (1, 1, 1, 0, 0), "L": (1, -1, 1, 0, 0)},
}


@pytest.mark.parametrize("index", ALL)
def test_every_sign_of_table_2(trunk, index):
    muscle = trunk.subdomains[index]
    Z = np.array([np.mean(trunk.edges[muscle.segment : muscle.segment + 2])])
    contraction = unit(trunk, muscle.name, -1.0)
    zeta, u = intrinsic_strain(trunk, contraction, Z)
    signs = np.sign([zeta[0] - 1, *u[0], torsion(trunk, contraction, Z)[0]])
    assert tuple(signs) == TABLE_2[muscle.group][muscle.side]


# Table 3, strongest first; the muscles left out of a u_3 ranking do not twist.
TABLE_3 = {
    1: ("dl dr ovo vr ivo", "dl ovo ivo dr vr", "dl ovo ivo dr vr", "ovo ivo"),
    2: ("ivo dl dr vr ovo", "dl ivo ovo dr vr", "dl ivo dr ovo vr", "ivo ovo"),
    3: ("dl vr ovo dr", "dl ovo vr dr", "dl ovo vr dr", "ovo"),
}


@pytest.mark.parametrize("side", "RL")
@pytest.mark.parametrize("segment", TABLE_3)
def test_every_ranking_of_table_3(trunk, segment, side):
    for measure, ranking in enumerate(TABLE_3[segment]):
        size = {
            muscle.group: abs(strain_matrix(trunk)[segment - 1, measure, column])
            for column, muscle in enumerate(trunk.subdomains)
            if (muscle.segment, muscle.side) == (segment - 1, side)
        }
        acting = sorted((group for group in size if size[group] > 0), key=size.get, reverse=True)
        assert " ".join(acting) == ranking


def test_sixteen_of_28_directions_change_nothing(trunk):
    matrix = strain_matrix(trunk).reshape(12, 28)
    _, singular, rows = np.linalg.svd(matrix)
    assert np.linalg.matrix_rank(matrix) == 12
    assert singular[-1] > 1e-2 * singular[0]  # rank far from doubtful
    still = rows[12:]
    assert len(still) == 16
    np.testing.assert_allclose(strains(trunk, still), strains(trunk, 0 * still), atol=1e-14)


def test_strains_are_affine_in_the_activation_and_batched(trunk, draw):
    activation = draw(trunk, 6, seed=1)
    expected = reference.strains(trunk, activation)  # strains from adaptive quadrature
    np.testing.assert_allclose(
        strains(trunk, activation.reshape(2, 3, 28)), expected.reshape(2, 3, 3, 4), atol=1e-12
    )


def test_volume_is_preserved_by_eq_30(trunk, draw):
    R0, RL = float(trunk.radius(0)), float(trunk.radius(trunk.length))

    def frustum(length, a, b):
        return math.pi / 3 * length * (a * a + a * b + b * b)

    for activation in draw(trunk, 5, seed=2):
        zeta = lambda Z, at=activation: intrinsic_strain(trunk, at, np.array([Z]))[0][0]
        length = quad(zeta, 0, trunk.length, points=trunk.edges[1:-1], epsrel=1e-13)[0]
        shrink = mean_extension(trunk, strains(trunk, activation)) ** -0.5
        activated = frustum(length, R0 * shrink, RL * shrink)
        assert activated == pytest.approx(frustum(trunk.length, R0, RL), rel=ROUND_OFF)


def test_torsion_is_eq_40_with_its_derivative_term(trunk, draw):
    h = 1e-5
    Z = np.array([0.3, 1.2, 1.6])
    for activation in draw(trunk, 5, seed=3):
        zeta, u = intrinsic_strain(trunk, activation, Z)
        (_, ahead), (_, back) = (intrinsic_strain(trunk, activation, Z + s) for s in (h, -h))
        du = (ahead - back) / (2 * h)
        turning = (du[:, 1] * u[:, 0] - du[:, 0] * u[:, 1]) / (u[:, 0] ** 2 + u[:, 1] ** 2)
        # Central differences of 1/f: h^2 f'''/f < 1e-8, rounding 1e-16/h = 1e-11.
        np.testing.assert_allclose(
            torsion(trunk, activation, Z), (u[:, 2] + turning) / zeta, atol=1e-7
        )


def test_a_straight_trunk_has_no_torsion_to_speak_of(trunk):
    assert np.isnan(torsion(trunk, np.zeros(28), np.array([0.1, 1.7]))).all()


def test_stiffness_is_eq_7_on_the_initial_radius(trunk):
    Z = np.array([0.0, 0.7, 1.75])
    R = 0.1185 * 1.75 - Z * math.tan(math.radians(4.81))
    K1 = 1e6 * math.pi / 4 * R**4
    expected = np.stack([1e6 * math.pi * R**2, K1, K1, K1 / 1.5], axis=1)
    np.testing.assert_allclose(stiffness(trunk, Z), expected, rtol=1e-13)


def test_a_boundary_belongs_to_the_segment_it_ends(trunk):
    Z = [0.0, 0.875, 0.876, trunk.edges[2], 1.5, 1.75]
    assert segment_at(trunk, Z).tolist() == [0, 0, 1, 1, 2, 2]

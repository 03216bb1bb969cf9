"""The strain map against the integrals it stands for and the closed forms that are printed."""

import math

import mpmath as mp
import numpy as np
import pytest
from scipy.integrate import dblquad

from trunk_ocp.model.activation import intrinsic_strain, radial_integrals
from trunk_ocp.model.anatomy import Muscle
from trust import reference

ALL = range(28)
ROUND_OFF = 1e-12  # relative; quadratures and closed forms below are good to 1e-13 or better


@pytest.mark.parametrize("index", ALL)
def test_extension_and_curvature_are_the_integrals_of_eq_6_anywhere_in_the_segment(trunk, index):
    muscle = trunk.subdomains[index]
    start, end = trunk.edges[muscle.segment : muscle.segment + 2]
    nu = trunk.poisson_ratio
    for Z in (start + 1e-9, 0.3 * start + 0.7 * end):
        f = 1 - Z * trunk.tan_taper / trunk.base_radius
        bounds = (*muscle.sector, muscle.radii[0] * f, muscle.radii[1] * f)

        def axial(R, Theta, weight, power, Z=Z):
            cos_2_alpha, _ = reference.fiber_angles(trunk, muscle, R, Z)
            return 0.5 * (1 - nu + (1 + nu) * cos_2_alpha) * weight(Theta) * R**power

        def shear(R, Theta, Z=Z):
            return 0.5 * reference.fiber_angles(trunk, muscle, R, Z)[1] * R**2

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
        zeta, u = intrinsic_strain(trunk, np.eye(28)[index], np.array([Z]))
        # cos(pi / 2) of radial fibers leaves 1e-16 where the exact value is 0; and the
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
    found = radial_integrals(rod, muscle)
    assert found == pytest.approx([float(x) for x in expected], rel=ROUND_OFF)


def test_without_taper_and_helix_a_muscle_acts_through_the_moments_of_its_area(build):
    rod = build(base_radius_over_length=0.5)
    muscle = Muscle("R1-x", "x", "R", 0, "longitudinal", (0.2, 0.5), (0, 1), 0.0)
    # cos 2 alpha = 1: the integrands of eq. (6) are R and R^2.
    expected = ((0.5**2 - 0.2**2) / 2, (0.5**3 - 0.2**3) / 3, 0.0)
    assert radial_integrals(rod, muscle) == pytest.approx(expected, rel=1e-14)

"""The strain map: symmetry, rank and volume, and the signs and rankings of the paper."""

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.polynomial import Chebyshev
from scipy.integrate import quad

from trunk_ocp.errors import InputError
from trunk_ocp.model.activation import (
    intrinsic_strain,
    mean_extension,
    segment_at,
    stiffness,
    strain_matrix,
    strains,
    torsion,
)
from trunk_ocp.rod.unloaded import unloaded_states
from trust import reference

ALL = range(28)
ROUND_OFF = 1e-12  # relative; quadratures and closed forms below are good to 1e-13 or better


def unit(trunk, name, value=1.0):
    activation = np.zeros(len(trunk.muscles))
    activation[trunk.muscles.index(name)] = value
    return activation


def test_the_left_side_mirrors_the_right(trunk):
    # Eqs. (18), (25): extension and u_2 alike, u_1 and (by the opposite hand) u_3 reversed.
    right, left = np.split(strain_matrix(trunk), 2, axis=2)
    mirror = np.array([1.0, -1.0, 1.0, -1.0])[:, None]
    # 2 pi - Theta rounds at 1e-15.
    np.testing.assert_allclose(left, mirror * right, rtol=0, atol=1e-14)


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


def test_torsion_is_that_of_the_unloaded_centerline(trunk, draw):
    """So eq. (40) with u_3 undivided: eq. (1) has u per activated length already."""
    for activation in draw(trunk, 5, seed=3):
        for Z in (0.3, 1.2, 1.6):
            nodes = Z + 0.05 * np.cos(np.pi * (np.arange(14) + 0.5) / 14)[::-1]
            r, _ = unloaded_states(trunk, activation, (0.0, 0.0), nodes)
            fits = [Chebyshev.fit(nodes, r[:, i], 13) for i in range(3)]
            first, second, third = (np.array([f.deriv(n)(Z) for f in fits]) for n in (1, 2, 3))
            normal = np.cross(first, second)
            geometric = normal @ third / (normal @ normal)
            # Third derivatives of a degree 13 fit over 0.1 m lose about 1e-16 / 0.01^3.
            assert torsion(trunk, activation, np.array([Z]))[0] == pytest.approx(
                geometric, abs=1e-6
            )


def test_the_torsion_of_a_straight_trunk_is_undefined(trunk):
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


def test_a_muscle_of_an_unknown_architecture_is_refused(trunk):
    """It must not be computed as a longitudinal one."""
    twisted = replace(trunk.subdomains[0], architecture="twisted")
    other = replace(trunk, subdomains=(twisted, *trunk.subdomains[1:]))
    with pytest.raises(
        InputError, match=r"R1-dl: architecture = 'twisted'.*one of longitudinal, helical"
    ):
        strain_matrix(other)

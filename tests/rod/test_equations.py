"""Eqs. (14), (15) as the package evaluates them against a second writing in plain NumPy."""

import math

import casadi as ca
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from trunk_ocp.model.loads import Loads
from trunk_ocp.rod.equations import point_parameters, rates
from trust import reference

LOG = Loads(9.8, (3.0, -4.0, 5.0), 1.4, (10.0, 20.0, 144.5), (-113.8, 7.0, 2.0))


def frame(q):
    """Rows d_1, d_2, d_3 of a unit quaternion."""
    q0, q1, q2, q3 = q
    return np.array(
        [
            [q0**2 + q1**2 - q2**2 - q3**2, 2 * (q1 * q2 + q0 * q3), 2 * (q1 * q3 - q0 * q2)],
            [2 * (q1 * q2 - q0 * q3), q0**2 - q1**2 + q2**2 - q3**2, 2 * (q2 * q3 + q0 * q1)],
            [2 * (q1 * q3 + q0 * q2), 2 * (q2 * q3 - q0 * q1), q0**2 - q1**2 - q2**2 + q3**2],
        ]
    )


def written_out(w, p):
    """(q', m', r') from w (15) and p (11), eqs. (14), (15), (30); complex numbers pass through."""
    q0, q1, q2, q3 = w[0:4]
    m1, m2, m3 = w[4:7]
    zeta_hat, c1, c2, c3, mean = w[7:12]
    f, K0, K1, K2, K3 = p[0:5]
    force, couple = w[12:15] + p[5:8], p[8:11]
    d1, d2, d3 = frame(w[0:4])
    n1, n2, n3 = (np.sum(force * d) for d in (d1, d2, d3))
    l1, l2, l3 = (np.sum(couple * d) for d in (d1, d2, d3))
    # R_0* = R_0 / sqrt(mean): K_0 goes with R^2, the others with R^4.
    zeta = zeta_hat * (1 + n3 / (K0 / mean))
    u1 = c1 / f + m1 / (K1 / mean**2)
    u2 = c2 / f + m2 / (K2 / mean**2)
    u3 = c3 / f + m3 / (K3 / mean**2)
    quarter_turn = 0.5 * zeta_hat * np.array(
        [
            -u1 * q1 - u2 * q2 - u3 * q3,
            u1 * q0 + u3 * q2 - u2 * q3,
            u2 * q0 - u3 * q1 + u1 * q3,
            u3 * q0 + u2 * q1 - u1 * q2,
        ]
    )  # fmt: skip
    moment = [
        zeta_hat * (u3 * m2 - u2 * m3) + zeta * n2 - l1,
        zeta_hat * (u1 * m3 - u3 * m1) - zeta * n1 - l2,
        zeta_hat * (u2 * m1 - u1 * m2) - l3,
    ]
    return np.concatenate([quarter_turn, moment, zeta * d3])


def points(count):
    """Random states and parameters of the size that a trunk has."""
    rng = np.random.default_rng(20)
    for _ in range(count):
        q = rng.normal(size=4)
        w = [*(q / np.linalg.norm(q)), *rng.normal(0, 100, 3), rng.uniform(0.7, 1.3)]
        w += [*rng.normal(size=3), rng.uniform(0.7, 1.3), *rng.normal(0, 100, 3)]
        p = [rng.uniform(0.3, 1), *rng.uniform([1e4, 100, 100, 100], [1e5, 1e3, 1e3, 1e3])]
        yield np.array(w), np.array(p + list(rng.normal(0, 300, 3)) + list(rng.normal(0, 100, 3)))


def value(w, p):
    return np.asarray(rates()(w, p)).ravel()


def test_the_rates_are_eqs_14_and_15():
    for w, p in points(20):
        expected = written_out(w, p)
        # Sums of terms up to 1e3 each, rounded at 1e-16.
        np.testing.assert_allclose(value(w, p), expected, rtol=1e-12, atol=1e-11)


def test_the_frame_of_a_quaternion_is_a_rotation_matrix():
    q = np.array([0.5, -0.1, 0.7, 0.5])  # |q| = 1
    np.testing.assert_allclose(
        frame(q), Rotation.from_quat(q[[1, 2, 3, 0]]).as_matrix().T, atol=1e-15
    )


def test_the_frame_turns_with_the_darboux_vector():
    # Eq. (14) itself, d_i' = zeta_hat u x d_i: differentiate the directors along q' by a
    # complex step, which is exact.
    for w, p in points(5):
        rate = value(w, p)
        d = frame(w[:4])
        turning = frame(w[:4] + 1e-30j * rate[:4]).imag / 1e-30
        u = w[8:11] / p[0] + w[4:7] * w[11] ** 2 / p[2:5]
        darboux = u @ d
        np.testing.assert_allclose(turning, w[7] * np.cross(darboux, d), rtol=1e-11, atol=1e-11)


def test_the_quaternion_keeps_its_length():
    for w, p in points(20):
        q, dq = w[:4], value(w, p)[:4]
        assert abs(q @ dq) < 1e-14 * np.linalg.norm(dq)


def test_the_jacobian_is_the_complex_step_derivative():
    w, p = ca.SX.sym("w", 15), ca.SX.sym("p", 11)
    jacobian = ca.Function("jacobian", [w, p], [ca.jacobian(rates()(w, p), w)])
    for at, parameters in points(5):
        columns = [written_out(at + 1e-30j * step, parameters).imag / 1e-30 for step in np.eye(15)]
        # A complex step of 1e-30 has no truncation and no cancellation.
        np.testing.assert_allclose(
            np.asarray(jacobian(at, parameters)), np.transpose(columns), rtol=1e-12, atol=1e-11
        )


def test_many_points_at_once_are_the_points_one_by_one():
    w, p = (np.transpose(part) for part in zip(*points(4), strict=True))
    together = np.asarray(rates()(w, p))
    for column in range(4):
        np.testing.assert_array_equal(together[:, column], value(w[:, column], p[:, column]))


def test_point_parameters_are_taper_stiffness_force_and_couple(trunk):
    Z = np.array([0.1, 1.0, 1.5, 1.7])
    p = point_parameters(trunk, LOG, Z)
    for column, at in enumerate(Z):
        f = 1 - at * math.tan(math.radians(4.81)) / (0.1185 * 1.75)
        R = 0.1185 * 1.75 * f
        K1 = 1e6 * math.pi / 4 * R**4
        share = min(1.0, (1.75 - at) / 0.35)
        force = np.array([10, 20, 144.5]) * share
        force[2] += 9.8 * reference.weight_beyond(trunk, at)
        couple = np.array([-113.8, 7, 2]) / 0.35 if at > 1.4 else np.zeros(3)
        expected = np.concatenate([[f, 1e6 * math.pi * R**2, K1, K1, K1 / 1.5], force, couple])
        np.testing.assert_allclose(p[:, column], expected, rtol=1e-12, atol=1e-11)


def test_the_tip_force_is_an_input_of_the_rates_and_not_a_parameter(trunk):
    Z = np.array([0.5])
    with_tip = point_parameters(trunk, Loads(tip_force=(1e3, 2e3, 3e3)), Z)
    without = point_parameters(trunk, Loads(), Z)
    np.testing.assert_allclose(with_tip, without, atol=1e-12)  # 3e3 added and taken away


@pytest.mark.parametrize("muscle", ["R1-dl", "L2-ivo"])
def test_an_unloaded_section_turns_as_its_muscles_ask(trunk, muscle):
    activation = np.zeros((1, 28))
    activation[0, trunk.muscles.index(muscle)] = -1.0
    segment = int(muscle[1]) - 1
    strain = reference.strains(trunk, activation)[0]
    mean = strain[:, 0] @ [0.5, 0.35, 0.15]
    Z = 0.3 if segment == 0 else 1.0
    w = np.array([1.0, 0, 0, 0, 0, 0, 0, *strain[segment], mean, 0, 0, 0])
    rate = value(w, point_parameters(trunk, Loads(gravity=0.0), np.array([Z]))[:, 0])
    f = 1 - Z * math.tan(math.radians(4.81)) / (0.1185 * 1.75)
    zeta, c = strain[segment, 0], strain[segment, 1:]
    # At the unit quaternion q' = (0, zeta u / 2), and r' = zeta e_3.
    expected = [0, *(zeta * c / f / 2), 0, 0, 0, 0, 0, zeta]
    np.testing.assert_allclose(rate, expected, atol=1e-13)

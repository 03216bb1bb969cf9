"""The unloaded trunk: spliced conical spirals against geometry."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from trunk_ocp.model.activation import strains
from trunk_ocp.model.anatomy import AnatomySpec, build_trunk
from trunk_ocp.model.loads import Loads
from trunk_ocp.model.quaternions import directors
from trunk_ocp.rod.unloaded import unloaded_states
from trust import reference

NO_LOAD = Loads(gravity=0.0)


def frames(q):
    """Directors (..., 3, 3) of quaternions (..., 4)."""
    rows = directors(np.moveaxis(q, -1, 0))
    return np.stack([np.stack(np.broadcast_arrays(*row), axis=-1) for row in rows], axis=-2)


def muscular(taper_deg):
    """One segment with every architecture, on a rod of length 2."""
    muscle = {"radii_over_length": (0.05, 0.1), "sides": ("R",)}
    return build_trunk(
        AnatomySpec.model_validate(
            {
                "name": "rod",
                "length": 2.0,
                "base_radius_over_length": 0.1,
                "taper_deg": taper_deg,
                "material": {"youngs_modulus": 1e6, "poisson_ratio": 0.5, "density": 1000.0},
                "segments": (
                    {
                        "Z_over_length": (0.0, 1.0),
                        "muscles": (
                            muscle
                            | {"group": "dl", "architecture": "longitudinal", "sector": (0.0, 1.0)},
                            muscle
                            | {"group": "he", "architecture": "helical", "sector": (1.0, 3.0)}
                            | {"helix_deg": 40.0},
                        ),
                    },
                ),
            }
        )
    )


def test_at_rest_the_trunk_is_a_straight_line_along_the_clamp(trunk):
    Z = np.linspace(0, trunk.length, 7)
    position, _ = unloaded_states(trunk, np.zeros(28), np.zeros(2), Z)
    # xi_d = 30 degrees from +Z toward +X (eq. 38).
    np.testing.assert_allclose(position, Z[:, None] * [0.5, 0, math.sqrt(0.75)], atol=1e-15)


@pytest.mark.parametrize("activation", [(-0.5, 0.0), (0.0, -0.5), (-0.7, 0.4)])
def test_without_taper_a_segment_is_a_circular_helix(activation):
    rod = muscular(0.0)
    zeta, *c = strains(rod, np.array(activation))[0]
    c = np.array(c)
    Z = np.linspace(0, rod.length, 9)
    position, q = unloaded_states(rod, np.array(activation), np.zeros(2), Z)
    # d_i' = zeta u x d_i with constant u: the frame has turned by zeta Z about the fixed
    # axis u, and the path is a screw about it: pitch part along u, circle across.
    expected = []
    for at in Z:
        s, rate = zeta * at, np.linalg.norm(c)
        axis = c / rate
        along = axis * axis[2]
        across = np.array([0, 0, 1]) - along
        circle = math.sin(rate * s) * across + (1 - math.cos(rate * s)) * np.cross(axis, across)
        expected.append(along * s + circle / rate)
    turns = Rotation.from_rotvec(zeta * Z[:, None] * c).as_matrix().swapaxes(1, 2)
    np.testing.assert_allclose(position, expected, atol=1e-14)
    np.testing.assert_allclose(frames(q), turns, atol=1e-14)


def test_without_taper_and_helix_a_segment_is_a_circular_arc():
    rod = muscular(0.0)
    activation = np.array([-0.8, 0.0])
    zeta, u1, u2, _ = strains(rod, activation)[0]
    position, _ = unloaded_states(rod, activation, np.zeros(2), np.linspace(0, 2, 50))
    radius, inward = 1 / math.hypot(u1, u2), np.array([u2, -u1, 0]) / math.hypot(u1, u2)
    np.testing.assert_allclose(
        np.linalg.norm(position - radius * inward, axis=1), radius, rtol=1e-13
    )
    # Angle swept = arc length over radius; all of it in one plane through the base tangent.
    swept = 2 * zeta / radius
    assert position[-1, 2] == pytest.approx(radius * math.sin(swept), rel=1e-12)
    np.testing.assert_allclose(position @ [u1, u2, 0], 0, atol=1e-14)


def test_vanishing_taper_is_no_taper():
    Z, activation, head = np.linspace(0, 2, 5), np.array([-0.6, -0.5]), np.array([0.1, 0.2])
    straight, _ = unloaded_states(muscular(0.0), activation, head, Z)
    nearly, _ = unloaded_states(muscular(1e-9), activation, head, Z)
    # 1e-9 degrees change curvature by 2e-10 of itself.
    np.testing.assert_allclose(nearly, straight, atol=1e-9)


def test_a_tapered_segment_turns_by_the_logarithm_of_its_taper():
    rod, activation = muscular(3.0), np.array([-0.6, 0.0])
    k = math.tan(math.radians(3.0)) / 0.2
    zeta, *c = strains(rod, activation)[0]
    _, q = unloaded_states(rod, activation, np.zeros(2), np.array([2.0]))
    turned = Rotation.from_matrix(frames(q)[0].T).magnitude()
    # Integral of |u| zeta dZ with u = c / (1 - k Z).
    angle = zeta * np.linalg.norm(c) * -math.log1p(-2 * k) / k
    assert turned == pytest.approx(angle if angle < math.pi else 2 * math.pi - angle, rel=1e-12)


def test_vanishing_activation_is_the_straight_trunk(trunk):
    Z = np.linspace(0, trunk.length, 5)
    rest, _ = unloaded_states(trunk, np.zeros(28), np.zeros(2), Z)
    nearly, _ = unloaded_states(trunk, np.full(28, -1e-13), np.zeros(2), Z)
    np.testing.assert_allclose(nearly, rest, atol=1e-11)  # about 28 * 3 /m * 3 m^2 * 1e-13


def test_a_batch_is_its_members(trunk, draw):
    activation = draw(trunk, 6, seed=12).reshape(2, 3, 28)
    head = np.random.default_rng(13).uniform(-1, 1, (3, 2))
    Z = np.linspace(0, trunk.length, 5)
    position, q = unloaded_states(trunk, activation, head, Z)
    assert position.shape == (2, 3, 5, 3)
    assert q.shape == (2, 3, 5, 4)
    for i, j in np.ndindex(2, 3):
        r_one, q_one = unloaded_states(trunk, activation[i, j], head[j], Z)
        np.testing.assert_allclose(position[i, j], r_one, atol=1e-14)
        np.testing.assert_allclose(q[i, j], q_one, atol=1e-14)


def test_points_may_come_in_any_order_and_the_head_carries_the_trunk_rigidly(trunk, draw):
    activation, psi = draw(trunk, 1, seed=14)[0], (0.4, -0.3)
    Z = np.array([1.6, 0.0, 1.75, 0.875, 0.2])
    rest, _ = unloaded_states(trunk, activation, np.zeros(2), Z)
    moved, _ = unloaded_states(trunk, activation, np.array(psi), Z)
    S = -0.4375 * Rotation.from_euler("Y", 100, degrees=True).apply([0, 0, 1])
    turn = Rotation.from_euler("ZY", psi)
    np.testing.assert_allclose(moved, S + turn.apply(rest - S), atol=1e-14)  # eqs. (35)-(39)


def test_the_tip_depends_on_the_twelve_strain_numbers_only(trunk, draw):
    activation = draw(trunk, 1, seed=15)[0]
    _, _, rows = np.linalg.svd(reference.strain_matrix(trunk).reshape(12, 28))
    other = activation + np.random.default_rng(16).normal(size=16) @ rows[12:]
    tips = [
        unloaded_states(trunk, gamma, np.zeros(2), np.array([1.75]))[0]
        for gamma in (activation, other)
    ]
    np.testing.assert_allclose(tips[0], tips[1], atol=1e-11)  # quadrature null space: 1e-13

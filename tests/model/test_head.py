"""The base of the trunk on its sphere, eqs. (35)-(39), against scipy's rotations."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from trunk_ocp.model.head import base_pose
from trunk_ocp.model.quaternions import directors

ANGLES = [(0.0, 0.0), (0.4, 0.0), (0.0, -0.3), (-0.7, 0.9), (2.5, -1.2)]
ROUND_OFF = 1e-14  # a few products of numbers of size one


def pose(head, psi):
    r, q = base_pose(head, *psi)
    return np.array(r), np.array(directors(q)), np.array(q)


def rotation(z, y):
    """R(z, e_Z) R(y, e_Y)."""
    return Rotation.from_rotvec([0, 0, z]) * Rotation.from_rotvec([0, y, 0])


def test_at_rest_the_base_is_at_the_origin(trunk):
    r, d, _ = pose(trunk.head, (0.0, 0.0))
    np.testing.assert_array_equal(r, np.zeros(3))
    # d_3 leans from +Z (down) by xi_d = 30 degrees toward +X.
    np.testing.assert_allclose(d[2], [0.5, 0, np.sqrt(0.75)], atol=ROUND_OFF)


@pytest.mark.parametrize("psi", ANGLES)
def test_base_and_frame_are_eqs_36_to_39(trunk, psi):
    turn, xi = rotation(*psi), np.radians([0, 100, 30])
    s_default = rotation(xi[0], xi[1]).apply([0, 0, 1])
    r, d, q = pose(trunk.head, psi)
    S = -1.75 / 4 * s_default
    np.testing.assert_allclose(r, S + 1.75 / 4 * turn.apply(s_default), atol=ROUND_OFF)
    frame = turn * rotation(xi[0], xi[2])
    np.testing.assert_allclose(d, frame.apply(np.eye(3)), atol=ROUND_OFF)
    assert np.linalg.norm(r - S) == pytest.approx(1.75 / 4, rel=1e-14)  # eq. (35)
    assert q @ q == pytest.approx(1, rel=1e-14)


@pytest.mark.parametrize("psi", ANGLES)
def test_the_clamp_moves_rigidly_with_the_head(trunk, psi):
    S = -1.75 / 4 * rotation(0, np.radians(100)).apply([0, 0, 1])
    (r_rest, d_rest, _), (r, d, _) = pose(trunk.head, (0.0, 0.0)), pose(trunk.head, psi)
    # What an observer on the head sees: arm and directors, and their angles, unchanged.
    np.testing.assert_allclose(d @ (r - S), d_rest @ (r_rest - S), atol=ROUND_OFF)
    np.testing.assert_allclose(d @ d.T, np.eye(3), atol=ROUND_OFF)
    assert np.linalg.det(d) == pytest.approx(1, rel=1e-13)


def test_the_default_head_turns_about_the_base(build):
    r, d, _ = pose(build().head, (0.3, 0.5))
    np.testing.assert_array_equal(r, np.zeros(3))
    np.testing.assert_allclose(d, rotation(0.3, 0.5).apply(np.eye(3)), atol=ROUND_OFF)


def test_poses_come_in_batches(trunk):
    psi = np.array(ANGLES)
    r, q = base_pose(trunk.head, psi[:, 0], psi[:, 1])
    for index, angles in enumerate(ANGLES):
        one, _, quaternion = pose(trunk.head, angles)
        r_at, q_at = ([np.broadcast_to(x, 5)[index] for x in part] for part in (r, q))
        np.testing.assert_allclose(r_at, one, atol=ROUND_OFF)
        np.testing.assert_allclose(q_at, quaternion, atol=ROUND_OFF)

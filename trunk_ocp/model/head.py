"""Pose of the trunk's base for given head angles (eqs. 35-39), for numbers and CasADi symbols."""

from __future__ import annotations

import numpy as np

from .anatomy import Head
from .quaternions import COMPLEX_STEP, Scalar, about_y, about_z, directors, product


def base_pose(
    head: Head, psi_z: Scalar, psi_y: Scalar
) -> tuple[tuple[Scalar, Scalar, Scalar], tuple[Scalar, Scalar, Scalar, Scalar]]:
    """Base position r_0 in m and orientation quaternion at head angles psi in radians.

    The head's rotation moves the base on a sphere about S (eq. 35) and turns the clamping
    directions with it (eqs. 38, 39). With psi = 0 the base is at r_D = 0.
    """
    turn = turn_quaternion(psi_z, psi_y)
    rest = product(about_z(head.xi_z), about_y(head.xi_y))
    s = directors(product(turn, rest))[2]  # eq. (37)
    s_default = directors(rest)[2]  # eq. (36)
    r = head.pivot_radius
    x, y, z = (r * (a - b) for a, b in zip(s, s_default, strict=True))
    return (x, y, z), product(turn, product(about_z(head.xi_z), about_y(head.xi_d)))


def turn_quaternion(psi_z: Scalar, psi_y: Scalar) -> tuple[Scalar, Scalar, Scalar, Scalar]:
    """Rotation of the head by its angles in radians: about e_Y first, then about e_Z."""
    return product(about_z(psi_z), about_y(psi_y))


def base_slopes(head: Head, angles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives of r_0 (..., 3, 2) and q_0 (..., 4, 2) by head angles (..., 2) in radians.

    By complex step, which has no truncation error and no cancellation: the pose is analytic.
    """
    varied = angles[..., None] + 1j * COMPLEX_STEP * np.eye(2)
    r, q = base_pose(head, varied[..., 0, :], varied[..., 1, :])
    r_slope, q_slope = (np.imag(np.stack(part, axis=-2)) / COMPLEX_STEP for part in (r, q))
    return r_slope, q_slope

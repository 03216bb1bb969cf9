"""Unit quaternions for the director frame, for numbers and CasADi symbols.

A quaternion is a sequence (q0, q1, q2, q3), scalar first, of scalars or arrays of one shape. It
maps the space axes to the directors, d_i = R(q) e_i.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

Scalar = Any  # a float, an array or a CasADi symbol
COMPLEX_STEP = 1e-30  # small enough that its square vanishes beside 1


def product(p: Sequence[Scalar], q: Sequence[Scalar]) -> tuple[Scalar, Scalar, Scalar, Scalar]:
    """Quaternion product p q: the rotation q followed by p."""
    return (
        p[0] * q[0] - p[1] * q[1] - p[2] * q[2] - p[3] * q[3],
        p[0] * q[1] + p[1] * q[0] + p[2] * q[3] - p[3] * q[2],
        p[0] * q[2] - p[1] * q[3] + p[2] * q[0] + p[3] * q[1],
        p[0] * q[3] + p[1] * q[2] - p[2] * q[1] + p[3] * q[0],
    )


def about_z(angle: Scalar) -> tuple[Scalar, Scalar, Scalar, Scalar]:
    """Rotation by `angle` about e_Z."""
    cos, sin = _cos_sin(angle / 2)
    return (cos, 0 * cos, 0 * cos, sin)


def about_y(angle: Scalar) -> tuple[Scalar, Scalar, Scalar, Scalar]:
    """Rotation by `angle` about e_Y."""
    cos, sin = _cos_sin(angle / 2)
    return (cos, 0 * cos, sin, 0 * cos)


def about_x(angle: Scalar) -> tuple[Scalar, Scalar, Scalar, Scalar]:
    """Rotation by `angle` about e_X."""
    cos, sin = _cos_sin(angle / 2)
    return (cos, sin, 0 * cos, 0 * cos)


def _cos_sin(angle: Scalar) -> tuple[Scalar, Scalar]:
    if isinstance(angle, ca.SX):
        return ca.cos(angle), ca.sin(angle)
    return np.cos(angle), np.sin(angle)


def directors(q: Sequence[Scalar]) -> tuple[tuple[Scalar, Scalar, Scalar], ...]:
    """Directors (d1, d2, d3), each by its space components; quadratic in q, not normalized."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    ww, xx, yy, zz = w * w, x * x, y * y, z * z
    return (
        (ww + xx - yy - zz, 2 * (x * y + w * z), 2 * (x * z - w * y)),
        (2 * (x * y - w * z), ww - xx + yy - zz, 2 * (y * z + w * x)),
        (2 * (x * z + w * y), 2 * (y * z - w * x), ww - xx - yy + zz),
    )


def tangent_slope(q: np.ndarray) -> np.ndarray:
    """Derivative (..., 3, 4) of d_3 by a unit quaternion (..., 4), by complex step."""
    varied = q[..., None] + 1j * COMPLEX_STEP * np.eye(4)
    d3 = directors(tuple(np.moveaxis(varied, -2, 0)))[2]
    return np.imag(np.stack(d3, axis=-2)) / COMPLEX_STEP


def director_rows(q: np.ndarray) -> np.ndarray:
    """Directors (..., 3, 3) of quaternions (..., 4): row i is d_i in space axes."""
    rows = directors(tuple(np.moveaxis(q, -1, 0)))
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def dot(a: Sequence[Scalar], b: Sequence[Scalar]) -> Scalar:
    """Scalar product of two triples."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Sequence[Scalar], b: Sequence[Scalar]) -> tuple[Scalar, Scalar, Scalar]:
    """Vector product of two triples."""
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )

"""The unloaded trunk in closed form: one conical spiral for each segment.

Without loads u_hat = c / f(Z) keeps its direction in the body frame within a segment. So the
frame turns about a fixed axis by kappa * l, with kappa = |c| zeta_hat and the stretched
coordinate l(Z) = ln(f(Z_1) / f(Z)) / k, and the centerline integrates to elementary functions.
"""

from __future__ import annotations

import numpy as np

from ..model.activation import strains
from ..model.anatomy import Trunk, check_activation
from ..model.head import base_pose
from ..model.quaternions import directors, product


def unloaded_states(
    trunk: Trunk, activation: np.ndarray, head: np.ndarray, Z: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Position r_hat (..., n, 3) in m and orientation q_hat (..., n, 4) of the unloaded trunk.

    Parameters
    ----------
    activation : (..., muscles)
    head : (..., 2)
        psi_Z, psi_Y in radians.
    Z : (n,)
        In m from the base, each in [0, L], in any order.

    Raises
    ------
    InputError
        For activations of a wrong shape, or not finite.
    """
    activation = check_activation(trunk, activation)
    head, Z = np.asarray(head, dtype=float), np.asarray(Z, dtype=float)
    strain = strains(trunk, activation)
    shape = np.broadcast_shapes(activation.shape[:-1], head.shape[:-1])
    r0, q0 = base_pose(trunk.head, head[..., 0], head[..., 1])
    r = np.broadcast_to(np.stack(r0, axis=-1), (*shape, 3))
    q = np.broadcast_to(np.stack(q0, axis=-1), (*shape, 4))
    position, orientation = np.empty((*shape, Z.size, 3)), np.empty((*shape, Z.size, 4))
    for i, (start, end) in enumerate(zip(trunk.edges[:-1], trunk.edges[1:], strict=True)):
        inside = (Z > start) & (Z <= end) if i else Z <= end
        points = np.append(Z[inside], end)  # the end carries on to the next segment
        r_at, q_at = _spiral(trunk, strain[..., i, :], start, points)
        r_at = r[..., None, :] + _rotate(q[..., None, :], r_at)
        q_at = np.stack(product(_parts(q[..., None, :]), _parts(q_at)), axis=-1)
        position[..., inside, :], orientation[..., inside, :] = r_at[..., :-1, :], q_at[..., :-1, :]
        r, q = r_at[..., -1, :], q_at[..., -1, :]
    return position, orientation


def _spiral(
    trunk: Trunk, strain: np.ndarray, start: float, Z: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """One segment's spiral from the frame at `start`: positions (..., n, 3), turns (..., n, 4)."""
    k, f1 = trunk.taper_rate, float(trunk.taper(start))
    zeta, c = strain[..., 0], strain[..., 1:]
    bend = np.linalg.norm(c, axis=-1)
    axis = c / np.where(bend > 0, bend, 1.0)[..., None]
    shrink = k * (Z - start) / f1
    length = (Z - start) / f1 * _ratio(np.log1p(-shrink), -shrink)
    kappa = (bend * zeta)[..., None]
    half = kappa * length / 2
    turn = np.concatenate(
        [np.cos(half)[..., None], np.sin(half)[..., None] * axis[..., None, :]], axis=-1
    )
    # Integral over Z of exp(i kappa l): f = f_1 exp(-k l), so dZ = f_1 exp(-k l) dl. Written with
    # expm1(z) / z, it has the right limits for k -> 0 and kappa -> 0.
    z = (1j * kappa - k) * length
    wave = f1 * length * _ratio(np.expm1(z), z)
    along = axis * axis[..., 2:]  # axis (axis . e3)
    sideways = np.array([0.0, 0, 1]) - along
    across = np.stack([axis[..., 1], -axis[..., 0], np.zeros_like(bend)], axis=-1)  # axis x e3
    r = (
        (Z - start)[:, None] * along[..., None, :]
        + wave.real[..., None] * sideways[..., None, :]
        + wave.imag[..., None] * across[..., None, :]
    )
    return zeta[..., None, None] * r, turn


def _ratio(numerator: np.ndarray, denominator: np.ndarray) -> np.ndarray:
    """Numerator / denominator, with the limit 1 where both vanish."""
    zero = denominator == 0
    return np.where(zero, 1.0, numerator / np.where(zero, 1.0, denominator))


def _parts(q: np.ndarray) -> tuple[np.ndarray, ...]:
    return tuple(np.moveaxis(q, -1, 0))


def _rotate(q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Components v (..., 3) in the directors, turned to space axes."""
    rows = directors(_parts(q))
    return sum(v[..., i, None] * np.stack(np.broadcast_arrays(*rows[i]), axis=-1) for i in range(3))

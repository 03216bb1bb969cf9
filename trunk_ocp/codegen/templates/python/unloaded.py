"""The unloaded shape in closed form, using only functions that NumPy, JAX and PyTorch share."""

import numpy as np

# <cut>
from tables import (
    EDGE,
    EDGE_SECTION,
    ENDS,
    INPUTS,
    PIECE,
    SEGMENT,
    STRAIN,
    base_slopes,
    spiral_slopes,
    turn_slopes,
)

# </cut>
# Slopes (n, 4, muscles) of zeta and u at the points Z.
POINT_STRAIN = STRAIN[SEGMENT[ENDS]]
POINT_STRAIN[:, 1:] /= EDGE_SECTION[EDGE, :1, None]


def unloaded(controls: np.ndarray) -> np.ndarray:
    """Unloaded shapes y (..., n, 16) of activations and head angles (..., muscles + 2)."""
    return unloaded_in(np, _checked_controls(controls))[0]


def unloaded_jacobian(controls: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unloaded shapes (..., n, 16) and their derivatives (..., n, 16, controls)."""
    return unloaded_in(np, _checked_controls(controls))


def _checked_controls(controls):
    controls, size = np.asarray(controls), INPUTS["head"].stop
    if controls.shape[-1:] != (size,):
        raise ValueError(f"controls: expected shape (..., {size}), got {controls.shape}.")
    return controls if np.iscomplexobj(controls) else controls.astype(float)


def unloaded_in(xp, controls, slopes: bool = True):
    """Unloaded shapes and their derivatives, with the functions of an array library xp.

    The trunk is a chain of pieces. Each rotates the directors, D_b = T D_a (rows d_i), and advances
    the centerline, r_b = r_a + rho D_a, both in closed form from its segment's strains.
    """
    like = lambda table: xp.asarray(table, dtype=controls.dtype)
    activation, head = controls[..., INPUTS["activation"]], controls[..., INPUTS["head"]]
    strain = [float(i == 0) + activation @ like(STRAIN[SEGMENT, i].T) for i in range(4)]
    pose = _outputs(xp, base_slopes, [head[..., 0], head[..., 1]], [], 7, 2)
    turn = _outputs(xp, turn_slopes, strain, [like(PIECE[:, 0])], 4, 4)
    rho = _outputs(xp, spiral_slopes, strain, [like(p) for p in PIECE.T], 3, 4)
    T, step = _rows(xp, _directors(turn[0])), _rows(xp, [rho[0]])
    D, r = [_rows(xp, _directors(pose[0][:4]))], [_rows(xp, [pose[0][4:]])]
    for e in range(len(SEGMENT)):
        r.append(r[e] + step[..., e, :, :] @ D[e])
        D.append(T[..., e, :, :] @ D[e])
    at_r = xp.stack([r[e][..., 0, :] for e in EDGE], axis=-2)
    at_D = xp.stack([D[e] for e in EDGE], axis=-3)
    own = [float(i == 0) + activation @ like(POINT_STRAIN[:, i].T) for i in range(4)]
    at_own = xp.stack(own, axis=-1)
    y = xp.concatenate([at_r, *(at_D[..., i, :] for i in range(3)), at_own], axis=-1)
    if not slopes:
        return y, None
    angle, shift = _motions(xp, pose, turn, rho, D, r)
    rows = like(_rows_before_points())  # (n, rows, controls)
    angle, shift = angle[..., None, :, :] @ rows, shift[..., None, :, :] @ rows
    d_r = shift + _cross(xp, angle, at_r[..., None], -2)
    d_D = [_cross(xp, angle, at_D[..., i, :][..., None], -2) for i in range(3)]
    fixed = np.concatenate([POINT_STRAIN, np.zeros((len(EDGE), 4, 2))], axis=-1)
    d_strain = like(fixed) + xp.zeros_like(d_r[..., :1, :])
    return y, xp.concatenate([d_r, *d_D, d_strain], axis=-2)


def _motions(xp, pose, turn, rho, D, r):
    """Rigid-body motion, angle and shift, of everything beyond due to each strain and head angle.

    Both (..., 3, 4 pieces + 2): strain 0 of all pieces, strain 1 of all, ..., head. The shift is
    that of the origin, so that a point at r moves by shift + angle x r.
    """
    before = xp.stack(D[:-1], axis=-3)
    end = xp.stack([place[..., 0, :] for place in r[1:]], axis=-2)[..., None, :]
    angle = _rows(xp, [_angle(turn[0], d) for d in turn[1]]) @ before
    shift = _rows(xp, rho[1]) @ before - _cross(xp, angle, end, -1)
    turned = _rows(xp, [_angle(pose[0], d) for d in pose[1]])
    moved = _rows(xp, [d[4:] for d in pose[1]]) - _cross(xp, turned, r[0], -1)
    angle = xp.concatenate([*(angle[..., i, :] for i in range(4)), turned], axis=-2)
    shift = xp.concatenate([*(shift[..., i, :] for i in range(4)), moved], axis=-2)
    return (xp.stack([part[..., i] for i in range(3)], axis=-2) for part in (angle, shift))


def _rows_before_points():
    """Slopes (n, 4 pieces + 2, controls) of all strains before a point, and of the head."""
    pieces, size = len(SEGMENT), INPUTS["head"].stop
    rows = np.zeros((len(EDGE), 4 * pieces + 2, size))
    for n, edge in enumerate(EDGE):
        own = STRAIN[SEGMENT].swapaxes(0, 1) * (np.arange(pieces) < edge)[:, None]
        rows[n, :-2, INPUTS["activation"]] = own.reshape(4 * pieces, -1)
        rows[n, -2:, INPUTS["head"]] = np.eye(2)
    return rows


def _rows(xp, rows):
    """Rows of arrays of equal shape (...) as one array (..., rows, columns)."""
    return xp.stack([xp.stack(list(row), axis=-1) for row in rows], axis=-2)


def _outputs(xp, kernel, w, p, size, inputs):
    """Outputs of a kernel, a list, and a list of their slopes for each input."""
    value, slopes = [None] * size, [None] * (size * inputs)
    kernel(w, p, value, slopes, xp)
    zero = xp.zeros_like(w[0])
    value, slopes = [zero + part for part in value], [zero + part for part in slopes]
    return value, [slopes[i * size : (i + 1) * size] for i in range(inputs)]


def _directors(q):
    """Rows d_1, d_2, d_3 of a unit quaternion."""
    w, x, y, z = q
    return (
        (w * w + x * x - y * y - z * z, 2 * (x * y + w * z), 2 * (x * z - w * y)),
        (2 * (x * y - w * z), w * w - x * x + y * y - z * z, 2 * (y * z + w * x)),
        (2 * (x * z + w * y), 2 * (y * z - w * x), w * w - x * x - y * y + z * z),
    )


def _angle(q, d):
    """Rotation vector of the change d of a quaternion q: 2 d o conj(q)."""
    w, x, y, z = q[:4]
    return (
        2 * (d[1] * w - d[0] * x - d[2] * z + d[3] * y),
        2 * (d[2] * w - d[0] * y - d[3] * x + d[1] * z),
        2 * (d[3] * w - d[0] * z - d[1] * y + d[2] * x),
    )


def _cross(xp, a, b, axis):
    part = lambda v, i: v[..., i] if axis == -1 else v[..., i, :]
    return xp.stack(
        [
            part(a, 1) * part(b, 2) - part(a, 2) * part(b, 1),
            part(a, 2) * part(b, 0) - part(a, 0) * part(b, 2),
            part(a, 0) * part(b, 1) - part(a, 1) * part(b, 0),
        ],
        axis=axis,
    )

"""How the tip of a loaded trunk follows its muscles and head: exact derivatives of statics.

The collocation equations of `statics`, differentiated by activations and head angles (implicit
function theorem) and solved with the same condensed elements: one linear solve, exact for the
collocated trunk.
"""

from __future__ import annotations

from functools import cache

import casadi as ca
import numpy as np

from .._support.arguments import check_arguments
from .._support.deferred_signals import deferred_interrupts
from ..errors import InputError
from ..model.activation import mean_extension, segment_at, segment_fractions, strain_matrix, strains
from ..model.anatomy import Head
from ..model.head import base_pose
from ..model.loads import Loads
from ..model.quaternions import directors
from .block_gaps import close_gaps
from .collocation import gauss
from .equations import STATES, STRAINS, point_parameters, rates
from .statics import Shape, check_controls, edge_units


@check_arguments
@deferred_interrupts()
def tip_jacobian(
    shape: Shape, activation: np.ndarray, head: np.ndarray | tuple[float, float], loads: Loads
) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives of tip position and tangent by all activations and both head angles.

    Parameters
    ----------
    shape : Shape
        Of one trunk, as `solve_statics` returned it for the other arguments.
    activation : (muscles,)
    head : (2,)
        psi_Z, psi_Y in radians.

    Returns
    -------
    position : (3, muscles + 2)
        In m per unit of activation, and m per radian in the last two columns.
    tangent : (3, muscles + 2)
        Of d_3(L).

    Raises
    ------
    InputError
        For a batch, wrong shapes or values that are not finite.
    """
    trunk, mesh = shape.trunk, shape.mesh
    activation, head = check_controls(trunk, activation, head)
    if shape.states.ndim != 3 or activation.ndim != 1 or head.ndim != 1:
        raise InputError("shape, activation, head: expected one of each, no batch.")
    E, d, element, h = mesh.elements, mesh.degree, gauss(mesh.degree), mesh.widths
    by_state, by_strain = _slopes(shape, activation, loads)
    per_muscle = _strain_slopes(shape)  # (E, 5, muscles + 2)
    forced = by_strain @ per_muscle[:, None]  # (E, d, 10, muscles + 2)

    # Response of each element's Gauss points to its left edge (7) and to the unknowns.
    n = d * STATES
    matrix = np.zeros((E, d, STATES, d, STATES))
    right = np.zeros((E, d, STATES, STATES + forced.shape[-1]))
    same = np.arange(STATES)
    matrix[:, :, same, :, same] = element.derivative[:, 1:]
    for j in range(d):
        matrix[:, j, :, j, :] -= h[:, None, None] * by_state[:, j, :STATES]
    right[:, :, same, same] = -element.derivative[:, 0][:, None]
    right[..., STATES:] = h[:, None, None, None] * forced[..., :STATES, :]
    inner = np.linalg.solve(matrix.reshape(E, n, n), right.reshape(E, n, -1))
    inner = inner.reshape(E, d, STATES, -1)

    # All edges together; m(0) is what keeps m(L) at zero.
    at_end = element.value(1.0)
    r0_slope, q0_slope = base_slopes(trunk.head, np.asarray(head, dtype=float))
    response = np.einsum("j,kjxc->kxc", at_end[1:], inner)
    maps, gaps = response[..., :STATES] + at_end[0] * np.eye(STATES), response[..., STATES:]
    gaps[0, :, -2:] += maps[0, :, :4] @ q0_slope
    unit = edge_units(trunk, mesh)
    scaled = maps * unit[:-1, None] / unit[1:, :, None]
    by_unknown = close_gaps(scaled[None], (gaps / unit[1:, :, None])[None])[0] * unit[..., None]
    by_unknown[0, :4, -2:] = q0_slope

    at_points = inner[..., :STATES] @ by_unknown[:-1, None] + inner[..., STATES:]
    slopes = by_state[..., STATES:, :] @ at_points + forced[..., STATES:, :]
    weights = h[:, None] * element.integral(1.0)
    position = np.einsum("ed,edci->ci", weights, slopes)
    position[:, -2:] += r0_slope
    tangent = tangent_slope(shape.state(np.array([trunk.length]))[0, :4]) @ by_unknown[-1, :4]
    return position, tangent


def _slopes(shape: Shape, activation: np.ndarray, loads: Loads) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives of the rates: by state (E, d, 10, 7), by strain (E, d, 10, 5)."""
    trunk, mesh = shape.trunk, shape.mesh
    E, d = mesh.elements, mesh.degree
    strain = strains(trunk, np.asarray(activation, dtype=float))
    w = np.empty((E, d, 15))
    w[..., :STATES] = shape.states[:, 1:]
    w[..., 7:11] = strain[segment_at(trunk, mesh.points[:, 0])][:, None]
    w[..., 11] = mean_extension(trunk, strain)
    w[..., 12:] = loads.tip_force
    p = point_parameters(trunk, loads, mesh.points.ravel())
    jacobian = np.asarray(_rates_jacobian()(w.reshape(-1, 15).T, p)).T.reshape(E, d, 12, 10)
    jacobian = jacobian.swapaxes(-1, -2)
    return jacobian[..., :STATES], jacobian[..., STATES:]


@cache
def _rates_jacobian() -> ca.Function:
    """Jacobian of `rates` by states and strains, column by column."""
    w, p = ca.SX.sym("w", 15), ca.SX.sym("p", 11)
    jacobian = ca.jacobian(rates()(w, p), w)[:, : STATES + STRAINS]
    return ca.Function("rates_jacobian", [w, p], [ca.vec(ca.densify(jacobian))])


def _strain_slopes(shape: Shape) -> np.ndarray:
    """Derivative of each element's strains and the mean extension, (E, 5, muscles + 2)."""
    A = strain_matrix(shape.trunk)
    slopes = np.zeros((shape.mesh.elements, STRAINS, A.shape[2] + 2))
    slopes[:, :4, :-2] = A[segment_at(shape.trunk, shape.mesh.points[:, 0])]
    slopes[:, 4, :-2] = segment_fractions(shape.trunk) @ A[:, 0]
    return slopes


def base_slopes(head: Head, angles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives of r_0 (..., 3, 2) and q_0 (..., 4, 2) by head angles (..., 2): exact.

    By complex step, as the pose is analytic in the angles.
    """
    step = 1e-30
    varied = angles[..., None] + 1j * step * np.eye(2)
    r, q = base_pose(head, varied[..., 0, :], varied[..., 1, :])
    return np.imag(np.stack(r, axis=-2)) / step, np.imag(np.stack(q, axis=-2)) / step


def tangent_slope(q: np.ndarray) -> np.ndarray:
    """Derivative (..., 3, 4) of d_3 by a unit quaternion (..., 4)."""
    step = 1e-30
    varied = q[..., None] + 1j * step * np.eye(4)
    d3 = directors(tuple(np.moveaxis(varied, -2, 0)))[2]
    return np.imag(np.stack(d3, axis=-2)) / step

"""Derivatives of the tip of a loaded trunk by its muscles and head angles.

The collocation equations of `statics` are differentiated by activations and head angles (implicit
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
from ..model.activation import segment_at, segment_fractions, strain_matrix
from ..model.head import base_slopes
from ..model.loads import Loads
from ..model.quaternions import tangent_slope
from .arguments import check_controls
from .collocation import gauss
from .condensed import condense
from .equations import ORIENTATION, POSITION, RATES, STATES, STRAINS, rate_arguments, rates
from .rod_batch import RodBatch, evaluate
from .shape import Shape


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
    rod = RodBatch(trunk, mesh, activation[None], head[None], [loads])
    (columns,) = evaluate(_rates_jacobian(rod.hung), shape.states[None, :, 1:], *rod.arguments)
    jacobian = columns[0].reshape(mesh.elements, mesh.degree, STATES + STRAINS, RATES)
    by_state, by_strain = np.split(jacobian.swapaxes(-1, -2), [STATES], axis=-1)
    forced = by_strain @ _strain_slopes(shape)[:, None]  # (E, d, 10, muscles + 2)
    h, element = mesh.widths[:, None, None, None], gauss(mesh.degree)
    elements = condense(mesh, by_state[None, ..., :STATES, :], (h * forced)[None, ..., :STATES, :])

    # The head turns the first edge, and what follows from that enters as a gap behind it.
    r0_slope, q0_slope = base_slopes(trunk.head, head)
    gaps = np.zeros_like(elements.offsets)
    gaps[0, 0, :, -2:] = elements.maps[0, 0, :, ORIENTATION] @ q0_slope
    edges = elements.at_edges(trunk, mesh, gaps)
    edges[0, 0, ORIENTATION, -2:] = q0_slope

    at_points = elements.at_points(edges[:, :-1])[0]
    slopes = by_state[..., POSITION, :] @ at_points + forced[..., POSITION, :]
    weights = mesh.widths[:, None] * element.integral(1.0)
    position = np.einsum("ed,edci->ci", weights, slopes)
    position[:, -2:] += r0_slope
    q = shape.state(np.array([trunk.length]))[0, ORIENTATION]
    return position, tangent_slope(q) @ edges[0, -1, ORIENTATION]


@cache
def _rates_jacobian(hung: bool) -> ca.Function:
    """Jacobian of `rates` by states (7) and strains (5), column by column."""
    w, p = rate_arguments(hung)
    jacobian = ca.jacobian(rates(hung)(w, p), w)[:, : STATES + STRAINS]
    return ca.Function("rates_jacobian", [w, p], [ca.vec(ca.densify(jacobian))])


def _strain_slopes(shape: Shape) -> np.ndarray:
    """Derivative of each element's strains and the mean extension, (E, 5, muscles + 2)."""
    A = strain_matrix(shape.trunk)
    slopes = np.zeros((shape.mesh.elements, STRAINS, A.shape[2] + 2))
    slopes[:, :4, :-2] = A[segment_at(shape.trunk, shape.mesh.points[:, 0])]
    slopes[:, 4, :-2] = segment_fractions(shape.trunk) @ A[:, 0]
    return slopes

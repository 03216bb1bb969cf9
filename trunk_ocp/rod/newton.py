"""Newton's method on the collocation equations of rods, many at once."""

from __future__ import annotations

from functools import cache

import casadi as ca
import numpy as np

from ..model.activation import stiffness
from .collocation import Mesh, gauss
from .condensed import condense
from .equations import MOMENT, ORIENTATION, POSITION, STATES, rate_arguments, rates
from .rod_batch import RodBatch, evaluate
from .shape import extension

MAX_ITERATIONS = 30
STEP_TOL = 1e-7  # on the last Newton step, relative; the error after it is its square
DIVERGED = 1e6  # size of a step
MOMENT_FLOOR = 1e-3  # of E I(0) / L: smaller moments do not count as relative, for tiny loads


def newton(rods: RodBatch, states: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """States (B, elements, degree + 1, 7) from guesses, and which rods converged (B,)."""
    w, p = rods.arguments
    states = states.copy()
    active = np.arange(len(rods.loads))
    converged = np.zeros(len(rods.loads), dtype=bool)
    floor = MOMENT_FLOOR * stiffness(rods.trunk, 0.0)[1] / rods.trunk.length
    with np.errstate(all="ignore"):  # a rod that diverges is dropped, not reported
        for _ in range(MAX_ITERATIONS):
            step = _step(rods, states[active], w[:, active], p[:, active])
            states[active] += step
            turn = np.abs(step[..., ORIENTATION]).max(axis=(1, 2, 3))
            moment = np.abs(states[active][..., MOMENT]).max(axis=(1, 2, 3)) + floor
            size = np.maximum(turn, np.abs(step[..., MOMENT]).max(axis=(1, 2, 3)) / moment)
            converged[active[size < STEP_TOL]] = True
            active = active[(size >= STEP_TOL) & (size < DIVERGED)]  # NaN drops out as well
            if not active.size:
                break
    return states, converged


def _step(rods: RodBatch, states: np.ndarray, w: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Newton step for states (B, E, d + 1, 7); w and p as in `RodBatch.arguments`."""
    mesh, element = rods.mesh, gauss(rods.mesh.degree)
    rate, slope = evaluate(rates_and_slope(rods.hung), states[..., 1:, :], w, p)
    residual = (
        np.einsum("ij,...jx->...ix", element.derivative, states)
        - mesh.widths[:, None, None] * rate[..., :STATES]
    )
    slopes = slope.reshape(*slope.shape[:3], STATES, STATES)
    elements = condense(mesh, slopes, -residual[..., None])
    edges = elements.at_edges(rods.trunk, mesh, _gaps(mesh, states)[..., None])[:, :-1]
    step = np.empty_like(states)
    step[:, :, 0] = edges[..., 0]
    step[:, :, 1:] = elements.at_points(edges)[..., 0]
    return step


def _gaps(mesh: Mesh, states: np.ndarray) -> np.ndarray:
    """Mismatch (B, E, 7) of each element's end with the next one's start; at the tip, m(L)."""
    gaps = np.einsum("j,bkjx->bkx", gauss(mesh.degree).value(1.0), states)
    gaps[:, :-1] -= states[:, 1:, 0]
    gaps[:, -1, ORIENTATION] = 0.0
    return gaps


@cache
def rates_and_slope(hung: bool) -> ca.Function:
    """`rates` (10) and the Jacobian of (q', m') by the state (7 x 7, row by row), as columns."""
    w, p = rate_arguments(hung)
    value = rates(hung)(w, p)
    slope = ca.jacobian(value[:STATES], w)[:, :STATES]
    return ca.Function("rates_and_slope", [w, p], [value, ca.vec(ca.densify(slope.T))])


def compressed(rods: RodBatch, states: np.ndarray) -> np.ndarray:
    """Whether the loads leave nothing of the length somewhere, zeta <= 0, (B,).

    Looks at the Gauss points and, by their polynomials, at both ends of each element.
    """
    with np.errstate(all="ignore"):
        (rate,) = evaluate(rates(rods.hung), states[..., 1:, :], *rods.arguments)
        zeta = extension(states[..., 1:, ORIENTATION], rate[..., POSITION])
        to_ends = gauss(rods.mesh.degree).from_nodes(np.array([0.0, 1.0]))
        ends = np.einsum("ij,bkj->bki", to_ends, zeta)
    return np.asarray(np.any(zeta <= 0, axis=(1, 2)) | np.any(ends <= 0, axis=(1, 2)))

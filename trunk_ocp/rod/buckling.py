"""Whether an equilibrium of the rod is stable: the second variation of its energy.

Stretch enters the energy as a convex quadratic at each Z, so it can be minimized out pointwise.
What remains under dead loads is a functional of the directors alone, with the force N(Z) known:

    Pi = int_0^L zeta_hat (sum_i K_i / (2 mean^2) (u_i - u_hat_i)^2
                           - n_3 - mean / (2 K_0) n_3^2) dZ,

n_3 = N . d_3. Under a small rotation y(Z) in space axes, y(0) = 0, the energy changes by half of

    Q[y] = int_0^L (chi . B chi + M . (y' x y) + zeta (n_3 |y|^2 - (d_3 . y) (N . y))
                    - zeta_hat mean / K_0 (y . (N x d_3))^2) dZ,

where chi_i = d_i . y' is the change of the spin zeta_hat u_i, B_i = K_i / (mean^2 zeta_hat) and
M the moment in space axes. A contact force on a lever along d_2 adds h_2 |y|^2 - (d_2 . y) (h . y),
h being the lever times the force per length. The first term is the rod's own stiffness; all others
are due to the loads. The equilibrium is stable if Q is positive for every y (Trefftz's criterion).

A couple that keeps its direction in space is not conservative in three dimensions (Ziegler,
Principles of Structural Stability, 1968). Its moment enters M, but its tangent, 1/2 l x eta in the
rotation vector eta, is skew: it adds nothing to Q, which is the symmetric part of the tangent
stiffness. By Bromwich's bound a positive Q then rules out divergence, that is static buckling, but
not flutter, which `flutter` finds.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Self

import numpy as np

from .._support.arguments import check_arguments
from ..errors import InputError
from ..model.activation import intrinsic_strain, mean_extension, stiffness, strains
from ..model.anatomy import check_activation
from ..model.loads import Loads, internal_force, internal_forces, lever_density
from .collocation import Mesh, gauss
from .equations import loaded_extension
from .shape import Shape

MAX_DENSE_UNKNOWNS = 240  # of one matrix; beyond, elements are condensed one by one
MAX_MARGIN_SIZE = 1e12  # where the bisection for a negative margin gives up
MARGIN_TOL = 1e-11  # of that bisection
NEUTRAL_MARGIN = 1e-5  # counts as zero: on the meshes of plans the margin is off by up to 2e-6


@dataclass(frozen=True, eq=False)
class Stability:
    """How far equilibria are from buckling, with the batch axes (...) of their shapes.

    Attributes
    ----------
    margin : (...,)
        Least Q[y] / int chi . B chi dZ, no unit: the share of the stiffness that the loads
        leave in the direction that they weaken most. 1 without loads, never more; 0 where the
        shape buckles; 1 - P / P_cr for a straight column under a thrust P.
    index : (...,) int
        Number of independent directions in which the energy falls (Morse index).
    """

    margin: np.ndarray
    index: np.ndarray

    @property
    def stable(self) -> np.ndarray:
        """Whether the energy rises in every direction, (...,) bool; False if one is neutral."""
        return np.asarray(self.margin > NEUTRAL_MARGIN)


@check_arguments
def buckling_margin(
    shape: Shape, activation: np.ndarray, loads: Loads | Sequence[Loads]
) -> Stability:
    """Stability of equilibria (...) as `solve_statics` returned them for the other arguments.

    y' takes any value at the shape's Gauss points, y is its integral by the collocation polynomials
    and Q a sum by the Gauss rule: the variational form of the Gauss method (Marsden & West, Acta
    Numerica 10, 2001, part 2), of the same order 2d. With chi scaled by sqrt(B) the
    margin is the least eigenvalue of one symmetric matrix. That takes time as the cube of the
    number of nodes, so on long meshes it is found by bisection, in time linear in the nodes.

    Parameters
    ----------
    activation : (..., muscles)
    loads : Loads, or one for each shape along the last batch axis

    Raises
    ------
    InputError
        For activations or loads that do not match the shape's batch axes.
    """
    batch, Z = shape.states.shape[:-3], shape.mesh.points.ravel()
    activations, each, which = matched(shape, activation, loads)
    forces = [
        (internal_force(load, shape.trunk, Z), lever_density(load, shape.trunk, Z)) for load in each
    ]
    integral = integral_matrix(shape.mesh) if 3 * Z.size <= MAX_DENSE_UNKNOWNS else None
    margin, index = np.empty(batch), np.zeros(batch, dtype=int)
    for i in np.ndindex(batch):  # one by one, as a large batch would fill the memory
        parts = integrand(shape[i], activations[i], *forces[which[i]])
        if integral is not None:
            values = _eigenvalues(integral, *parts)
            margin[i], index[i] = values[0], np.count_nonzero(values < -NEUTRAL_MARGIN)
        else:
            margin[i], index[i] = _ElementChain.of(shape.mesh, *parts).margin()
    return Stability(np.minimum(margin, 1.0), index)


def all_stable(shape: Shape, activation: np.ndarray, loads: Loads | Sequence[Loads]) -> bool:
    """Whether all of some equilibria are stable; a tenth of the work of their margins.

    Arguments and errors are those of `buckling_margin`.
    """
    Z = shape.mesh.points.ravel()
    activations, each, which = matched(shape, activation, loads)
    forces = internal_forces(each, shape.trunk, Z)[which]
    levers = np.array([lever_density(load, shape.trunk, Z) for load in each])[which]
    parts = integrand(shape, activations, forces, levers)
    return _ElementChain.of(shape.mesh, *parts).all_above(NEUTRAL_MARGIN)


def matched(
    shape: Shape, activation: np.ndarray, loads: Loads | Sequence[Loads]
) -> tuple[np.ndarray, list[Loads], np.ndarray]:
    """Activations (..., muscles) of shapes (...), loads, and which of them are each shape's (...).

    Raises
    ------
    InputError
        For activations or loads that do not match the shape's batch axes.
    """
    batch = shape.states.shape[:-3]
    activation = check_activation(shape.trunk, activation)
    each = [loads] if isinstance(loads, Loads) else list(loads)
    try:
        which = np.broadcast_to(0 if len(each) == 1 else np.arange(len(each)), batch)
        activations = np.broadcast_to(activation, (*batch, activation.shape[-1]))
    except ValueError:
        raise InputError(
            f"activation and loads: expected leading axes that match those of the shape, {batch}, "
            f"got {activation.shape[:-1]} with {len(each)} loads."
        ) from None
    return activations, each, which


def integrand(
    shape: Shape, activation: np.ndarray, N: np.ndarray, lever: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rate, by_turn and by_rate, (..., n, 3, 3), of Q as a sum over n Gauss points.

    Q = sum of |s|^2 + y . (by_turn y + by_rate y'), y' = rate s; the Gauss weights are in them.

    activation : (..., muscles); N : (..., n, 3), force on the sections in N and space axes;
    lever : (..., n, 3), see `lever_density`.
    """
    trunk, mesh = shape.trunk, shape.mesh
    Z = mesh.points.ravel()
    weights = (mesh.widths[:, None] * gauss(mesh.degree).integral(1.0)).ravel()
    zeta_hat, _ = intrinsic_strain(trunk, activation, Z)
    mean = mean_extension(trunk, strains(trunk, activation))[..., None]
    K = stiffness(trunk, Z)
    B = K[:, 1:] / (mean**2 * zeta_hat)[..., None]
    d, moment = shape.at_points()
    rate = d.swapaxes(-1, -2) / np.sqrt(weights[:, None] * B)[..., None, :]

    softness = mean / K[:, 0]
    d3 = d[..., 2, :]
    n3 = np.sum(N * d3, axis=-1)
    zeta = loaded_extension(zeta_hat, mean, n3, K[:, 0])
    across = np.cross(N, d3)
    by_turn = (
        _per_matrix(weights * zeta * n3) * np.eye(3)
        - _per_matrix(weights * zeta) * _outer(d3, N)
        - _per_matrix(weights * zeta_hat * softness) * _outer(across, across)
    )
    if np.any(lever):
        d2 = d[..., 1, :]
        along = np.sum(lever * d2, axis=-1)
        by_turn += _per_matrix(weights * along) * np.eye(3)
        by_turn -= _per_matrix(weights) * _outer(d2, lever)
    M = np.einsum("...i,...ij->...j", moment, d)
    by_rate = _per_matrix(weights) * np.cross(np.eye(3), M[..., None, :])
    return rate, by_turn, by_rate


def _eigenvalues(
    integral: np.ndarray, rate: np.ndarray, by_turn: np.ndarray, by_rate: np.ndarray
) -> np.ndarray:
    """Eigenvalues (3 n,), ascending, of Q in the unknowns s (n, 3); see `quadratic_form`."""
    Q = quadratic_form(integral, rate, by_turn, by_rate)
    if not np.all(np.isfinite(Q)):  # no equilibrium, and so no stable one
        return np.full(len(Q), np.nan)
    return np.linalg.eigvalsh(Q)


def quadratic_form(
    integral: np.ndarray, rate: np.ndarray, by_turn: np.ndarray, by_rate: np.ndarray
) -> np.ndarray:
    """Matrix (3 n, 3 n) of Q in the unknowns s (n, 3); see `integrand`.

    integral : (n, n), from y' to y.
    """
    size, points = 3 * len(integral), np.arange(len(integral))
    turn = np.einsum("kl,lai->kali", integral, rate)
    load = by_turn @ turn.reshape(-1, 3, size)
    by_point = load.reshape(-1, 3, len(integral), 3)
    by_point[points, :, points] += by_rate @ rate
    Q = turn.reshape(size, size).T @ load.reshape(size, size)
    whole: np.ndarray = np.eye(size) + (Q + Q.T) / 2
    return whole


@dataclass(frozen=True, eq=False)
class _ElementChain:
    """Q of shapes (...), element by element: in unknowns s (3 d) and the turn y at the left edge.

    Let y_1 . P y_1 be the least value of Q over all elements beyond, for a turn y_1 at the right
    edge. Then

        Q - share |s|^2 = s . (inner - share) s + 2 y . mixed s + y . edge y + y_1 . P y_1,

    y_1 = y + over s. Its least value over s gives the P of the element before. By Haynsworth's
    inertia formula for Schur complements, Q has as many eigenvalues below the share as the matrices
    of s together have below zero.

    Attributes
    ----------
    inner : (..., E, 3 d, 3 d)
    mixed, over : (..., E, 3, 3 d)
    edge : (..., E, 3, 3)
    """

    inner: np.ndarray
    mixed: np.ndarray
    over: np.ndarray
    edge: np.ndarray

    @classmethod
    def of(cls, mesh: Mesh, rate: np.ndarray, by_turn: np.ndarray, by_rate: np.ndarray) -> Self:
        """The chain of an integrand (..., n, 3, 3) on a mesh; see `integrand`."""
        element, E, d, batch = gauss(mesh.degree), mesh.elements, mesh.degree, rate.shape[:-3]
        each, square = (*batch, E, d, 3, 3), (*batch, E, 3 * d, 3 * d)
        rates = (mesh.widths[:, None, None, None] * rate.reshape(each)).swapaxes(-3, -2)
        turn = np.einsum("kj,...ajb->...kajb", element.integral(element.nodes), rates)
        over = element.integral(1.0)[:, None] * rates
        A = (by_turn + by_turn.swapaxes(-1, -2)).reshape(each) / 2
        load = np.einsum("...kac,...kcjb->...kajb", A, turn)
        mixed = load.sum(axis=-4)
        half = (by_rate @ rate).reshape(each) / 2
        mixed += half.swapaxes(-3, -2)
        points = np.arange(d)
        load[..., points, :, points, :] += 2 * np.moveaxis(half, -3, 0)
        Q = turn.reshape(square).swapaxes(-1, -2) @ load.reshape(square)
        inner = np.eye(3 * d) + (Q + Q.swapaxes(-1, -2)) / 2
        rows = (*batch, E, 3, 3 * d)
        return cls(inner, mixed.reshape(rows), over.reshape(rows), A.sum(axis=-3))

    def margin(self) -> tuple[float, int]:
        """Least eigenvalue, at most 1, and how many are below -NEUTRAL_MARGIN."""
        low, high = 0.0, 1.0
        if not all(np.all(np.isfinite(part)) for part in (self.inner, self.mixed, self.edge)):
            return math.nan, 0  # no equilibrium, and so no stable one
        if not self.below(high - MARGIN_TOL, 1):
            return 1.0, 0
        while low > -MAX_MARGIN_SIZE and self.below(low, 1):
            low, high = 10 * low - 1, low
        while high - low > MARGIN_TOL * max(1.0, -low):
            middle = (low + high) / 2
            low, high = (low, middle) if self.below(middle, 1) else (middle, high)
        return low, self.below(-NEUTRAL_MARGIN) if low < -NEUTRAL_MARGIN else 0

    def all_above(self, share: float) -> bool:
        """Whether all eigenvalues of all shapes are above a share of the stiffness."""
        P = np.zeros((*self.edge.shape[:-3], 3, 3))
        parts = (self.inner, self.mixed, self.over, self.edge)
        elements = zip(*(np.moveaxis(part, -3, 0)[::-1] for part in parts), strict=True)
        for inner, mixed, over, edge in elements:
            push = P @ over
            matrix = inner + over.swapaxes(-1, -2) @ push - share * np.eye(inner.shape[-1])
            right = mixed + push
            if not np.all(np.isfinite(matrix)):
                return False
            try:
                np.linalg.cholesky(matrix)  # fails unless all are positive definite
                P = edge + P - right @ np.linalg.solve(matrix, right.swapaxes(-1, -2))
            except np.linalg.LinAlgError:
                return False
            P = (P + P.swapaxes(-1, -2)) / 2
        return True

    def below(self, share: float, enough: float = math.inf) -> int:
        """Number of eigenvalues below a share of the stiffness; counts no further than `enough`."""
        count, P = 0, np.zeros((3, 3))
        for inner, mixed, over, edge in zip(
            self.inner[::-1], self.mixed[::-1], self.over[::-1], self.edge[::-1], strict=True
        ):
            push = P @ over
            matrix = inner + over.T @ push
            matrix.flat[:: len(inner) + 1] -= share
            if not np.all(np.isfinite(matrix)):
                return count + 1  # overflow: the loads are enormous
            try:
                np.linalg.cholesky(matrix)  # positive definite, as a rule: cheaper than eigenvalues
            except np.linalg.LinAlgError:
                count += int(np.count_nonzero(np.linalg.eigvalsh(matrix) <= 0))
                if count >= enough:
                    return count
            right = mixed + push
            try:
                P = edge + P - right @ np.linalg.solve(matrix, right.T)
            except np.linalg.LinAlgError:
                return max(count, 1)  # exactly at an eigenvalue
            P = (P + P.T) / 2
        return count


@lru_cache(maxsize=16)
def integral_matrix(mesh: Mesh) -> np.ndarray:
    """Matrix (n, n) from rates at the mesh's n Gauss points to the integral from 0 to each.

    Kept, because plans ask for it again and again; read-only.
    """
    element, E = gauss(mesh.degree), mesh.elements
    before, within = np.tri(E, k=-1), np.eye(E)
    parts = (
        before[:, None, :, None] * element.integral(1.0)
        + within[:, None, :, None] * element.integral(element.nodes)[:, None]
    )
    n = E * mesh.degree
    matrix: np.ndarray = (parts * mesh.widths[:, None]).reshape(n, n)
    matrix.setflags(write=False)
    return matrix


def _outer(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Outer products (..., 3, 3) of vectors (..., 3)."""
    return a[..., :, None] * b[..., None, :]


def _per_matrix(a: np.ndarray) -> np.ndarray:
    """Numbers (...) as factors (..., 1, 1) of matrices."""
    return a[..., None, None]

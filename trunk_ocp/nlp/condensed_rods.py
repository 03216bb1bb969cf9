"""Rods of several time steps with their states eliminated: first and second derivatives.

The states of a rod follow from its controls by the collocation equations of `rod_block`,
c = D s - h rates(s, ...) = 0. They are linearized and solved element by element: states at Gauss
points follow from the state at the element's left edge, edges are chained, and the moment at the
base is what leaves the tip free. Second derivatives need the multipliers of the equations, from the
transposed linear equations (the adjoint). Nothing larger than an element is factorized.

Units are the NLP's: lengths in L, moments in E I(0) / L.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from ..rod.collocation import Mesh, gauss
from ..rod.condensed import MAX_GROWTH
from ..rod.equations import MOMENT, ORIENTATION, POSITION, RATES, STATES
from .term_derivatives import first_derivatives, second_derivatives, values

FORCED = 8
"""Arguments of `rates` besides the state: strains (4) and mean extension (1) of the segment, and
the tip force (3)."""
INPUTS = STATES + FORCED
"""What the states inside an element depend on: the state at its left edge, and these."""


class IllConditionedError(ArithmeticError):
    """The equations of a rod cannot be condensed: singular, or errors would grow too much."""


@dataclass(frozen=True, eq=False)
class RodEquationsAt:
    """Collocation equations of H rods of E elements with d Gauss points, at given states.

    Attributes
    ----------
    function : casadi.Function
        `scaled_rates`.
    edges : (H, E + 1, 7)
    inner : (H, E, d, 7)
    forced : (H, E, 8)
    parameters : (H, E, d, k)
        Parameters p of `rates`.
    """

    mesh: Mesh
    length: float
    function: ca.Function
    edges: np.ndarray
    inner: np.ndarray
    forced: np.ndarray
    parameters: np.ndarray

    @property
    def widths(self) -> np.ndarray:
        """Element lengths (E,) in L."""
        return self.mesh.widths / self.length

    @property
    def arguments(self) -> tuple[np.ndarray, np.ndarray]:
        """Arguments (w, p) of `rates`, a row for each Gauss point."""
        forced = np.broadcast_to(self.forced[:, :, None], (*self.inner.shape[:3], FORCED))
        w = np.concatenate([self.inner, forced], axis=-1).reshape(-1, INPUTS)
        return w, self.parameters.reshape(len(w), -1)

    def rates(self) -> np.ndarray:
        """Rates (H, E, d, 10) at the Gauss points, per L."""
        return values(self.function, *self.arguments).reshape(*self.inner.shape[:3], RATES)

    def residuals(self, rates: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Residuals (H, E, d, 7) of collocation, and (H, E, 7) of continuity."""
        element = gauss(self.mesh.degree)
        start, ends = element.end[0], element.end[1:]
        collocation = (
            element.derivative[:, :1] * self.edges[:, :-1, None]
            + element.derivative[:, 1:] @ self.inner
            - self.widths[:, None, None] * rates[..., :STATES]
        )
        reached = start * self.edges[:, :-1] + np.tensordot(ends, self.inner, (0, 2))
        return collocation, reached - self.edges[:, 1:]

    def largest_residual(self, rates: np.ndarray) -> float:
        """The largest of them, infinite if one is not a number."""
        return _largest(*self.residuals(rates))


@dataclass(frozen=True, eq=False)
class CondensedRods:
    """Equations linearized in C local controls of each rod.

    The last column of arrays with C + 1 columns, and of those with 16, is the Newton step that
    removes the residuals.

    Attributes
    ----------
    at : RodEquationsAt
    rates : (H, E, d, 10)
    edges : (H, E + 1, 7, C + 1)
        Changes of the states at the edges.
    inputs : (H, E, 16, C + 1)
        Changes of the elements' inputs; the last row selects the Newton step.
    states : (H, E, d, 7, 16)
        Changes of the states at the Gauss points by the elements' inputs.
    centerline : (H, E, d, 3, 16)
        Changes of r' there.
    slopes : (H, E, d, 10, 15)
        Jacobians of `rates`.
    inverses : (H, E, 7 d, 7 d)
        Of the elements' matrices.
    maps : (H, E, 7, 16)
        Changes at the right edges by the elements' inputs.
    by_base : (H, E + 1, 7, 3)
        Changes at the edges by the moment at the base.
    residual : float
        Largest residual.
    """

    at: RodEquationsAt
    rates: np.ndarray
    edges: np.ndarray
    inputs: np.ndarray
    states: np.ndarray
    centerline: np.ndarray
    slopes: np.ndarray
    inverses: np.ndarray
    maps: np.ndarray
    by_base: np.ndarray
    residual: float

    @classmethod
    def of(cls, at: RodEquationsAt, base: np.ndarray, forced: np.ndarray) -> CondensedRods:
        """Linearize.

        Parameters
        ----------
        base : (H, 4, C)
            Derivatives of the orientations at the base by the local controls.
        forced : (H, E, 8, C)
            Derivatives of the elements' other inputs.

        Raises
        ------
        IllConditionedError
        """
        element, h = gauss(at.mesh.degree), at.widths[:, None, None, None]
        H, E, d = at.inner.shape[:3]
        rates, slopes = first_derivatives(at.function, *at.arguments)
        rates, slopes = rates.reshape(H, E, d, RATES), slopes.reshape(H, E, d, RATES, INPUTS)
        collocation, continuity = at.residuals(rates)
        inverses = _inverses(element.derivative[:, 1:], at.widths, slopes[..., :STATES, :STATES])
        right = np.zeros((H, E, d, STATES, INPUTS + 1))
        same = np.arange(STATES)
        right[..., same, same] = -element.derivative[:, 0][:, None]
        right[..., STATES:INPUTS] = h * slopes[..., :STATES, STATES:]
        right[..., INPUTS] = -collocation
        states = (inverses @ right.reshape(H, E, d * STATES, INPUTS + 1)).reshape(right.shape)
        start, ends = element.end[0], element.end[1:]
        maps = np.tensordot(ends, states, (0, 2))
        maps[..., same, same] += start
        maps[..., INPUTS] += continuity
        edges, by_base = _chained(maps, base, forced)
        inputs = np.zeros((H, E, INPUTS + 1, edges.shape[-1]))
        inputs[:, :, :STATES] = edges[:, :-1]
        inputs[:, :, STATES:INPUTS, :-1] = forced
        inputs[:, :, INPUTS, -1] = 1.0
        centerline = slopes[..., POSITION, :STATES] @ states
        centerline[..., STATES:INPUTS] += slopes[..., POSITION, STATES:]
        residual = _largest(collocation, continuity)
        return cls(
            at, rates, edges, inputs, states, centerline, slopes, inverses, maps, by_base, residual
        )

    def newton_step(
        self, at: RodEquationsAt, rates: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, float]:
        """Simplified Newton step at other states with those rates, with the matrices of these.

        Returns
        -------
        edges : (H, E + 1, 7), inner : (H, E, d, 7)
            Changes of the states.
        residual : float
            Largest residual before the step.
        """
        collocation, continuity = at.residuals(rates)
        H, E = collocation.shape[:2]
        ends = gauss(at.mesh.degree).end[1:]
        fixed = -(self.inverses @ collocation.reshape(H, E, -1, 1)).reshape(collocation.shape)
        gaps = np.tensordot(ends, fixed, (0, 2)) + continuity
        edges = np.zeros((H, E + 1, STATES))
        for k in range(E):
            through = (self.maps[:, k, :, :STATES] @ edges[:, k, :, None])[..., 0]
            edges[:, k + 1] = through + gaps[:, k]
        moment = np.linalg.solve(self.by_base[:, -1, MOMENT], -edges[:, -1, MOMENT, None])
        edges += (self.by_base @ moment[:, None])[..., 0]
        inner = fixed + (self.states[..., :STATES] @ edges[:, :-1, None, :, None])[..., 0]
        return edges, inner, _largest(collocation, continuity)

    def multipliers(
        self, by_edges: np.ndarray, by_states: np.ndarray, by_line: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Weights of the rates (H, E, d, 10) in the Lagrangian of a function of the rods.

        And the function's derivative (H, 4) by the orientation at the base.

        Parameters
        ----------
        by_edges : (H, E + 1, 7), by_states : (H, E, d, 7)
            Its derivatives by the states at edges and Gauss points.
        by_line : (H, E, d, 3)
            Its derivatives by r' at the Gauss points.
        """
        H, E = self.rates.shape[:2]
        direct = (
            by_states + (by_line[..., None, :] @ self.slopes[..., POSITION, :STATES])[..., 0, :]
        )
        inside = (direct[..., None, :] @ self.states[..., :STATES]).sum(axis=(2, 3))

        def adjoint(tip: np.ndarray) -> np.ndarray:
            """Derivatives (H, E + 1, 7) by the edges, with a weight (H, 3) of the tip's moment."""
            by = np.zeros((H, E + 1, STATES))
            by[:, E] = by_edges[:, E]
            by[:, E, MOMENT] += tip
            for k in reversed(range(E)):
                through = (by[:, k + 1, None] @ self.maps[:, k, :, :STATES])[:, 0]
                by[:, k] = by_edges[:, k] + through + inside[:, k]
            return by

        # The moment at the base is free, so that the derivative by it vanishes.
        by_moment = adjoint(np.zeros((H, 3)))[:, 0, MOMENT, None]
        tip = np.linalg.solve(self.by_base[:, -1, MOMENT].swapaxes(-1, -2), -by_moment)[..., 0]
        by = adjoint(tip)
        total = direct + gauss(self.at.mesh.degree).end[1:, None] * by[:, 1:, None]
        equations = -(total.reshape(H, E, 1, -1) @ self.inverses).reshape(direct.shape)
        weights = np.concatenate([-self.at.widths[:, None, None] * equations, by_line], axis=-1)
        return weights, by[:, 0, ORIENTATION]

    def hessians(self, weights: np.ndarray) -> np.ndarray:
        """Second derivatives (H, C + 1, C + 1) of weighted rates (H, E, d, 10).

        States follow the controls to first order; the last row and column are the Newton step's.
        """
        w, p = self.at.arguments
        second = second_derivatives(self.at.function, w, p, weights.reshape(-1, RATES))
        second = second.reshape(*weights.shape[:3], INPUTS, INPUTS)
        transposed = self.states.swapaxes(-1, -2)
        by_input = transposed @ (second[..., :STATES, :STATES] @ self.states)
        mixed = transposed @ second[..., :STATES, STATES:]
        by_input[..., STATES:INPUTS] += mixed
        by_input[..., STATES:INPUTS, :] += mixed.swapaxes(-1, -2)
        by_input[..., STATES:INPUTS, STATES:INPUTS] += second[..., STATES:, STATES:]
        of_elements = self.inputs.swapaxes(-1, -2) @ (by_input.sum(axis=2) @ self.inputs)
        return np.asarray(of_elements.sum(axis=1))


def _largest(*residuals: np.ndarray) -> float:
    """Largest residual; infinite if one is not a number."""
    largest = max(float(np.abs(residual).max()) for residual in residuals)
    return largest if np.isfinite(sum(float(residual.sum()) for residual in residuals)) else np.inf


def _inverses(derivative: np.ndarray, h: np.ndarray, slopes: np.ndarray) -> np.ndarray:
    """Inverses (H, E, 7 d, 7 d) of the elements' matrices, from slopes (H, E, d, 7, 7)."""
    H, E, d = slopes.shape[:3]
    matrix = np.zeros((H, E, d, STATES, d, STATES))
    same = np.arange(STATES)
    matrix[:, :, :, same, :, same] = derivative
    for j in range(d):
        matrix[:, :, j, :, j, :] -= h[:, None, None] * slopes[:, :, j]
    try:
        return np.linalg.inv(matrix.reshape(H, E, d * STATES, d * STATES))
    except np.linalg.LinAlgError as error:
        raise IllConditionedError(str(error)) from error


def _chained(
    maps: np.ndarray, base: np.ndarray, forced: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Changes (H, E + 1, 7, C + 1) at the edges, and (H, E + 1, 7, 3) by the moment at the base."""
    H, E, C = len(maps), maps.shape[1], base.shape[-1]
    left = np.zeros((H, E + 1, STATES, 3 + C + 1))
    left[:, 0, MOMENT, :3] = np.eye(3)
    left[:, 0, ORIENTATION, 3:-1] = base
    for k in range(E):
        left[:, k + 1] = maps[:, k, :, :STATES] @ left[:, k]
        left[:, k + 1, :, 3:-1] += maps[:, k, :, STATES:INPUTS] @ forced[:, k]
        left[:, k + 1, :, -1] += maps[:, k, :, INPUTS]
    by_base = left[..., :3]
    if not np.abs(by_base).max() <= MAX_GROWTH:
        raise IllConditionedError("errors grow too much along the trunk")
    try:
        moment = np.linalg.solve(by_base[:, -1, MOMENT], -left[:, -1, MOMENT, 3:])
    except np.linalg.LinAlgError as error:
        raise IllConditionedError(str(error)) from error
    return left[..., 3:] + by_base @ moment[:, None], by_base

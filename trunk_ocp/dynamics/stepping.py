"""One implicit stage in time of the moving rod: the same collocation in Z as for equilibria."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import lu_factor, lu_solve

from ..errors import StaticsError
from ..model.activation import stiffness
from ..model.anatomy import Trunk
from ..rod.collocation import Mesh, gauss
from .moving_rod import STATES, A, M, N, Q, moving_rod, moving_rod_slope

TOLERANCE = 1e-10
"""On the last step of Newton's method, relative to the largest force, moment and acceleration."""
MAX_ITERATIONS = 25
SLOW = 0.3  # factor of convergence above which the Jacobian is computed again


@dataclass(frozen=True, eq=False)
class Ends:
    """What is known at the ends at one instant.

    Attributes
    ----------
    base : (4,)
        Orientation.
    acceleration : (3,)
        Of the base, in m/s^2.
    tip_force : (3,)
        In N.
    tip_mass : float
        In kg.
    """

    base: np.ndarray
    acceleration: np.ndarray
    tip_force: np.ndarray
    tip_mass: float


class StageSolver:
    """Solves for the states (E, d + 1, 13) of a rod at one instant; see `moving_rod`."""

    def __init__(self, trunk: Trunk, mesh: Mesh) -> None:
        self.mesh, self._element = mesh, gauss(mesh.degree)
        E, d = mesh.elements, mesh.degree
        self._shape = (E, d + 1, STATES)
        size = E * (d + 1) * STATES
        index = np.arange(size).reshape(self._shape)
        self._inner = index[:, 1:].reshape(-1, STATES)
        """Columns of the states at the Gauss points (n, 13), and the rows of their equations."""
        linear = np.zeros((size, size))
        same = np.arange(STATES)
        for e in range(E):
            for i in range(d):
                for j in range(d + 1):
                    linear[index[e, i + 1][same], index[e, j][same]] = self._element.derivative[
                        i, j
                    ]
        # The rows of an element's left edge: it joins the element before, or the ends are known.
        for e in range(1, E):
            linear[index[e, 0], index[e, 0]] = -1.0
            for j in range(d + 1):
                linear[index[e, 0][same], index[e - 1, j][same]] = self._element.end[j]
        self._base = np.concatenate([index[0, 0, Q], index[0, 0, A]])
        linear[self._base, self._base] = 1.0
        self._free = np.concatenate([index[0, 0, M], index[0, 0, N]])
        for j in range(d + 1):
            linear[self._free, np.concatenate([index[-1, j, M], index[-1, j, N]])] = (
                self._element.end[j]
            )
        self._tip = index[-1, :, A]
        self._linear = linear
        self._widths = np.repeat(mesh.widths, d)
        bending = float(stiffness(trunk, 0.0)[1]) / trunk.length
        scale = np.ones(STATES)
        scale[M], scale[N], scale[A] = bending, bending / trunk.length, 9.8
        self._scale = np.broadcast_to(scale, self._shape).ravel()
        self._factors: tuple[np.ndarray, np.ndarray] | None = None
        self.factored = 0

    def forget(self) -> None:
        """Compute the Jacobian anew at the next stage."""
        self._factors = None

    def solve(
        self, guess: np.ndarray, given: np.ndarray, ends: Ends
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """States, and at the Gauss points what changes with time (n, 11), and spins (n, 6).

        guess : (E, d + 1, 13); given : (p, n), see `moving_rod.GIVEN`

        Raises
        ------
        StaticsError
            If Newton's method does not converge.
        """
        x, before = guess.ravel().copy(), np.inf
        with np.errstate(all="ignore"):
            for _ in range(MAX_ITERATIONS):
                value, changing, bend = moving_rod()(x[self._inner].T, given)
                residual = self._residual(x, np.asarray(value).T, ends)
                if self._factors is None:
                    slope = np.asarray(moving_rod_slope()(x[self._inner].T, given)).T
                    self._factors = lu_factor(self._jacobian(slope, ends), check_finite=False)
                    self.factored += 1
                step = lu_solve(self._factors, -residual, check_finite=False)
                x += step
                size = float(np.max(np.abs(step) / np.maximum(self._scale, np.abs(x))))
                if size < TOLERANCE:
                    return x.reshape(self._shape), np.asarray(changing).T, np.asarray(bend).T
                if not np.isfinite(size):
                    break
                if size > SLOW * before:
                    self._factors = None
                before = size
        raise StaticsError("no motion found from one time step to the next; use shorter steps", 1.0)

    def _residual(self, x: np.ndarray, value: np.ndarray, ends: Ends) -> np.ndarray:
        residual = self._linear @ x
        residual[self._inner] -= self._widths[:, None] * value
        residual[self._base] -= np.concatenate([ends.base, ends.acceleration])
        at_tip = ends.tip_mass * (self._element.end @ x[self._tip])
        residual[self._free[3:]] += at_tip - ends.tip_force
        return residual

    def _jacobian(self, slope: np.ndarray, ends: Ends) -> np.ndarray:
        jacobian = self._linear.copy()
        blocks = self._widths[:, None, None] * slope.reshape(-1, STATES, STATES)
        jacobian[self._inner[:, :, None], self._inner[:, None, :]] -= blocks
        for j, weight in enumerate(self._element.end):
            jacobian[self._free[3:], self._tip[j]] += ends.tip_mass * weight
        return jacobian

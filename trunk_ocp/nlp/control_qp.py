"""The quadratic programs of SQP steps, in the controls of all steps and the held directions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import piqp
import scipy.sparse as sp
from scipy.linalg import LinAlgError, cholesky_banded

from .condensed_window import CondensedWindow
from .quadratic_model import QuadraticModel
from .window import Window

QP_TOL = 1e-8
"""Largest violation of a row, and of stationarity relative to the Hessian's largest entry."""


class QPError(ArithmeticError):
    """A quadratic program was not solved."""


class InfeasibleQPError(QPError):
    """A quadratic program has no feasible point: bounds contradict each other."""


@dataclass(frozen=True, eq=False)
class QPStep:
    """Solution of a quadratic program.

    Attributes
    ----------
    step : (n,)
        Change of z.
    multipliers : (3 D,)
        Of the equations of held directions.
    """

    step: np.ndarray
    multipliers: np.ndarray


class ControlQP:
    """Quadratic programs of one layout, solved by PIQP.

    Their Hessian is block-tridiagonal, with a border of held directions, which PIQP's multistage
    backend finds and uses. All rows but those of held directions are linear in the controls: bounds
    on controls, on their change, and on extensions. So every step keeps them.
    """

    def __init__(self, condensed: CondensedWindow) -> None:
        H, n = condensed.x.shape
        self._held = condensed.held.size
        self._basis, self._to_basis = np.linalg.qr(condensed.to_local.T)
        i, j = np.triu_indices(n + self._held)
        first = n * np.arange(H)[:, None]
        row, column = (np.where(k < n, first + k, (H - 1) * n + k) for k in (i, j))
        linked = np.arange(n, H * n)
        rows = np.concatenate([row.ravel(), linked - n])
        columns = np.concatenate([column.ravel(), linked])
        slots, self._slot = np.unique(columns * condensed.size + rows, return_inverse=True)
        counts = np.bincount(slots // condensed.size, minlength=condensed.size)
        self._upper, self._pattern = (i, j), (slots % condensed.size, np.append(0, counts.cumsum()))
        self._set_rows(condensed)
        self._kept: Any = None

    def _set_rows(self, condensed: CondensedWindow) -> None:
        """Rows of extensions and of changes, by the controls."""
        H, n = condensed.x.shape
        head = np.zeros((len(condensed.extension), 2))
        extension = sp.kron(sp.eye(H), np.hstack([condensed.extension, head]))
        change = (sp.eye(H * n) - sp.eye(H * n, k=-n)).tocsr()
        limited = [t * n + step.change.limited for t, step in enumerate(condensed.window.steps)]
        self._limited = np.concatenate(limited).astype(int)
        rows = sp.vstack([extension, change[self._limited]])
        self._by_controls = rows.tocsr()
        self._rows = sp.csc_matrix(sp.hstack([rows, sp.csc_matrix((rows.shape[0], self._held))]))

    def bounds(self, window: Window, x: np.ndarray) -> tuple[np.ndarray, ...]:
        """Bounds on steps from controls x (H, controls): lower and upper of z, and of the rows."""
        steps, (low, high) = window.steps, window.motion.extension
        free = np.full(self._held, np.inf)
        lower = np.append(np.ravel([step.box.lower for step in steps]) - x.ravel(), -free)
        upper = np.append(np.ravel([step.box.upper for step in steps]) - x.ravel(), free)
        change = np.array([[s.change.lower for s in steps], [s.change.upper for s in steps]])
        change[:, 0] += window.before
        least, most = change.reshape(2, -1)[:, self._limited]
        now = self._by_controls @ x.ravel()
        extensions = np.ones(now.size - least.size)
        rows_lower = np.append((low - 1) * extensions, least) - now
        rows_upper = np.append((high - 1) * extensions, most) - now
        return lower, upper, rows_lower, rows_upper

    def violation(self, window: Window, x: np.ndarray) -> float:
        """Largest violation of a bound by controls x (H, controls)."""
        lower, upper, rows_lower, rows_upper = self.bounds(window, x)
        parts = (lower, -upper, rows_lower, -rows_upper)
        return max(float(part.max(initial=0.0)) for part in parts)

    def _solver_of(self, program: tuple[Any, ...]) -> Any:
        """PIQP's solver of a program; kept, which saves the analysis of the next one.

        Not with equations, whose scaling an update leaves with other round-off, so that results
        would depend on the programs before.
        """
        if self._kept is not None:
            self._kept.update(*program)
            return self._kept
        solver = piqp.SparseSolver()
        solver.settings.kkt_solver = piqp.KKTSolver.sparse_multistage
        solver.settings.eps_abs = solver.settings.eps_rel = QP_TOL
        solver.settings.preconditioner_iter = 1  # more save no iterations
        solver.setup(*program)
        self._kept = None if self._held else solver
        return solver

    def hessian(self, model: QuadraticModel) -> np.ndarray:
        """Blocks (H, n + 3 D, n + 3 D) of a model's Hessian, made convex if they are not.

        The costs of controls and their links are convex by themselves. So negative eigenvalues of
        the rest change sign, in an orthonormal basis of the controls that strains depend on.
        """
        n, to_local = model.links.shape[1], model.to_local
        blocks: np.ndarray = to_local.T @ model.blocks @ to_local
        blocks[:, np.arange(n), np.arange(n)] += model.diagonal
        if not _is_convex(blocks, model.links):
            values, vectors = np.linalg.eigh(self._to_basis @ model.blocks @ self._to_basis.T)
            vectors = self._basis @ vectors
            blocks += (vectors * (np.abs(values) - values)[:, None]) @ vectors.swapaxes(-1, -2)
        return blocks

    def solve(self, window: Window, model: QuadraticModel, x: np.ndarray) -> QPStep:
        """Minimize a model from controls x (H, controls), made convex if it is not.

        Raises
        ------
        InfeasibleQPError, QPError
        """
        blocks = self.hessian(model)
        lower, upper, rows_lower, rows_upper = self.bounds(window, x)
        scale = 1 / (np.abs(blocks).max() or 1.0)
        i, j = self._upper
        entries = np.concatenate([blocks[:, i, j].ravel(), model.links[1:].ravel()]) * scale
        data = np.bincount(self._slot, entries, self._pattern[0].size)
        n = model.gradient.size
        program = (
            sp.csc_matrix((data, *self._pattern), (n, n)),
            scale * model.gradient,
            sp.csc_matrix(model.held_rows) if self._held else None,
            model.held_rest if self._held else None,
            self._rows,
            rows_lower,
            rows_upper,
            lower,
            upper,
        )
        solver = self._solver_of(program)
        status = solver.solve()
        result = solver.result
        if status == piqp.PIQP_PRIMAL_INFEASIBLE:
            raise InfeasibleQPError("the quadratic program has no feasible point")
        if status != piqp.PIQP_SOLVED:
            raise QPError(f"the quadratic program was not solved ({status})")
        multipliers = np.array(result.y) / scale if self._held else np.zeros(0)
        return QPStep(np.array(result.x), multipliers)


def _is_convex(blocks: np.ndarray, links: np.ndarray) -> bool:
    """Whether the Hessian by the controls alone is positive definite."""
    H, n = links.shape
    band = np.zeros((n + 1, H * n))
    i, j = np.tril_indices(n)
    band[i - j, n * np.arange(H)[:, None] + j] = blocks[:, i, j]
    band[n, : (H - 1) * n] = links[1:].ravel()
    try:
        cholesky_banded(band, lower=True, check_finite=False)
    except LinAlgError:
        return False
    return True

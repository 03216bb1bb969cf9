"""The quadratic programs of SQP steps: block-tridiagonal, with a border of held directions."""

from __future__ import annotations

import numpy as np
import piqp
import scipy.sparse as sp
from scipy.linalg import LinAlgError, cholesky_banded

from .condensed_window import CondensedWindow, QuadraticModel

QP_TOL = 1e-9
"""Largest violation of a row, and of stationarity in units of the objective's scale."""


ACTIVE_TOL = 1e-6


class QPError(ArithmeticError):
    """A quadratic program was not solved, or has no feasible point."""


class ControlQP:
    """Quadratic programs of one structure, from models of a `CondensedWindow`.

    The rows besides those of held directions are linear in the controls: bounds on change and on
    extension. So they are kept exactly by every step.
    """

    def __init__(self, condensed: CondensedWindow) -> None:
        H, n = condensed.x.shape
        self.steps, self.controls, self.size = H, n, condensed.size
        self.held = condensed.size - H * n
        self._place_hessian()
        self._place_rows(condensed)
        self._solver: piqp.SparseSolver | None = None

    def _place_hessian(self) -> None:
        """Row and column of each entry of the upper triangle, in CSC order."""
        H, n, D = self.steps, self.controls, self.held
        i, j = np.triu_indices(n + D)
        base = np.arange(H)[:, None] * n
        rows = np.where(i < n, base + i, H * n + i - n)
        columns = np.where(j < n, base + j, H * n + j - n)
        self._upper = (i, j)
        link = np.arange(n, H * n)
        row = np.concatenate([rows.ravel(), link - n])
        column = np.concatenate([columns.ravel(), link])
        key = column * self.size + row
        unique, self._slot = np.unique(key, return_inverse=True)
        self._nonzeros = unique.size
        counts = np.bincount(unique // self.size, minlength=self.size)
        self._pattern = (unique % self.size, np.append(0, counts.cumsum()))

    def _place_rows(self, condensed: CondensedWindow) -> None:
        """Rows of changes and extensions, (G, their values at zero controls)."""
        H, n = self.steps, self.controls
        self.extension = condensed.extension
        segments, muscles = condensed.extension.shape
        extension = sp.kron(sp.eye(H), np.hstack([condensed.extension, np.zeros((segments, 2))]))
        matrix = sp.eye(H * n) - sp.eye(H * n, k=-n)
        self.limited = np.concatenate(
            [t * n + step.change.limited for t, step in enumerate(condensed.window.steps)]
        ).astype(int)
        rows = sp.vstack([extension, matrix.tocsr()[self.limited]])
        self._rows = sp.csc_matrix(sp.hstack([rows, sp.csc_matrix((rows.shape[0], self.held))]))

    def limits(self, condensed: CondensedWindow) -> tuple[np.ndarray, np.ndarray]:
        """Bounds of the rows, for the controls themselves."""
        steps, H, n = condensed.window.steps, self.steps, self.controls
        segments = len(condensed.extension)
        change = np.stack([[s.change.lower for s in steps], [s.change.upper for s in steps]])
        before = condensed.window.bounds["lbx"][condensed.window.previous]
        change[:, 0] += before
        low, high = condensed.window.motion.extension
        lower = np.concatenate([np.full(H * segments, low - 1), change[0].ravel()[self.limited]])
        upper = np.concatenate([np.full(H * segments, high - 1), change[1].ravel()[self.limited]])
        return lower, upper

    def _with_active_rows(self, model, x_l, x_u, low, high):
        """Hessian with curvature across the bounds that hold now.

        It changes no step that stays on them, and often makes the Hessian convex.
        """
        H, n = self.steps, self.controls
        blocks, links = model.blocks.copy(), model.links.copy()
        strong = np.abs(blocks[:, :n, :n]).max()
        at = (np.minimum(-x_l, x_u)[: H * n] < ACTIVE_TOL).reshape(H, n)
        blocks[:, np.arange(n), np.arange(n)] += strong * at
        active = np.minimum(-low, high) < ACTIVE_TOL
        S = len(self.extension)
        for t, s in zip(*np.nonzero(active[: H * S].reshape(H, S)), strict=True):
            muscles = self.extension.shape[1]
            blocks[t, :muscles, :muscles] += strong * np.outer(self.extension[s], self.extension[s])
        t, i = np.divmod(self.limited[active[H * S :]], n)
        np.add.at(blocks, (t, i, i), strong)
        later = t > 0
        np.add.at(blocks, (t[later] - 1, i[later], i[later]), strong)
        links[t[later], i[later]] -= strong
        return blocks, links

    def solve(
        self, condensed: CondensedWindow, model: QuadraticModel, x: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Step in z from controls x (H, n), and multipliers of the held directions' equations.

        Raises
        ------
        QPError
        """
        steps = condensed.window.steps
        values, self.clipped = x.ravel(), False
        lower, upper = self.limits(condensed)
        now = self._rows[:, : values.size] @ values
        free = np.full(self.held, np.inf)
        x_l = np.append(np.ravel([s.box.lower for s in steps]) - values, -free)
        x_u = np.append(np.ravel([s.box.upper for s in steps]) - values, free)
        blocks, links = model.blocks, model.links
        if not is_convex(blocks, links):
            blocks, links = self._with_active_rows(model, x_l, x_u, lower - now, upper - now)
        if not is_convex(blocks, links):
            blocks, links = convex(model.blocks, model.links), model.links
            self.clipped = True
        scale = 1 / np.abs(blocks[:, : self.controls, : self.controls]).max()
        i, j = self._upper
        entries = np.concatenate([blocks[:, i, j].ravel(), links[1:].ravel()]) * scale
        data = np.bincount(self._slot, entries, self._nonzeros)
        hessian = sp.csc_matrix((data, *self._pattern), (self.size, self.size))
        A = sp.csc_matrix(model.held_rows) if self.held else None
        b = model.held_rest if self.held else None
        solver = piqp.SparseSolver()
        settings = solver.settings
        settings.kkt_solver = piqp.KKTSolver.sparse_multistage
        settings.eps_abs, settings.eps_rel = QP_TOL, 1e-9
        solver.setup(
            hessian, model.gradient * scale, A, b, self._rows, lower - now, upper - now, x_l, x_u
        )
        status = solver.solve()
        self.iterations = solver.result.info.iter
        if status != piqp.PIQP_SOLVED:
            raise QPError(str(status))
        step = np.array(solver.result.x)
        return step, np.array(solver.result.y) / scale if self.held else np.zeros(0)


def is_convex(blocks: np.ndarray, links: np.ndarray) -> bool:
    """Whether the Hessian in the controls alone is positive definite."""
    H, n = links.shape
    band = np.zeros((n + 1, H * n))
    i, j = np.tril_indices(n)
    band[(i - j), (np.arange(H)[:, None] * n + j)] = blocks[:, i, j]
    band[n, : (H - 1) * n] = links[1:].ravel()
    try:
        cholesky_banded(band, lower=True, check_finite=False)
    except LinAlgError:
        return False
    return True


def convex(blocks: np.ndarray, links: np.ndarray) -> np.ndarray:
    """Blocks with curvatures made positive, so that the Hessian is."""
    n = links.shape[1]
    own = np.zeros_like(blocks)
    # What remains of the diagonal is shared among neighbors so that links stay covered.
    cover = np.abs(links) + np.append(np.abs(links[1:]), np.zeros((1, n)), axis=0)
    own[:, np.arange(n), np.arange(n)] = cover
    values, vectors = np.linalg.eigh(blocks - own)
    return (vectors * np.abs(values)[:, None]) @ vectors.swapaxes(-1, -2) + own

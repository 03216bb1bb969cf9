"""Partially separable NLPs: exact sparse derivatives from small repeated functions.

Objective and constraints are stacked as one map, row 0 the objective,

    F(x; p) = C x + sum over terms of  S @ vec(y_1, ..., y_N),   y_i = phi(x[v_i], p_i),

with a constant sparse C and, for each term, one small function phi evaluated at N places
(Griewank & Toint 1982, partially separable functions). The derivatives of F are sums of those of
phi, gathered by constant sparse matrices. The expression graph has a few nodes whatever the number
of places, so it is built in milliseconds.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
import scipy.sparse as sp

OBJECTIVE, CONSTRAINTS = slice(0, 1), slice(1, None)  # rows of F
Place = tuple[ca.MX, ca.MX]  # w (n, N) and p (k, N) of a term


@dataclass(frozen=True, eq=False)
class Term:
    """One small function at many places.

    Attributes
    ----------
    function : casadi.Function
        SX function (w (n,), p (k,)) -> y (m,).
    variables : (n, N) int
        Indices of w in x, a column for each place; no index occurs twice in a column.
    scatter : (rows, m N) sparse
        S above; output r at place i is column r + m i.
    parameters : (k, N)
        Values of p, a column for each place.
    """

    function: ca.Function
    variables: np.ndarray
    scatter: sp.csr_matrix
    parameters: np.ndarray

    @property
    def places(self) -> int:
        """Number N of places."""
        return self.variables.shape[1]


@dataclass(frozen=True, eq=False)
class SeparableNLP:
    """An NLP: minimize F[0] subject to bounds on x and on g = F[1:].

    `linear` is C, (1 + constraints, variables). Parameter values are arguments of each solve, in
    the order of `parameters`, so that NLPs which differ only in them share one solver.
    """

    linear: sp.csr_matrix
    terms: tuple[Term, ...]

    @cached_property
    def parameters(self) -> np.ndarray:
        """Parameter values of all terms as one vector."""
        return np.concatenate([term.parameters.ravel(order="F") for term in self.terms])

    @property
    def size(self) -> tuple[int, int]:
        """Numbers of variables and of constraints."""
        return self.linear.shape[1], self.linear.shape[0] - 1

    def as_casadi(self) -> dict[str, ca.MX]:
        """The NLP as CasADi's `nlpsol` takes it: x, p, f, g."""
        x, p, places = self._inputs()
        f, g = self._values(x, places, OBJECTIVE), self._values(x, places, CONSTRAINTS)
        return {"x": x, "p": p, "f": f, "g": g}

    def derivatives(self) -> dict[str, ca.Function]:
        """Exact first and second derivatives, as options of CasADi's `nlpsol`."""
        x, p, places = self._inputs()
        f, g = self._values(x, places, OBJECTIVE), self._values(x, places, CONSTRAINTS)
        gradient = ca.densify(self._jacobian(places, OBJECTIVE).T)
        jacobian = self._jacobian(places, CONSTRAINTS)
        lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", self.size[1])
        hessian = self._hessian(ca.vertcat(lam_f, lam_g), places)
        names = ["x", "p", "lam_f", "lam_g"]
        return {
            "grad_f": ca.Function(
                "nlp_grad_f", [x, p], [f, gradient], names[:2], ["f", "grad_f_x"]
            ),
            "jac_g": ca.Function("nlp_jac_g", [x, p], [g, jacobian], names[:2], ["g", "jac_g_x"]),
            "hess_lag": ca.Function(
                "nlp_hess_l", [x, p, lam_f, lam_g], [hessian], names, ["triu_hess_gamma_x_x"]
            ),
        }

    def _inputs(self) -> tuple[ca.MX, ca.MX, list[Place]]:
        """Symbols x and p, and each term's inputs gathered from them."""
        x, p = ca.MX.sym("x", self.size[0]), ca.MX.sym("p", self.parameters.size)
        places, start = [], 0
        for term in self.terms:
            w = ca.reshape(x[term.variables.ravel(order="F").tolist()], *term.variables.shape)
            stop = start + term.parameters.size
            places.append((w, ca.reshape(p[start:stop], *term.parameters.shape)))
            start = stop
        return x, p, places

    def _terms_of(
        self, places: list[Place], rows: slice
    ) -> list[tuple[Term, sp.csr_matrix, Place]]:
        """Terms that these rows depend on: (term, rows of its scatter, inputs)."""
        parts = (
            (term, term.scatter[rows], place)
            for term, place in zip(self.terms, places, strict=True)
        )
        return [part for part in parts if part[1].nnz]

    def _values(self, x: ca.MX, places: list[Place], rows: slice) -> ca.MX:
        """Some rows of F."""
        value = _times(self.linear[rows], x)
        for term, scatter, (w, q) in self._terms_of(places, rows):
            value += _times(scatter, ca.vec(term.function.map(term.places)(w, q)))
        return value

    def _jacobian(self, places: list[Place], rows: slice) -> ca.MX:
        """Jacobian of some rows of F, sparse."""
        linear = self.linear[rows]
        gather = _Gather(linear)
        for term, scatter, (w, q) in self._terms_of(places, rows):
            jacobian, row, column = _term_jacobian(term.function)
            outputs, count = term.function.size1_out(0), term.places
            place = np.repeat(np.arange(count), row.size)
            output = np.tile(row, count) + outputs * place
            variable = term.variables[np.tile(column, count), place]
            spread = sp.coo_matrix(scatter[:, output])
            gather.add(
                spread.row,
                variable[spread.col],
                spread.data,
                spread.col,
                ca.vec(jacobian.map(count)(w, q)),
            )
        return gather.matrix()

    def _hessian(self, lam: ca.MX, places: list[Place]) -> ca.MX:
        """Upper triangle of the Hessian of lam . F."""
        n = self.size[0]
        gather = _Gather(sp.csr_matrix((n, n)))
        for term, (w, q) in zip(self.terms, places, strict=True):
            # A function is linear in w if its Hessian has no entries.
            hessian, row, column = _term_hessian(term.function)
            count, outputs = term.places, term.function.size1_out(0)
            if not row.size:
                continue
            place = np.repeat(np.arange(count), row.size)
            first = term.variables[np.tile(row, count), place]
            second = term.variables[np.tile(column, count), place]
            mu = ca.reshape(_times(term.scatter.T.tocsr(), lam), outputs, count)
            gather.add(
                np.minimum(first, second),
                np.maximum(first, second),
                np.ones(first.size),
                np.arange(first.size),
                ca.vec(hessian.map(count)(w, q, mu)),
            )
        return gather.matrix()


class _Gather:
    """Sums the entries of many small matrices into one large sparse matrix."""

    def __init__(self, constant: sp.csr_matrix) -> None:
        self.constant = sp.coo_matrix(constant)
        self.entries: list[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]] = []
        self.sources: list[ca.MX] = []

    def add(
        self,
        row: np.ndarray,
        column: np.ndarray,
        factor: np.ndarray,
        source: np.ndarray,
        values: ca.MX,
    ) -> None:
        """Add factor * values[source] at (row, column), entry by entry."""
        offset = sum(values.size1() for values in self.sources)
        self.entries.append((row, column, factor, source + offset))
        self.sources.append(values)

    def matrix(self) -> ca.MX:
        """The sum as a sparse matrix.

        Its nonzeros are a constant plus one constant sparse matrix times the vector of all values:
        three nodes of the expression graph, whatever the number of entries.
        """
        rows, columns = self.constant.shape
        row = np.concatenate([self.constant.row, *(e[0] for e in self.entries)])
        column = np.concatenate([self.constant.col, *(e[1] for e in self.entries)])
        key = column.astype(np.int64) * rows + row  # column-major, as CasADi stores
        unique, position = np.unique(key, return_inverse=True)
        constants = position[: self.constant.nnz]
        nonzeros = ca.MX(ca.DM(np.bincount(constants, self.constant.data, unique.size)))
        if self.entries:
            factor, source = (np.concatenate([e[i] for e in self.entries]) for i in (2, 3))
            values = ca.vertcat(*self.sources)
            spread = sp.csr_matrix(
                (factor, (position[self.constant.nnz :], source)), (unique.size, values.size1())
            )
            nonzeros = nonzeros + _times(spread, values)
        pattern = ca.Sparsity.triplet(
            rows, columns, (unique % rows).tolist(), (unique // rows).tolist()
        )
        return ca.MX(pattern, nonzeros)


def _times(matrix: sp.csr_matrix, vector: ca.MX) -> ca.MX:
    """Constant sparse matrix times a dense column."""
    compressed = sp.csc_matrix(matrix)
    compressed.sort_indices()
    rows, columns = compressed.shape
    pattern = ca.Sparsity(rows, columns, compressed.indptr.tolist(), compressed.indices.tolist())
    return ca.densify(ca.mtimes(ca.DM(pattern, compressed.data), vector))


def _symbols(function: ca.Function) -> tuple[ca.SX, ca.SX, ca.SX]:
    w = ca.SX.sym("w", function.size1_in(0))
    p = ca.SX.sym("p", function.size1_in(1))
    return w, p, function(w, p)


def _term_jacobian(function: ca.Function) -> tuple[ca.Function, np.ndarray, np.ndarray]:
    """Nonzeros of dy/dw as one column, with their rows and columns."""
    w, p, y = _symbols(function)
    return _nonzeros("jacobian", [w, p], ca.jacobian(y, w))


def _term_hessian(function: ca.Function) -> tuple[ca.Function, np.ndarray, np.ndarray]:
    """Nonzeros of the upper triangle of the Hessian of mu . y as one column."""
    w, p, y = _symbols(function)
    mu = ca.SX.sym("mu", y.size1())
    return _nonzeros("hessian", [w, p, mu], ca.triu(ca.hessian(ca.dot(mu, y), w)[0]))


def _nonzeros(
    name: str, inputs: list[ca.SX], matrix: Any
) -> tuple[ca.Function, np.ndarray, np.ndarray]:
    row, column = matrix.sparsity().get_triplet()
    nonzeros = ca.vertcat(*matrix.nonzeros()) if matrix.nnz() else ca.SX(0, 1)
    return ca.Function(name, inputs, [nonzeros]), np.array(row, int), np.array(column, int)

"""Putting a partially separable programme together, piece by piece."""

from __future__ import annotations

import hashlib

import casadi as ca
import numpy as np
import scipy.sparse as sp

from .separable import Programme, Term


class Assembly:
    """Collects variables, constraint rows, linear entries and terms."""

    def __init__(self) -> None:
        self._lower: list[np.ndarray] = []
        self._upper: list[np.ndarray] = []
        self._row_lower: list[np.ndarray] = []
        self._row_upper: list[np.ndarray] = []
        self._linear: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
        self._terms: list[tuple[ca.Function, np.ndarray, np.ndarray, tuple[np.ndarray, ...]]] = []
        self._count = 0
        self._rows = 0

    def variables(
        self, *shape: int, lower: float | np.ndarray = -np.inf, upper: float | np.ndarray = np.inf
    ) -> np.ndarray:
        """New variables of a shape; returns their indices in x."""
        size = int(np.prod(shape))
        self._lower.append(np.broadcast_to(lower, shape).ravel().astype(float))
        self._upper.append(np.broadcast_to(upper, shape).ravel().astype(float))
        self._count += size
        return np.arange(self._count - size, self._count).reshape(shape)

    def rows(
        self, *shape: int, lower: float | np.ndarray = 0.0, upper: float | np.ndarray = 0.0
    ) -> np.ndarray:
        """New constraint rows, lower <= g <= upper; returns their row numbers in F."""
        size = int(np.prod(shape))
        self._row_lower.append(np.broadcast_to(lower, shape).ravel().astype(float))
        self._row_upper.append(np.broadcast_to(upper, shape).ravel().astype(float))
        self._rows += size
        return 1 + np.arange(self._rows - size, self._rows).reshape(shape)

    def linear(
        self, rows: np.ndarray, columns: np.ndarray, values: float | np.ndarray = 1.0
    ) -> None:
        """Add C[rows, columns] += values; the three are broadcast against each other."""
        r, c, v = np.broadcast_arrays(rows, columns, np.asarray(values, dtype=float))
        keep = v.ravel() != 0
        self._linear.append((r.ravel()[keep], c.ravel()[keep], v.ravel()[keep]))

    def term(
        self,
        function: ca.Function,
        variables: np.ndarray,
        parameters: np.ndarray,
        output: np.ndarray | int,
        place: np.ndarray | int,
        rows: np.ndarray | int,
        weights: np.ndarray | float = 1.0,
    ) -> None:
        """Add a term: F[rows] += weights * (output `output` at place `place`), broadcast."""
        scatter = np.broadcast_arrays(output, place, rows, np.asarray(weights, dtype=float))
        self._terms.append((function, variables, parameters, tuple(a.ravel() for a in scatter)))

    def cost(self, function: ca.Function, variables: np.ndarray, parameters: np.ndarray) -> None:
        """Add a scalar function, summed over places, to the objective."""
        if variables.size:
            self.term(function, variables, parameters, 0, np.arange(variables.shape[1]), 0)

    def programme(self) -> Programme:
        """The programme of everything that was added."""
        shape = (1 + self._rows, self._count)
        row, column, value = (np.concatenate(part) for part in zip(*self._linear, strict=True))
        terms = []
        for function, variables, parameters, (output, place, rows, weights) in self._terms:
            outputs = function.size1_out(0)
            scatter = sp.csr_matrix(
                (weights, (rows, output + outputs * place)),
                (shape[0], outputs * variables.shape[1]),
            )
            terms.append(Term(function, variables, scatter, parameters))
        return Programme(sp.csr_matrix((value, (row, column)), shape), tuple(terms))

    def digest(self) -> bytes:
        """Fingerprint of the programme without its parameter values."""
        known = hashlib.blake2b(f"{self._count} {self._rows}".encode())
        for function, variables, _, scatter in self._terms:
            known.update(f"{function.__hash__()} {variables.shape}".encode())
            for array in (variables, *scatter):
                known.update(np.ascontiguousarray(array).tobytes())
        for entries in self._linear:
            for array in entries:
                known.update(array.tobytes())
        return known.digest()

    @property
    def parameters(self) -> np.ndarray:
        """Parameter values of all terms as one vector, as `Programme.parameters` has them."""
        return np.concatenate([parameters.ravel(order="F") for _, _, parameters, _ in self._terms])

    @property
    def bounds(self) -> dict[str, np.ndarray]:
        """Bounds in the words of CasADi's solvers: lbx, ubx, lbg, ubg."""
        return {
            "lbx": np.concatenate(self._lower),
            "ubx": np.concatenate(self._upper),
            "lbg": np.concatenate(self._row_lower),
            "ubg": np.concatenate(self._row_upper),
        }

"""Builds a partially separable NLP piece by piece."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
import scipy.sparse as sp

from .quantities import Meaning
from .separable_nlp import SeparableNLP, Term


@dataclass(frozen=True, eq=False)
class _Places:
    """Some places of a term, with its scatter as four arrays of equal length."""

    function: ca.Function
    variables: np.ndarray  # (n, N)
    parameters: np.ndarray  # (k, N)
    output: np.ndarray
    place: np.ndarray
    rows: np.ndarray
    weights: np.ndarray


@dataclass(frozen=True, eq=False)
class Block:
    """Constraint rows that belong together.

    Attributes
    ----------
    meaning : Meaning
        What the rows state, with the units and scales of their components.
    rows : (..., components) int
        Row numbers in F, which start from 1.
    Z : (...), optional
        Points of the trunk that the rows belong to, in m.
    step : int
        Time step of the motion, from 0.
    variables : (..., components) int, optional
        The variables that the rows define, where these have bounds of their own.
    controls : (components,) int, optional
        The components of the meaning that the rows are about, each a constraint of its own; by
        default all of them.
    """

    meaning: Meaning
    rows: np.ndarray
    Z: np.ndarray | None = None
    step: int = 0
    variables: np.ndarray | None = None
    controls: np.ndarray | None = None

    def component(self, i: int) -> int:
        """Index in the meaning's components of that of the rows' last axis."""
        return i if self.controls is None else int(self.controls[i])

    def moved(self, variables: int, rows: int, step: int) -> Block:
        """The block of a time step, with indices of variables and rows shifted."""
        moved = None if self.variables is None else self.variables + variables
        return replace(self, rows=self.rows + rows, step=step, variables=moved)


class NLPBuilder:
    """Collects variables, constraint rows, linear entries and terms of an NLP."""

    def __init__(self) -> None:
        self._lower: list[np.ndarray] = []
        self._upper: list[np.ndarray] = []
        self._row_lower: list[np.ndarray] = []
        self._row_upper: list[np.ndarray] = []
        self._linear: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
        self._terms: list[_Places] = []
        self.blocks: list[Block] = []
        self._count = 0
        self._rows = 0

    @property
    def size(self) -> tuple[int, int]:
        """Numbers of variables and of constraint rows."""
        return self._count, self._rows

    def variables(
        self, *shape: int, lower: float | np.ndarray = -np.inf, upper: float | np.ndarray = np.inf
    ) -> np.ndarray:
        """Add variables of a shape; returns their indices in x."""
        size = int(np.prod(shape))
        self._lower.append(np.broadcast_to(lower, shape).ravel().astype(float))
        self._upper.append(np.broadcast_to(upper, shape).ravel().astype(float))
        self._count += size
        return np.arange(self._count - size, self._count).reshape(shape)

    def rows(
        self,
        meaning: Meaning,
        *shape: int,
        lower: float | np.ndarray = 0.0,
        upper: float | np.ndarray = 0.0,
        **about: Any,
    ) -> np.ndarray:
        """Add constraint rows, lower <= g <= upper; returns their row numbers in F.

        about : attributes of the `Block`.
        """
        rows = self._add_rows(np.broadcast_to(lower, shape), np.broadcast_to(upper, shape))
        if rows.size:
            self.blocks.append(Block(meaning, rows, **about))
        return rows

    def _add_rows(self, lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
        self._row_lower.append(lower.ravel().astype(float))
        self._row_upper.append(upper.ravel().astype(float))
        self._rows += lower.size
        return 1 + np.arange(self._rows - lower.size, self._rows).reshape(lower.shape)

    def linear(
        self, rows: np.ndarray, columns: np.ndarray, values: float | np.ndarray = 1.0
    ) -> None:
        """Add values to C[rows, columns]; the three are broadcast against each other."""
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
        self._terms.append(
            _Places(function, variables, parameters, *(array.ravel() for array in scatter))
        )

    def cost(self, function: ca.Function, variables: np.ndarray, parameters: np.ndarray) -> None:
        """Add a scalar function, summed over places, to the objective."""
        if variables.size:
            self.term(function, variables, parameters, 0, np.arange(variables.shape[1]), 0)

    def include(
        self,
        part: NLPBuilder,
        bounds: Sequence[tuple[np.ndarray, np.ndarray, np.ndarray]],
        step: int,
    ) -> tuple[int, int]:
        """Add variables, rows, linear entries and constraint terms of a part.

        bounds : (variables of the part, lower, upper), which replace the part's own bounds.
        step : time step that the part's rows belong to.

        Returns
        -------
        Shifts of the part's variables and of its row numbers.
        """
        variables, rows = self._count, self._rows
        limits = part.bounds
        for places, lower, upper in bounds:
            limits["lbx"][places], limits["ubx"][places] = lower, upper
        self.variables(part._count, lower=limits["lbx"], upper=limits["ubx"])
        self._add_rows(limits["lbg"], limits["ubg"])
        self.blocks += [block.moved(variables, rows, step) for block in part.blocks]
        r, c, v = part._entries
        self._linear.append((r + rows, c + variables, v))
        for t in part._terms:
            self._terms.append(
                _Places(
                    t.function,
                    t.variables + variables,
                    t.parameters,
                    t.output,
                    t.place,
                    t.rows + rows,
                    t.weights,
                )
            )
        return variables, rows

    @cached_property
    def _entries(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """All linear entries: rows, columns, values. Cached, so call it once all are added."""
        rows, columns, values = (np.concatenate(part) for part in zip(*self._linear, strict=True))
        return rows, columns, values

    @cached_property
    def _merged(self) -> list[_Places]:
        """One piece for each function, with all its places. Cached, as `_entries`."""
        merged = []
        for function in dict.fromkeys(term.function for term in self._terms):
            pieces = [term for term in self._terms if term.function == function]
            before = np.cumsum([0, *(piece.variables.shape[1] for piece in pieces)])
            merged.append(
                _Places(
                    function,
                    np.concatenate([piece.variables for piece in pieces], axis=1),
                    np.concatenate([piece.parameters for piece in pieces], axis=1),
                    np.concatenate([piece.output for piece in pieces]),
                    np.concatenate(
                        [piece.place + n for piece, n in zip(pieces, before, strict=False)]
                    ),
                    np.concatenate([piece.rows for piece in pieces]),
                    np.concatenate([piece.weights for piece in pieces]),
                )
            )
        return merged

    def nlp(self) -> SeparableNLP:
        """The NLP, with one term for each function."""
        rows, columns, values = self._entries
        size = 1 + self._rows
        terms = []
        for t in self._merged:
            outputs, places = t.function.size1_out(0), t.variables.shape[1]
            scatter = sp.csr_matrix(
                (t.weights, (t.rows, t.output + outputs * t.place)), (size, outputs * places)
            )
            terms.append(Term(t.function, t.variables, scatter, t.parameters))
        linear = sp.csr_matrix((values, (rows, columns)), (size, self._count))
        return SeparableNLP(linear, tuple(terms))

    def digest(self) -> bytes:
        """Fingerprint of the NLP without its parameter values."""
        digest = hashlib.blake2b(f"{self._count} {self._rows}".encode())
        for t in self._merged:
            digest.update(f"{t.function.__hash__()} {t.variables.shape}".encode())
            for array in (t.variables, t.output, t.place, t.rows, t.weights):
                digest.update(np.ascontiguousarray(array).tobytes())
        for array in self._entries:
            digest.update(array.tobytes())
        return digest.digest()

    @property
    def parameters(self) -> np.ndarray:
        """Parameter values of all terms as one vector, as in `SeparableNLP.parameters`."""
        return np.concatenate([t.parameters.ravel(order="F") for t in self._merged])

    @property
    def bounds(self) -> dict[str, np.ndarray]:
        """Bounds as arguments of CasADi's solvers: lbx, ubx, lbg, ubg."""
        return {
            "lbx": np.concatenate(self._lower),
            "ubx": np.concatenate(self._upper),
            "lbg": np.concatenate(self._row_lower),
            "ubg": np.concatenate(self._row_upper),
        }

"""Values and derivatives of small CasADi functions (w, p) -> y at many places, in NumPy arrays."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from .._support.casadi_to_python import python_source

MANY = 64
"""Places from which operations on arrays of all places take less time than CasADi's interpreter."""


def values(function: ca.Function, w: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Values (N, m) at places w (N, n) with parameters p (N, k)."""
    (value,) = _evaluated(function, [w, p])
    return value


def first_derivatives(
    function: ca.Function, w: np.ndarray, p: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Values (N, m) and Jacobians (N, m, n) by w."""
    value, jacobian = _evaluated(_first(function), [w, p])
    return value, jacobian.reshape(len(w), value.shape[1], w.shape[1])


def second_derivatives(
    function: ca.Function, w: np.ndarray, p: np.ndarray, weights: np.ndarray
) -> np.ndarray:
    """Hessians (N, n, n) by w of the outputs weighted with (N, m)."""
    (hessian,) = _evaluated(_second(function), [w, p, weights])
    return hessian.reshape(len(w), w.shape[1], w.shape[1])


def _evaluated(function: ca.Function, arguments: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Outputs (N, m) for arguments (N, n)."""
    evaluate = _by_place if len(arguments[0]) < MANY else _by_operation
    return evaluate(function, arguments)


def _by_place(function: ca.Function, arguments: Sequence[np.ndarray]) -> list[np.ndarray]:
    """By CasADi's interpreter; in place, because its own call copies number by number."""
    count = len(arguments[0])
    buffer, evaluate = _mapped(function, count).buffer()
    rows = [np.ascontiguousarray(argument, dtype=float) for argument in arguments]
    outputs = [np.zeros((count, function.size1_out(i))) for i in range(function.n_out())]
    for i, row in enumerate(rows):
        if row.size:
            buffer.set_arg(i, memoryview(row))  # type: ignore
    for i, output in enumerate(outputs):
        if output.size:
            buffer.set_res(i, memoryview(output))  # type: ignore
    evaluate()
    return outputs


def _by_operation(function: ca.Function, arguments: Sequence[np.ndarray]) -> list[np.ndarray]:
    """By NumPy, each operation at all places at once."""
    count, (evaluate, nonzeros) = len(arguments[0]), _translated(function)
    columns = [np.ascontiguousarray(argument.T, dtype=float) for argument in arguments]
    entries = [np.empty((len(places), count)) for places in nonzeros]
    evaluate(*columns, *entries, np)
    outputs = [np.zeros((count, function.size1_out(i))) for i in range(function.n_out())]
    for output, places, entry in zip(outputs, nonzeros, entries, strict=True):
        output[:, places] = entry.T
    return outputs


@lru_cache(maxsize=256)
def _mapped(function: ca.Function, count: int) -> ca.Function:
    arguments, outputs = _expanded(function)
    dense = [ca.densify(output) for output in outputs]
    return ca.Function("at_a_place", arguments, dense).map(count)


@lru_cache(maxsize=256)
def _translated(function: ca.Function) -> tuple[Callable[..., None], list[list[int]]]:
    """As Python, which sets the outputs' nonzero entries; and the places of these."""
    arguments, outputs = _expanded(function)
    names: dict[str, Any] = {}
    exec(python_source(ca.Function("at_all_places", arguments, outputs), "evaluate", True), names)
    return names["evaluate"], [output.sparsity().row() for output in outputs]


def _expanded(function: ca.Function) -> tuple[list[ca.SX], list[ca.SX]]:
    """Its inputs and outputs, with common subexpressions shared."""
    w, p = function.size1_in(0), function.size1_in(1)
    arguments = [ca.SX.sym("w", w), ca.SX.sym("p", p)]
    arguments += [ca.SX.sym("mu", function.size1_in(i)) for i in range(2, function.n_in())]
    return arguments, ca.cse(function.call(arguments))


@lru_cache(maxsize=256)
def _first(function: ca.Function) -> ca.Function:
    w, p, y = _symbols(function)
    return ca.Function("first", [w, p], [y, ca.vec(ca.jacobian(y, w).T)])


@lru_cache(maxsize=256)
def _second(function: ca.Function) -> ca.Function:
    w, p, y = _symbols(function)
    mu = ca.SX.sym("mu", y.size1())
    hessian = ca.hessian(ca.dot(mu, y), w)[0]
    return ca.Function("second", [w, p, mu], [ca.vec(hessian)])


def _symbols(function: ca.Function) -> tuple[ca.SX, ca.SX, ca.SX]:
    w = ca.SX.sym("w", function.size1_in(0))
    p = ca.SX.sym("p", function.size1_in(1))
    return w, p, function(w, p)

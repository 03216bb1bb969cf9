"""Derivatives of small functions at many places: by CasADi and by NumPy, and by complex steps."""

import casadi as ca
import numpy as np
import pytest
from plans import shipped

from trunk_ocp.nlp import point_functions as functions
from trunk_ocp.nlp.term_derivatives import (
    MANY,
    _translated,
    first_derivatives,
    second_derivatives,
    values,
)

COUNT = MANY + 6
STEP = 1e-30
"""Complex steps have no truncation and no cancellation."""


def linear():
    """With outputs that do not depend on their input, and derivatives that are all constant."""
    w, p = ca.SX.sym("w", 2), ca.SX.sym("p", 1)
    return ca.Function("linear", [w, p], [ca.vertcat(p * w[1], 3.0, w[0])])


TRUNK = shipped("pick-fruit").trunk
FUNCTIONS = {
    "rates": functions.rates_in_units,
    "rates of hung loads": lambda: functions.rates_in_units(True),
    "base": lambda: functions.base(TRUNK),
    "director": lambda: functions.director(2),
    "distance": lambda: functions.squared_distance(1.75),
    "distance in the head's frame": lambda: functions.squared_distance_in_head(TRUNK),
    "direction": lambda: functions.squared_held_direction(1),
    "linear": linear,
}


@pytest.fixture(params=FUNCTIONS)
def case(request):
    """A function, places and parameters, and weights of its outputs."""
    function, rng = FUNCTIONS[request.param](), np.random.default_rng(2)
    w, p, mu = (
        rng.uniform(0.5, 1.5, (COUNT, size))
        for size in (function.size1_in(0), function.size1_in(1), function.size1_out(0))
    )
    return function, w, p, mu


def complex_values(function, w, p):
    """Values (N, m) in complex arithmetic, place by place."""
    evaluate, (places,) = _translated(function)
    found = np.zeros((len(w), function.size1_out(0)), dtype=complex)
    for one, at, parameters in zip(found, w, p, strict=True):
        entries = np.empty(len(places), dtype=complex)
        evaluate(at, parameters, entries, np)
        one[places] = entries
    return found


def complex_step(function, w, p):
    """Jacobians (N, m, n)."""
    steps = 1j * STEP * np.eye(w.shape[1])
    columns = [complex_values(function, w + step, p).imag / STEP for step in steps]
    return np.stack(columns, axis=-1)


def assert_close(found, wanted, tolerance):
    """Relative to the largest entry."""
    np.testing.assert_allclose(
        found, wanted, rtol=0, atol=tolerance * np.abs(wanted).max(initial=1)
    )


def test_both_ways_agree_to_round_off(case):
    """Few places go through CasADi's interpreter, many through NumPy."""
    function, w, p, mu = case
    few = [slice(0, MANY - 1), slice(MANY - 1, COUNT)]
    apart = [values(function, w[k], p[k]) for k in few]
    assert_close(values(function, w, p), np.concatenate(apart), 1e-14)
    apart = zip(*(first_derivatives(function, w[k], p[k]) for k in few), strict=True)
    for found, wanted in zip(first_derivatives(function, w, p), apart, strict=True):
        assert_close(found, np.concatenate(wanted), 1e-14)
    apart = [second_derivatives(function, w[k], p[k], mu[k]) for k in few]
    assert_close(second_derivatives(function, w, p, mu), np.concatenate(apart), 1e-13)


@pytest.mark.parametrize("count", [3, COUNT])
def test_first_derivatives_are_those_of_complex_steps(case, count):
    function, w, p, _ = (part[:count] if isinstance(part, np.ndarray) else part for part in case)
    value, jacobian = first_derivatives(function, w, p)
    by_casadi = [function(*at).full() for at in zip(w, p, strict=True)]
    assert_close(value, np.reshape(by_casadi, value.shape), 1e-14)
    assert_close(jacobian, complex_step(function, w, p), 1e-13)


@pytest.mark.parametrize("count", [3, COUNT])
def test_second_derivatives_are_differences_of_the_first(case, count):
    function, w, p, mu = (part[:count] if isinstance(part, np.ndarray) else part for part in case)
    hessian = second_derivatives(function, w, p, mu)
    assert_close(hessian, hessian.swapaxes(-1, -2), 1e-14)
    h, columns = 1e-5, []
    for step in h * np.eye(w.shape[1]):
        ahead, back = (first_derivatives(function, w + s * step, p)[1] for s in (1, -1))
        columns.append(np.einsum("km,kmn->kn", mu, ahead - back) / (2 * h))
    assert_close(hessian, np.stack(columns, axis=-1), 1e-8)

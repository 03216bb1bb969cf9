"""Structured derivatives are the derivatives: of Rosenbrock's function, and of real windows."""

import casadi as ca
import numpy as np
import pytest
from plans import first_steps, in_equilibrium, shipped
from scipy.optimize import rosen, rosen_der, rosen_hess

from trunk_ocp.nlp.nlp_builder import NLPBuilder
from trunk_ocp.nlp.window import Window
from trunk_ocp.problem.weights import Weights
from trunk_ocp.rod.collocation import mesh_for

# Two orders of evaluating the same sums of products: some thousand round-offs of 1e-16.
ROUND_OFF = 1e-12


def derivatives_of(nlp, x, p, lam_f, lam_g):
    """(f, grad f, g, Jacobian, Hessian of lam . (f, g)) by our functions."""
    functions = nlp.derivatives()
    f, gradient = functions["grad_f"](x, p)
    g, jacobian = functions["jac_g"](x, p)
    upper = functions["hess_lag"](x, p, lam_f, lam_g).full()
    assert np.array_equal(upper, np.triu(upper))
    hessian = upper + upper.T - np.diag(np.diag(upper))
    return float(f), gradient.full().ravel(), g.full().ravel(), jacobian.full(), hessian


def automatic(nlp, x, p, lam_f, lam_g):
    """The same by CasADi's algorithmic differentiation of the whole expression graph."""
    problem = nlp.as_casadi()
    flat = ca.Function("flat", [problem["x"], problem["p"]], [problem["f"], problem["g"]]).expand()
    X, P = ca.SX.sym("x", nlp.size[0]), ca.SX.sym("p", nlp.parameters.size)
    F, G = flat(X, P)
    lagrangian = lam_f * F + ca.dot(ca.DM(lam_g), G)
    outputs = [F, ca.gradient(F, X), G, ca.jacobian(G, X), ca.hessian(lagrangian, X)[0]]
    f, gradient, g, jacobian, hessian = ca.Function("all", [X, P], outputs)(x, p)
    return float(f), gradient.full().ravel(), g.full().ravel(), jacobian.full(), hessian.full()


def difference(ours, theirs):
    """Largest difference of two lists of arrays, each as a share of its array's largest entry."""
    pairs = zip(ours, theirs, strict=True)
    return np.max([np.abs(np.subtract(a, b)).max() / np.abs(b).max() for a, b in pairs])


# --- a function whose derivatives are known ----------------------------------------------


def rosenbrock(count):
    """Rosenbrock's function of `count` variables: one term at count - 1 places."""
    add = NLPBuilder()
    x = add.variables(count)
    w, p = ca.SX.sym("w", 2), ca.SX.sym("p", 2)
    phi = ca.Function("phi", [w, p], [p[0] * (w[1] - w[0] ** 2) ** 2 + (p[1] - w[0]) ** 2])
    add.cost(phi, np.stack([x[:-1], x[1:]]), np.tile([[100.0], [1.0]], count - 1))
    rows = add.rows("a", 2, lower=-1.0, upper=[2.0, 3.0])
    add.linear(rows[0], x, np.arange(count))
    # The second row adds up a vector term at two places, one weighted by -3.
    w, p = ca.SX.sym("w", 2), ca.SX.sym("p", 0)
    pair = ca.Function("pair", [w, p], [ca.vertcat(w[0] * w[1], ca.sin(w[0]))])
    places = np.stack([x[[0, 1]], x[[2, 3]]])
    add.term(pair, places, np.zeros((0, 2)), [0, 1], [0, 1], rows[1], [1.0, -3.0])
    return add


def test_a_known_function_has_its_known_derivatives():
    nlp, rng = rosenbrock(6).nlp(), np.random.default_rng(1)
    x, (lam_f, *lam_g) = rng.normal(size=6), rng.normal(size=3)
    jacobian = np.zeros((2, 6))
    jacobian[0] = np.arange(6)
    jacobian[1, [0, 2, 1]] = x[2], x[0], -3 * np.cos(x[1])
    hessian = lam_f * rosen_hess(x)
    hessian[0, 2] += lam_g[1]
    hessian[2, 0] += lam_g[1]
    hessian[1, 1] += 3 * lam_g[1] * np.sin(x[1])
    g = [np.arange(6) @ x, x[0] * x[2] - 3 * np.sin(x[1])]
    expected = rosen(x), rosen_der(x), np.array(g), jacobian, hessian
    ours = derivatives_of(nlp, x, nlp.parameters, lam_f, lam_g)
    assert difference(ours, expected) <= ROUND_OFF


def test_parameters_are_no_part_of_the_structure():
    nlp, x = rosenbrock(4).nlp(), np.array([0.3, -0.2, 0.5, 1.1])
    doubled = np.tile([200.0, 1.0], 3)
    f, *_ = derivatives_of(nlp, x, doubled, 1.0, np.zeros(2))
    assert f == pytest.approx(2 * rosen(x) - np.sum((1 - x[:-1]) ** 2), rel=ROUND_OFF)


def test_only_variables_that_share_a_place_have_second_derivatives():
    functions = rosenbrock(6).nlp().derivatives()
    pattern = functions["hess_lag"].sparsity_out(0)
    pairs = set(zip(*pattern.get_triplet(), strict=True))
    chain = {(i, i) for i in range(6)} | {(i, i + 1) for i in range(5)}
    assert pairs == chain | {(0, 2), (1, 3)}


def test_bounds_come_back_in_the_order_of_variables_and_rows():
    add = NLPBuilder()
    add.variables(2, lower=-1.0, upper=[3.0, 4.0])
    add.variables(1, 2)
    add.rows("a", 2, lower=[1.0, 2.0], upper=5.0)
    add.rows("b", 1)
    bounds = add.bounds
    assert bounds["lbx"].tolist() == [-1, -1, -np.inf, -np.inf]
    assert bounds["ubx"].tolist() == [3, 4, np.inf, np.inf]
    assert bounds["lbg"].tolist() == [1, 2, 0]
    assert bounds["ubg"].tolist() == [5, 5, 0]


# --- windows of real motions -------------------------------------------------------------


def window(name, first, last, held=None, elements=3, degree=4):
    motion = first_steps(name, last)
    mesh = mesh_for(motion.trunk, motion.contact_from, elements, degree)
    before = np.zeros(len(motion.trunk.muscles) + 2)
    tasks = motion.steps[first:last]
    return Window(motion, mesh, tasks, before, held or {}, first, Weights(1e-3, 1e-2))


WINDOWS = {
    "held directions and pulls inside": lambda: window("pick-fruit", 0, 3),
    "held directions known": lambda: window(
        "pick-fruit", 1, 3, {h: np.array([0.6, 0.0, -0.8]) for h in shipped("pick-fruit").held}
    ),
    "wrap with targets inside elements": lambda: window("lift-log", 0, 2),
    "contact couple": lambda: window("lift-log-asymmetric", 1, 3),
}


@pytest.mark.parametrize("make", WINDOWS.values(), ids=WINDOWS)
def test_derivatives_of_a_window_are_those_of_automatic_differentiation(make):
    w, rng = make(), np.random.default_rng(7)
    x = -0.3 * rng.random((len(w.steps), 30))
    shapes, _ = in_equilibrium(w, x)
    full = w.pack(x, shapes) + 0.1 * rng.normal(size=w.nlp.size[0])
    lam_f, lam_g = 1.7, rng.normal(size=w.nlp.size[1])
    p = w.nlp.parameters
    ours = derivatives_of(w.nlp, full, p, lam_f, lam_g)
    assert difference(ours, automatic(w.nlp, full, p, lam_f, lam_g)) <= ROUND_OFF


def test_the_wrap_window_does_have_targets_inside_elements():
    w = WINDOWS["wrap with targets inside elements"]()
    _, tau = w.mesh.locate(np.array([target.Z for target in w.steps[0].targets]))
    assert np.any((tau > 0.01) & (tau < 0.99))


def test_steps_couple_only_to_their_neighbors():
    w = window("lift-log", 0, 3)
    rows, columns = w.nlp.derivatives()["hess_lag"].sparsity_out(0).get_triplet()
    start = [u.x.min() for u in w.unknowns]
    row, column = (np.searchsorted(start, index, side="right") for index in (rows, columns))
    assert np.all(np.abs(column - row) <= 1)

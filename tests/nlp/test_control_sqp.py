"""SQP in the controls: solutions are Ipopt's, every iterate is a plan, solves may stop early."""

import time
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from plans import first_steps, in_equilibrium
from toys import TRUNK as SHORTENER
from toys import C, shortening

from trunk_ocp.nlp.condensed_window import CondensedWindow
from trunk_ocp.nlp.control_qp import ControlQP, _is_convex
from trunk_ocp.nlp.control_sqp import ControlSQP
from trunk_ocp.nlp.ipopt import Optimizer
from trunk_ocp.nlp.pace import Pace
from trunk_ocp.nlp.window import Weights, Window
from trunk_ocp.reporting import Reporter
from trunk_ocp.rod.collocation import mesh_for


def window_of(motion, elements=3, degree=4, weights=None):
    mesh = mesh_for(motion.trunk, motion.contact_from, elements, degree)
    weights = weights or Weights(1e-3, 1e-4)
    return Window(motion, mesh, motion.steps, motion.start, {}, 0, weights)


def packed(w, x):
    return w.pack(x, in_equilibrium(w, x)[0])


def solved(w, full, deadline=np.inf, **options):
    return ControlSQP(w).solve(w, [ControlSQP(w).start(full)], deadline, Optimizer(**options))


def test_a_plan_by_hand():
    """Targets of a rod that only shortens: a quadratic program, solved in one iteration."""
    wanted = [-0.1, -0.3, -0.2]
    w = window_of(shortening(wanted, most=0.15), weights=Weights(0.0, 0.0))
    outcome, _ = solved(w, packed(w, np.zeros((3, 4))))
    assert outcome.converged
    # Change bounds of 0.15 around 0, and the least-squares compromise with -0.3 in between.
    gamma = w.controls_of(outcome.full)[:, :2]
    np.testing.assert_allclose(gamma[:, 0], gamma[:, 1], atol=1e-6)
    np.testing.assert_allclose(gamma[:, 0], [-0.12, -0.27, -0.2], atol=0.05)
    assert C > 0
    assert SHORTENER.length == 1.0


@pytest.mark.parametrize("name", ["pick-fruit", "lift-log"])
def test_solutions_are_ipopts(name):
    """From nearby; pulls along a held direction, a wrap with curvature of either sign."""
    motion = first_steps(name, 3)
    w = window_of(motion)
    reference = Optimizer().solve(w, packed(w, np.zeros((3, 30))), "horizon", "")
    near = w.controls_of(reference.full) + 0.03 * np.random.default_rng(6).normal(size=(3, 30))
    box = [(step.box.lower, step.box.upper) for step in motion.steps]
    outcome, _ = solved(w, packed(w, np.clip(near, *np.swapaxes(box, 0, 1))))
    assert outcome.converged
    assert reference.converged
    assert outcome.objective <= reference.objective * (1 + 1e-3)
    evaluated = Optimizer().evaluate(w, outcome.full)
    assert evaluated.objective == pytest.approx(outcome.objective, rel=1e-9)
    assert evaluated.infeasibility <= 1e-6
    assert evaluated.infeasibility <= outcome.infeasibility + 1e-9


def test_every_iterate_is_a_plan_that_keeps_its_bounds():
    w = window_of(first_steps("lift-log", 3))
    full = packed(w, np.zeros((3, 30)))
    objectives = [Optimizer().evaluate(w, full).objective]
    for most in range(1, 6):
        outcome, _ = solved(w, full, max_iterations=most)
        assert not outcome.converged
        evaluated = Optimizer().evaluate(w, outcome.full)
        assert evaluated.infeasibility <= 1e-6
        objectives.append(evaluated.objective)
    assert np.all(np.diff(objectives) < 0)


def test_a_deadline_in_the_past_still_allows_one_iteration():
    w = window_of(first_steps("lift-log", 3))
    full = packed(w, np.zeros((3, 30)))
    outcome, _ = solved(w, full, deadline=time.perf_counter())
    one, _ = solved(w, full, max_iterations=1)
    assert outcome.late
    assert outcome.iterations == one.iterations == 1
    np.testing.assert_array_equal(outcome.full, one.full)


def test_time_that_runs_out_leaves_the_start_within_bounds(monkeypatch):
    """Not the better one, whose way back within bounds is half done: its rods do not settle."""
    w = window_of(shortening([-0.4, -0.4], most=0.15), weights=Weights(0.0, 0.0))
    within = packed(w, np.zeros((2, 4)))
    better = packed(w, np.tile([-0.3, -0.3, 0.0, 0.0], (2, 1)))
    sqp, settled, calls = ControlSQP(w), CondensedWindow.settled, []

    def first_fails(self, full, rods):
        calls.append(full)
        full, residual = settled(self, full, rods)
        return full, np.inf if len(calls) == 1 else residual

    def out_of_time(*starts):
        calls.clear()
        return sqp.solve(w, [sqp.start(full) for full in starts], 0.0, Optimizer())[0]

    assert CondensedWindow(w).objective(better) < CondensedWindow(w).objective(within)
    outcome = out_of_time(within, better)  # else, its first iteration brings it within bounds
    assert outcome.late
    assert Optimizer().evaluate(w, outcome.full).infeasibility <= 1e-6
    monkeypatch.setattr(CondensedWindow, "settled", first_fails)
    alone = out_of_time(better)
    assert alone.late
    assert alone.infeasibility == pytest.approx(0.075)
    outcome = out_of_time(within, better)
    assert outcome.late
    assert outcome.iterations == 1
    assert Optimizer().evaluate(w, outcome.full).infeasibility <= 1e-6
    np.testing.assert_allclose(w.controls_of(outcome.full), w.controls_of(within), atol=1e-12)
    again = out_of_time(within, better)  # the same once more would get nowhere
    assert Optimizer().evaluate(w, again.full).infeasibility <= 1e-6
    assert again.objective < 0.9 * outcome.objective


def test_time_for_no_further_iteration_goes_into_a_correction(monkeypatch):
    """Targets are closer then than after the iteration alone, in equilibrium and within bounds."""
    motion = first_steps("pick-fruit", 3)
    before, _ = solved(window_of(motion), packed(window_of(motion), np.zeros((3, 30))))
    w = window_of(motion.shifted((0.05, 0.05, 0.0)))
    alone, _ = solved(w, before.full, max_iterations=1)
    monkeypatch.setattr(Pace, "allows", lambda self, *parts: len(parts) <= 2)
    outcome, _ = solved(w, before.full)
    assert outcome.late
    assert outcome.iterations == 1
    evaluated = Optimizer().evaluate(w, outcome.full)
    assert evaluated.infeasibility <= 1e-6
    assert evaluated.objective < alone.objective


def test_a_reporter_that_stops_gets_a_plan_of_this_motion():
    """Not the start, whose rods are in equilibrium under other loads."""
    reporter = Reporter()
    reporter.stop = True
    old = first_steps("lift-log", 1)
    start = packed(window_of(old), np.zeros((1, 30)))
    w = window_of(old.with_loads(tip_mass=1.0))
    outcome, _ = solved(w, start, reporter=reporter)
    assert outcome.stopped
    assert outcome.infeasibility <= 1e-6
    assert Optimizer().evaluate(w, outcome.full).infeasibility <= 1e-6


def test_rods_that_find_no_equilibrium_are_not_called_feasible():
    old = first_steps("lift-log", 1)
    start = packed(window_of(old), np.zeros((1, 30)))
    w = window_of(old.with_loads(tip_mass=1e4))
    outcome, _ = solved(w, start, max_iterations=1)
    assert not outcome.converged
    assert outcome.infeasibility > 1.0


def test_a_target_out_of_reach_hides_no_other():
    """Which moves by 5 mm, for next to nothing of the objective."""
    free = Weights(0.0, 0.0)
    w = window_of(shortening([-0.1, 50.0]), weights=free)
    first, _ = solved(w, packed(w, np.zeros((2, 4))))
    moved = -0.1 - 0.005 / C
    w = window_of(shortening([moved, 50.0]), weights=free)
    outcome, _ = solved(w, first.full)
    assert outcome.converged
    np.testing.assert_allclose(C * w.controls_of(outcome.full)[0, 0], C * moved, atol=1e-3)


def test_what_cannot_be_solved_says_why_and_how_far_off_it_is():
    old = first_steps("lift-log", 1)
    start = packed(window_of(old), np.zeros((1, 30)))
    w = window_of(old.with_loads(tip_mass=1e4))
    outcome, _ = solved(w, start)
    assert outcome.message == "Error_In_Step_Computation"
    assert outcome.infeasibility > 1.0
    w = window_of(shortening([-0.1], most=0.1).started(np.array([-0.9, -0.9, 0.0, 0.0])))
    w = window_of(w.motion.limited(activation=0.2))
    outcome, _ = solved(w, packed(w, np.zeros((1, 4))))
    assert outcome.message == "Infeasible_Problem_Detected"
    assert outcome.infeasibility == pytest.approx(0.8)


def test_an_objective_of_zero_is_a_solution():
    """Nothing is asked of a trunk that has to move all the same: bounds do not allow its start."""
    motion = shortening([-0.1]).started(np.array([-0.2, -0.2, 0.0, 0.0])).limited(activation=0.1)
    target = {"position_weight": 0.0, "position": (0.0, 0.0, 1.0)}
    w = window_of(motion.retarget(**target), weights=Weights(0.0, 0.0))
    full = packed(w, np.full((1, 4), [-0.2, -0.2, 0.0, 0.0]))
    outcome, _ = solved(w, full)
    assert outcome.converged
    assert outcome.objective == 0.0
    assert Optimizer().evaluate(w, outcome.full).infeasibility <= 1e-6


def test_quadratic_programs_are_solved_as_by_another_solver():
    """Against Ipopt, on dense rows."""
    w = window_of(first_steps("pick-fruit", 3))
    condensed = CondensedWindow(w)
    qp = ControlQP(condensed)
    x = np.zeros(condensed.x.shape)
    model = condensed.model(packed(w, x), np.zeros(3))
    found = qp.solve(w, model, x)
    lower, upper, rows_lower, rows_upper = qp.bounds(w, x)
    blocks = qp.hessian(model)
    (H, n), size = x.shape, condensed.size
    hessian = np.zeros((size, size))
    for t in range(H):
        at = np.r_[t * n : t * n + n, H * n : size]
        hessian[np.ix_(at, at)] += blocks[t]
        if t:
            hessian[at[:n], at[:n] - n] += model.links[t]
            hessian[at[:n] - n, at[:n]] += model.links[t]
    A = np.vstack([qp._rows.toarray(), model.held_rows])
    z = ca.MX.sym("z", size)
    objective = ca.bilin(ca.DM(hessian), z) / 2 + ca.dot(model.gradient, z)
    options = {"ipopt.print_level": 0, "print_time": False, "ipopt.sb": "yes"}
    solver = ca.nlpsol("qp", "ipopt", {"x": z, "f": objective, "g": ca.DM(A) @ z}, options)
    rest = model.held_rest
    bounds = {"lbg": np.append(rows_lower, rest), "ubg": np.append(rows_upper, rest)}
    other = solver(lbx=lower, ubx=upper, **bounds)

    def cost(step):
        return step @ hessian @ step / 2 + model.gradient @ step

    reference = np.asarray(other["x"]).ravel()
    assert cost(found.step) == pytest.approx(cost(reference), rel=1e-5)
    assert qp.violation(w, found.step[: H * n].reshape(H, n)) <= 1e-8
    np.testing.assert_allclose(model.held_rows @ found.step, model.held_rest, atol=1e-8)


def test_convexity_is_found():
    rng = np.random.default_rng(5)
    links = -rng.random((4, 6))
    links[0] = 0.0
    square = rng.normal(size=(4, 6, 6))
    blocks = square @ square.swapaxes(-1, -2) + 3 * np.eye(6)
    assert _is_convex(blocks, links)
    blocks[2, 3, 3] -= 20.0
    assert not _is_convex(blocks, links)


def test_curvatures_that_are_negative_change_sign():
    """Of the model less the costs of controls; the others, and convex models, stay."""
    w = window_of(first_steps("pick-fruit", 2))
    condensed, rng = CondensedWindow(w), np.random.default_rng(5)
    qp, x = ControlQP(condensed), -0.1 * rng.random(condensed.x.shape)
    model = condensed.model(packed(w, x), np.zeros(3))
    to_local, n = model.to_local, x.shape[1]

    def without_costs(blocks):
        blocks = blocks.copy()
        blocks[:, np.arange(n), np.arange(n)] -= model.diagonal
        return blocks

    square = rng.normal(size=model.blocks.shape)
    convex = replace(model, blocks=square @ square.swapaxes(-1, -2))
    exact = to_local.T @ convex.blocks @ to_local
    np.testing.assert_allclose(without_costs(qp.hessian(convex)), exact, atol=1e-10)
    bent = replace(model, blocks=square + square.swapaxes(-1, -2))
    curvatures = np.linalg.eigvalsh(to_local.T @ bent.blocks @ to_local)
    mended = np.linalg.eigvalsh(without_costs(qp.hessian(bent)))
    assert curvatures.min() < -1.0
    np.testing.assert_allclose(np.sort(np.abs(curvatures)), mended, atol=1e-10 * mended.max())


def test_bounds_that_contradict_each_other_are_reported():
    w = window_of(shortening([-0.1, -0.3], most=0.1))
    motion = w.motion.started(np.array([-0.9, -0.9, 0.0, 0.0]))
    w = window_of(motion.limited(activation=0.2))
    outcome, point = solved(w, packed(w, np.zeros((2, 4))))
    assert outcome.message == "Infeasible_Problem_Detected"
    assert not outcome.converged
    assert outcome.infeasibility > 0.1
    assert np.all(np.isfinite(point.full))

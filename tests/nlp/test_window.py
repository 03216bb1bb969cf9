"""A window's NLP says what statics, eq. (42) and appendix B say."""

from dataclasses import replace

import numpy as np
import pytest
from plans import first_steps, in_equilibrium, planned, shipped

from trunk_ocp.model.loads import Loads
from trunk_ocp.nlp.ipopt import Optimizer
from trunk_ocp.nlp.window import Window
from trunk_ocp.problem.motion import HeldDirection
from trunk_ocp.problem.weights import Weights
from trunk_ocp.rod.collocation import mesh_for
from trust import reference

# Newton's method in statics stops at relative steps of 1e-9 and is quadratic: what is left
# is round-off, in a few hundred operations on numbers of order ten.
EQUILIBRIUM = 1e-10


def window(name, first, last, weights=None, elements=3, degree=6, before=None, held=None):
    motion = first_steps(name, last)
    mesh = mesh_for(motion.trunk, motion.contact_from, elements, degree)
    before = np.zeros(30) if before is None else before
    tasks = motion.steps[first:last]
    return Window(motion, mesh, tasks, before, held or {}, first, weights or Weights())


def drawn(count, seed=3):
    """Unknowns of a few steps: mild contractions, small head angles."""
    rng = np.random.default_rng(seed)
    return np.hstack([-0.3 * rng.random((count, 28)), 0.1 * rng.random((count, 2))])


def values(w, full):
    """Objective and constraints of a window at a vector of unknowns."""
    functions, p = w.nlp.derivatives(), w.nlp.parameters
    return float(functions["grad_f"](full, p)[0]), functions["jac_g"](full, p)[0].full().ravel()


def change_rows(w):
    """Rows of the bounds on change: those that are no equation, or tie x to x."""
    linear = w.nlp.linear[1:].tocsr()
    of_x = {int(i) for u in w.unknowns for i in u.x} | {int(i) for i in w.previous}
    nonlinear = sum(abs(term.scatter[1:]).sum(axis=1).A1 for term in w.nlp.terms)
    return [
        i
        for i in range(w.nlp.size[1])
        if nonlinear[i] == 0 and set(linear[i].indices.tolist()) <= of_x
    ]


CASES = {"pick-fruit": 4, "lift-log": 3, "lift-log-asymmetric": 3}


@pytest.mark.parametrize(("name", "steps"), CASES.items())
def test_equilibria_of_statics_satisfy_the_constraints(name, steps):
    """Two codes agree: a Newton solver on condensed elements, and the NLP's equations."""
    w = window(name, 0, steps)
    boxes = [step.box for step in w.steps]
    x = np.clip(drawn(steps), [b.lower for b in boxes], [b.upper for b in boxes])
    shapes, _ = in_equilibrium(w, x)
    full = w.pack(x, shapes)
    _, g = values(w, full)
    low, high = w.bounds["lbg"], w.bounds["ubg"]
    off = np.maximum(low - g, g - high)
    off[change_rows(w)] = 0.0  # the drawn steps are not near each other
    assert off.max() <= EQUILIBRIUM
    fixed = w.bounds["lbx"] == w.bounds["ubx"]
    assert np.abs(full - w.bounds["lbx"])[fixed].max() <= EQUILIBRIUM


@pytest.mark.parametrize(("name", "steps"), CASES.items())
def test_the_objective_is_eq_42_squared_plus_effort_and_rate(name, steps):
    weights = Weights(effort=3e-3, rate=2e-2)
    w, x = window(name, 0, steps, weights), drawn(steps)
    shapes, _ = in_equilibrium(w, x)
    motion = w.motion
    tip = np.array([motion.trunk.length])
    tracking = 0.0
    for t, step in enumerate(motion.steps):
        for target in step.targets:
            Z = np.array([target.Z])
            error = shapes.position(Z)[t, 0] - target.position
            tracking += target.position_weight * error @ error
            goal = target.directions[2]
            if isinstance(goal, HeldDirection):
                goal = shapes.directors(tip)[0, 0, 2]
            error = shapes.directors(Z)[t, 0, 2] - goal
            tracking += target.direction_weights[2] * error @ error
    change = np.diff(x, axis=0, prepend=0.0)
    rate = sum((change[t] ** 2).sum() / s.duration for t, s in enumerate(motion.steps))
    expected = tracking + 3e-3 * (x[:, :28] ** 2).sum() + 2e-2 * rate
    # The NLP leaves collocation's |q| - 1 as it is; shapes normalize it (1e-6 at most).
    assert values(w, w.pack(x, shapes))[0] == pytest.approx(expected, rel=1e-5)


def test_packing_and_unpacking_is_the_identity_in_si_units():
    w, x = window("pick-fruit", 0, 3), drawn(3)
    shapes, loads = in_equilibrium(w, x)
    full = w.pack(x, shapes)
    np.testing.assert_array_equal(w.controls_of(full), x)
    np.testing.assert_allclose(w.states_of(full), shapes.states, rtol=1e-12, atol=1e-9)
    forces = [load.tip_force for load in loads]
    np.testing.assert_allclose(w.tip_forces_of(full), forces, rtol=0, atol=1e-9)
    ((held, direction),) = w.directions_of(full).items()
    assert held == HeldDirection(0, 1.75, 2)
    tip = np.array([1.75])
    np.testing.assert_allclose(direction, shapes.directors(tip)[0, 0, 2], atol=1e-12)
    np.testing.assert_allclose(forces[2], 10 * direction, atol=1e-9)  # step 3: 100 N * 2 / 20
    worst = np.linalg.norm(shapes.position(tip)[:, 0] - (0.7, 0.3, -0.2), axis=1).max()
    assert w.worst_error(full) == pytest.approx(worst, rel=1e-12)


def test_bounds_on_change_are_rows_of_the_nlp():
    w = window("lift-log", 1, 3, before=np.full(30, -0.05))
    x = drawn(2)
    shapes, _ = in_equilibrium(w, x)
    _, g = values(w, w.pack(x, shapes))
    rows = change_rows(w)
    expected = np.diff(x, axis=0, prepend=-0.05).ravel()
    np.testing.assert_allclose(g[rows], expected, rtol=0, atol=1e-12)
    assert w.bounds["ubg"][rows].tolist() == 2 * [*28 * [0.4], np.pi / 64, np.pi / 64]
    assert w.bounds["lbg"][rows].tolist() == 2 * [*28 * [-0.4], -np.pi / 64, 0.0]


def test_a_direction_known_from_before_is_no_unknown():
    direction = np.array([0.6, 0.0, -0.8])
    w = window("pick-fruit", 2, 4, held={HeldDirection(0, 1.75, 2): direction})
    assert w.held == {}
    x = drawn(2)
    shapes, _ = in_equilibrium(w, x)
    forces = w.tip_forces_of(w.pack(x, shapes))
    np.testing.assert_allclose(forces, np.outer([10.0, 15.0], direction), atol=1e-9)


def test_windows_of_one_structure_differ_in_numbers_only():
    first, second = window("lift-log", 2, 4), window("lift-log", 3, 5, before=np.full(30, -0.1))
    assert first.structure == second.structure
    assert hash(first.structure) == hash(second.structure)
    assert (first.nlp.linear != second.nlp.linear).nnz == 0
    assert not np.array_equal(first.nlp.parameters, second.nlp.parameters)
    other = window("lift-log", 0, 2)  # no bounds on change in its first step
    assert other.structure != first.structure


def test_the_optimum_found_is_that_of_the_integrated_trunk():
    """Ipopt's objective against NumPy on shapes integrated by DOP853, within the mesh error."""
    plan = planned("lift-log", "sequential")
    w = window("lift-log", 0, 10)
    objective, _ = values(w, w.pack(plan.x, plan.shape))
    # 0.1 mm of mesh error on the 10 mm of a typical miss, squared: 2 %; measured far less.
    assert plan.objective.total == pytest.approx(objective, rel=1e-3)
    motion, Z = plan.motion, np.array([g.Z for g in plan.motion.steps[0].targets])
    tracking = 0.0
    for loads, steps in (([Loads(9.8)], [0]), (list(plan.loads[1:]), range(1, 10))):
        moment = plan.shape.moment(np.zeros(1))[list(steps), 0]
        x = plan.x[list(steps)]
        r, d, _ = reference.march(motion.trunk, x[:, :28], x[:, 28:], loads, moment, Z, rtol=1e-8)
        for t, step in enumerate(steps):
            for p, g in enumerate(motion.steps[step].targets):
                tracking += g.position_weight * np.sum((r[t, p] - g.position) ** 2)
                tracking += g.direction_weights[2] * np.sum((d[t, p, 2] - g.directions[2]) ** 2)
    assert plan.objective.tracking == pytest.approx(tracking, rel=1e-5)


def test_the_optimum_does_not_depend_on_the_mesh():
    """Three elements of degree 6 against twelve of degree 8, from the same start."""
    x = planned("lift-log", "sequential").x[:1]
    found = []
    for elements, degree in ((3, 6), (12, 8)):
        w = window("lift-log", 0, 1, elements=elements, degree=degree)
        shapes, _ = in_equilibrium(w, x)
        found.append(Optimizer().solve(w, w.pack(x, shapes), "", ""))
    assert all(outcome.converged and outcome.infeasibility <= 1e-8 for outcome in found)
    # DESIGN 5: a lean mesh gives lift-log's optimum to 1e-4 of the objective.
    assert found[0].objective == pytest.approx(found[1].objective, rel=2e-4)


def test_extension_is_bounded_in_every_segment():
    """zeta_hat is an unknown of its own with the bounds of eq. (42): three linear constraints."""
    w = window("lift-log", 0, 1)
    index = w.unknowns[0].strain
    low, high = w.bounds["lbx"][index[:, 0]], w.bounds["ubx"][index[:, 0]]
    assert low.tolist() == [0.67, 0.67, 0.67]
    assert high.tolist() == [1.35, 1.35, 1.35]
    x = drawn(1)
    shapes, _ = in_equilibrium(w, x)
    expected = reference.strains(w.motion.trunk, x[:, :28])[0] * [1, 1.75, 1.75, 1.75]
    np.testing.assert_allclose(w.pack(x, shapes)[index], expected, rtol=1e-10, atol=1e-12)


def test_a_target_without_position_weight_costs_nothing():
    motion = shipped("lift-log")
    step = motion.steps[0]
    light = replace(step, targets=tuple(replace(g, position_weight=0.0) for g in step.targets[1:5]))
    motion = replace(motion, steps=(light,))
    mesh = mesh_for(motion.trunk, motion.contact_from, 3, 6)
    w = Window(motion, mesh, motion.steps, np.zeros(30), {}, 0, Weights(0.0, 0.0))
    shapes, _ = in_equilibrium(w, drawn(1))
    assert values(w, w.pack(drawn(1), shapes))[0] == 0.0

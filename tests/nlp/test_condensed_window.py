"""Condensed windows have the reduced derivatives of the full NLP, by dense linear algebra."""

import numpy as np
import pytest
from plans import first_steps, in_equilibrium, shipped

from trunk_ocp.nlp import condensed_rods
from trunk_ocp.nlp.condensed_rods import IllConditionedError
from trunk_ocp.nlp.condensed_window import CondensedWindow
from trunk_ocp.nlp.ipopt import Optimizer
from trunk_ocp.nlp.outcome import Outcome
from trunk_ocp.nlp.window import Weights, Window
from trunk_ocp.nlp.window_layout import layout_of
from trunk_ocp.rod.collocation import mesh_for

EXACT = 1e-9
"""Relative: both sides are exact, and round-off grows some thousandfold along the trunk."""


def window_of(motion, elements=3, degree=4):
    mesh = mesh_for(motion.trunk, motion.contact_from, elements, degree)
    return Window(motion, mesh, motion.steps, motion.start, {}, 0, Weights(1e-2, 1e-3))


def alone(name, number):
    """One phase of a shipped motion."""
    motion = shipped(name)
    phases = (motion.spec.phases[number],)
    return motion.with_spec(motion.spec.model_copy(update={"phases": phases}))


MOTIONS = {
    "a pull along a held direction": lambda: first_steps("pick-fruit", 4),
    "a target in the head's frame": lambda: alone("feed-fruit", -1),
    "a wrap and a couple": lambda: first_steps("lift-log-asymmetric", 3),
    "a log that hangs on a lever": lambda: first_steps("lift-log-hung", 3),
}


def drawn(full, w, seed=4):
    """Controls, states and directions in no equilibrium, near those of a decision vector."""
    rng = np.random.default_rng(seed)
    moved = full.copy()
    for u in w.unknowns:
        moved[u.x] += 0.02 * rng.normal(size=u.x.shape)
        moved[u.edges[1:]] += 1e-3 * rng.normal(size=u.edges[1:].shape)
        moved[u.edges[-1, 4:]] = 0.0
        moved[u.inner] += 1e-3 * rng.normal(size=u.inner.shape)
    for D in w.held.values():
        moved[D] += 1e-2 * rng.normal(size=3)
    return moved


def eliminated(w, full, multipliers):
    """Reduced gradient, Hessian and Newton step of the full NLP, by dense linear algebra.

    Multipliers of the other equations follow from the gradient.
    """
    optimizer, n = Optimizer(), full.size
    zero = {"lam_x0": np.zeros(n), "lam_g0": np.zeros(w.bounds["lbg"].size)}
    first = optimizer.derivatives(w, Outcome(full, 0.0, 0.0, 0, "", zero))
    held, rows = [
        np.array([i for block in w.blocks if chosen(block) for i in block.rows.ravel() - 1], int)
        for chosen in (
            lambda block: block.meaning.name == "held direction",
            lambda block: block.meaning.name not in ("held direction", "change"),
        )
    ]
    z = np.concatenate([u.x for u in w.unknowns] + [*w.held.values()])
    fixed = np.flatnonzero(w.bounds["lbx"] == w.bounds["ubx"])
    dependent = np.setdiff1d(np.setdiff1d(np.arange(n), fixed), np.concatenate([z, w.previous]))
    J = first.jacobian.toarray()
    by_dependent = J[np.ix_(rows, dependent)]
    assert by_dependent.shape[0] == by_dependent.shape[1]
    Z = np.zeros((n, z.size + 1))
    Z[z, np.arange(z.size)] = 1.0
    Z[dependent, :-1] = -np.linalg.solve(by_dependent, J[np.ix_(rows, z)])
    rest = first.g[rows] - w.bounds["lbg"][rows]
    Z[dependent, -1] = -np.linalg.solve(by_dependent, rest)
    lam = zero["lam_g0"].copy()
    lam[held] = multipliers
    force = first.gradient + J.T @ lam
    lam[rows] = -np.linalg.solve(by_dependent.T, force[dependent])
    second = optimizer.derivatives(w, Outcome(full, 0.0, 0.0, 0, "", zero | {"lam_g0": lam}))
    hessian = Z.T @ (second.hessian @ Z)
    gradient = Z[:, :-1].T @ first.gradient + hessian[:-1, -1]
    return gradient, hessian[:-1, :-1], J[held] @ Z, first.g[held]


def assembled(model):
    """Hessian (n, n) of a quadratic model."""
    H, n = model.links.shape
    D = model.to_local.shape[1] - n
    whole = np.zeros((H * n + D, H * n + D))
    for t, block in enumerate(model.blocks):
        at = np.r_[t * n : t * n + n, H * n : H * n + D]
        whole[np.ix_(at, at)] += model.to_local.T @ block @ model.to_local
        whole[at[:n], at[:n]] += model.diagonal[t]
        if t:
            before = at[:n] - n
            whole[at[:n], before] += model.links[t]
            whole[before, at[:n]] += model.links[t]
    return whole


@pytest.mark.parametrize("kind", MOTIONS)
def test_the_model_is_the_full_nlp_with_its_dependent_variables_eliminated(kind):
    w = window_of(MOTIONS[kind]())
    condensed = CondensedWindow(w)
    rng = np.random.default_rng(1)
    x = 0.05 * rng.normal(size=condensed.x.shape)
    full = drawn(w.pack(x, in_equilibrium(w, x)[0]), w)
    multipliers = rng.normal(size=condensed.held.size)
    model = condensed.model(full, multipliers)
    gradient, hessian, rows, rest = eliminated(w, model.full, multipliers)
    np.testing.assert_allclose(model.gradient, gradient, atol=EXACT * np.abs(gradient).max())
    np.testing.assert_allclose(assembled(model), hessian, atol=EXACT * np.abs(hessian).max())
    np.testing.assert_allclose(
        model.held_rows, rows[:, :-1], atol=EXACT * np.abs(rows).max(initial=1)
    )
    np.testing.assert_allclose(model.held_rest, -rest - rows[:, -1], atol=EXACT)
    assert model.objective == pytest.approx(
        Optimizer().evaluate(w, model.full).objective, rel=1e-12
    )


def test_settled_rods_are_in_equilibrium_and_objectives_are_the_nlps():
    w = window_of(first_steps("pick-fruit", 3))
    condensed, optimizer = CondensedWindow(w), Optimizer()
    x = -0.2 * np.random.default_rng(2).random(condensed.x.shape)
    model = condensed.model(w.pack(x, in_equilibrium(w, x)[0]), np.zeros(3))
    step = 0.03 * np.random.default_rng(3).normal(size=condensed.size)
    full, residual = condensed.settled(condensed.moved(model, step), model.rods)
    assert residual <= 1e-7
    x = full[condensed.x]
    np.testing.assert_allclose(
        x, w.controls_of(model.full) + step[:-3].reshape(x.shape), atol=1e-15
    )
    shape, _ = in_equilibrium(w, x)
    np.testing.assert_allclose(full, w.pack(x, shape), atol=1e-6)
    assert condensed.objective(full) == pytest.approx(
        optimizer.evaluate(w, full).objective, rel=1e-12
    )


def test_steps_that_moved_on_are_updated_to_the_plan_of_later_controls():
    """Poses at targets, the held direction, the pull and the start, which follow from others."""
    motion = first_steps("pick-fruit", 1)
    phase = motion.spec.phases[0].model_copy(update={"steps": 3})
    motion = motion.with_spec(motion.spec.model_copy(update={"phases": (phase,)}))
    x = -0.1 * np.arange(1, 4)[:, None] * np.random.default_rng(7).random((3, 30))
    old, w = window_of(motion), window_of(motion.started(x[0]))
    full = w.advanced(old.pack(x, in_equilibrium(old, x)[0]), 1)
    moved, residual = CondensedWindow(w).updated(full)
    later = x[[1, 2, 2]]
    np.testing.assert_allclose(moved, w.pack(later, in_equilibrium(w, later)[0]), atol=1e-6)
    assert residual <= 1e-7
    heavy = window_of(w.motion.with_loads(gravity=20.0))
    assert CondensedWindow(heavy).updated(full)[1] > 1e-2


def test_a_window_of_other_numbers_is_the_window_built_for_them():
    first = first_steps("pick-fruit", 3)
    moved = first.shifted((0.01, -0.02, 0.03)).started(np.full(30, 0.01)).limited(activation=2.0)
    assert layout_of(first) == layout_of(moved)
    old, new = window_of(first), window_of(moved)
    renumbered = old.renumbered(moved)
    for name in ("lbx", "ubx", "lbg", "ubg"):
        np.testing.assert_array_equal(renumbered.bounds[name], new.bounds[name])
    np.testing.assert_array_equal(renumbered.parameters, new.parameters)
    x = np.full((3, 30), -0.05)
    full = new.pack(x, in_equilibrium(new, x)[0])
    one = CondensedWindow(old).renumbered(renumbered).model(full, np.zeros(3))
    other = CondensedWindow(new).model(full, np.zeros(3))
    for name in ("full", "objective", "gradient", "blocks", "links", "held_rest"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


def test_motions_of_other_layouts_differ():
    motion = shipped("lift-log")
    assert layout_of(motion) == layout_of(motion.shifted((0.1, 0.0, 0.0)))
    assert layout_of(motion) != layout_of(first_steps("lift-log", 3))
    assert layout_of(shipped("lift-log-hung")) != layout_of(shipped("lift-log-asymmetric"))
    alike = motion.spec.weights.model_copy(update={"symmetric": True})
    motion = first_steps("lift-log", 1)
    symmetric = motion.with_spec(motion.spec.model_copy(update={"weights": alike}))
    assert layout_of(motion) != layout_of(symmetric)


def test_a_rod_on_which_errors_grow_too_much_is_refused(monkeypatch):
    w = window_of(first_steps("lift-log", 1))
    x = np.zeros((1, 30))
    full = w.pack(x, in_equilibrium(w, x)[0])
    monkeypatch.setattr(condensed_rods, "MAX_GROWTH", 0.5)  # every rod's is at least 1
    with pytest.raises(IllConditionedError):
        CondensedWindow(w).model(full, np.zeros(0))

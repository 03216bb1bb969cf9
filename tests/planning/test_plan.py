"""What is said of a plan: its costs, its errors, its faults, its status."""

import re
from dataclasses import replace

import numpy as np
import pytest
from plans import TOUCH, first_steps, planned, written

from trunk_ocp.analysis.measures import compare, plan_measures
from trunk_ocp.cli.tables import step_table
from trunk_ocp.errors import InputError
from trunk_ocp.planning.options import Options
from trunk_ocp.planning.planner import plan_motion
from trunk_ocp.planning.status import Status
from trunk_ocp.problem.build import load_motion
from trunk_ocp.problem.motion import Bounds
from trunk_ocp.problem.weights import Weights
from trunk_ocp.rod.statics import solve_statics


@pytest.fixture(scope="module")
def plan():
    """Three steps of lift-log, planned together: bounds on change hold from step 2 on."""
    return plan_motion(first_steps("lift-log", 3))


def errors_of(plan):
    """|r - goal| and |d3 - goal| of every target, by hand from the planned shapes."""
    for t, step in enumerate(plan.motion.steps):
        Z = np.array([g.Z for g in step.targets])
        position, directors = plan.shape.position(Z)[t], plan.shape.directors(Z)[t]
        for p, g in enumerate(step.targets):
            yield (
                np.linalg.norm(position[p] - g.position),
                g.position_weight,
                np.linalg.norm(directors[p, 2] - g.directions[2]),
                g.direction_weights[2],
            )


# Planned and integrated shapes differ by the mesh error: 0.1 mm at most, on misses of 10 mm.
MESH = 1e-3


def test_the_papers_objective_is_a_sum_of_distances_not_squared(plan):
    expected = sum(w * a + v * b for a, w, b, v in errors_of(plan))
    assert plan.objective.paper == pytest.approx(expected, rel=MESH)


def test_the_planners_objective_is_tracking_effort_and_rate(plan):
    tracking = sum(w * a**2 + v * b**2 for a, w, b, v in errors_of(plan))
    change = np.diff(plan.x, axis=0, prepend=0.0)
    duration = np.array([1.0, 0.4, 0.125])
    assert plan.objective.tracking == pytest.approx(tracking, rel=MESH)
    assert plan.objective.effort == pytest.approx(1e-5 * (plan.x[:, :28] ** 2).sum(), rel=1e-12)
    rate = 1e-5 * ((change**2).sum(axis=1) / duration).sum()
    assert plan.objective.rate == pytest.approx(rate, rel=1e-12)
    total = plan.objective.tracking + plan.objective.effort + plan.objective.rate
    assert plan.objective.total == pytest.approx(total, rel=1e-15)


def test_errors_are_given_target_by_target(plan):
    for errors in plan.errors:
        np.testing.assert_allclose(errors.position_Z, np.linspace(1.4, 1.75, 6), atol=1e-12)
        assert errors.position_weights.tolist() == [7, 1, 1, 1, 1, 5]
        np.testing.assert_allclose(errors.direction_Z, [1.4, 1.75], atol=1e-12)
        assert errors.direction_weights.tolist() == [1, 1]
        mine = errors.position_weights @ errors.position + errors.direction.sum()
        assert errors.paper == pytest.approx(mine, rel=1e-14)


def test_a_small_objective_is_not_shown_as_nothing(plan):
    exact = replace(plan)
    exact.__dict__["objective"] = replace(plan.objective, paper=4.2e-7)  # a cached property
    assert "J = 4.2e-07," in str(step_table(exact).caption)


def test_a_good_plan_is_solved(plan):
    assert plan.status is Status.SOLVED
    assert plan.verified
    assert plan.verification.faults == plan.missed == []


def test_the_tolerance_decides_what_is_missed(plan):
    spec = plan.motion.spec
    tight = spec.model_copy(
        update={"tolerance": spec.tolerance.model_copy(update={"position": 1e-5})}
    )
    strict = replace(plan, motion=replace(plan.motion, spec=tight))
    assert strict.status is Status.MISSED
    assert strict.verified
    worst = plan.errors[0].position[0]
    assert f"step 1: the target at Z = 1.4 m is missed by {1e3 * worst:.4g} mm" in strict.missed[0]


def test_how_it_ended_comes_before_how_good_it_is(plan):
    assert replace(plan, interrupted=True, converged=False).status is Status.INTERRUPTED
    assert replace(plan, converged=False).status is Status.NOT_CONVERGED
    cut = replace(plan, x=plan.x[:2], tip_forces=plan.tip_forces[:2], shape=plan.part(0, 2))
    assert cut.status is Status.NOT_CONVERGED
    assert not cut.verified
    assert len(cut.errors) == 2


# --- a check that cannot fail is none -----------------------------------------------------


def bent(plan):
    """Claims a moment at the base that is 1 % off; all else follows from it."""
    states = plan.shape.states.copy()
    states[1, ..., 4:] *= 1.01
    return replace(plan, shape=replace(plan.shape, states=states))


def shifted(plan):
    """Claims a centerline 0.2 mm beside the real one."""
    return replace(plan, shape=replace(plan.shape, edges=np.add(plan.shape.edges, (2e-4, 0, 0))))


def undone(plan):
    """Claims no number at all."""
    states = plan.shape.states.copy()
    states[1] = np.nan
    return replace(plan, shape=replace(plan.shape, states=states))


def bounded(plan, **boxes):
    """The same plan of a motion whose second step is stricter than it was planned for."""
    steps = list(plan.motion.steps)
    steps[1] = replace(steps[1], **boxes)
    return replace(plan, motion=replace(plan.motion, steps=tuple(steps)))


def over_bounds(plan):
    box = plan.motion.steps[1].box
    return bounded(plan, box=Bounds(box.lower, np.minimum(box.upper, plan.x[1] - 1e-5)))


def over_change(plan):
    change = plan.motion.steps[1].change
    upper = np.minimum(change.upper, plan.x[1] - plan.x[0] - 1e-5)
    return bounded(plan, change=Bounds(change.lower, upper))


def over_extension(plan):
    return replace(plan, motion=replace(plan.motion, extension=(0.99, 1.35)))


@pytest.mark.parametrize(
    ("spoil", "fault"),
    [
        (bent, "step 2: planned and integrated moments differ by 0.0"),
        (shifted, "planned and integrated centerline differ by 0.00"),
        (undone, "step 2: planned and integrated centerline differ by inf"),
        (over_bounds, "step 2: a bound on activation or head is exceeded by 1e-05"),
        (over_change, "step 2: a bound on change is exceeded by 1e-05"),
        (over_extension, "an extension bound is exceeded by"),
    ],
)
def test_a_spoilt_plan_is_caught(plan, spoil, fault):
    spoilt = spoil(plan)
    assert spoilt.status is Status.UNVERIFIED
    assert not spoilt.verified
    assert any(fault in sentence for sentence in spoilt.verification.faults)


def test_steps_near_an_auxiliary_solution_are_checked_against_it():
    sequential = planned("lift-log", "sequential")
    assert sequential.verified
    elsewhere = {t: near + 0.5 for t, near in sequential.auxiliary.items()}
    moved = replace(sequential, auxiliary=elsewhere)
    assert any("a bound on activation or head" in text for text in moved.verification.faults)


# --- names and measures -------------------------------------------------------------------


def test_a_comparison_has_the_same_measures_of_both_plans(plan):
    sequential = plan_motion(plan.motion, 1)
    figures = compare(sequential, plan)
    assert list(figures) == ["sequential", "horizon"]
    assert figures["sequential"].keys() == figures["horizon"].keys()
    mine = figures["horizon"]
    errors = [a for a, *_ in errors_of(plan)]
    change = np.diff(plan.x, axis=0, prepend=0.0)
    assert mine["worst_position_error"] == pytest.approx(max(errors), rel=1e-2)
    assert mine["mean_position_error"] == pytest.approx(np.mean(errors), rel=1e-2)
    assert mine["planner_objective"] == plan.objective.total
    assert mine["paper_objective"] == plan.objective.paper
    assert mine["squared_activation"] == pytest.approx((plan.activations**2).sum())
    seconds = np.array([1.0, 0.4, 0.125])
    assert mine["squared_rate"] == pytest.approx(((change**2).sum(axis=1) / seconds).sum())
    assert mine["largest_change"] <= 0.4 + 1e-7  # of activations, from step 2 on
    assert mine["change_excess"] <= 1e-7


def test_largest_change_leaves_out_the_first_step(plan):
    """The motion starts from rest, freely; changes are between planned steps."""
    expected = np.abs(np.diff(plan.activations, axis=0)).max()
    assert plan_measures(plan).largest_change == pytest.approx(expected, rel=1e-14)


def test_between_equilibria_the_moving_trunk_stays_on_the_planned_one(tmp_path):
    """Pushed from below there are several equilibria; from the straight trunk another is found."""
    text = TOUCH.replace("[-3.0, 0.0]", "[-2.0, 0.0]").replace("[0.6, 0.1, 1.2]", "[0.67, 0, 1.5]")
    text = text.replace(
        "[0.67, 1.35]", "[0.67, 1.35]\nhead_z_deg = [-10, 10]\nhead_y_deg = [-5, 5]"
    )
    text = text.replace("duration = 1.0", "duration = 1.0\nloads.tip_force = [0, 0, -300.0]")
    text = text.replace("Z = 1.75", "Z = 1.75\nposition_weight = 8.0")
    plan = plan_motion(load_motion(written(tmp_path, text)), throw=False)
    trunk, Z = plan.motion.trunk, np.array([0.9, 1.75])
    other = solve_statics(trunk, plan.activations[0], plan.head[0], plan.loads[0], plan.mesh)
    planned_points = plan.shape.position(Z)[0]
    assert np.abs(other.position(Z) - planned_points).max() > 0.1
    sample = plan.sample(1.0).shape
    np.testing.assert_allclose(sample.position(Z), planned_points, rtol=0, atol=1e-6)


def test_a_plan_is_printed_without_integrating_its_rods(plan, monkeypatch):
    fresh = replace(plan)  # has none of the checks of the original
    monkeypatch.setattr("trunk_ocp.planning.plan.verify", None)
    assert repr(fresh) == "<Plan of lift-log: horizon, 3 of 3 steps>"
    assert repr(plan).startswith(repr(fresh)[:-1] + ", J = ")


def test_the_trajectory_starts_at_rest(plan):
    assert not plan.trajectory[0].any()
    np.testing.assert_array_equal(plan.trajectory[1:], plan.x)
    assert plan.times.tolist() == [0.0, *(step.time for step in plan.motion.steps)]


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("starts", 0),
        ("elements", -3),
        ("elements", 2.5),
        ("elements", None),
        ("degree", 0),
        ("degree", "6"),
        ("max_iterations", 0),
        ("max_iterations", True),
        ("linear_solver", 3),
        ("linear_solver", ""),
        ("weights", (1e-5, 1e-5)),
    ],
)
def test_options_out_of_their_range_are_refused(name, value):
    with pytest.raises(InputError, match=f"^{re.escape(name)} = .*expected"):
        Options(**{name: value})


@pytest.mark.parametrize(("name", "value"), [("effort", -1.0), ("rate", np.nan), ("rate", "much")])
def test_weights_out_of_their_range_are_refused(name, value):
    with pytest.raises(InputError, match=f"^{name} = .*expected"):
        Weights(**{name: value})

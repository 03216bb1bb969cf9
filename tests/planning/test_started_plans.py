"""Plans that start from a known state instead of rest."""

import csv
import json
from dataclasses import replace

import numpy as np
import pytest
from dense_contact import deepest
from reaching import BALL, reaching
from scenes import TRUNK as ARM_TRUNK
from toys import TRUNK, shortening
from toys import C as SHORTENING

from trunk_ocp.analysis.bound_sensitivity import responses
from trunk_ocp.analysis.elastic_bounds import contradictions, reach
from trunk_ocp.analysis.measures import plan_measures
from trunk_ocp.analysis.reached_bounds import at_bounds, change_excess
from trunk_ocp.analysis.redundancy.alternatives import least_cost
from trunk_ocp.contact.obstructions import stuck_at_start
from trunk_ocp.errors import InputError
from trunk_ocp.model.loads import Loads
from trunk_ocp.motion_files.opensim import write_sto
from trunk_ocp.nlp.window import Weights
from trunk_ocp.planning.checkpoint import Checkpoint
from trunk_ocp.planning.options import Options
from trunk_ocp.planning.planner import plan_motion
from trunk_ocp.planning.replanning import Replanner
from trunk_ocp.planning.status import Status
from trunk_ocp.planning.storage import load_plan, save_plan
from trunk_ocp.planning.verification import verify
from trunk_ocp.problem.mirror import mirrored_controls, mirrored_motion
from trunk_ocp.problem.motion import REFERENCE_LENGTH
from trunk_ocp.reporting import Reporter
from trunk_ocp.rod.statics import solve_statics
from trunk_ocp.scene.keyframes import at_steps
from trunk_ocp.scene.moments import moments_at

C = SHORTENING * REFERENCE_LENGTH / TRUNK.length  # in the objective's units
WEIGHTS = Weights(effort=1e-2, rate=2e-2)
OPTIONS = Options(weights=WEIGHTS)
WANTED = (-0.5, -0.6, -0.1)
DURATIONS = (0.5, 0.25, 1.0)
X0 = np.array([-0.3, -0.3, 0.0, 0.0])
TIP = np.array([1.0])


@pytest.fixture(scope="module")
def plan():
    return plan_motion(shortening(WANTED, DURATIONS), None, OPTIONS, initial=X0, throw=False)


def minimum(start):
    """Contractions (3,) that minimize the cost of the toy, a quadratic function."""
    track = C**2 * np.eye(3)
    effort = 2 * WEIGHTS.effort * np.eye(3)  # both muscles
    D = np.eye(3) - np.eye(3, k=-1)
    rate = 2 * WEIGHTS.rate * D.T @ np.diag(1 / np.array(DURATIONS))
    known = np.array([start, 0.0, 0.0])
    return np.linalg.solve(track + effort + rate @ D, track @ WANTED + rate @ known)


# --- the plan ------------------------------------------------------------------------------


@pytest.mark.parametrize("lookahead", [1, 2, None])
def test_a_plan_minimizes_its_cost_from_where_it_starts(lookahead):
    motion, start = shortening(WANTED, DURATIONS).started(X0), X0[0]
    found = plan_motion(motion, lookahead, OPTIONS, throw=False).x[:, 0]
    if lookahead is None:
        np.testing.assert_allclose(found, minimum(start), rtol=0, atol=1e-6)
        assert np.abs(minimum(start) - minimum(0.0)).max() > 5e-3
    elif lookahead == 1:
        for wanted, duration, gamma in zip(WANTED, DURATIONS, found, strict=True):
            rate = 2 * WEIGHTS.rate / duration
            expected = (C**2 * wanted + rate * start) / (C**2 + 2 * WEIGHTS.effort + rate)
            assert gamma == pytest.approx(expected, abs=1e-6)
            start = gamma


def test_the_cost_of_rates_counts_from_the_start(plan):
    gamma = np.append(X0[0], plan.x[:, 0])
    by_hand = 2 * np.sum(np.diff(gamma) ** 2 / DURATIONS)
    assert plan.squared_rate == pytest.approx(by_hand, rel=1e-6)
    assert plan.objective.rate == pytest.approx(WEIGHTS.rate * by_hand, rel=1e-6)
    assert plan_measures(plan).squared_rate == plan.squared_rate


def test_initial_is_the_start_of_the_motion(plan):
    motion = shortening(WANTED, DURATIONS).started(X0)
    assert plan.motion.spec == motion.spec
    np.testing.assert_array_equal(plan.trajectory[0], X0)
    np.testing.assert_array_equal(plan_motion(motion, None, OPTIONS, throw=False).x, plan.x)
    with pytest.raises(InputError, match="start: expected 4 finite values"):
        plan_motion(motion, initial=X0[:3])


def test_the_first_change_is_bounded_from_the_start():
    plan = plan_motion(shortening((-0.9,), most=0.2), initial=X0, throw=False)
    np.testing.assert_allclose(plan.x[0, :2], -0.5, rtol=0, atol=1e-6)
    assert plan.verification.change[0] < 1e-6
    assert at_bounds(plan)["change"] == {"R1-long": [1], "L1-long": [1]}
    x = plan.x - np.array([0.05, 0.0, 0.0, 0.0])
    beyond = verify(plan.motion, x, plan.loads, plan.shape, {}).change
    assert beyond[0] == pytest.approx(0.05, abs=1e-6)
    assert change_excess(plan) == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(("start", "status"), [(0.1, Status.SOLVED), (0.3, Status.INFEASIBLE)])
def test_a_start_outside_bounds_must_leave_them_at_once(start, status):
    x0 = np.array([start, start, 0.0, 0.0])
    plan = plan_motion(shortening((0.0,), most=0.2), initial=x0, throw=False)
    assert plan.status is status


def test_the_mirror_image_of_a_plan_is_one_of_the_mirrored_motion():
    motion = arm([{"Z": 1.0, "position": (0.4, 0.1, 0.8)}])
    x0 = np.random.default_rng(1).uniform(-0.3, 0.0, 10)
    plan = plan_motion(motion, initial=x0)
    image = plan_motion(mirrored_motion(plan.motion))
    expected = mirrored_controls(motion.trunk, plan.trajectory)
    np.testing.assert_allclose(image.trajectory, expected, rtol=0, atol=1e-5)


# --- a control loop ------------------------------------------------------------------------


def arm(targets, **phase):
    return reaching(targets, {}, **phase)


def chase(tick):
    """Reach a place that moves, in two steps of 0.05 s that may change activations by 0.15."""
    x = np.zeros(8)
    x[[0, 4]], x[[3, 6]] = -0.05 * (tick + 1), -0.02 * tick  # right and left, not alike
    place = solve_statics(ARM_TRUNK, x, loads=Loads(9.8)).position(TIP)[0]
    target = {"Z": 1.0, "position": tuple(place.tolist()), "position_weight": 10.0}
    change = ({"activation": 0.15, "head_z_deg": (-2.0, 2.0), "head_y_deg": (-2.0, 2.0)},)
    return arm([target], duration=0.1, steps=2, change=change)


def test_a_loop_from_state_to_state_follows_a_moving_target():
    plan = plan_motion(chase(0))
    for tick in range(1, 11):
        before = plan.x[0]
        plan = plan_motion(chase(tick), initial=before)  # which raises for a target out of reach
        assert np.all(np.abs(plan.x[0] - before)[:-2] <= 0.15 + 1e-6)
        assert plan.errors[0].position[0] < 1e-4  # m
    assert np.abs(plan.x[0]).max() > 2 * 0.15  # two steps from rest would not get there
    from_rest = plan_motion(chase(10), throw=False)
    assert from_rest.errors[0].position[0] > 0.01


def test_a_replanner_takes_motions_that_start_elsewhere():
    options = Options(weights=Weights(1e-3, 1e-3))  # which make the optimum a sharp one
    plan = plan_motion(chase(0), None, options, throw=False)
    moved = chase(1).started(plan.x[0])
    again, fresh = Replanner(plan)(moved, False), plan_motion(moved, None, options, throw=False)
    np.testing.assert_array_equal(again.trajectory[0], moved.start)
    assert again.objective.total == pytest.approx(fresh.objective.total, rel=5e-3)


# --- the moving trunk ----------------------------------------------------------------------


def test_the_moving_trunk_starts_from_there(plan, tmp_path):
    place = [0.0, 0.0, 1.0 + SHORTENING * X0[0]]
    first, frames = plan.sample(0.0), at_steps(plan)
    np.testing.assert_array_equal(first.activation, X0[:2])
    np.testing.assert_allclose(first.shape.position(TIP)[0], place, rtol=0, atol=1e-9)
    (moment,) = moments_at(plan, np.zeros(1))
    np.testing.assert_allclose(moment.shape.position(TIP)[0, 0], place, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(frames.activation[0], X0[:2])
    np.testing.assert_allclose(frames.shape.position(TIP)[0, 0], place, rtol=0, atol=1e-9)
    half = plan.sample(DURATIONS[0] / 2)  # of a cosine
    np.testing.assert_allclose(half.activation, (X0[:2] + plan.activations[0]) / 2, atol=1e-15)
    rows = write_sto(plan, tmp_path / "activations.sto").read_text().splitlines()
    assert float(rows[rows.index("endheader") + 2].split("\t")[1]) == 0.3


def test_under_weight_the_trunk_starts_in_equilibrium():
    motion = arm([{"Z": 1.0, "position": (0.4, 0.1, 0.8)}], interpolation="cosine")
    plan = plan_motion(motion, initial=np.random.default_rng(2).uniform(-0.3, 0.0, 10))
    x0 = plan.motion.start
    alone = solve_statics(motion.trunk, x0[:-2], x0[-2:], Loads(motion.gravity))
    Z = np.linspace(0, 1, 11)
    (moment,) = moments_at(plan, np.zeros(1))
    for shape in (plan.sample(0.0).shape, moment.shape[0], plan.sample(1e-9).shape):
        np.testing.assert_allclose(shape.position(Z), alone.position(Z), rtol=0, atol=1e-6)


# --- files ---------------------------------------------------------------------------------


def test_a_saved_plan_starts_where_it_did(plan, tmp_path):
    save_plan(plan, tmp_path)
    again = load_plan(tmp_path, throw=False)
    np.testing.assert_array_equal(again.trajectory, plan.trajectory)
    assert (again.status, again.objective) == (plan.status, plan.objective)
    assert json.loads((tmp_path / "summary.json").read_text())["start"] == {
        "activation": {"R1-long": -0.3, "L1-long": -0.3}, "psi_z": 0.0, "psi_y": 0.0
    }  # fmt: skip
    with (tmp_path / "activations.csv").open(newline="") as stream:
        _, first, *_ = csv.reader(stream)
    assert first[:6] == ["0.0", "start", "-0.3", "-0.3", "0.0", "0.0"]


def test_the_summary_of_a_plan_from_rest_has_no_start(tmp_path):
    save_plan(plan_motion(shortening((-0.1,))), tmp_path)
    assert "start" not in json.loads((tmp_path / "summary.json").read_text())


class Stopping(Reporter):
    """Asks to stop after a number of iterations."""

    def __init__(self, iterations):
        self.left = iterations

    def iteration(self, progress):
        self.left -= 1
        self.stop = self.left <= 0


def test_an_unfinished_plan_is_resumed_from_its_start_only(plan, tmp_path):
    motion, path = shortening(WANTED, DURATIONS), tmp_path / "resume.npz"
    reporter = Stopping(12)
    cut = plan_motion(motion, 2, OPTIONS, reporter, None, Checkpoint(path), False, initial=X0)
    assert cut.status is Status.INTERRUPTED
    with pytest.raises(InputError, match=r"the problem changed .*start"):
        plan_motion(motion, 2, OPTIONS, checkpoint=Checkpoint(path, True), throw=False)
    resumed = plan_motion(
        motion, 2, OPTIONS, checkpoint=Checkpoint(path, True), throw=False, initial=X0
    )
    whole = plan_motion(motion, 2, OPTIONS, throw=False, initial=X0)
    np.testing.assert_array_equal(resumed.x, whole.x)


# --- contact -------------------------------------------------------------------------------


def test_a_body_where_the_trunk_starts_is_found_and_one_where_it_rests_is_not():
    motion = reaching([{"Z": 1.0, "position": (0.5, 0.0, 0.5)}], {"obstacles": True}, [BALL])
    x0 = np.append(np.tile([-0.6, 0.0], 4), [0.0, 0.0])
    shapes = solve_statics(
        motion.trunk, np.stack([np.zeros(8), x0[:-2]]), np.zeros((2, 2)), Loads(motion.gravity)
    )
    at_rest, at_start = (tuple(p.tolist()) for p in shapes.position(TIP)[:, 0])
    for center, stuck in ((at_rest, (True, False)), (at_start, (False, True))):
        ball = BALL | {"center": center, "radius": 0.02}
        here = reaching([{"Z": 1.0, "position": (0.5, 0.0, 0.5)}], {"obstacles": True}, [ball])
        found = [bool(stuck_at_start(one)) for one in (here, here.started(x0))]
        assert tuple(found) == stuck


def test_the_way_from_the_start_to_the_first_step_is_looked_at():
    """A ball beside the trunk halfway is found, as deep in it as dense samples show."""
    target = [{"Z": 1.0, "position": (0.3, -0.25, 0.85)}]
    x0 = np.array([-0.4, 0.0, -0.4, 0.0, 0.0, 0.0, 0.0, 0.0, 0.2, 0.0])
    blind = plan_motion(arm(target, interpolation="cosine"), initial=x0)
    half, near = blind.sample(0.5).shape, np.array([0.9])
    beside = half.position(near)[0] + 0.058 * half.directors(near)[0, 0]
    ball = BALL | {"center": tuple(beside.tolist()), "radius": 0.03}
    motion = reaching(target, {"obstacles": True}, [ball], interpolation="cosine").started(x0)
    there = replace(blind, motion=motion)
    depth, _ = deepest(there, between=32)
    (gap,) = [gap for gap in there.clearance.between if gap.body == "ball"]
    assert depth > 0.005
    assert gap.bound <= -depth <= gap.gap <= 5e-3 - depth
    plan = plan_motion(motion, throw=False)  # which adds time steps, to get around it
    np.testing.assert_array_equal(plan.motion.start, motion.start)
    assert plan.status is Status.SOLVED
    assert deepest(plan)[0] < 1e-4


# --- analysis ------------------------------------------------------------------------------


def test_what_must_be_relaxed_counts_from_the_start():
    motion = shortening((-0.9,), most=0.2)
    bounds = motion.spec.bounds.model_copy(update={"activation": (-1.0, -0.8)})
    tight = motion.with_spec(motion.spec.model_copy(update={"bounds": bounds}))
    assert sum(e.amount for e in contradictions(tight)) == pytest.approx(2 * 0.6, abs=1e-6)
    near = contradictions(tight.started(X0))
    assert {e.bound.name for e in near} == {
        f"least change of activation of {s}1-long" for s in "RL"
    }
    assert [e.amount for e in near] == pytest.approx([0.3, 0.3], abs=1e-6)
    assert not contradictions(tight.started(np.array([-0.7, -0.7, 0.0, 0.0])))


def test_the_change_that_a_target_needs_counts_from_the_start():
    plan = plan_motion(shortening((-0.9,), most=0.2), initial=X0, throw=False)
    assert plan.status is Status.MISSED
    missing = 0.4 - plan.motion.tolerance[0] / SHORTENING
    assert sum(e.amount for e in reach(plan)) == pytest.approx(2 * missing, abs=1e-3)


def test_a_plan_from_a_start_chooses_its_muscles_best():
    """The optimum of the whole NLP, and that of the convex program that keeps its shapes."""
    targets = [{"Z": 1.0, "position": (0.4, 0.1, 0.8)}]
    options = Options(weights=Weights(1e-4, 1e-3))
    x0 = np.random.default_rng(3).uniform(-0.4, 0.0, 10)
    motion = arm(targets, steps=2, change=({"activation": 0.3},))
    plan = plan_motion(motion, None, options, initial=x0, throw=False)
    ours, best = (p.objective.effort + p.objective.rate for p in (plan, least_cost(plan)))
    assert best <= ours * (1 + 1e-9)
    assert ours <= best * (1 + 1e-4)


def test_the_effect_of_a_bound_on_change_is_that_of_a_new_plan():
    def plan(most):
        return plan_motion(shortening((-0.9,), most=most), None, OPTIONS, initial=X0, throw=False)

    effects = [e for e in responses(plan(0.2)) if e.name.startswith("change of")]
    assert len(effects) == 2
    better = plan(0.202).objective.total / plan(0.2).objective.total - 1
    assert sum(e.objective for e in effects) == pytest.approx(better, rel=0.05)

"""What weights do to a plan."""

import json

import numpy as np
import pytest
import xarray as xr
from click.testing import CliRunner
from plans import TOUCH, written
from scipy.optimize import minimize
from toys import C, pointing, shortening

import trunk_ocp as to
from trunk_ocp._support.provenance import fingerprint
from trunk_ocp.cli import commands
from trunk_ocp.cli.commands import resume_command
from trunk_ocp.planning.checkpoint import _identity
from trunk_ocp.planning.planner import plan_motion
from trunk_ocp.planning.storage import load_plan, save_plan
from trunk_ocp.problem.build import load_motion
from trunk_ocp.problem.mirror import mirror_order

MIDLINE = [{"duration": 1.0, "targets": [{"Z": 1.75, "position": [0.9, 0.0, 1.0]}]}]
EFFORT = {"*": 1e-5, "*-ivo": 1e-3}


def midline(**sections):
    bounds = {"activation": [-3.0, 0.0], **sections.pop("bounds", {})}
    return to.Motion.build("midline", MIDLINE, bounds=bounds, **sections)


@pytest.fixture(scope="module")
def touch(tmp_path_factory):
    return load_motion(written(tmp_path_factory.mktemp("touch"), TOUCH))


@pytest.fixture(scope="module")
def costed(touch):
    """A plan with a weight of its own for some muscles, and one of the head."""
    return plan_motion(touch.weighted(EFFORT, head_effort=1e-4), lookahead=1)


# --- costs ---------------------------------------------------------------------------------


def test_the_costs_of_a_plan_are_their_sums_by_hand(costed):
    muscles, objective = costed.motion.trunk.muscles, costed.objective
    squares, angles = costed.activations**2, costed.head**2
    dear = np.array([name.endswith("-ivo") for name in muscles])
    expected = 1e-5 * squares.sum() + (1e-3 - 1e-5) * squares[:, dear].sum()
    assert objective.effort == pytest.approx(expected, rel=1e-12)
    assert objective.head_effort == pytest.approx(1e-4 * angles.sum(), rel=1e-12)
    change = np.sum(costed.x**2)  # one step of 1 s, from rest
    assert objective.rate == pytest.approx(1e-5 * change, rel=1e-12)
    parts = (objective.tracking, objective.effort, objective.rate, objective.head_effort)
    assert objective.total == sum(parts)
    assert costed.weights == to.Weights(EFFORT, 1e-5, 1e-4) == costed.motion.weights


def test_the_work_moves_to_the_cheaper_muscles(touch, costed):
    plain = plan_motion(touch, lookahead=1)
    dear = np.array([name.endswith("-ivo") for name in touch.trunk.muscles])
    works = [np.sum(plan.activations[:, dear] ** 2) for plan in (plain, costed)]
    others = [np.sum(plan.activations[:, ~dear] ** 2) for plan in (plain, costed)]
    assert works[0] > 0.1
    assert works[1] < works[0] / 10
    assert others[1] > others[0]


def test_the_cost_of_the_head_is_that_of_a_search_over_its_two_angles():
    motion = pointing((0.3, 0.2, 0.8)).weighted(0.0, 0.0, 0.5)
    plan = plan_motion(motion, lookahead=1, throw=False)
    trunk, scale = motion.trunk, motion.position_scale**2

    def cost(angles):
        shape = to.solve_statics(trunk, np.zeros(2), angles, to.Loads(0.0))
        error = shape.position(np.array([trunk.length]))[0] - (0.3, 0.2, 0.8)
        return scale * error @ error + 0.5 * np.sum(np.square(angles))

    best = min((minimize(cost, (z, 0.2)) for z in (-0.5, 0.5)), key=lambda found: found.fun)
    assert plan.objective.total == pytest.approx(best.fun, rel=1e-6)
    np.testing.assert_allclose(plan.head[0], best.x, atol=1e-4)


def test_the_factor_of_the_last_step_is_that_of_its_quadratic_program():
    wanted, weights = (-0.4, 0.0), to.Weights(1e-3, 1e-2)
    for factor in (1.0, 20.0):
        motion = shortening(wanted).weighted(terminal=factor)
        plan = plan_motion(motion, options=to.Options(weights=weights), throw=False)
        # Two muscles alike, 1 s a step: the gradient of the cost in both contractions is 0.
        pull = (C * motion.position_scale) ** 2 * np.array([1.0, factor])
        tied = np.array([[2.0, -1.0], [-1.0, 1.0]])
        matrix = np.diag(pull + 2 * weights.effort) + 2 * weights.rate * tied
        gamma = np.linalg.solve(matrix, pull * wanted)
        np.testing.assert_allclose(plan.activations, np.stack([gamma, gamma], axis=1), atol=2e-5)


# --- the midline ---------------------------------------------------------------------------


@pytest.mark.parametrize("head_z_deg", [[-90.0, 90.0], [-10.0, 45.0]])
def test_a_head_that_costs_stays_in_the_midline_whatever_its_bounds(head_z_deg):
    """Without a cost it turns as far as 39 degrees, since muscles on one side work less."""
    motion = midline(bounds={"head_z_deg": head_z_deg, "head_y_deg": [-5.0, 5.0]})
    costed = plan_motion(motion.weighted(head_effort=1e-2), lookahead=1)
    assert abs(np.degrees(costed.head[0, 0])) < 0.2
    alike = plan_motion(motion.weighted(symmetric=True), lookahead=1)
    assert alike.head[0, 0] == 0
    order = mirror_order(motion.trunk)
    np.testing.assert_allclose(alike.x[:, order], alike.activations, atol=1e-8)
    free = plan_motion(motion, lookahead=1)
    assert free.objective.total <= alike.objective.total + 1e-9


# --- files and options ---------------------------------------------------------------------


def test_weights_come_back_from_a_file(costed, tmp_path):
    save_plan(costed, tmp_path)
    again = load_plan(tmp_path)
    assert again.weights == costed.weights
    assert list(again.weights.effort) == list(EFFORT)  # whose order counts
    assert again.motion.spec == costed.motion.spec
    assert again.objective == costed.objective
    report = json.loads((tmp_path / "summary.json").read_text())
    assert report["planner_objective"]["head_effort"] == costed.objective.head_effort


def test_plans_from_before_there_were_weights_in_problem_files_are_read(touch, tmp_path):
    plan = plan_motion(touch, lookahead=1, options=to.Options(weights=to.Weights(2e-5, 3e-5)))
    save_plan(plan, tmp_path)
    with xr.open_dataset(tmp_path / "solution.nc", engine="scipy") as opened:
        data = opened.load()
    problem = json.loads(data.attrs["problem_json"])
    del problem["weights"], data.attrs["weight_head_effort"]
    data.attrs |= {"problem_json": json.dumps(problem), "problem_sha256": fingerprint(problem)}
    data.to_netcdf(tmp_path / "solution.nc", engine="scipy")
    again = load_plan(tmp_path)
    assert again.weights == to.Weights(2e-5, 3e-5)
    assert again.objective == plan.objective


def test_a_run_knows_the_order_of_patterns(touch):
    one, other = ({"*": 1e-3, "*-dl": 1e-4}, {"*-dl": 1e-4, "*": 1e-3})
    first, second, third = (
        _identity(touch.weighted(effort), "horizon", 1, to.Options(), None)["steps"]
        for effort in (one, other, one)
    )
    assert first == third != second


def test_options_override_the_motion_and_the_command_line_the_file(tmp_path):
    file = written(tmp_path, TOUCH + "[weights]\neffort = 1e-3\nrate = 1e-4\n")
    motion = load_motion(file)
    assert to.Options().weights_for(motion) == to.Weights(1e-3, 1e-4)
    assert to.Options(weights=to.Weights()).weights_for(motion) == to.Weights()
    arguments = [str(file), "--out", str(tmp_path / "out"), "--no-figures", "--mode", "sequential"]
    told = CliRunner().invoke(commands.solve, [*arguments, "--rate", "2e-5", "--head-effort", "0"])
    assert told.exit_code == 0, told.output
    plan = load_plan(tmp_path / "out" / "sequential")
    assert plan.weights == to.Weights(1e-3, 2e-5)
    assert plan.options["weights"] == {"effort": 1e-3, "rate": 2e-5, "head_effort": 0.0}
    resumed = resume_command(plan.options["command"])
    assert "--rate 2e-05" in resumed
    assert "--head-effort 0.0" in resumed
    assert "--effort" not in resumed.replace("--head-effort", "")

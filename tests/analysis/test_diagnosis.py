"""Every way a plan can end, reached on purpose: its status, its exit code, what is said of it."""

import json
import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from click.testing import CliRunner
from plans import POINT, TOUCH, first_steps, planned, shipped, soft_rod, written

from trunk_ocp.analysis.bound_sensitivity import Response, effects
from trunk_ocp.analysis.diagnosis import explain
from trunk_ocp.analysis.reached_bounds import at_bounds
from trunk_ocp.cli import commands
from trunk_ocp.nlp.ipopt import Optimizer
from trunk_ocp.nlp.outcome import Solve, rank
from trunk_ocp.nlp.window import Window
from trunk_ocp.planning.options import Options
from trunk_ocp.planning.plan import PlanError
from trunk_ocp.planning.planner import plan_motion
from trunk_ocp.planning.replanning import Replanner
from trunk_ocp.planning.status import Status
from trunk_ocp.planning.storage import load_plan, save_plan
from trunk_ocp.problem.build import load_motion
from trunk_ocp.problem.motion import Bounds
from trunk_ocp.problem.weights import Weights
from trunk_ocp.reporting import Reporter
from trust import reference

pytestmark = pytest.mark.slow

WEAK = TOUCH.replace("activation = [-3.0, 0.0]", "activation = [-0.1, 0.0]")
STIFF = TOUCH.replace("activation = [-3.0, 0.0]", "activation = [0.0, 0.0]").replace(
    "[0.67, 1.35]", "[1.2, 1.35]"
)
# The trunk at rest hangs through the floor, which no plan can change.
FLOOR = (
    TOUCH
    + """
[[obstacles]]
name = "floor"
shape = "half-space"
point = [0.0, 0.0, 1.5]
normal = [0.0, 0.0, -1.0]

[contact]
obstacles = true
"""
)
# An upright column without muscles, g upwards in our axes: its own weight buckles it.
COLUMN = soft_rod("column", radius="{radius}")
STAND = """
name = "stand"
anatomy = "column.toml"
gravity = -9.8

[bounds]
activation = [-1.0, 0.0]
extension = [0.5, 1.5]
head_z_deg = [0.0, 0.0]
head_y_deg = [0.0, 0.0]

[tolerance]
position = 0.05

[[phases]]
name = "stand"
duration = 1.0

[[phases.targets]]
Z = 1.0
position = [0.0, 0.0, 1.0]
"""
# Greenhill (1881): L^3 = 7.8373 E I / (rho g A), and I / A = R^2 / 4.
GREENHILL = math.sqrt(4 * 1000 * 9.8 / (7.8373 * 1e6))


class Stop(Reporter):
    """Ends a plan after some iterations."""

    def __init__(self, after):
        self.left = after

    def iteration(self, progress):
        self.left -= 1
        self.stop = self.left <= 0


def column(folder, radius):
    written(folder, COLUMN.format(radius=radius), "column.toml")
    return plan_motion(load_motion(written(folder, STAND)), throw=False)


def doctored(plan):
    """Claims a moment at the base that is 1 % off; all else follows from it."""
    states = plan.shape.states.copy()
    states[..., 4:] *= 1.01
    return replace(plan, shape=replace(plan.shape, states=states))


def undone(plan):
    """Claims no number at all."""
    return replace(plan, shape=replace(plan.shape, states=np.full_like(plan.shape.states, np.nan)))


def recorded(plan, *solves):
    return replace(plan, converged=False, solves=solves)


def record(message, detail="steps 1 to 1", history=((1.0, 1.0, 1.0),), stage="horizon", **more):
    steps = {"first": 1, "last": 1} | more
    return Solve(stage, detail, **steps, message=message, objective=1.0, infeasibility=1.0,
        history=history)  # fmt: skip


CHECKED = [status for status in Status if status is not Status.UNCHECKED]
"""Of plans in files; tests/planning/test_unchecked.py has the other."""


@pytest.fixture(scope="module")
def ends(tmp_path_factory):
    """A plan of every status that a checked plan may have."""
    folder = tmp_path_factory.mktemp("ends")

    def motion(text):
        return load_motion(written(folder, text))

    solved = plan_motion(motion(TOUCH))
    return {
        Status.SOLVED: solved,
        Status.MISSED: plan_motion(motion(WEAK), throw=False),
        Status.COLLIDING: plan_motion(motion(FLOOR), throw=False),
        Status.UNSTABLE: column(folder, 0.97 * GREENHILL),
        Status.UNVERIFIED: doctored(solved),
        Status.INFEASIBLE: plan_motion(motion(STIFF), throw=False),
        Status.ITERATION_LIMIT: plan_motion(
            motion(POINT), options=Options(max_iterations=4), throw=False
        ),
        Status.TIME_LIMIT: plan_motion(solved.motion, start=solved, deadline=1e-6, throw=False),
        Status.NOT_CONVERGED: recorded(solved, record("Restoration_Failed")),
        Status.INTERRUPTED: plan_motion(shipped("lift-log"), 1, reporter=Stop(60), throw=False),
    }


# --- statuses ----------------------------------------------------------------------------


@pytest.mark.parametrize("status", CHECKED)
def test_every_status_is_reached(ends, status):
    assert ends[status].status is status


@pytest.mark.parametrize("status", CHECKED)
def test_only_a_solved_plan_is_given_without_asking(ends, status, tmp_path):
    plan = ends[status]
    save_plan(plan, tmp_path)
    assert load_plan(tmp_path, throw=False).status is status
    if status is Status.SOLVED:
        assert plan.checked() is plan
        assert load_plan(tmp_path).status is status
        return
    with pytest.raises(PlanError) as caught:
        plan.checked()
    assert caught.value.plan is plan
    assert status.value in str(caught.value)
    with pytest.raises(PlanError) as caught:
        load_plan(tmp_path)
    assert caught.value.plan.status is status


@pytest.mark.parametrize("status", Status)
def test_the_exit_code_tells_success_failure_and_interruption(status):
    code = {Status.SOLVED: 0, Status.INTERRUPTED: 4}.get(status, 3)
    assert status.exit_code == code
    assert ("verified" in status.value and "converged" not in status.value) == (code == 0)


def test_planners_raise_with_the_plan(ends):
    missed = ends[Status.MISSED]
    with pytest.raises(PlanError, match="missed by") as caught:
        plan_motion(missed.motion)
    assert caught.value.plan.status is Status.MISSED
    again = Replanner(ends[Status.SOLVED])
    far = ends[Status.SOLVED].motion.shifted((5.0, 0.0, 0.0))
    with pytest.raises(PlanError, match="missed by"):
        again(far)
    assert again(far, throw=False).status is Status.MISSED


def test_the_error_begins_with_what_is_worst(ends):
    with pytest.raises(PlanError, match=r"Step 1: extension made by the muscles of segment \d"):
        ends[Status.INFEASIBLE].checked()


@pytest.mark.parametrize(("factor", "status"), [(1.02, Status.SOLVED), (0.98, Status.UNSTABLE)])
def test_a_column_stands_up_to_greenhills_height(tmp_path, factor, status):
    assert column(tmp_path, factor * GREENHILL).status is status


def test_a_start_that_overflows_is_no_crash(tmp_path):
    motion = load_motion(written(tmp_path, TOUCH))  # files may not say such numbers
    (step,) = motion.steps
    crushed = replace(step, loads=replace(step.loads, tip_force=(1e305, 0.0, 0.0)))
    plan = plan_motion(replace(motion, steps=(crushed,)), lookahead=1, throw=False)
    assert plan.status is Status.NOT_CONVERGED
    (finding, *_) = explain(plan).findings
    assert "overflowed" in finding.what
    assert "Check units" in finding.advice


# --- which solve failed ------------------------------------------------------------------


def test_a_start_that_another_start_made_up_for_did_not_fail(ends):
    plan = recorded(
        ends[Status.SOLVED],
        record("Restoration_Failed", "step 1 of 3, unloaded"),
        record("Solve_Succeeded", "step 1 of 3, unloaded"),
        record("Solve_Succeeded", "step 1 of 3"),
        record("Maximum_Iterations_Exceeded", "step 2 of 3", first=2, last=2),
        record("Infeasible_Problem_Detected", "step 3 of 3", first=3, last=3),
    )
    assert plan.failure.detail == "step 2 of 3"
    assert plan.status is Status.ITERATION_LIMIT
    starts = ("sequential plan", "passive trunk")
    plan = recorded(
        ends[Status.SOLVED],
        *(record("Restoration_Failed", f"steps 1 to 1, from the {start}") for start in starts),
    )
    assert plan.failure.detail == "steps 1 to 1, from the sequential plan"


def test_a_finer_mesh_may_fail_where_the_coarse_one_did_not(ends):
    plan = recorded(
        ends[Status.SOLVED],
        record("Solve_Succeeded", "steps 1 to 1, from the sequential plan"),
        record("Maximum_Iterations_Exceeded", "steps 1 to 1, from the horizon plan"),
    )
    assert plan.failure.message == "Maximum_Iterations_Exceeded"


# --- the best point ----------------------------------------------------------------------


class Points(Reporter):
    """Keeps what each iteration's point is worth."""

    def __init__(self):
        self.seen = []

    def iteration(self, progress):
        self.seen.append(progress)


@pytest.mark.parametrize("most", [1, 3, 6, 9])
def test_no_iterate_was_better_than_the_one_that_is_kept(most):
    motion = first_steps("lift-log", 3)
    reporter = Points()
    optimizer = Optimizer(max_iterations=most, reporter=reporter)
    mesh = planned("lift-log", "sequential").mesh
    window = Window(motion, mesh, motion.steps, np.zeros(30), {}, 0, Weights())
    start = window.pack(planned("lift-log", "sequential").x[:3] / 2,
        planned("lift-log", "sequential").part(0, 3))  # fmt: skip
    outcome = optimizer.solve(window, start, "horizon", "cut short")
    (solve,) = optimizer.solves
    assert outcome.message == "Maximum_Iterations_Exceeded"
    assert len(reporter.seen) == len(solve.history) == most + 1
    again = optimizer.evaluate(window, outcome.full)
    assert again.objective == pytest.approx(outcome.objective, rel=1e-9)
    points = [
        replace(solve, objective=objective, infeasibility=progress.infeasibility)
        for (objective, *_), progress in zip(solve.history, reporter.seen, strict=True)
    ]
    assert rank(solve) == min(rank(point) for point in points)
    assert (solve.objective, solve.infeasibility) == (outcome.objective, outcome.infeasibility)


def test_feasible_points_rank_before_others_and_then_by_objective():
    def point(objective, infeasibility):
        return replace(record("x"), objective=objective, infeasibility=infeasibility)

    order = [
        point(3.0, 0.0), point(5.0, 1e-7), point(0.0, 0.01), point(0.5, 0.01), point(0.0, 1.0),
        point(math.nan, 1.0),
    ]  # fmt: skip
    assert sorted([order[i] for i in (3, 0, 5, 1, 4, 2)], key=rank) == order


# --- what is said ------------------------------------------------------------------------


@pytest.mark.parametrize("status", CHECKED)
def test_every_failure_is_told_with_something_to_try(ends, status):
    diagnosis = explain(ends[status])
    failures = [finding for finding in diagnosis.findings if finding.level == "failure"]
    assert bool(failures) == (status is not Status.SOLVED)
    assert not failures or any(finding.advice for finding in failures)
    json.dumps(diagnosis.as_json(), allow_nan=False)
    assert diagnosis.status is status


def test_a_missed_target_comes_with_what_the_bounds_cost(ends):
    plan = ends[Status.MISSED]
    missed, reach, pressed, *_ = explain(plan).findings
    worst = 1e3 * plan.errors[0].position[0]
    assert f"step 1: the target at Z = 1.75 m is missed by {worst:.4g} mm" in missed.details[0]
    assert "would be reached if these bounds were relaxed" in reach.what
    assert all("activation of" in detail and "from -0.1 to" in detail for detail in reach.details)
    at = [m for m, x in zip(plan.motion.trunk.muscles, plan.activations[0], strict=True)
          if x < -0.0999]  # fmt: skip
    assert pressed.details == (f"{', '.join(at)}: step 1",)


def test_a_shallow_look_does_not_solve(ends):
    plan = ends[Status.MISSED]
    diagnosis = explain(plan, deep=False)
    assert not any("would be reached" in finding.what for finding in diagnosis.findings)
    assert diagnosis.responses == ()


def test_contradicting_bounds_are_named(ends):
    contradiction, failure = explain(ends[Status.INFEASIBLE]).findings[:2]
    assert "no nearby point satisfies the constraints better" in failure.what
    assert failure.details[0].startswith("step 1: extension ")
    assert "least extension of segment 1 (step 1): from 1.2 to 0.9999" in contradiction.details


def test_bounds_that_bind_are_told_of_a_plan_that_failed_as_well(ends):
    """All muscles may do nothing, so none has a bound worth telling; the head has."""
    solved = ends[Status.SOLVED]
    box = Bounds(np.minimum(solved.motion.box.lower, -1.0), solved.motion.box.upper)
    box.lower[3] = solved.x[0, 3]
    step = replace(solved.motion.steps[0], box=box)
    plan = recorded(
        replace(solved, motion=replace(solved.motion, steps=(step,))), record("Restoration_Failed")
    )
    name = solved.motion.trunk.muscles[3]
    told = [f for f in explain(plan).findings if f.what == "muscles at their bound of contraction"]
    assert [finding.details for finding in told] == [(f"{name}: step 1",)]


def test_the_residuals_are_kept_for_each_iteration(ends):
    plan = ends[Status.ITERATION_LIMIT]
    history = explain(plan).history
    assert [number for number, *_ in history] == list(range(5))
    assert tuple(row[1:] for row in history) == plan.failure.history


@pytest.mark.parametrize(
    ("message", "residuals", "steps", "advice"),
    [
        ("Maximum_Iterations_Exceeded", [1.0] * 10, 1, "--max-iterations 36"),
        ("Maximum_Iterations_Exceeded", [0.5**k for k in range(61)], 1, "--max-iterations 240"),
        ("Maximum_Iterations_Exceeded", [1.0] * 61, 1, "Try other starts (--starts 4)."),
        ("Restoration_Failed", [1.0] * 9, 2, "--mode horizon"),
        ("Invalid_Number_Detected", [1.0], 1, "Check units"),
    ],
)
def test_the_next_thing_to_try_follows_from_the_residuals(ends, message, residuals, steps, advice):
    solved = ends[Status.SOLVED]
    one = record(message, history=tuple((1.0, r, 1.0) for r in residuals))
    broken = ends[Status.INFEASIBLE].failure.violations
    motion = replace(solved.motion, steps=steps * solved.motion.steps)
    plan = recorded(replace(solved, motion=motion), replace(one, violations=broken))
    assert advice in explain(plan).findings[0].advice


def test_a_plan_without_a_record_or_a_number_is_explained(ends):
    solved = ends[Status.SOLVED]
    assert "unrecorded" in explain(replace(solved, converged=False, solves=())).findings[0].what
    nothing = undone(solved)
    assert nothing.status is Status.UNVERIFIED
    assert "independent check" in explain(nothing).findings[0].what
    assert not nothing.stability.stable.any()
    empty = replace(solved, x=solved.x[:0], tip_forces=solved.tip_forces[:0],
        shape=solved.part(0, 0), interrupted=True)  # fmt: skip
    assert "0 of 1 time steps" in explain(empty).findings[0].what


def test_an_empty_or_undone_plan_can_be_saved_and_read(ends, tmp_path):
    save_plan(undone(ends[Status.SOLVED]), tmp_path)
    report = json.loads((tmp_path / "summary.json").read_text())
    assert report["status"] == "unverified"
    assert report["timesteps"][0]["stability_margin"] is None
    assert load_plan(tmp_path, throw=False).status is Status.UNVERIFIED


def test_what_is_at_a_bound_is_told_with_its_steps():
    """Against strains by adaptive quadrature, and activations as the bounds are printed."""
    plan = planned("lift-log", "sequential")
    pressed = at_bounds(plan)
    zeta = reference.strains(plan.motion.trunk, plan.activations)[..., 0]
    assert pressed["extension"] == {
        f"segment {s + 1}": (np.flatnonzero(zeta[:, s] < 0.6705) + 1).tolist()
        for s in range(3)
        if np.any(zeta[:, s] < 0.6705)
    }
    assert pressed["extension"]
    for name in ("R3-dr", "L3-dr"):
        x = plan.activations[:, plan.motion.trunk.muscles.index(name)]
        assert pressed["contraction"][name] == (np.flatnonzero(x < -3.4965) + 1).tolist()


def test_effects_are_told_in_millimeters():
    plan = plan_motion(replace(first_steps("lift-log", 3), extension=(0.75, 1.35)))
    responses = explain(plan).responses
    first = responses[0]
    (sentence, *_) = effects(responses, plan.motion.trunk.length)
    assert sentence == (
        f"extension of segment 1 (steps 1, 3), 0.75 moved by -0.0075: the worst point comes "
        f"{-1e3 * first.worst:.2g} mm closer, the mean distance {-1e3 * first.mean:.2g} mm closer"
    )


def test_effects_count_by_the_size_of_the_trunk_and_zero_has_no_sign():
    response = Response("change of R1-dl", (5,), -0.0, -0.01, -1e-7, 0.0, -1e-3)
    assert effects((response,), 1.75) == []
    (sentence,) = effects((response,), 0.0175)
    assert sentence.startswith("change of R1-dl (step 5), 0 moved by -0.01: ")


# --- on the command line -----------------------------------------------------------------


@cache
def explained(folder, *arguments):
    return CliRunner().invoke(commands.main, ["explain", str(folder), *arguments])


@pytest.mark.parametrize("status", CHECKED)
def test_explain_says_how_it_ended_and_keeps_it(ends, status, tmp_path):
    save_plan(ends[status], tmp_path / "run" / ends[status].mode)
    result = explained(tmp_path / "run")
    assert result.exit_code == status.exit_code, result.output
    assert status.value in result.stdout.replace("\n", " ")
    kept = tmp_path / "run" / ends[status].mode / "diagnosis.json"

    def no_constant(name):
        raise AssertionError(f"{name} is no JSON")

    told = json.loads(kept.read_text(), parse_constant=no_constant)
    assert told["status"] == status.name.lower()
    for finding in told["findings"]:
        for detail in finding["details"]:
            assert detail in result.stdout


@pytest.mark.parametrize(
    ("status", "words"),
    [
        (Status.MISSED, ["step 1", "Z = 1.75 m", "R2-ivo", "from -0.1 to"]),
        (
            Status.INFEASIBLE,
            ["step 1", "segment 1", "allowed 1.2 to 1.35", "constraints violated by"],
        ),
        (Status.ITERATION_LIMIT, ["--max-iterations", "optimality error"]),
        (Status.INTERRUPTED, ["time steps are kept", "--resume"]),
        (Status.TIME_LIMIT, ["time steps are kept", "start=plan"]),
        (Status.UNSTABLE, ["step 1", "the trunk would fall in"]),
        (Status.COLLIDING, ["the trunk enters the floor", "mm at Z = 1.7", "at the start"]),
    ],
)
def test_what_explain_prints_names_place_and_size(ends, status, words, tmp_path):
    save_plan(ends[status], tmp_path / ends[status].mode)
    text = explained(tmp_path).stdout
    for word in words:
        assert word in text


def test_explain_prints_json_and_nothing_else(ends, tmp_path):
    save_plan(ends[Status.SOLVED], tmp_path / "horizon")
    assert json.loads(explained(tmp_path, "--json").stdout)["horizon"]["status"] == "solved"


def test_a_folder_without_a_run_gets_a_message(tmp_path):
    result = explained(tmp_path)
    assert result.exit_code == 2
    assert result.stdout == ""
    assert "no finished run" in result.stderr
    assert "Traceback" not in result.output


def test_what_is_not_solved_is_converted_only_if_asked_twice(ends, tmp_path):
    save_plan(ends[Status.MISSED], tmp_path / "horizon")
    convert = ["convert", str(tmp_path), "--to", "sto"]
    refused = CliRunner().invoke(commands.main, convert)
    assert refused.exit_code == 2
    assert Status.MISSED.value in refused.stderr
    assert "--anyway" in refused.stderr
    assert not (tmp_path / "horizon" / "activations.sto").exists()
    assert CliRunner().invoke(commands.main, [*convert, "--anyway"]).exit_code == 0
    assert (tmp_path / "horizon" / "activations.sto").exists()


def test_view_shows_what_is_not_solved(ends, tmp_path):
    save_plan(ends[Status.MISSED], tmp_path / "horizon")
    shown = CliRunner().invoke(commands.main, ["view", str(tmp_path), "--no-browser"])
    assert shown.exit_code == 0, shown.output
    assert Status.MISSED.value in (tmp_path / "motion.html").read_text()

"""What foresight is worth: by hand where a motion is small enough, and by what has to hold."""

import io
import json
from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner
from plans import POINT, TOUCH, first_steps, shipped, with_phases, written
from rich.console import Console
from scipy.optimize import minimize
from toys import TRUNK, shortening
from toys import C as SHORTENING

from trunk_ocp._support.process_pool import run_tasks
from trunk_ocp.analysis.lookahead_study import (
    TRACKING_ONLY,
    Curve,
    compare_lookaheads,
    equal_bounds,
    smoothness_tradeoff,
    survey_limits,
)
from trunk_ocp.analysis.measures import DEFINITIONS, Measures, plan_measures, reversals
from trunk_ocp.cli import commands
from trunk_ocp.cli.tables import foresight_table
from trunk_ocp.errors import InputError
from trunk_ocp.planning.options import Options
from trunk_ocp.planning.planner import plan_motion
from trunk_ocp.planning.status import Status
from trunk_ocp.problem.bound_specs import LimitsSpec
from trunk_ocp.problem.motion import REFERENCE_LENGTH
from trunk_ocp.problem.weights import Weights
from trunk_ocp.reporting import Reporter

pytestmark = pytest.mark.slow

C = SHORTENING * REFERENCE_LENGTH / TRUNK.length  # in the objective's units
WEIGHTS = Weights(effort=1e-3, rate=1e-3)
OPTIONS = Options(weights=WEIGHTS)
WANTED = (0.0, -0.1, -0.8, -0.8, -0.1, -0.5)
MOST = 0.2


@cache
def toy():
    """Every lookahead of a motion that cannot keep up with its targets."""
    return compare_lookaheads(shortening(WANTED, most=MOST), options=OPTIONS, processes=1)


def cost(gamma, wanted, before, duration=1.0):
    """What the planner minimizes of the toy: two muscles, each gamma."""
    change = np.diff(gamma, prepend=before)
    tracking = np.sum((C * (gamma - wanted)) ** 2)
    effort, rate = 2 * np.sum(gamma**2), 2 * np.sum(change**2) / duration
    return tracking + WEIGHTS.effort * effort + WEIGHTS.rate * rate


def by_hand(wanted, before):
    """The window's contractions, by sequential least squares on its quadratic program."""
    steps = len(wanted)
    difference = np.eye(steps) - np.eye(steps, k=-1)
    first = np.eye(steps)[0] * before

    def room(gamma):
        change = difference @ gamma - first
        return np.concatenate([MOST - change, MOST + change, -gamma, 1 + gamma])

    return minimize(
        cost, np.full(steps, before), (np.array(wanted), before), method="SLSQP",
        constraints={"type": "ineq", "fun": room}, options={"ftol": 1e-15, "maxiter": 500},
    ).x  # fmt: skip


def receding(wanted, lookahead):
    """The contractions that moving the window by one step at a time leads to."""
    kept = []
    while len(kept) < len(wanted):
        before, first = (kept[-1] if kept else 0.0), len(kept)
        window = by_hand(wanted[first : first + lookahead], before).tolist()
        kept += window if first + lookahead >= len(wanted) else window[:1]
    return np.array(kept)


# --- known answers -----------------------------------------------------------------------


def test_foresight_halves_what_a_blind_plan_misses():
    """Rest is asked for, then 2 D, and D is the most a step may change.

    Blind: 0 and D, which misses by D. With foresight: x and x + D, which misses by x and D - x;
    the squares are least at x = D / 2, half of D^2.
    """
    little = Options(weights=Weights(1e-7, 0.0))
    result = compare_lookaheads(shortening((0.0, -0.4), most=MOST), options=little, processes=1)
    blind, horizon = result.curve.blind, result.curve.horizon
    np.testing.assert_allclose(blind.activations, [[0, 0], [-0.2, -0.2]], atol=1e-4)
    np.testing.assert_allclose(horizon.activations, [[-0.1, -0.1], [-0.3, -0.3]], atol=1e-4)
    assert blind.objective.tracking == pytest.approx((C * MOST) ** 2, rel=1e-3)
    assert horizon.objective.tracking == pytest.approx((C * MOST) ** 2 / 2, rel=1e-3)


@pytest.mark.parametrize("lookahead", range(1, len(WANTED) + 1))
def test_every_lookahead_is_its_quadratic_program(lookahead):
    plan = toy().curve.plans[lookahead]
    gamma = receding(WANTED, lookahead)
    np.testing.assert_allclose(plan.activations, np.stack([gamma, gamma], axis=1), atol=2e-4)
    assert plan.objective.total == pytest.approx(cost(gamma, WANTED, 0.0), rel=1e-4)


def test_a_good_start_is_no_foresight():
    """The toy has one optimum: shown where the horizon is, the blind solve ends as before."""
    np.testing.assert_allclose(toy().curve.shown.x, toy().curve.blind.x, atol=2e-4)


def test_the_lookahead_that_suffices_is_found():
    costs = [cost(receding(WANTED, H), WANTED, 0.0) for H in range(1, len(WANTED) + 1)]
    enough = next(H for H, value in enumerate(costs, 1) if value <= 1.01 * costs[-1])
    assert enough > 1
    assert toy().curve.sufficient == enough
    assert toy().curve.worse_than_blind == []
    assert toy().curve.best is toy().curve.horizon


def test_smoothness_is_bought_with_tracking():
    data = smoothness_tradeoff(shortening(WANTED), (1e-4, 1e-2, 1.0), OPTIONS, processes=1)
    for way in ("blind", "horizon"):
        rates = [plan["squared_rate"] for plan in data[way]]
        tracking = [plan["tracking"] for plan in data[way]]
        assert rates == sorted(rates, reverse=True)
        assert tracking == sorted(tracking)
    # Blind, each step is its own least-squares problem: gamma_t from gamma_{t-1} alone.
    gamma, weight = 0.0, 1.0
    for wanted in WANTED:
        gamma = (C**2 * wanted + 2 * weight * gamma) / (C**2 + 2 * WEIGHTS.effort + 2 * weight)
    last = data["blind"][-1]
    assert last["planner_objective"] >= data["horizon"][-1]["planner_objective"]
    blind = plan_motion(
        shortening(WANTED), 1, Options(weights=Weights(WEIGHTS.effort, weight)), throw=False
    )
    np.testing.assert_allclose(blind.activations[-1], gamma, atol=1e-5)
    assert last["tracking"] == pytest.approx(blind.objective.tracking, rel=1e-9)


# --- the ways are what they say ----------------------------------------------------------


@cache
def lifted():
    """Three steps of lift-log; appendix B has auxiliary problems for each."""
    return compare_lookaheads(first_steps("lift-log", 3), lookaheads=(2,), processes=1)


def test_one_step_ahead_is_the_sequential_solve_without_auxiliary_problems():
    blind = plan_motion(equal_bounds(first_steps("lift-log", 3)), 1)
    assert blind.auxiliary == {}
    np.testing.assert_array_equal(lifted().curve.blind.x, blind.x)


def test_all_steps_ahead_are_the_horizon():
    horizon = plan_motion(first_steps("lift-log", 3), start=lifted().curve.blind)
    assert horizon.mode == "horizon"
    np.testing.assert_array_equal(lifted().curve.horizon.x, horizon.x)


def test_the_papers_way_has_its_feasible_sets_and_no_running_cost():
    paper, costed = lifted().paper, lifted().paper_costed
    assert paper.weights == TRACKING_ONLY
    assert costed.weights == lifted().curve.horizon.weights == Weights()
    assert set(paper.auxiliary) == set(costed.auxiliary) == {0, 1, 2}
    assert all(plan.auxiliary == {} for plan in lifted().curve.plans.values())


def test_all_objectives_are_by_the_same_weights():
    measures, paper = lifted().measures, lifted().paper
    expected = paper.objective.tracking + 1e-5 * (paper.activations**2).sum()
    expected += 1e-5 * measures["paper"].squared_rate
    assert measures["paper"].planner_objective == pytest.approx(expected, rel=1e-12)
    assert list(measures) == [
        "paper", "paper, same cost", "lookahead 1", "lookahead 2", "lookahead 3",
        "blind from best",
    ]  # fmt: skip


def test_no_plan_of_the_curve_leaves_the_horizons_bounds():
    for plan in lifted().curve.plans.values():
        assert plan.verification.faults == []
        assert plan_measures(plan).change_excess <= 1e-7


def test_the_number_of_processes_changes_nothing():
    motion = shortening(WANTED[:3], most=MOST)
    one, two = (compare_lookaheads(motion, options=OPTIONS, processes=n) for n in (1, 2))
    for H, plan in one.curve.plans.items():
        np.testing.assert_array_equal(plan.x, two.curve.plans[H].x)


def made_up(totals, sounds, missed=()):
    plans = {
        H: SimpleNamespace(
            objective=SimpleNamespace(total=total),
            converged=good,
            verified=True,
            status=Status.MISSED if H in missed else Status.SOLVED,
        )
        for H, (total, good) in enumerate(zip(totals, sounds, strict=True), 1)
    }
    return Curve(shortening(WANTED[: len(totals)]), plans, plans[len(totals)], plans[1])


def test_only_sound_plans_suffice():
    curve = made_up([2.0, 1.005, 1.005, 1.3, 1.0], [True, False, True, True, True])
    assert curve.sufficient == 3
    assert set(curve.excess) == {1, 3, 4, 5}


@pytest.mark.parametrize(
    ("missed", "enough"),
    [((), 2), ((2,), 3), ((2, 3, 4), 5), ((1, 2, 3, 4, 5), 2)],
)
def test_no_lookahead_suffices_that_misses_what_the_horizon_reaches(missed, enough):
    assert made_up([2.0, 1.005, 1.004, 1.003, 1.0], [True] * 5, missed).sufficient == enough


@pytest.mark.parametrize("mode", ["narrow", "long words"])
def test_no_column_of_a_comparison_is_cut_at_80(mode):
    result = toy()
    if mode == "long words":
        plans = {H: replace(plan, converged=False) for H, plan in result.curve.plans.items()}
        result = replace(result, curve=replace(result.curve, plans=plans))
    console = Console(width=80, record=True, file=io.StringIO())
    console.print(foresight_table(result))
    text = console.export_text()
    assert "\N{HORIZONTAL ELLIPSIS}" not in text
    assert max(map(len, text.splitlines())) <= 80
    for name in result.measures:
        assert text.count(name.replace("paper, ", "").replace("lookahead", "ahead")) >= 2


def test_the_comparison_explains_its_words():
    quality = foresight_table(toy()).renderables[0]
    for words in ("blind from best: ", "same cost: ", "cost / best: "):
        assert words in str(quality.caption)


def test_lookaheads_worse_than_none_are_told():
    curve = made_up([1.2, 1.5, 1.2, 1.21, 1.0], [True] * 5)
    assert curve.worse_than_blind == [2, 4]


# --- limits ------------------------------------------------------------------------------


def test_limits_cut_bounds_and_leave_narrower_ones():
    motion = shipped("lift-log").limited(activation=2.0, rate=1.5)
    names = motion.trunk.muscles
    for step, own in zip(motion.steps, shipped("lift-log").steps, strict=True):
        np.testing.assert_array_equal(step.box.lower[:28], np.maximum(own.box.lower[:28], -2.0))
        np.testing.assert_array_equal(step.box.upper, own.box.upper)
        np.testing.assert_array_equal(step.box.lower[28:], own.box.lower[28:])
        most = min(1.5 * own.duration, 0.4 if own is not shipped("lift-log").steps[0] else np.inf)
        np.testing.assert_allclose(step.change.upper[:28], most, rtol=1e-15)
        np.testing.assert_allclose(step.change.lower[:28], -most, rtol=1e-15)
        np.testing.assert_array_equal(step.change.upper[28:], own.change.upper[28:])
    assert motion.steps[0].box.lower[names.index("R3-dl")] == 0.0  # eq. (B.3)
    np.testing.assert_array_equal(motion.box.lower[:28], -2.0)


def test_a_limited_rate_is_kept_in_steps_of_any_length():
    durations = np.array([0.5, 2.0, 0.25])
    motion = shortening((-0.9, -0.9, -0.1), durations).limited(rate=0.4)
    plan = plan_motion(motion, options=Options(weights=Weights(1e-7, 0.0)), throw=False)
    np.testing.assert_allclose(
        plan.activations[:, 0], [-0.2, -0.55, -0.45], atol=1e-3
    )  # both miss by 0.35
    change = np.abs(np.diff(plan.activations, axis=0, prepend=0.0))
    assert (change / durations[:, None]).max() <= 0.4 + 1e-6


@pytest.mark.parametrize("limit", [{"activation": 0.0}, {"rate": -1.0}])
def test_a_limit_of_nothing_is_refused(limit):
    with pytest.raises(InputError, match=f"{next(iter(limit))} = .*above 0"):
        shortening(WANTED).limited(**limit)


def test_a_limit_that_a_motion_excludes_is_refused():
    tense = with_phases(shortening(WANTED), bounds=LimitsSpec(activation=(-1.0, -0.5)))
    with pytest.raises(InputError, match=r"activation = 0.3: R1-long must be between -1 and -0.5"):
        tense.limited(activation=0.3)


def test_a_survey_has_a_cell_for_each_pair_of_limits():
    data = survey_limits(shortening(WANTED[:3]), (None, 0.3), (0.1,), options=OPTIONS, processes=1)
    assert [cell["limits"] for cell in data["cells"]] == [
        {"activation": None, "rate": 0.1}, {"activation": 0.3, "rate": 0.1},
    ]  # fmt: skip
    for cell in data["cells"]:
        assert list(cell["lookaheads"]) == ["1", "2", "3"]
        assert cell["best"]["largest_change"] <= 0.1 + 1e-6
    json.dumps(data)


@pytest.mark.parametrize("lookaheads", [(0, 2), (7,)])
def test_lookaheads_beyond_the_motion_are_refused(lookaheads):
    with pytest.raises(InputError, match="whole numbers from 1 to 6"):
        compare_lookaheads(shortening(WANTED), lookaheads=lookaheads, processes=1)


# --- measures ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("curve", "turns"),
    [
        ([], 0),
        ([0.0, -1.0, -2.0], 0),
        ([0.0, -1.0, 0.0], 1),
        ([0.0, -1.0, 0.0, -1.0], 2),
        ([0.0, -0.09, 0.0, -0.09], 0),  # wiggles
        ([0.0, -0.5, -0.45, -1.0, -0.95, -1.5], 0),  # wiggles on the way
        ([0.0, -0.06, -0.12, -0.06, 0.0], 1),  # in small steps
        ([-1.0, -1.05, -0.5, -0.55, -1.0], 1),
    ],
)
def test_turns_are_counted_without_wiggles(curve, turns):
    assert reversals(np.array(curve)) == turns


def test_measures_of_a_made_up_plan():
    durations = np.array([1.0, 0.5, 0.25, 0.25])
    motion = shortening((0.0,) * 4, durations)
    plan = plan_motion(motion, 1, options=OPTIONS, throw=False)
    x = np.zeros((4, 4))
    x[:, 0] = [-0.5, -1.0, -0.2, -1.0]  # two turns; 0.75 s at its bound
    x[:, 1] = [-0.3, -0.35, -0.3, -0.35]  # wiggles
    x[:, 2] = [0.1, 0.3, 0.3, -0.1]
    x[:, 3] = [-0.2, 0.0, 0.0, 0.1]
    measures = plan_measures(replace(plan, x=x), Weights(2.0, 3.0))
    assert measures.total_variation == pytest.approx(0.5 + 0.8 + 0.8 + 3 * 0.05)
    assert measures.largest_change == pytest.approx(0.8)
    assert measures.reversals == 2
    assert measures.time_at_bound == pytest.approx(0.75)
    assert measures.saturated_muscles == 1
    assert measures.head_travel == pytest.approx(0.1 + 0.2 + 0.4 + 0.2 + 0.2 + 0.1)
    assert measures.squared_activation == pytest.approx(2.29 + 0.425)
    changes = np.diff(x, axis=0, prepend=0.0)
    assert measures.squared_rate == pytest.approx((changes**2).sum(axis=1) @ (1 / durations))
    total = measures.tracking + 2 * measures.squared_activation + 3 * measures.squared_rate
    assert measures.planner_objective == pytest.approx(total, rel=1e-12)


def test_every_measure_has_a_definition():
    assert list(DEFINITIONS) == list(Measures.__dataclass_fields__)


# --- stopping ----------------------------------------------------------------------------


def sleepless(number, reporter):
    """A task that ends when it is told to."""
    while not reporter.stop:
        reporter.iteration(None)
    return number


@pytest.mark.parametrize("processes", [1, 2])
def test_a_stop_ends_all_tasks(processes):
    reporter = Reporter()
    reporter.stop = True
    with pytest.raises(KeyboardInterrupt):
        run_tasks(sleepless, [(1,), (2,), (3,)], processes, reporter)


def doubled(number, _):
    if number == 3:
        raise InputError("three")
    return 2 * number


def test_results_keep_their_order_and_are_counted():
    counted = []
    results = run_tasks(doubled, [(1,), (2,), (5,)], 1, done=lambda *n: counted.append(n))
    assert results == [2, 4, 10]
    assert counted == [(0, 3), (1, 3), (2, 3), (3, 3)]


def test_an_error_in_another_process_keeps_its_kind():
    with pytest.raises(InputError, match="three"):
        run_tasks(doubled, [(1,), (3,)], 2)


# --- command line ------------------------------------------------------------------------


def test_compare_writes_numbers_with_their_definitions_and_a_figure(tmp_path):
    problem = str(written(tmp_path, POINT))
    arguments = ["compare", problem, "--out", str(tmp_path / "out"), "--processes", "1"]
    result = CliRunner().invoke(commands.main, [*arguments, "--max-rate", "0.6"])
    assert result.exit_code == 0, result.output
    report = json.loads((tmp_path / "out" / "comparison.json").read_text())
    assert report["limits"] == {"activation": None, "rate": 0.6}
    assert set(report["measures"]) >= {"paper", "paper, same cost", "lookahead 1", "lookahead 4"}
    for measures in report["measures"].values():
        assert set(measures) <= set(report["definitions"])
    assert (tmp_path / "out" / "comparison.pdf").read_bytes()[:4] == b"%PDF"
    assert "ahead 4" in result.stdout


def test_survey_writes_both_files(tmp_path):
    problem = str(written(tmp_path, TOUCH))
    arguments = ["survey", problem, "--out", str(tmp_path), "--processes", "1"]
    limits = ["--max-rates", "none,0.6", "--lookaheads", "1"]
    result = CliRunner().invoke(commands.main, [*arguments, *limits])
    assert result.exit_code == 0, result.output
    cells = json.loads((tmp_path / "survey.json").read_text())["cells"]
    assert [cell["limits"]["rate"] for cell in cells] == [None, 0.6]
    assert len(json.loads((tmp_path / "front.json").read_text())["blind"]) > 5
    assert {path.name for path in tmp_path.glob("*.png")} == {
        "foresight-touch.png", "front-touch.png",
    }  # fmt: skip


@pytest.mark.parametrize(
    "wrong", [["--max-activation", "0"], ["--max-rate", "fast"], ["--lookaheads", "1,two"],
              ["--lookaheads", "99"]],
)  # fmt: skip
def test_wrong_limits_exit_2(wrong, tmp_path):
    problem = str(written(tmp_path, POINT))
    result = CliRunner().invoke(commands.main, ["compare", problem, "--out", str(tmp_path), *wrong])
    assert result.exit_code == 2
    assert "Traceback" not in result.output

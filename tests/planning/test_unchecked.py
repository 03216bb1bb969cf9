"""check="later": a plan is back before its check, and never counts as verified until then."""

import copy
import json
import pickle
from dataclasses import replace

import numpy as np
import pytest
from toys import pointing, shortening

from trunk_ocp.analysis.diagnosis import explain
from trunk_ocp.analysis.measures import plan_measures
from trunk_ocp.errors import InputError
from trunk_ocp.planning import plan as plan_module
from trunk_ocp.planning.options import Options
from trunk_ocp.planning.plan import PlanError
from trunk_ocp.planning.planner import plan_motion
from trunk_ocp.planning.status import Status
from trunk_ocp.planning.storage import load_plan, save_plan
from trunk_ocp.planning.tables import activations_table

MOTION = shortening([-0.1, -0.2])


@pytest.fixture(scope="module")
def made():
    """A plan made without its check, and the same plan checked at once."""
    return plan_motion(MOTION, check="later"), plan_motion(MOTION)


@pytest.fixture
def unchecked(made):
    return replace(made[0])  # no results of checks that another test asked for


@pytest.fixture
def uncheckable(monkeypatch):
    """Nothing may be checked."""

    def fail(*_):
        raise AssertionError("checked too early")

    for name in ("verify", "all_stable", "buckling_margin"):
        monkeypatch.setattr(plan_module, name, fail)


def test_it_is_the_plan_that_a_check_at_once_leaves(made, unchecked):
    np.testing.assert_array_equal(unchecked.x, made[1].x)
    assert made[1].status is Status.SOLVED
    assert unchecked.check() is Status.SOLVED
    assert unchecked.errors[0].position == pytest.approx(made[1].errors[0].position, abs=1e-12)


def test_planning_checks_nothing(uncheckable):
    plan = plan_motion(MOTION, check="later")
    assert plan.status is Status.UNCHECKED
    assert plan.unchecked
    assert plan.status.exit_code == 3


def test_its_status_is_unchecked_until_it_is_checked(unchecked):
    assert unchecked.status is Status.UNCHECKED
    assert unchecked.objective.paper < 1e-3  # though parts of the check are known by now
    assert unchecked.status is Status.UNCHECKED
    unchecked.check()
    assert unchecked.status is Status.SOLVED
    assert not unchecked.unchecked


def test_a_changed_plan_is_unchecked_again_but_not_one_with_another_record(unchecked):
    unchecked.check()
    assert replace(unchecked, x=2 * unchecked.x).status is Status.UNCHECKED
    assert replace(unchecked, x=2 * unchecked.x).check() is Status.UNVERIFIED
    assert unchecked.with_record(notes=("a note",)).status is Status.SOLVED
    for same in (copy.deepcopy(unchecked), pickle.loads(pickle.dumps(unchecked))):
        assert same.status is Status.SOLVED


def test_what_fails_the_check_is_found_by_it():
    plan = plan_motion(pointing((0.0, 0.0, 5.0)), check="later")  # no error: not known yet
    assert plan.status is Status.UNCHECKED
    with pytest.raises(PlanError, match="out of reach"):
        plan.checked()
    assert plan.status is Status.MISSED


def test_what_is_known_without_a_check_is_an_error(uncheckable):
    few = Options(max_iterations=1)
    with pytest.raises(PlanError, match="not converged within the allowed iterations") as error:
        plan_motion(MOTION, options=few, check="later")
    plan = error.value.plan
    assert plan.status is plan.check() is Status.ITERATION_LIMIT
    assert not plan.unchecked


@pytest.mark.parametrize("check", ["never", "", "NOW"])
def test_other_times_are_refused(check):
    with pytest.raises(InputError, match=r"check = .*: expected 'now' or 'later'"):
        plan_motion(MOTION, check=check)


def test_what_saves_or_judges_a_plan_checks_it(unchecked, tmp_path):
    save_plan(unchecked, tmp_path)
    assert json.loads((tmp_path / "summary.json").read_text())["status"] == "solved"
    assert load_plan(tmp_path).status is Status.SOLVED
    assert unchecked.status is Status.SOLVED
    assert "unchecked" not in activations_table(replace(unchecked))
    assert explain(replace(unchecked), deep=False).status is Status.SOLVED
    assert plan_measures(replace(unchecked)).status == "solved"

"""Shipped motions with contact: they load, and the fastest are planned and keep their bars."""

import pytest

from trunk_ocp.planning.planner import plan_motion
from trunk_ocp.planning.status import Status
from trunk_ocp.problem.build import load_motion

GAP_TOL = 1e-4  # m
MAX_ROWS = 200
VARIANTS = {
    "feed-fruit": {"head", "self"},
    "fruit-behind-posts": {"obstacles", "self"},
    "lift-log-hung": {"head", "log", "self"},
    "tight-curl": {"log", "self"},
}


@pytest.mark.parametrize("name", VARIANTS)
def test_a_variant_asks_for_contact(name):
    assert VARIANTS[name] <= load_motion(name).contact


@pytest.mark.parametrize("name", ["tight-curl", "fruit-behind-posts"])
def test_a_variant_keeps_clear_with_few_rows_and_few_plans(name):
    motion = load_motion(name)
    plan = plan_motion(motion)
    assert plan.status is Status.SOLVED
    asked = [gap for gap in plan.clearance.all if gap.group in motion.contact]
    assert min(gap.bound - gap.least for gap in asked) >= -GAP_TOL
    assert 0 < sum(map(len, plan.gaps.values())) <= MAX_ROWS
    assert sum(solve.stage == "horizon" for solve in plan.solves) <= 6

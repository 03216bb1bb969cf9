"""Sides taken and heads turned though no task asks for it: that the plan says so, and only then."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from plans import ROD, TOUCH, planned, shipped, with_phases, written

from trunk_ocp.analysis import free_choices
from trunk_ocp.analysis.diagnosis import explain
from trunk_ocp.analysis.free_choices import one_sided
from trunk_ocp.analysis.reached_bounds import at_bounds
from trunk_ocp.planning.planner import plan_from, plan_motion
from trunk_ocp.problem.build import load_motion
from trunk_ocp.problem.load_specs import LoadsSpec
from trunk_ocp.problem.mirror import is_symmetric, mirrored_controls, mirrored_motion
from trunk_ocp.problem.motion import Bounds

pytestmark = pytest.mark.slow

# A leaf above the head, straight ahead, that is reached and held.
HOLD = """position_weight = 8.0

[[phases]]
name = "hold"
duration = 1.0
steps = 5
interpolation = "hermite"

[[phases.targets]]
Z = 1.75
position = [0.3, 0.0, -1.0]
position_weight = 8.0
"""
LEAF = TOUCH.replace("[0.6, 0.1, 1.2]", "[0.3, 0.0, -1.0]").replace(
    "[bounds]", "[bounds]\nhead_z_deg = [-20.0, 20.0]\nhead_y_deg = [-20.0, 30.0]"
)
LEAF += HOLD
SIDES = "the task is symmetric"
WORTH = "the value of turning"


@cache
def leaf(folder, head_z="[-20.0, 20.0]"):
    return plan_motion(load_motion(written(folder, LEAF.replace("[-20.0, 20.0]", head_z))))


def notes(plan, deep=True):
    return {f.what: f for f in explain(plan, deep=deep).findings if f.level == "note"}


def told(plan, what, deep=True):
    return [detail for key, f in notes(plan, deep).items() if what in key for detail in f.details]


@pytest.mark.parametrize(
    ("old", "new", "symmetric"),
    [
        ("Z = 1.75", "Z = 1.75", True),
        ("[0.3, 0.0, -1.0]", "[0.3, 0.001, -1.0]", False),
        ("[-20.0, 20.0]", "[-20.0, 19.0]", False),
        ("[-20.0, 30.0]", "[-20.0, 29.0]", True),
        ("Z = 1.75", "Z = 1.75\nd2 = [0.0, 1.0, 0.0]", True),
        ("Z = 1.75", "Z = 1.75\nd3 = [0.0, 1.0, 1.0]", False),
        ("duration = 1.0", "duration = 1.0\nloads.tip_force = [1.0, 0.0, 5.0]", True),
        ("duration = 1.0", "duration = 1.0\nloads.tip_force = [0.0, 1.0, 0.0]", False),
        ("[bounds]", '[bounds]\nmuscles = { "R1-dl" = [-1.0, 0.0] }', False),
        ("[bounds]", '[bounds]\nmuscles = { "*1-dl" = [-1.0, 0.0] }', True),
        ("[bounds]", '[start]\nactivation = { "R1-dl" = -0.2 }\n[bounds]', False),
        ("[bounds]", "[start]\nhead_z_deg = 1.0\n[bounds]", False),
        ("[bounds]", '[start]\nactivation = { "*1-dl" = -0.2 }\nhead_y_deg = 1.0\n[bounds]', True),
    ],
)
def test_a_motion_is_symmetric_if_all_it_asks_for_is(tmp_path, old, new, symmetric):
    motion = load_motion(written(tmp_path, LEAF.replace(old, new, 1)))
    assert is_symmetric(motion) == symmetric
    assert is_symmetric(mirrored_motion(motion)) == symmetric


@pytest.mark.parametrize(
    ("name", "symmetric"),
    [("lift-log", True), ("lift-log-asymmetric", False), ("pick-fruit", False)],
)
def test_of_the_shipped_motions_one_is_symmetric(name, symmetric):
    assert is_symmetric(shipped(name)) == symmetric


def test_a_trunk_of_one_side_is_not_symmetric(tmp_path):
    one = ROD.replace("sector = [0.0, 1.5] }", 'sector = [0.0, 1.5], sides = ["R"] }')
    written(tmp_path, one, "arm.toml")
    text = TOUCH.replace("[bounds]", 'anatomy = "arm.toml"\n[bounds]').replace("1.75", "1.0")
    assert not is_symmetric(load_motion(written(tmp_path, text)))


def test_a_plan_that_takes_sides_says_so_and_how_to_mend_it(tmp_path):
    plan = leaf(tmp_path)
    turned = np.degrees(plan.head[0, 0])
    assert abs(turned) > 1
    for deep in (False, True):
        (told_once,) = told(plan, SIDES, deep)
        assert (
            f"psi_Z reaches {turned:.3g} deg, and {-turned:.3g} would be equally good" in told_once
        )
        assert "symmetric = true in [weights]" in told_once


def test_the_mirror_image_really_is_as_good(tmp_path):
    plan = leaf(tmp_path)
    image = plan_from(plan.motion, mirrored_controls(plan.motion.trunk, plan.x))
    assert image.head[0, 0] == pytest.approx(-plan.head[0, 0], abs=1e-3)
    assert image.objective.total == pytest.approx(plan.objective.total, rel=1e-4)


def test_what_a_head_held_straight_costs_is_measured(tmp_path):
    free, held = leaf(tmp_path), leaf(tmp_path, "[0.0, 0.0]")
    (text,) = told(free, WORTH)
    assert "every target is still reached" in text
    assert text.startswith("holding psi_Z at 0 (head_z_deg = [0.0, 0.0] in [bounds]) raises the ")
    percent = float(text.split("raises the objective by ")[1].split(" %")[0])
    assert percent == pytest.approx(
        100 * (held.objective.total / free.objective.total - 1), rel=0.1, abs=0.1
    )
    assert not told(free, WORTH, deep=False)


@pytest.mark.parametrize(
    ("before", "after", "said"), [(0.032, 0.039, False), (15.0, 15.2, False), (15, 17, True)]
)
def test_errors_are_compared_where_they_differ(before, after, said):
    """In mm; whom a tolerance of 20 serves, 0.032 and 0.039 are the same."""
    plan = planned("lift-log", "sequential")
    pair = []
    for error in (before, after):
        errors = tuple(replace(e, position=np.full_like(e.position, 1e-3 * error))
                       for e in plan.errors)  # fmt: skip
        other = replace(plan)
        other.__dict__["errors"] = errors  # a cached property
        pair.append(other)
    assert ("17 mm off instead of 15" in free_choices._cost(*pair, 0)) is said
    assert ("mm off" in free_choices._cost(*pair, 0)) is said


@pytest.mark.parametrize(
    ("force", "aside", "symmetric"), [(1e6, 1e-5, True), (1e-8, 5e-10, False), (0.0, 0.0, True)]
)
def test_symmetry_is_measured_against_the_loads(force, aside, symmetric):
    """In N: 1e-5 is round-off of 1e6, 5e-10 is none of 1e-8."""
    motion = with_phases(shipped("lift-log"), loads=LoadsSpec(tip_force=(force, aside, 0.0)))
    assert is_symmetric(motion) is symmetric


def test_a_straight_head_gives_nothing_to_say(tmp_path):
    plan = leaf(tmp_path, "[0.0, 0.0]")
    assert not one_sided(plan)
    assert not told(plan, SIDES)
    assert not told(plan, WORTH)


def test_a_task_to_one_side_gives_no_talk_of_sides():
    assert not one_sided(planned("lift-log-asymmetric", "sequential"))
    assert one_sided(planned("lift-log", "sequential"))


def test_no_muscle_is_said_to_contract_that_may_only_lengthen(tmp_path):
    plan = leaf(tmp_path)
    count = len(plan.motion.trunk.muscles)
    lower, upper = plan.motion.box.lower.copy(), plan.motion.box.upper.copy()
    lower[:count], upper[:count] = 0.0, 1.0
    x = plan.x.copy()
    x[:, :count] = 0.0
    x[:, 3] = 1.0
    steps = tuple(replace(step, box=Bounds(lower, upper)) for step in plan.motion.steps)
    longer = replace(plan, x=x, motion=replace(plan.motion, steps=steps))
    pressed = at_bounds(longer)
    assert pressed["contraction"] == {}
    assert pressed["lengthening"] == {plan.motion.trunk.muscles[3]: [1, 2, 3, 4, 5, 6]}
    warned = [f for f in explain(longer, deep=False).findings if "lengthen actively" in f.what]
    assert plan.motion.trunk.muscles[3] in warned[0].details[0]
    assert not any("lengthen actively" in f.what for f in explain(plan, deep=False).findings)

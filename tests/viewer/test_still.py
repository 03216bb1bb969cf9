"""What the page gets of a trunk without a plan, and of what users may try."""

import numpy as np
import pytest
from plans import planned, soft_rod, written

from trunk_ocp.model.anatomy import load_anatomy
from trunk_ocp.problem.interpolation import loads_at
from trunk_ocp.scene.moments import moments_at
from trunk_ocp.viewer import page
from trunk_ocp.viewer.still import still_payload
from trunk_ocp.viewer.try_it import plan_controls


def test_a_trunk_that_does_not_hold_its_weight_is_shown_without_gravity(tmp_path):
    upright = soft_rod("jelly").replace("1.0e6", "2.0e3") + "\n[head]\nxi_d_deg = 180.0\n"
    (shown,) = still_payload(load_anatomy(written(tmp_path, upright)))["plans"]
    assert shown["controls"]["loads"][0]["gravity"] == 0
    (shown,) = still_payload(load_anatomy("asian-elephant"))["plans"]
    assert shown["controls"]["loads"][0]["gravity"] == 9.8


def test_controls_have_the_bounds_of_every_step_and_the_loads_of_every_moment():
    plan = planned("pick-fruit", "sequential")
    moments = moments_at(plan, plan.times)
    controls = plan_controls(plan, moments)
    for step in plan.motion.steps:
        (box,) = (b for b in controls["boxes"] if b["from"] < step.time - 1e-9 <= b["to"])
        np.testing.assert_array_equal(box["lower"], step.box.lower)
        np.testing.assert_array_equal(box["upper"], step.box.upper)
    for moment, load in zip(moments, controls["loads"], strict=True):
        expected = loads_at(plan.motion, plan.loads, moment.time, moment.after)
        assert load["tip_force"] == list(expected.tip_force)
    assert [load["tip_mass"] for load in controls["loads"]][-1] == 8.0
    assert controls["largest_mass"] == pytest.approx(20)  # twice the fruit, rounded up


def test_pages_are_the_same_every_time():
    trunk = load_anatomy("asian-elephant")
    assert page(trunk) == page(trunk)

"""The widget's side in Python: what it holds, takes and refuses. `test_in_a_browser` moves it."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from toys import TRUNK, shortening

from trunk_ocp.errors import InputError, TrunkError
from trunk_ocp.planning.planner import plan_motion
from trunk_ocp.planning.replanning import Replanner
from trunk_ocp.viewer.payload import payload


@pytest.fixture(scope="module")
def plan():
    return plan_motion(shortening([-0.2, -0.4]))


@pytest.fixture(scope="module")
def view(plan):
    return plan.view()


def test_it_starts_where_the_motion_starts(plan):
    started = plan_motion(plan.motion.started(np.array([-0.3, -0.3, 0.0, 0.0])))
    view = started.view(height=300)
    assert (view.time, view.height, view.moved) == (0.0, 300, False)
    assert view.activation == [-0.3, -0.3]
    assert view.head == [0.0, 0.0]


def test_a_trunk_has_one_too():
    view = TRUNK.view()
    assert view.activation == [0.0, 0.0]
    assert TRUNK.name in view.page


def test_arrays_are_welcome(view):
    view.activation = np.array([-0.1, -0.2])
    view.head = (np.float32(0.5), 0)
    assert view.activation == [-0.1, -0.2]
    assert view.head == [0.5, 0.0]
    assert view.moved


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("activation", [0.0], "activation: expected 2 numbers, got 1"),
        ("activation", [], "activation: expected 2 numbers, got 0"),
        ("head", [0.0] * 3, "head: expected 2 numbers, got 3"),
        ("head", [np.nan, 0.0], "head = .*: expected a list of finite numbers"),
        ("head", "up", "expected an array of real numbers"),
        ("activation", [[0.0, 0.0]], "expected a list of finite numbers"),
    ],
)
def test_what_the_page_cannot_show_is_refused_and_changes_nothing(view, name, value, message):
    before = getattr(view, name)
    with pytest.raises(InputError, match=message):
        setattr(view, name, value)
    assert getattr(view, name) == before


def test_another_plan_takes_the_place(view, plan):
    view.show(plan_motion(shortening([-0.3])))
    assert view.plan["plans"][0]["times"][-1] == 1.0
    with pytest.raises(InputError, match="no time steps"):
        view.show(replace(plan, x=plan.x[:0], interrupted=True))


@pytest.mark.parametrize("height", [0, 1e9, "tall", None])
def test_an_impossible_height_is_refused(plan, height):
    with pytest.raises(InputError, match=r"height = .*: expected a whole number of pixels"):
        plan.view(height=height)


def test_a_plan_without_steps_is_refused(plan):
    with pytest.raises(InputError, match="no time steps"):
        replace(plan, x=plan.x[:0], interrupted=True).view()


def test_without_anywidget_a_sentence_says_what_to_install(plan, monkeypatch):
    monkeypatch.setitem(sys.modules, "trunk_ocp.notebook.widget", None)
    with pytest.raises(TrunkError, match=r"pip install 'trunk_ocp\[notebook\]'"):
        plan.view()


def test_a_picture_loads_neither_matplotlib_nor_widgets():
    code = (
        "import sys, trunk_ocp as to; to.load_anatomy('asian-elephant')._repr_html_();"
        "print([m for m in ('matplotlib', 'anywidget') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_a_dragged_target_can_be_planned_again():
    """The loop of docs/how-to/notebooks.md."""
    plan = plan_motion(shortening([-0.2]))
    view, replanner = plan.view(), Replanner(plan)

    def replan(change):
        dragged = change["new"]
        if dragged["what"] == "target" and dragged["done"]:
            view.show(replanner(plan.motion.retarget(position=dragged["position"])))

    view.observe(replan, "dragged")
    (name,) = {target["name"] for target in payload([plan])["plans"][0]["targets"]}
    view.dragged = {"what": "target", "name": name, "position": [0, 0, 0.9], "done": False}
    assert view.plan is None
    view.dragged = {"what": "target", "name": name, "position": [0, 0, 0.9], "done": True}
    (target,) = view.plan["plans"][0]["targets"]
    assert target["position"] == [0, 0, 0.9]

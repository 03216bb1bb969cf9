"""Small pictures with key facts: true, small, and only text whatever a file says."""

import html.parser
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hostile import HOSTILE
from toys import TRUNK, shortening

from trunk_ocp._support.outputs import outputs
from trunk_ocp.errors import InputError
from trunk_ocp.model.loads import Loads
from trunk_ocp.notebook.side_view import silhouettes
from trunk_ocp.planning.options import Options
from trunk_ocp.planning.planner import plan_motion
from trunk_ocp.rod.shape import Shape
from trunk_ocp.rod.statics import solve_statics

MAX_SIZE = 20_000  # characters


class Elements(html.parser.HTMLParser):
    """Tags of HTML in their order, and its text."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.text = [], ""
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, [name for name, _ in attrs]))

    def handle_data(self, data):
        self.text += f" {data}"


@pytest.fixture(scope="module")
def plan():
    return plan_motion(shortening([-0.2, -0.4]))


@pytest.fixture(scope="module")
def shown(plan):
    """One of each kind."""
    shapes = solve_statics(TRUNK, np.array([[[-0.1, -0.1], [0.0, 0.0], [-0.2, -0.2]]] * 2))
    return {
        "plan": plan,
        "motion": plan.motion,
        "trunk": TRUNK,
        "shape": shapes[0, 1],
        "shapes": shapes,
    }


KINDS = ("plan", "motion", "trunk", "shape", "shapes")


@pytest.mark.parametrize("kind", KINDS)
def test_a_picture_and_facts_of_a_small_size(shown, kind):
    text = shown[kind]._repr_html_()
    tags = [tag for tag, _ in Elements(text).tags]
    assert tags.count("svg") == 1
    assert tags.count("table") == 1
    assert len(text) < MAX_SIZE
    assert "nan" not in text


def test_facts_of_a_plan(plan):
    text = Elements(plan._repr_html_()).text
    for fact in ("solved and verified", "2 of 2 time steps", "position error", "shorten"):
        assert fact in text
    worst = re.search(r"at most ([\d.e-]+) mm", text)
    errors = [each.position.max() for each in plan.errors]
    assert float(worst[1]) == pytest.approx(1e3 * max(errors), rel=0.05)  # two digits are shown


def test_a_plan_that_is_not_solved_says_so():
    cut = plan_motion(shortening([-0.2]), options=Options(max_iterations=1), throw=False)
    assert "not converged" in cut._repr_html_()


def test_an_unchecked_plan_is_not_checked_for_its_picture():
    plan = plan_motion(shortening([-0.2]), check="later")
    assert "not checked yet" in plan._repr_html_()
    assert plan.unchecked


def test_a_plan_without_steps_has_no_picture(plan):
    none = replace(plan, x=plan.x[:0], tip_forces=plan.tip_forces[:0], shape=plan.shape[:0],
                   interrupted=True)  # fmt: skip
    assert "<svg" not in none._repr_html_()
    assert "interrupted" in none._repr_html_()


def test_mass_of_a_trunk_is_that_of_a_truncated_cone(trunk):
    # Radii and density as in the anatomy file; 114.743 kg by integration.
    assert "114.7 kg" in trunk._repr_html_()


def test_tips_of_shapes_are_given(shown):
    assert "X 0.000, Y 0.000, Z 1.000 m" in shown["shape"]._repr_html_()  # straight, 1 m
    text = Elements(shown["shapes"]._repr_html_()).text
    assert "2 x 3" in text
    assert "Z 0.832 to 1.000" in text  # 1 + C gamma, C = 0.84


def test_a_silhouette_is_the_outline_of_the_trunk():
    """Of a hanging cylinder of 1 m and radius 0.05 m, bent by nothing: a rectangle."""
    shape = Shape.stack([solve_statics(TRUNK, np.zeros(2), loads=Loads(0.0))])
    outline = silhouettes(shape)[0]
    assert outline.min(axis=0) == pytest.approx([-0.05, 0.0], abs=1e-9)
    assert outline.max(axis=0) == pytest.approx([0.05, 1.0], abs=1e-9)
    x, z = outline.T
    area = 0.5 * abs(np.sum(x * np.roll(z, -1) - z * np.roll(x, -1)))
    assert area == pytest.approx(0.1, rel=1e-9)


def test_a_trunk_that_does_not_hold_its_weight_has_facts_and_no_picture(plan, monkeypatch):
    from trunk_ocp.errors import StaticsError
    from trunk_ocp.notebook import summaries

    def fails(*args):
        raise StaticsError("no equilibrium", 0.1)

    monkeypatch.setattr(summaries, "solve_statics", fails)
    assert "no equilibrium" in plan.motion._repr_html_()


@pytest.mark.parametrize("name", HOSTILE.values(), ids=HOSTILE.keys())
def test_a_name_is_only_text(plan, shown, name):
    trunk = replace(TRUNK, name=name)
    spec = plan.motion.spec.model_copy(update={"name": name, "title": name})
    phases = tuple(replace(phase, name=name) for phase in plan.motion.phases)
    motion = replace(plan.motion, spec=spec, trunk=trunk, phases=phases)
    for harmless, hostile in (
        (plan, plan.with_record(motion=motion)),
        (plan.motion, motion),
        (TRUNK, trunk),
        (shown["shape"], replace(shown["shape"], trunk=trunk)),
    ):
        text = hostile._repr_html_()
        text.encode()
        assert len(text) < MAX_SIZE
        assert Elements(text).tags == Elements(harmless._repr_html_()).tags


def test_nothing_else_has_a_picture():
    with pytest.raises(InputError, match="expected a Plan, Motion, Trunk or Shape"):
        outputs().html(SimpleNamespace())

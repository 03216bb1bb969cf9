"""Figures of a plan that one can change."""

import sys

import matplotlib
import pytest
from matplotlib.figure import Figure
from toys import shortening

from trunk_ocp._support.outputs import Outputs, outputs
from trunk_ocp.errors import InputError
from trunk_ocp.planning.planner import plan_motion

NAMES = ("shapes", "activations", "muscles", "errors")


@pytest.fixture(scope="module")
def plan():
    return plan_motion(shortening([-0.2, -0.4]))


@pytest.mark.parametrize("name", NAMES)
def test_a_figure_is_new_shown_without_pyplot_and_can_be_changed(plan, name):
    figure, settings = getattr(plan.plot, name)(), dict(matplotlib.rcParams)
    assert isinstance(figure, Figure)
    assert figure is not getattr(plan.plot, name)()
    figure.axes[0].set_title("mine")
    figure.set_size_inches(4, 3)
    assert figure._repr_png_().startswith(b"\x89PNG")
    pyplot = sys.modules.get("matplotlib.pyplot")  # another test may have imported it
    assert pyplot is None or not pyplot.get_fignums()
    assert dict(matplotlib.rcParams) == settings


def test_either_side_has_its_muscles(plan):
    for side, name in (("R", "right"), ("L", "left")):
        assert name in plan.plot.muscles(side).get_suptitle()
    with pytest.raises(InputError, match="side = 'B': expected 'L' or 'R'"):
        plan.plot.muscles("B")


def test_a_plan_without_steps_has_no_figures(plan):
    from dataclasses import replace

    none = replace(plan, x=plan.x[:0], shape=plan.shape[:0], interrupted=True)
    for name in NAMES:
        with pytest.raises(InputError, match="no time steps; nothing to draw"):
            getattr(none.plot, name)()


def test_the_accessor_says_what_it_has(plan):
    assert all(f"{name}()" in repr(plan.plot) for name in NAMES)


def test_everything_that_layers_below_ask_for_is_there():
    asked = [name for name in vars(Outputs) if not name.startswith("_")]
    assert asked == ["html", "view", "figure", "labeled", "table"]
    assert all(callable(getattr(outputs(), name)) for name in asked)

"""Commands on problems with bodies in the way: exit codes, sentences, and numbers in JSON."""

import json

import numpy as np
import pytest
from click.testing import CliRunner
from plans import TOUCH, shipped, written

from trunk_ocp.cli import commands
from trunk_ocp.model.loads import Loads
from trunk_ocp.rod.statics import solve_statics

pytestmark = pytest.mark.slow


def invoked(*arguments):
    return CliRunner().invoke(commands.main, [*map(str, arguments)])


def with_ball(folder, place, radius=0.05):
    x, y, z = np.asarray(place).tolist()
    ball = f'name = "ball"\nshape = "sphere"\ncenter = [{x}, {y}, {z}]\nradius = {radius}\n'
    return written(folder, f"{TOUCH}\n[[obstacles]]\n{ball}")


def at_rest(Z):
    """Where the trunk of TOUCH hangs before it moves."""
    trunk = shipped("pick-fruit").trunk
    shape = solve_statics(trunk, np.zeros((1, 28)), np.zeros((1, 2)), Loads())
    return shape.position(np.array([Z]))[0, 0]


def solved(problem, folder, *options):
    ended = invoked(
        "solve", problem, "--mode", "horizon", "--no-figures", "--out", folder, *options
    )
    return ended, json.loads((folder / "horizon" / "summary.json").read_text())


def test_a_body_that_need_not_be_avoided_is_a_warning(tmp_path):
    ended, told = solved(with_ball(tmp_path, at_rest(1.2)), tmp_path / "out")
    assert ended.exit_code == 0
    assert "ball" in ended.output
    assert told["status"] == "solved"
    assert any("ball" in sentence for sentence in told["collisions"])
    assert told["clearance"]["min"] < -0.04
    assert told["clearance"]["with"] == "ball"


def test_a_collision_that_cannot_be_avoided_exits_3_and_names_the_body(tmp_path):
    problem = with_ball(tmp_path, at_rest(1.2))
    ended, told = solved(problem, tmp_path / "out", "--contact", "obstacles")
    assert ended.exit_code == 3
    assert "ball" in ended.output
    assert told["status"] == "colliding"
    assert any("ball" in sentence for sentence in told["collisions"])
    explained = invoked("explain", tmp_path / "out" / "horizon")
    assert explained.exit_code == 3
    assert "ball" in explained.output


def test_bodies_out_of_the_way_cost_nothing(tmp_path):
    problem = with_ball(tmp_path, (-2.0, 0.0, 0.0))
    ended, told = solved(problem, tmp_path / "out", "--contact", "all")
    assert ended.exit_code == 0
    assert told["clearance"]["min"] > 0
    assert told["collisions"] == []


def test_a_kind_of_body_that_there_is_not_is_named(tmp_path):
    ended = invoked("solve", with_ball(tmp_path, (1, 1, 1)), "--contact", "walls")
    assert ended.exit_code == 2
    assert "walls" in ended.output
    assert "obstacles" in ended.output

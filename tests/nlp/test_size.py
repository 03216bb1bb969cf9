"""The size of a plan is known before it begins, and what cannot work is refused."""

import pytest
from click.testing import CliRunner
from plans import MOTIONS, TOUCH, shipped, written

from trunk_ocp.analysis.multistart import find_optima
from trunk_ocp.cli import commands
from trunk_ocp.errors import InputError
from trunk_ocp.nlp import size
from trunk_ocp.nlp.ipopt import Optimizer
from trunk_ocp.nlp.size import check_size, size_of
from trunk_ocp.planning.decided_steps import DecidedSteps
from trunk_ocp.planning.options import Options, first_mesh
from trunk_ocp.planning.planner import plan_motion
from trunk_ocp.planning.planning_run import PlanningRun
from trunk_ocp.problem.build import load_motion
from trunk_ocp.reporting import Reporter


@pytest.mark.parametrize("name", MOTIONS)
def test_unknowns_and_equations_are_those_of_the_whole_motion(name):
    motion, options, count = shipped(name), Options(), len(shipped(name).steps)
    mesh = first_mesh(motion, options)
    work = PlanningRun(motion, mesh, "horizon", count, options, Optimizer())
    unknowns, equations = work.window(0, motion.steps, DecidedSteps()).nlp.size
    told = size_of(motion, mesh, count)
    # By its largest step each; lift-log's first steps have fewer targets than the last.
    assert unknowns == pytest.approx(told.unknowns, rel=0.2)
    assert equations == pytest.approx(told.equations, rel=0.2)


@pytest.mark.parametrize("name", MOTIONS)
def test_a_shipped_motion_is_planned_without_a_word(name):
    motion = shipped(name)
    assert check_size(motion, first_mesh(motion, Options()), len(motion.steps)) == ""


class Notes(Reporter):
    def __init__(self):
        self.notes = []

    def note(self, text):
        self.notes.append(text)


def test_a_large_plan_is_announced(tmp_path, monkeypatch):
    monkeypatch.setattr(size, "LARGE_SECONDS", 0.0)
    reporter = Notes()
    motion = load_motion(written(tmp_path, TOUCH))
    plan_motion(motion, 1, reporter=reporter)
    (sentence,) = reporter.notes
    assert "1 time steps of 28 muscles" in sentence
    assert "unknowns" in sentence


def test_a_plan_that_needs_more_memory_than_there_is_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(size, "available_memory", lambda: 1e6)
    path = written(tmp_path, TOUCH)
    with pytest.raises(InputError, match=r"0\.0 GB that are free here.*--lookahead"):
        plan_motion(load_motion(path))
    arguments = ["solve", str(path), "--out", str(tmp_path / "out"), "--no-figures"]
    result = CliRunner().invoke(commands.main, arguments)
    assert result.exit_code == 2
    assert "Error: touch: " in result.stderr


def test_2500_muscles_over_1000_steps_do_not_go_unnoticed(tmp_path):
    """Of any machine: more memory than a laptop has, and hours."""
    groups = "".join(
        f"""[[segments.muscles]]
group = "g{k}"
architecture = "longitudinal"
radii_over_length = [0.02, 0.06]
sector = [{0.12 * k}, {0.12 * k + 0.1}]
"""
        for k in range(25)
    )
    segments = "".join(
        f"[[segments]]\nZ_over_length = [{k / 50}, {(k + 1) / 50}]\n{groups}" for k in range(50)
    )
    material = "[material]\nyoungs_modulus = 1e6\npoisson_ratio = 0.5\ndensity = 1000.0\n"
    anatomy = 'name = "big"\nlength = 1.75\nbase_radius_over_length = 0.1\n'
    written(tmp_path, anatomy + material + segments, "big.toml")
    text = 'anatomy = "big.toml"\n' + TOUCH.replace("duration = 1.0", "duration = 9\nsteps = 1000")
    motion = load_motion(written(tmp_path, text))
    told = size_of(motion, first_mesh(motion, Options()), 1000)
    assert len(motion.trunk.muscles) == 2500
    assert told.large
    assert told.unknowns > 2_500_000
    assert told.memory > 8e9


def test_memory_is_what_the_tightest_limit_leaves(monkeypatch, tmp_path):
    monkeypatch.setattr(size, "CGROUP", tmp_path)
    before = size.available_memory()
    (tmp_path / "memory.max").write_text("1000000\n")
    (tmp_path / "memory.current").write_text("400000\n")
    assert size.available_memory() == 600_000
    (tmp_path / "memory.max").write_text("max\n")
    assert size.available_memory() == pytest.approx(before, rel=0.5)


@pytest.mark.parametrize(
    "wrong",
    [{"max_iterations": 0}, {"max_iterations": 2**31}, {"starts": 0}, {"elements": 10**9},
     {"degree": 0}, {"max_iterations": 1.5}, {"starts": True}],
)  # fmt: skip
def test_options_out_of_range_are_refused(wrong):
    (name,) = wrong
    with pytest.raises(InputError, match=f"{name} = .*expected a whole number"):
        Options(**wrong)


@pytest.mark.parametrize("wrong", [{"seed": -1}, {"starts": -1}, {"seed": 10**5000}])
def test_starts_and_seeds_out_of_range_are_refused(wrong):
    with pytest.raises(InputError, match="expected a whole number"):
        find_optima(shipped("lift-log"), **wrong)

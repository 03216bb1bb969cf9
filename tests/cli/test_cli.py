"""The command line: exit codes, what is written, what is printed, and how it is interrupted."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner
from plans import POINT, ROD, TOUCH, arm_file, written

from trunk_ocp.cli import commands
from trunk_ocp.cli import finished_runs as runs
from trunk_ocp.cli import run_figures as drawing
from trunk_ocp.cli import solve as cli
from trunk_ocp.errors import InputError
from trunk_ocp.figures import film, style
from trunk_ocp.planning.storage import load_plan
from trunk_ocp.problem.build import load_motion

pytestmark = pytest.mark.slow

SOLVE_MOTION = Path(sys.executable).parent / "solve-motion"
FAR = TOUCH.replace("[0.6, 0.1, 1.2]", "[5.0, 0.0, 0.0]")  # the trunk is 1.75 m long


def run(*arguments):
    """`solve-motion` in this process, without pictures."""
    return CliRunner().invoke(commands.solve, [*map(str, arguments), "--no-figures"])


def summary(folder):
    return json.loads((folder / "summary.json").read_text())


# --- solved ------------------------------------------------------------------------------


def test_a_solved_motion_exits_0_and_leaves_its_files(tmp_path):
    result = run(written(tmp_path, POINT), "--out", tmp_path / "out")
    assert result.exit_code == 0, result.output
    assert {path.name for path in (tmp_path / "out" / "horizon").iterdir()} == {
        "summary.json",
        "activations.csv",
        "solution.nc",
        "diagnosis.json",
    }
    report = summary(tmp_path / "out" / "horizon")
    assert (report["status"], report["verified"]) == ("solved", True)
    assert "solved and verified" in result.stdout
    assert str(tmp_path / "out") in result.stdout.replace("\n", "")
    assert result.stderr == ""


@pytest.mark.parametrize("text", [TOUCH, POINT], ids=["one step", "four steps"])
@pytest.mark.parametrize("mode", ["horizon", "sequential"])
def test_results_are_in_a_folder_named_by_the_mode(tmp_path, text, mode):
    result = run(written(tmp_path, text), "--out", tmp_path / "out", "--mode", mode)
    assert result.exit_code == 0, result.output
    assert {path.name for path in (tmp_path / "out").iterdir()} == {mode, "source.json"}
    assert summary(tmp_path / "out" / mode)["mode"] == mode


def test_contact_of_the_command_is_saved_with_the_plan(tmp_path):
    path = written(tmp_path, TOUCH + "\n[contact]\nlog = true\n")
    for option, kinds in (("self,head", {"self", "head"}), ("none", set())):
        result = run(path, "--contact", option, "--out", tmp_path / option)
        assert result.exit_code == 0, result.output
        assert load_plan(tmp_path / option / "horizon").motion.contact == kinds


def test_contact_with_what_does_not_exist_is_a_usage_error(tmp_path):
    result = run(written(tmp_path, POINT), "--contact", "ground", "--out", tmp_path / "out")
    assert result.exit_code == 2
    assert "expected all, none, or some of self, head, log, obstacles" in result.output


@pytest.mark.parametrize("text", [TOUCH, POINT], ids=["one step", "four steps"])
def test_both_modes_are_compared(tmp_path, text):
    result = run(written(tmp_path, text), "--out", tmp_path / "out", "--mode", "both")
    assert result.exit_code == 0, result.output
    comparison = json.loads((tmp_path / "out" / "comparison.json").read_text())
    assert set(comparison) == {"sequential", "horizon"}
    for mode, figures in comparison.items():
        report = summary(tmp_path / "out" / mode)
        assert figures["planner_objective"] == report["planner_objective"]["total"]


def test_a_lookahead_between_is_a_receding_horizon(tmp_path):
    result = run(written(tmp_path, POINT), "--out", tmp_path / "out", "--lookahead", 2)
    assert result.exit_code == 0, result.output
    report = summary(tmp_path / "out" / "receding-2")
    assert (report["mode"], report["lookahead"]) == ("receding", 2)


def test_results_go_to_a_folder_of_the_problems_name(tmp_path, monkeypatch):
    path = written(tmp_path, TOUCH)
    monkeypatch.chdir(tmp_path)
    assert run(path.name).exit_code == 0
    assert summary(tmp_path / "results" / "touch" / "horizon")["problem"] == "touch"


def test_quiet_prints_nothing(tmp_path):
    result = run(written(tmp_path, TOUCH), "--out", tmp_path / "out", "--quiet")
    assert (result.exit_code, result.output) == (0, "")
    assert (tmp_path / "out" / "horizon" / "solution.nc").is_file()


def test_json_prints_the_summary_and_nothing_else(tmp_path):
    result = run(written(tmp_path, POINT), "--out", tmp_path / "out", "--mode", "both", "--json")
    assert result.exit_code == 0
    assert result.stderr == ""
    reports = json.loads(result.stdout)
    assert set(reports) == {"horizon", "sequential"}
    for mode, report in reports.items():
        assert report == summary(tmp_path / "out" / mode)


@pytest.mark.parametrize("command", ["solve", "tables", "schema"])
def test_every_command_has_help(command):
    result = CliRunner().invoke(commands.main, [command, "--help"])
    assert result.exit_code == 0
    assert "Usage:" in result.stdout


def test_trunk_ocp_solve_is_the_same_command():
    ours = CliRunner().invoke(commands.main, ["solve", "--help"]).stdout.split("\n", 1)[1]
    assert ours == run("--help").stdout.split("\n", 1)[1]


class StopHereError(InputError):
    """Raised in place of planning."""


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ([], ("pick-fruit", None)),
        (["lift-log"], ("lift-log", None)),
        (["lift-log-asymmetric", "--mode", "sequential"], ("lift-log-asymmetric", 1)),
        (["lift-log", "--lookahead", "4"], ("lift-log", 4)),
    ],
)
def test_what_is_planned(monkeypatch, tmp_path, arguments, expected):
    seen = []

    def planner(motion, lookahead=None, *rest, **options):
        seen.append((motion.name, lookahead))
        raise StopHereError("enough")

    monkeypatch.setattr(cli, "plan_motion", planner)
    assert run(*arguments, "--out", tmp_path / "out").exit_code == 2
    assert seen == [expected]


# --- exit code 2 -------------------------------------------------------------------------

WRONG = {
    "unknown name": (["pick-friut"], "Did you mean pick-fruit?"),
    "missing file": (["nowhere/problem.toml"], "nowhere/problem.toml"),
    "unknown key": (["gravty.toml"], "Did you mean gravity?"),
    "not TOML": (["broken.toml"], "not valid TOML"),
    "missing linear solver": (["good.toml", "--linear-solver", "nosuch"], "nosuch"),
    "linear solver of sequential": (
        ["good.toml", "--mode", "sequential", "--linear-solver", "nosuch"],
        "nosuch",
    ),
    "mode and lookahead": (["good.toml", "--mode", "both", "--lookahead", "2"], "not both"),
    "even the default mode": (["good.toml", "--mode", "horizon", "--lookahead", "2"], "not both"),
    "no lookahead": (["good.toml", "--lookahead", "0"], "--lookahead"),
    "unknown mode": (["good.toml", "--mode", "clever"], "clever"),
    "no iterations": (["good.toml", "--max-iterations", "0"], "--max-iterations"),
    "unknown option": (["good.toml", "--fast"], "--fast"),
    "two problems": (["good.toml", "good.toml"], "extra argument"),
}


@pytest.mark.parametrize(("arguments", "message"), WRONG.values(), ids=WRONG)
def test_bad_input_exits_2_and_writes_nothing(tmp_path, monkeypatch, arguments, message):
    written(tmp_path, TOUCH, "good.toml")
    written(tmp_path, "gravty = 9.8\n" + TOUCH, "gravty.toml")
    written(tmp_path, "name = [", "broken.toml")
    monkeypatch.chdir(tmp_path)
    before = sorted(tmp_path.rglob("*"))
    result = run(*arguments)
    assert result.exit_code == 2, result.output
    assert message in result.stderr
    assert "Traceback" not in result.output
    assert isinstance(result.exception, SystemExit)
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize("blocked", ["out", "out/horizon"])
def test_a_folder_that_cannot_be_made_exits_2(tmp_path, blocked):
    (tmp_path / blocked).parent.mkdir(exist_ok=True)
    (tmp_path / blocked).write_text("a file")
    result = run(written(tmp_path, TOUCH), "--out", tmp_path / "out")
    assert result.exit_code == 2
    assert "out" in result.stderr
    assert "Traceback" not in result.output


# --- exit code 3 -------------------------------------------------------------------------


def test_an_unreachable_target_exits_3_with_results_marked(tmp_path):
    result = run(written(tmp_path, FAR), "--out", tmp_path / "out")
    assert result.exit_code == 3, result.output
    report = summary(tmp_path / "out" / "horizon")
    assert (report["status"], report["verified"]) == ("missed", True)
    # A trunk of 1.75 m at 1.35 times its length, its base moved by 2 * 0.44 m at most.
    assert report["max_position_error"] >= 5.0 - 1.35 * 1.75 - 0.875
    assert "missed by" in result.stdout
    assert report["missed"][0].startswith("step 1: the target at Z = 1.75 m is missed by")


def test_too_few_iterations_exit_3_with_results_marked(tmp_path):
    result = run(written(tmp_path, TOUCH), "--out", tmp_path / "out", "--max-iterations", 3)
    assert result.exit_code == 3
    assert summary(tmp_path / "out" / "horizon")["status"] == "iteration_limit"
    assert not load_plan(tmp_path / "out" / "horizon", throw=False).converged


def test_one_bad_mode_of_two_exits_3(tmp_path):
    result = run(written(tmp_path, FAR), "--out", tmp_path / "out", "--mode", "both", "--quiet")
    assert result.exit_code == 3
    assert result.stdout == ""
    assert "out of reach" in result.stderr


# --- as installed ------------------------------------------------------------------------


def started(*arguments):
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    return subprocess.Popen(
        [SOLVE_MOTION, *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=environment,
    )


def test_the_installed_command_solves(tmp_path):
    process = started(written(tmp_path, TOUCH), "--out", tmp_path / "out", "--json", "--no-figures")
    out, err = process.communicate(timeout=120)
    assert (process.returncode, err) == (0, "")
    assert json.loads(out)["horizon"]["status"] == "solved"


@pytest.mark.parametrize(
    ("mode", "line", "folder", "steps"),
    [
        ("sequential", "sequential", "sequential", range(1, 10)),  # only those already done
        ("horizon", "sequential", "horizon", range(1, 10)),  # in the plan it would start from
        ("horizon", "steps 1 to 10", "horizon", range(10, 11)),  # the best whole motion
        ("both", "steps 1 to 10", "horizon", range(10, 11)),
    ],
)
def test_an_interrupt_exits_4_with_the_best_so_far_saved(tmp_path, mode, line, folder, steps):
    process = started("lift-log", "--out", tmp_path / "out", "--mode", mode)
    assert any(line in text for text in process.stdout)  # reads until it is shown
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=120)
    assert process.returncode == 4, out + err
    assert "Traceback" not in err
    assert "Stopping" in out
    report = summary(tmp_path / "out" / folder)
    assert report["status"] == "interrupted"
    assert len(report["timesteps"]) in steps
    assert load_plan(tmp_path / "out" / folder, throw=False).interrupted


# --- a finished run ----------------------------------------------------------------------


def test_a_finished_run_is_converted_for_other_programs(tmp_path):
    out = tmp_path / "out"
    assert run(written(tmp_path, POINT), "--out", out).exit_code == 0
    result = CliRunner().invoke(commands.main, ["convert", str(out)])
    assert result.exit_code == 0, result.output
    assert (out / "horizon" / "motion.glb").read_bytes()[:4] == b"glTF"
    assert (out / "horizon" / "vtk" / "muscles.pvd").exists()
    assert (out / "horizon" / "activations.sto").exists()
    only = CliRunner().invoke(commands.main, ["convert", str(out / "horizon"), "--to", "sto"])
    assert only.exit_code == 0, only.output
    assert only.stdout.strip().endswith(": sto")


def test_a_solved_motion_is_drawn_filmed_and_shown(tmp_path, monkeypatch):
    monkeypatch.setattr(drawing, "PROCESSES", 1)  # for speed, as all that follows
    monkeypatch.setitem(style.LOOK, "savefig.dpi", 60.0)
    monkeypatch.setitem(style.LOOK, "pdf.fonttype", 3)
    monkeypatch.setattr(film, "MAX_FRAMES", 4)
    monkeypatch.setattr(film, "DPI", 40)
    out = tmp_path / "out"
    monkeypatch.setattr(film.shutil, "which", lambda program: None)  # no ffmpeg
    arguments = [str(arm_file(tmp_path)), "--out", str(out), "--mode", "both", "--film"]
    arguments += ["--figures", "all"]
    result = CliRunner().invoke(commands.solve, arguments)
    assert result.exit_code == 0, result.output
    for mode in ("sequential", "horizon"):
        drawn = {path.name for path in (out / mode / "figures").iterdir()}
        assert {"shapes.pdf", "activations.png", "muscles-left.pdf", "errors.png"} <= drawn
        assert (out / mode / "film.gif").read_bytes()[:4] == b"GIF8"
    assert (out / "figures" / "comparison.pdf").exists()
    assert (out / "motion.html").exists()
    opened = []
    monkeypatch.setattr(runs.webbrowser, "open", lambda page: opened.append(page) or True)
    (out / "motion.html").unlink()
    shown = CliRunner().invoke(commands.main, ["view", str(out)])
    assert shown.exit_code == 0, shown.output
    assert opened == [(out / "motion.html").as_uri()]
    quiet = CliRunner().invoke(commands.main, ["view", str(out / "horizon"), "--no-browser"])
    assert quiet.exit_code == 0, quiet.output
    assert len(opened) == 1
    assert (out / "horizon" / "motion.html").exists()


def pictures(folder):
    return {str(path.relative_to(folder)) for path in folder.rglob("*") if path.suffix in PICTURES}


PICTURES = (".png", ".pdf", ".gif", ".mp4", ".html")
MAIN = {f"horizon/figures/{name}.png" for name in ("shapes", "activations", "errors")}
OF_TRUNK = ("figures/anatomy-sections", "figures/anatomy-exploded")
OF_PLAN = ("shapes", "activations", "errors", "muscles-right", "muscles-left")
ALL = {
    f"{name}.{kind}"
    for name in (*OF_TRUNK, *(f"horizon/figures/{name}" for name in OF_PLAN))
    for kind in ("pdf", "png")
}


@pytest.mark.parametrize(
    ("options", "files"),
    [
        (("--figures", "none"), set()),
        (("--no-figures",), set()),
        ((), MAIN | {"motion.html"}),
        (("--figures", "main"), MAIN | {"motion.html"}),
        (("--figures", "all"), ALL | {"motion.html"}),
    ],
)
def test_the_option_says_which_figures_are_drawn(tmp_path, monkeypatch, options, files):
    monkeypatch.setattr(drawing, "PROCESSES", 1)
    monkeypatch.setitem(style.LOOK, "savefig.dpi", 30.0)
    monkeypatch.setitem(style.LOOK, "pdf.fonttype", 3)
    out = tmp_path / "out"
    result = CliRunner().invoke(
        commands.solve, [str(arm_file(tmp_path)), "--out", str(out), *options]
    )
    assert result.exit_code == 0, result.output
    assert pictures(out) == files
    assert ("--figures all also draws" in result.output) == (files == MAIN | {"motion.html"})
    for name in ("shapes", "activations", "errors") if files else ():
        assert name in result.output.split("horizon/figures/: ")[1].splitlines()[0]


def test_figures_are_asked_for_in_one_way(tmp_path):
    arguments = [str(arm_file(tmp_path)), "--figures", "all", "--no-figures"]
    result = CliRunner().invoke(commands.solve, arguments)
    assert result.exit_code == 2
    assert "not both" in result.output


def test_a_trunk_is_viewed_without_a_plan(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = written(tmp_path, ROD, "my arm.toml")
    for subject, name in (("asian-elephant", "asian-elephant"), (str(path), "soft-arm")):
        result = CliRunner().invoke(commands.main, ["view", subject, "--no-browser"])
        assert result.exit_code == 0, result.output
        page = tmp_path / "results" / name / "trunk.html"
        assert result.output.split() == [str(page)]
        assert f"<title>{name}</title>" in page.read_text()
    path.write_text(ROD.replace("length = 1.0", "length = -1.0"))
    result = CliRunner().invoke(commands.main, ["view", str(path)])
    assert result.exit_code == 2
    assert "length = -1" in result.stderr


@pytest.mark.parametrize("verb", ["convert", "view"])
def test_what_is_not_a_finished_run_is_said_so(tmp_path, verb, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("lift-log", str(tmp_path)):
        result = CliRunner().invoke(commands.main, [verb, name])
        assert result.exit_code == 2
        assert "no finished run" in result.stderr
        assert "solve-motion" in result.stderr
    for name, hint in (
        ("asian-elefant", "Did you mean asian-elephant?"),
        ("a.toml", "no such file"),
    ):
        result = CliRunner().invoke(commands.main, [verb, name])
        assert result.exit_code == 2
        assert hint in result.stderr


def test_a_slower_problem_elsewhere_finds_the_anatomy_and_long_names_leave_room(
    tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    problem = POINT.replace('name = "reach"', f'name = "{"long " * 30}"')
    assert run(written(tmp_path, problem), "--out", tmp_path / "out").exit_code == 0
    command = ["slow", str(tmp_path / "out"), "--out", "elsewhere/slower.toml"]
    result = CliRunner().invoke(commands.main, command)
    assert result.exit_code == 0, result.output
    table = result.stdout.splitlines()
    assert [line.count("\u2026") for line in table if "long" in line] == [1]  # of the name alone
    load_motion("elsewhere/slower.toml")


def test_slow_says_how_long_phases_have_to_be_and_writes_the_problem(tmp_path):
    assert run(written(tmp_path, POINT), "--out", tmp_path / "out").exit_code == 0
    slower = tmp_path / "slower.toml"
    command = ["slow", str(tmp_path / "out"), "--ratio", "0.02", "--out", str(slower)]
    result = CliRunner().invoke(commands.main, command)
    assert result.exit_code == 0, result.output
    assert "reach" in result.stdout
    assert f"solve-motion {slower}" in result.stdout
    before = load_plan(tmp_path / "out" / "horizon")
    after = load_motion(slower)
    for old, new in zip(before.motion.spec.phases, after.spec.phases, strict=True):
        worst = max(
            ratio
            for step, ratio in zip(before.motion.steps, before.inertia.ratio, strict=True)
            if before.motion.phases[step.phase].name == old.name
        )
        factor = max(1.0, (worst / 0.02) ** 0.5)
        assert new.duration == pytest.approx(old.duration * factor)
        assert new.model_copy(update={"duration": old.duration}) == old
    again = CliRunner().invoke(commands.main, command)
    assert again.exit_code == 2
    assert "exists already" in again.stderr

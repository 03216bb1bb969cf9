"""Faults from outside: killed, interrupted, no room, no rights, no fonts, no terminal.

Real processes, except where an error of the system can be had no other way.
"""

import contextlib
import errno
import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from click.testing import CliRunner
from plans import POINT, TOUCH, arm_file, written
from processes import run_script
from programs import needs

from trunk_ocp._support.atomic_files import alone, replacing, write
from trunk_ocp.cli import commands
from trunk_ocp.cli import solve as cli
from trunk_ocp.errors import InputError
from trunk_ocp.figures import draw_anatomy, write_film
from trunk_ocp.figures.errors import draw_errors
from trunk_ocp.motion_files import write_glb, write_sto, write_vtk
from trunk_ocp.planning import checkpoint
from trunk_ocp.planning.planner import plan_motion
from trunk_ocp.planning.storage import load_plan, save_plan
from trunk_ocp.problem.build import load_motion
from trunk_ocp.viewer import write_page

pytestmark = pytest.mark.slow

FAULTY = Path(__file__).parents[1] / "support" / "faulty.py"
SOLVE = [sys.executable, "-c", "from trunk_ocp.cli.commands import solve; solve()"]
ENVIRONMENT = os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}


def run(*arguments):
    """`solve-motion` in this process, without pictures."""
    return CliRunner().invoke(commands.solve, [*map(str, arguments), "--no-figures"])


def started(command, *arguments, **options):
    """A process of its own, without pictures; what it printed, and its exit code."""
    options = {"capture_output": True, "env": ENVIRONMENT, "timeout": 100} | options
    return subprocess.run([*command, *map(str, arguments), "--no-figures"], text=True, **options)


def struck(fault, moment, count, *arguments):
    words = (fault, moment, count, *arguments, "--no-figures")
    return run_script(FAULTY, words, timeout=100)


def bits(out):
    """All numbers of a run's results but seconds, by file and name."""
    found = {}
    for path in sorted(out.glob("*/solution.nc")):
        with xr.open_dataset(path, engine="scipy") as data:
            for name, array in data.variables.items():
                if array.dtype.kind in "fi":
                    found[path.parent.name, name] = array.values.tobytes()
            found[path.parent.name, "iterations"] = int(data.attrs["iterations"])
        found[path.parent.name, "csv"] = (path.parent / "activations.csv").read_bytes()
    return found


def leftovers(out):
    """Files that only an unfinished run has."""
    return [p.name for p in out.rglob("*") if p.name.startswith((".", "resume"))]


MODES = {
    "sequential": ("--mode", "sequential"),
    "horizon": ("--mode", "horizon"),
    "both": ("--mode", "both"),
    "receding": ("--lookahead", "2"),
}


@pytest.fixture(scope="module")
def problem(tmp_path_factory):
    return written(tmp_path_factory.mktemp("problem"), POINT)


@pytest.fixture(scope="module")
def whole(problem, tmp_path_factory):
    """Results of runs that nothing stopped."""
    found = {}
    for name, options in MODES.items():
        out = tmp_path_factory.mktemp(name)
        assert run(problem, "--out", out, *options).exit_code == 0
        assert leftovers(out) == []
        found[name] = bits(out)
    return found


@pytest.fixture(scope="module")
def plan(problem):
    return plan_motion(load_motion(problem), lookahead=1)


# --- killed --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("mode", "moment", "count"),
    [
        ("sequential", "keeping", 3),
        ("sequential", "solution.nc", 1),
        ("horizon", "window", 4),  # all of the sequential plan that it starts from
        ("horizon", "iteration", 43),  # amid the window of all steps
        ("receding", "window", 6),  # two windows after the sequential plan
        ("both", "comparison.json", 1),
    ],
)
def test_a_killed_run_is_resumed_to_the_same_bits(problem, whole, tmp_path, mode, moment, count):
    options = (problem, "--out", tmp_path, *MODES[mode])
    assert struck("KILL", moment, count, *options).returncode == -signal.SIGKILL
    assert any(name.startswith("resume") for name in leftovers(tmp_path))
    resumed = run(*options, "--resume")
    assert resumed.exit_code == 0, resumed.output
    assert bits(tmp_path) == whole[mode]
    assert leftovers(tmp_path) == []


def test_a_killed_run_loses_its_last_window_only(problem, tmp_path):
    options = (problem, "--out", tmp_path, "--mode", "sequential")
    struck("KILL", "window", 3, *options)
    begun = struck("KILL", "window", 1, *options, "--resume")  # the fourth, which is the last
    assert begun.returncode == -signal.SIGKILL
    with np.load(tmp_path / "sequential" / checkpoint.FILE, allow_pickle=False) as data:
        (stage,) = json.loads(data["progress"].tobytes())["stages"]
    assert stage["shapes"]["x"] == [4, 30]


def test_a_run_is_killed_twice_and_resumed_twice(problem, whole, tmp_path):
    options = (problem, "--out", tmp_path, "--mode", "both")
    struck("KILL", "window", 2, *options)
    assert struck("KILL", "window", 2, *options, "--resume").returncode == -signal.SIGKILL
    assert run(*options, "--resume").exit_code == 0
    assert bits(tmp_path) == whole["both"]


def test_what_draws_ends_with_a_killed_run(problem, tmp_path):
    """Processes of the pool would wait for work for ever."""
    command = [sys.executable, str(FAULTY), "KILL", "drawing", "1", str(problem)]
    mark = {"TRUNK_OCP_TEST": str(tmp_path)}
    ended = subprocess.run(
        [*command, "--out", str(tmp_path)], env=ENVIRONMENT | mark, capture_output=True, timeout=60
    )
    assert ended.returncode == -signal.SIGKILL
    assert load_plan(tmp_path / "horizon").status.name == "SOLVED"
    left = [1]
    for _ in range(100):
        left = [p for p in Path("/proc").glob("[0-9]*/environ") if str(tmp_path) in _text(p)]
        if not left:
            break
        time.sleep(0.1)
    assert left == []


def _text(path):
    try:
        return path.read_bytes().decode(errors="replace")
    except OSError:
        return ""


# --- resuming what is another run ----------------------------------------------------------


@pytest.fixture
def unfinished(problem, tmp_path, monkeypatch):
    """Folder with a problem file and a sequential run of it, ended after two windows."""
    shutil.copy(problem, tmp_path / "problem.toml")
    real, windows = checkpoint.Checkpoint.save, []

    def save(self, *arguments):
        real(self, *arguments)
        windows.append(self)
        if len(windows) == 2:
            raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(checkpoint.Checkpoint, "save", save)
        assert resume(tmp_path, anew=True).exit_code == 4
    return tmp_path


def resume(folder, *options, anew=False):
    chosen = options or ("--mode", "sequential")
    more = () if anew else ("--resume",)
    return run(folder / "problem.toml", "--out", folder / "out", *chosen, *more)


def refused(folder, *options):
    before = (folder / "out" / "sequential" / checkpoint.FILE).read_bytes()
    result = resume(folder, *options)
    assert result.exit_code == 2, result.output
    assert "without --resume" in result.stderr
    assert (folder / "out" / "sequential" / checkpoint.FILE).read_bytes() == before
    return result.stderr


def test_a_changed_problem_is_not_resumed(unfinished):
    written(unfinished, POINT.replace("duration = 0.5", "duration = 0.6"))
    assert "the problem changed (phases[2].duration: 0.5 -> 0.6)" in refused(unfinished)


def test_a_problem_with_fewer_steps_is_not_resumed(unfinished):
    written(unfinished, POINT.replace("steps = 2", "steps = 1", 1))
    assert "the problem changed (phases[1].steps: 2 -> 1)" in refused(unfinished)


def test_a_problem_with_another_comment_is_resumed(unfinished, whole):
    written(unfinished, "# the same motion\n" + POINT)
    assert resume(unfinished).exit_code == 0
    assert bits(unfinished / "out") == whole["sequential"]


def test_a_run_with_other_weights_is_not_resumed(unfinished):
    message = refused(unfinished, "--mode", "sequential", "--effort", "1e-3")
    assert "the problem changed (weights.effort: 1e-05 -> 0.001)" in message


def test_a_changed_anatomy_is_not_resumed(unfinished):
    shipped = Path(cli.__file__).parent.parent / "data" / "anatomies" / "asian-elephant.toml"
    text = shipped.read_text().replace("length = 1.75", "length = 1.76", 1)
    assert text != shipped.read_text()
    written(unfinished, text, "asian-elephant")
    assert "the anatomy changed (length: 1.75 -> 1.76)" in refused(unfinished)


def test_another_version_does_not_resume(unfinished, monkeypatch):
    known = checkpoint.versions()
    later = known | {"trunk_ocp": "99.0"}
    monkeypatch.setattr(checkpoint, "versions", lambda: later)
    told = f'the versions changed (trunk_ocp: "{known["trunk_ocp"]}" -> "99.0")'
    assert told in refused(unfinished)


def test_other_options_are_not_resumed(unfinished):
    told = refused(unfinished, "--mode", "sequential", "--max-iterations", "77")
    assert "the options changed (max_iterations: 1000 -> 77)" in told


def test_a_damaged_file_is_not_resumed(unfinished):
    path = unfinished / "out" / "sequential" / checkpoint.FILE
    content = path.read_bytes()
    for part in (content[: len(content) // 2], b"", content.replace(b"stages", b"stagse")):
        path.write_bytes(part)
        assert "cannot be read as an unfinished run" in refused(unfinished)


def test_nothing_to_resume_is_said_so(problem, tmp_path):
    result = run(problem, "--out", tmp_path / "out", "--resume")
    assert result.exit_code == 2
    assert "nothing to resume" in result.stderr
    assert not (tmp_path / "out").exists()


def test_a_run_without_resume_starts_anew(unfinished, whole):
    written(unfinished, POINT + "# changed\n")
    assert resume(unfinished, anew=True).exit_code == 0
    assert bits(unfinished / "out") == whole["sequential"]


def test_a_plan_from_another_start_is_not_resumed(problem, tmp_path):
    motion, path = load_motion(problem), tmp_path / "resume.npz"
    start = plan_motion(motion, 1)
    plan_motion(motion, start=start, checkpoint=checkpoint.Checkpoint(path))
    with pytest.raises(InputError, match="the plan that it starts from changed"):
        plan_motion(motion, checkpoint=checkpoint.Checkpoint(path, resume=True))


def test_a_motion_moved_in_python_is_not_resumed(problem, tmp_path):
    motion, path = load_motion(problem), tmp_path / "resume.npz"
    plan_motion(motion, 1, checkpoint=checkpoint.Checkpoint(path))
    moved, again = motion.shifted((0.01, 0.0, 0.0)), checkpoint.Checkpoint(path, resume=True)
    with pytest.raises(InputError, match=r"the problem changed \(phases\[1\]\.targets"):
        plan_motion(moved, 1, checkpoint=again)


# --- interrupted ---------------------------------------------------------------------------


@pytest.mark.parametrize(("moment", "count"), [("iteration", 30), ("window", 2)])
def test_an_interrupted_run_is_saved_and_resumed(problem, whole, tmp_path, moment, count):
    options = (problem, "--out", tmp_path, "--mode", "both")
    ended = struck("INT", moment, count, *options)
    assert (ended.returncode, ended.stderr) == (4, "")
    assert "Stopping" in ended.stdout
    command = f"solve-motion {problem} --mode both --out {tmp_path} --no-figures --resume"
    assert ended.stdout.count(f"Resume with: {command}\n") == 1
    assert load_plan(tmp_path / "sequential", throw=False).interrupted
    assert leftovers(tmp_path) == [checkpoint.FILE]
    assert run(*options, "--resume").exit_code == 0
    assert bits(tmp_path) == whole["both"]


@pytest.mark.parametrize("moment", ["reading", "comparison.json"])
def test_an_interrupt_before_and_after_planning_exits_4(problem, whole, tmp_path, moment):
    options = (problem, "--out", tmp_path, "--mode", "both")
    ended = struck("INT", moment, 1, *options)
    assert ended.returncode == 4
    assert "Traceback" not in ended.stderr
    if moment == "reading":
        assert "nothing more was saved" in ended.stderr
        assert leftovers(tmp_path) == []
    else:
        assert bits(tmp_path) == whole["both"]  # what was planned is saved to the end


def test_an_interrupt_before_the_first_step_leaves_what_is_there(problem, tmp_path):
    old = tmp_path / "sequential" / "summary.json"
    write(old, "of an earlier run")
    ended = struck("INT", "beginning", 1, problem, "--out", tmp_path, "--mode", "sequential")
    assert ended.returncode == 4
    assert "nothing more was saved" in ended.stderr
    assert [path.name for path in old.parent.iterdir()] == ["summary.json"]
    assert old.read_text() == "of an earlier run"


def test_a_plan_without_steps_is_not_saved(plan, tmp_path):
    empty = replace(plan, x=plan.x[:0], tip_forces=plan.tip_forces[:0], shape=plan.part(0, 0))
    with pytest.raises(InputError, match="no time steps"):
        save_plan(empty, tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_an_interrupt_while_drawing_leaves_the_plans(problem, whole, tmp_path):
    command = [sys.executable, str(FAULTY), "INT", "drawing", "1", str(problem), "--mode", "both"]
    ended = subprocess.run(
        [*command, "--out", str(tmp_path)], env=ENVIRONMENT, capture_output=True, timeout=60
    )
    assert (ended.returncode, ended.stderr) == (4, b"")
    assert b"Stopped drawing; the plans are saved." in ended.stdout
    assert bits(tmp_path) == whole["both"]
    assert leftovers(tmp_path) == []


@pytest.mark.parametrize(("moment", "count"), [("iteration", 20), ("solution.nc", 1)])
def test_a_second_interrupt_ends_at_once_and_leaves_no_half_file(problem, tmp_path, moment, count):
    options = (problem, "--out", tmp_path, "--mode", "sequential")
    ended = struck("TWICE", moment, count, *options)
    assert ended.returncode == 4
    assert "Traceback" not in ended.stderr
    command = f"solve-motion {problem} --mode sequential --out {tmp_path} --no-figures --resume"
    assert f"Resume with: {command}\n" in ended.stderr
    assert not (tmp_path / "sequential" / "solution.nc").exists()
    assert not [name for name in leftovers(tmp_path) if ".part" in name]


# --- no room -------------------------------------------------------------------------------

WRITERS = {
    "activations.csv": save_plan,
    "solution.nc": save_plan,
    "summary.json": save_plan,
    "motion.html": lambda plan, folder: write_page([plan], folder / "motion.html"),
    "motion.glb": lambda plan, folder: write_glb(plan, folder / "motion.glb"),
    "activations.sto": lambda plan, folder: write_sto(plan, folder / "activations.sto"),
    "muscles.pvd": write_vtk,
    "errors.png": lambda plan, folder: draw_errors(plan, folder, ["png"]),
    "anatomy-sections.pdf": lambda plan, folder: draw_anatomy(plan.motion.trunk, folder, ["pdf"]),
    "film.gif": write_film,
}


@pytest.mark.parametrize("name", WRITERS)
def test_a_full_disk_is_named_and_leaves_the_old_file(plan, tmp_path, monkeypatch, name):
    (tmp_path / name).write_text("what was there before")
    real = os.fsync

    def fsync(descriptor):
        file = Path(os.readlink(f"/proc/self/fd/{descriptor}")).name
        if file.startswith(f".{Path(name).stem}.") and file.endswith(Path(name).suffix):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        real(descriptor)

    monkeypatch.setattr(os, "fsync", fsync)
    monkeypatch.setattr("trunk_ocp.figures.film.MAX_FRAMES", 2)
    monkeypatch.setattr("trunk_ocp.figures.film.shutil.which", lambda program: None)
    with pytest.raises(InputError, match=rf"{name}: cannot be written \(No space left on device\)"):
        WRITERS[name](plan, tmp_path)
    assert (tmp_path / name).read_text() == "what was there before"
    assert leftovers(tmp_path) == []


@pytest.mark.parametrize("size", [3_000, 60_000])  # bytes: no checkpoint; no solution.nc
def test_a_run_without_room_says_so_and_is_resumed(problem, whole, tmp_path, size):
    options = (problem, "--out", tmp_path, "--mode", "sequential")
    limit = lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))
    ended = started(SOLVE, *options, preexec_fn=limit)
    assert ended.returncode == 2
    assert ended.stderr.startswith(f"Error: {tmp_path}/sequential/")
    assert "cannot be written (File too large)" in ended.stderr
    assert ("could not be resumed" in ended.stdout) == (size == 3_000)
    assert not [name for name in leftovers(tmp_path) if ".part" in name]
    resumed = run(*options, "--resume")
    assert resumed.exit_code == (2 if size == 3_000 else 0)
    if size == 60_000:
        assert bits(tmp_path) == whole["sequential"]


def test_a_comparison_that_cannot_be_written_exits_2(problem, tmp_path):
    (tmp_path / "comparison.json").mkdir()
    (tmp_path / "comparison.json" / "mine").touch()
    result = run(problem, "--out", tmp_path, "--mode", "both")
    assert result.exit_code == 2
    assert "comparison.json: cannot be written" in result.stderr
    assert load_plan(tmp_path / "horizon").converged


# --- no rights, no such place --------------------------------------------------------------


@pytest.mark.parametrize("place", ["/proc/results", "/sys/results", "/dev/null/results"])
def test_a_folder_that_cannot_be_written_to_exits_2(problem, place):
    """The kernel's own folders take no files, not even from root."""
    result = run(problem, "--out", place)
    assert result.exit_code == 2
    assert result.stderr.startswith(f"Error: {place}: ")
    assert "name another folder" in result.stderr


def test_a_file_in_place_of_the_folder_exits_2(problem, tmp_path):
    (tmp_path / "out").write_text("mine")
    assert run(problem, "--out", tmp_path / "out").exit_code == 2
    assert run(problem, "--out", tmp_path / "out" / "deeper").exit_code == 2
    assert (tmp_path / "out").read_text() == "mine"


def test_a_file_in_place_of_the_modes_folder_is_named_before_planning(problem, tmp_path):
    (tmp_path / "horizon").write_text("mine")
    result = run(problem, "--out", tmp_path)
    assert result.exit_code == 2
    assert f"{tmp_path}/horizon" in result.stderr
    assert "sequential" not in result.stdout  # the first thing that is solved


@pytest.mark.parametrize(
    "name", ["with spaces", "Rüssel 象", "[bold]markup[/]", "-", "a" * 200 + "/" + "b" * 200]
)
def test_folders_of_any_name_will_do(problem, whole, tmp_path, name):
    result = run(problem, "--out", tmp_path / name, "--mode", "sequential")
    assert result.exit_code == 0, result.output
    assert f"Results are in {tmp_path / name}/" in result.stdout
    assert bits(tmp_path / name) == whole["sequential"]


def test_a_name_too_long_for_the_system_exits_2(problem, tmp_path):
    result = run(problem, "--out", tmp_path / ("c" * 300))
    assert result.exit_code == 2
    assert "cannot be written to (File name too long)" in result.stderr


def test_writing_fails_without_a_trace(tmp_path):
    write(tmp_path / "file", "old")
    with contextlib.suppress(ZeroDivisionError), replacing(tmp_path / "file") as unfinished:
        unfinished.write_text("half of it")
        raise ZeroDivisionError
    assert [p.name for p in tmp_path.iterdir()] == ["file"]
    assert (tmp_path / "file").read_text() == "old"


# --- two runs ------------------------------------------------------------------------------


def test_the_second_run_into_a_folder_ends_with_a_message(problem, tmp_path):
    with alone(tmp_path):
        ended = started(SOLVE, problem, "--out", tmp_path)
    assert ended.returncode == 2
    assert f"{tmp_path}: another run is writing to this folder" in ended.stderr
    assert "--out" in ended.stderr
    assert list(tmp_path.iterdir()) == []


def test_two_runs_at_once_one_wins_and_one_is_told(problem, whole, tmp_path):
    command = [*SOLVE, str(problem), "--out", str(tmp_path), "--mode", "both", "--no-figures"]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    both = [subprocess.Popen(command, env=ENVIRONMENT, **pipes) for _ in range(2)]
    told = {}
    for process in both:
        _, error = process.communicate(timeout=100)
        told[process.returncode] = error
    assert set(told) <= {0, 2}  # one may have ended before the other began
    assert told[0] == ""
    assert "another run" in told.get(2, "another run")
    assert bits(tmp_path) == whole["both"]


# --- what may be missing -------------------------------------------------------------------


def test_a_missing_linear_solver_exits_2(problem, tmp_path):
    result = run(problem, "--out", tmp_path / "out", "--linear-solver", "ma57")
    assert result.exit_code == 2
    assert "linear solver 'ma57' is not available" in result.stderr
    assert "mumps" in result.stderr
    assert not (tmp_path / "out").exists()


def test_no_compiler_is_needed(problem, whole, tmp_path):
    bare = ENVIRONMENT | {"PATH": str(tmp_path / "nothing"), "CC": "/nonexistent/cc"}
    ended = started(SOLVE, problem, "--out", tmp_path, "--mode", "sequential", env=bare)
    assert (ended.returncode, ended.stderr) == (0, "")
    assert bits(tmp_path) == whole["sequential"]


def child(code, **options):
    """Output of a piece of Python in a process of its own."""
    options = {"capture_output": True, "env": ENVIRONMENT, "timeout": 100} | options
    return subprocess.run([sys.executable, "-c", code], text=True, **options)


def test_without_numba_all_but_the_shape_map_works():
    ended = child(
        "import sys; sys.modules['numba'] = None\n"
        "import trunk_ocp as to\n"
        "trunk = to.load_anatomy('asian-elephant')\n"
        "print(to.solve_statics(trunk, [0.0] * 28).position([1.75])[0, 0])\n"
        "try:\n    to.ShapeMap(trunk, to.Loads())\n"
        "except to.TrunkError as error:\n    print(error)\n"
    )
    number, sentence = ended.stdout.splitlines()
    assert float(number) == pytest.approx(0.6720968, abs=1e-6)  # DESIGN 2.10, printed
    assert "numba" in sentence
    assert "pip install" in sentence
    assert ended.stderr == ""


@pytest.mark.parametrize("left", ["DejaVu", "STIX"])
def test_pictures_need_the_font_that_matplotlib_brings_and_no_other(plan, tmp_path, left):
    save_plan(plan, tmp_path)
    ended = child(
        "from matplotlib.font_manager import fontManager as fonts\n"
        f"fonts.ttflist = [font for font in fonts.ttflist if {left!r} in font.name]\n"
        "from pathlib import Path\n"
        "import trunk_ocp as to, trunk_ocp.cli.solve\n"
        f"folder = Path({str(tmp_path)!r})\n"
        "from trunk_ocp.figures.errors import draw_errors\n"
        "try:\n"
        "    print(draw_errors(to.load_plan(folder), folder, ['png']))\n"
        "except to.TrunkError as error:\n"
        "    print(error)\n"
    )
    assert (ended.returncode, ended.stderr) == (0, "")
    assert (tmp_path / "errors.png").exists() == (left == "DejaVu")
    assert ("reinstall matplotlib" in ended.stdout) == (left == "STIX")


# --- places and terminals ------------------------------------------------------------------


@pytest.fixture(scope="module")
def comma(tmp_path_factory):
    """Environment in which the system writes 1,5 for 1.5, with a locale made for it if need be."""
    folder = tmp_path_factory.mktemp("locales")
    installed = subprocess.run(["locale", "-a"], capture_output=True, text=True).stdout.split()
    name = next((name for name in installed if name.startswith(("de_", "fr_", "es_"))), None)
    if name:
        return ENVIRONMENT | {"LC_ALL": name}
    needs("localedef")
    made = ["localedef", "-i", "de_DE", "-f", "UTF-8", str(folder / "de_DE.UTF-8")]
    subprocess.run(made, check=True, capture_output=True)
    return ENVIRONMENT | {"LC_ALL": "de_DE.UTF-8", "LOCPATH": str(folder)}


def test_files_have_points_where_the_locale_has_commas(problem, whole, comma, tmp_path):
    script = (
        "import locale; locale.setlocale(locale.LC_ALL, '')\n"
        "assert locale.format_string('%.1f', 1.5) == '1,5'\n"
        "from pathlib import Path; from trunk_ocp import load_plan, viewer\n"
        "from trunk_ocp.cli import commands\n"
        "try:\n    commands.solve()\n"
        "finally:\n    viewer.write_page([load_plan('horizon')], Path('page.html'))\n"
    )
    command = [sys.executable, "-c", script]
    options = ("--out", tmp_path, "--mode", "both")
    ended = started(command, problem, *options, env=comma, cwd=tmp_path)
    assert ended.returncode == 0, ended.stderr
    assert bits(tmp_path) == whole["both"]
    told = json.loads((tmp_path / "horizon" / "summary.json").read_text())
    assert told["timesteps"][0]["time"] == 0.5
    ours = write_page([load_plan(tmp_path / "horizon")], tmp_path / "ours.html")
    assert (tmp_path / "page.html").read_bytes() == ours.read_bytes()


@pytest.mark.parametrize("terminal", ["pipe", "script"])
def test_letters_that_the_output_lacks_do_no_harm(tmp_path, terminal):
    path = written(tmp_path, 'title = "Rüssel → 象"\n' + TOUCH)
    plain = ENVIRONMENT | {"LANG": "C", "LC_ALL": "C", "PYTHONIOENCODING": "ascii"}
    plain |= {"PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    command = SOLVE if terminal == "pipe" else _in_a_terminal()
    ended = started(command, path, "--out", tmp_path / "Rüssel", env=plain, errors="replace")
    assert ended.returncode == 0, ended.stdout + ended.stderr
    assert ended.stderr == ""
    assert "R?ssel" in ended.stdout
    assert load_plan(tmp_path / "Rüssel" / "horizon").verified


def _in_a_terminal():
    """solve-motion in a pseudo terminal, its live line included."""
    code = "import os, pty, sys; sys.exit(os.waitstatus_to_exitcode(pty.spawn(sys.argv[1:])))"
    return [sys.executable, "-c", code, *SOLVE]


def bare_environment(tmp_path):
    """No home, no terminal, and folders for settings that cannot be written to."""
    nowhere = {"MPLCONFIGDIR": "/proc/nowhere", "TERM": "dumb", "XDG_CACHE_HOME": "/proc/nowhere"}
    kept = {k: v for k, v in ENVIRONMENT.items() if k not in ("HOME", "COLUMNS", "TERM")}
    return kept | nowhere | {"HOME": "/proc/nowhere", "TMPDIR": str(tmp_path)}


def test_a_run_needs_neither_home_nor_terminal_nor_input(tmp_path):
    """Pictures and page included; nothing is said of settings that cannot be kept."""
    path, out = arm_file(tmp_path), tmp_path / "out"
    command = ["sh", "-c", f'exec "$@" --out {out} <&- >&- 2>{tmp_path}/errors', "sh", *SOLVE]
    ended = subprocess.run([*command, str(path)], env=bare_environment(tmp_path), timeout=100)
    assert ended.returncode == 0
    assert (tmp_path / "errors").read_text() == ""
    assert load_plan(out / "horizon").verified
    assert (out / "motion.html").exists()
    assert (out / "horizon" / "figures" / "shapes.png").read_bytes()[1:4] == b"PNG"


@pytest.mark.parametrize(
    ("reader", "options", "told"),
    [
        ("| head -1 >/dev/null", ("--no-figures",), ""),
        ("| :", ("--no-figures", "--json"), ""),
        (
            ">/dev/full",
            ("--no-figures",),
            "warning: standard output cannot be written (No space left on device).\n",
        ),
        (">/dev/full 2>&- <&-", ("--no-figures", "--json"), ""),
    ],
)
def test_output_that_nobody_takes_stops_nothing(tmp_path, reader, options, told):
    path, out = written(tmp_path, TOUCH), tmp_path / "out"
    command = f'{{ "$@"; echo $? >{tmp_path}/code; }} {reader}'
    ended = subprocess.run(
        ["sh", "-c", command, "sh", *SOLVE, str(path), "--out", str(out), *options],
        env=ENVIRONMENT,
        capture_output=True,
        text=True,
        timeout=100,
    )
    assert ended.stderr == told
    assert (tmp_path / "code").read_text() == "0\n"
    assert load_plan(out / "horizon").verified


def test_a_clock_that_jumps_changes_nothing(problem, whole, tmp_path):
    code = (
        "import random, sys, time; real = time.time\n"
        "time.time = lambda: real() + random.uniform(-1e9, 1e9)\n"
        "from trunk_ocp.cli import commands; commands.solve()\n"
    )
    command = [sys.executable, "-c", code]
    ended = started(command, problem, "--out", tmp_path, "--mode", "sequential")
    assert (ended.returncode, ended.stderr) == (0, "")
    assert bits(tmp_path) == whole["sequential"]
    told = json.loads((tmp_path / "sequential" / "summary.json").read_text())
    assert 0 < told["seconds"]["total"] < 100

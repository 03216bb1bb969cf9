"""How commands end: with the right exit code and a sentence, whatever happens around them."""

import contextlib
import errno
import io
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import click
import pytest
from click.testing import CliRunner
from plans import TOUCH, arm_file, written

import trunk_ocp
from trunk_ocp.cli import commands
from trunk_ocp.cli import run_figures as drawing
from trunk_ocp.cli import solve as cli
from trunk_ocp.cli.interrupts import Interrupts
from trunk_ocp.cli.option_types import Number, Numbers
from trunk_ocp.cli.safe_streams import SafeStream, safe_streams
from trunk_ocp.errors import InputError
from trunk_ocp.figures import FORMATS
from trunk_ocp.reporting import Reporter
from trust import interrupts as trials

pytestmark = pytest.mark.slow

ENVIRONMENT = os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}


def invoked(*arguments):
    return CliRunner().invoke(commands.main, [*map(str, arguments)])


def every_command():
    context = click.Context(commands.main)
    return {
        name: commands.main.get_command(context, name)
        for name in commands.main.list_commands(context)
    }


# --- quick to start ------------------------------------------------------------------------


@pytest.mark.parametrize("words", [["--help"], ["--version"], ["solve", "--help"]])
def test_help_is_there_without_importing_anything_large(words):
    code = (
        "import sys\n"
        "large = ('numpy', 'casadi', 'pydantic', 'xarray', 'rich.console')\n"
        "from trunk_ocp.cli.entry import trunk_ocp; trunk_ocp()\n"
        "print('large:', [n for n in large if n in sys.modules])\n"
    )
    ended = subprocess.run(
        [sys.executable, "-c", code, *words], capture_output=True, text=True, timeout=60
    )
    assert (ended.returncode, ended.stderr) == (0, "")
    assert "large: []" in ended.stdout


def test_the_list_of_commands_says_what_their_own_help_says():
    for name, about in commands.main.help_texts.items():
        own = " ".join(every_command()[name].help.split())
        assert own.startswith(about.rstrip("."))


def test_no_public_name_is_that_of_a_module():
    package = Path(trunk_ocp.__file__).parent
    modules = {path.stem for path in package.iterdir()}
    assert not modules & set(trunk_ocp.__all__)


# --- Ctrl-C --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("words", "delays", "number"),
    [
        (("tables",), (0.02,), signal.SIGINT),  # amid the imports
        (("schema",), (0.05,), signal.SIGTERM),
        (("optima", "problem.toml", "--out", "new"), (2.5,), signal.SIGINT),
        (("optima", "problem.toml", "--out", "new"), (3.0, 0.0), signal.SIGINT),
        (("solve", "problem.toml", "--out", "new"), (1.0, 0.1), signal.SIGINT),
    ],
)
def test_an_interrupted_command_says_so_and_exits_4(tmp_path, words, delays, number):
    (tmp_path / "problem.toml").write_text(trials.PROBLEM)
    ended = trials.struck(trials.COMMAND, words, tmp_path, delays, number)
    assert ended.code == 4, ended.errors
    assert "Traceback" not in ended.errors
    assert ended.errors.strip() or "Stopping" in ended.output


def test_a_second_ctrl_c_ends_native_code():
    """An eigenvalue problem of a minute, in which Python's own handlers do not run."""
    code = (
        "import numpy as np, os\n"
        "from trunk_ocp.cli.interrupts import Interrupts\n"
        "with Interrupts():\n"
        "    A = np.random.default_rng(1).normal(size=(4000, 4000))\n"
        "    os.write(2, b'begun\\n')\n"
        "    np.linalg.eigvals(A)\n"
    )
    ended = trials.struck(code, (), Path.cwd(), (0.3, 0.2), signal.SIGINT)
    assert ended.code == 4
    assert "Stopped immediately" in ended.errors


def destroy(things):
    things.clear()
    for _ in range(100):
        time.sleep(0.01)


@pytest.mark.parametrize("count", [1, 2])
def test_a_terminated_command_leaves_the_cursor_visible(tmp_path, count):
    """In a terminal of its own, whose live line hides it."""
    (tmp_path / "problem.toml").write_text(trials.PROBLEM)
    words = ["solve", "problem.toml", "--out", "new", "--no-figures"]
    process, terminal = os.forkpty()
    if process == 0:
        os.chdir(tmp_path)
        os.execve(sys.executable, [sys.executable, "-m", "trunk_ocp", *words], ENVIRONMENT)
    shown = b""
    with contextlib.suppress(OSError):  # the terminal ends with the process
        while b"iteration" not in shown:
            shown += os.read(terminal, 4096)
        for _ in range(count):
            os.kill(process, signal.SIGTERM)
            time.sleep(0.05)
        while more := os.read(terminal, 4096):
            shown += more
    os.close(terminal)
    assert os.waitstatus_to_exitcode(os.waitpid(process, 0)[1]) == 4
    assert b"\x1b[?25l" in shown
    assert shown.rfind(b"\x1b[?25h") > shown.rfind(b"\x1b[?25l")


class Clumsy:
    """Is interrupted while it is destroyed, where Python throws exceptions away."""

    def __del__(self):
        signal.raise_signal(signal.SIGINT)


def test_an_interrupt_in_a_destructor_is_not_lost():
    with Interrupts() as interrupts:
        with pytest.raises(KeyboardInterrupt):
            destroy([Clumsy()])
        assert interrupts.received


def test_an_interrupt_that_came_before_planning_stops_it():
    with Interrupts() as interrupts:
        interrupts.received = True
        reporter = Reporter()
        with interrupts.graceful_stop(reporter):
            assert reporter.stop


def handlers():
    return [signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM)], sys.unraisablehook


def test_handlers_are_as_before_after_a_command():
    before = handlers()
    assert invoked("schema").exit_code == 0
    assert handlers() == before


def test_an_error_that_native_code_makes_of_an_interrupt_is_one(monkeypatch):
    def reading(_):
        try:
            signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt:
            raise SystemError("<built-in> returned a result with an exception set") from None

    monkeypatch.setattr(cli, "load_anatomy", reading)
    result = invoked("tables")
    assert (result.exit_code, result.stderr) == (4, "Interrupted; nothing more was saved.\n")


# --- what fails after success --------------------------------------------------------------


def broken(*arguments, **options):
    raise ValueError("12 phases")


@pytest.fixture
def in_this_process(monkeypatch):
    monkeypatch.setattr(drawing, "PROCESSES", 1)


def test_a_picture_that_fails_is_a_warning_and_stops_no_other(
    tmp_path, monkeypatch, in_this_process
):
    monkeypatch.setattr(drawing, "PARTS", (broken, *drawing.PARTS[-1:]))
    out = ("--out", tmp_path / "out")
    result = invoked("solve", arm_file(tmp_path), *out, "--figures", "all")
    assert result.exit_code == 0, result.output
    assert (
        "warning: could not draw the horizon plan's broken: ValueError: 12 phases" in result.stderr
    )
    assert (tmp_path / "out" / "motion.html").exists()
    assert len([*(tmp_path / "out" / "horizon" / "figures").iterdir()]) == len(FORMATS)


def test_drawing_that_fails_as_a_whole_is_a_warning(tmp_path, monkeypatch):
    monkeypatch.setattr(drawing, "draw_run", broken)
    result = invoked("solve", arm_file(tmp_path), "--out", tmp_path / "out")
    assert result.exit_code == 0, result.output
    assert "warning: could not draw the figures; the plans are saved: ValueError" in result.stderr
    assert (tmp_path / "out" / "horizon" / "solution.nc").exists()


@pytest.mark.parametrize("error", [ValueError, MemoryError, RecursionError, OSError])
def test_a_main_figure_that_fails_is_a_sentence(tmp_path, monkeypatch, error):
    def draw_nothing(*arguments):
        raise error("12 phases")

    monkeypatch.setattr(drawing, "MAIN_PARTS", (draw_nothing, *drawing.MAIN_PARTS[-1:]))
    result = invoked("solve", arm_file(tmp_path), "--out", tmp_path / "out")
    assert result.exit_code == 0, result.output
    said = f"could not draw the horizon plan's nothing: {error.__name__}: 12 phases"
    assert said in result.stderr
    assert (tmp_path / "out" / "horizon" / "figures" / "errors.png").exists()
    assert (tmp_path / "out" / "motion.html").exists()


@pytest.mark.parametrize(
    ("name", "options"),
    [("explain", ()), ("compare", ("--mode", "both")), ("_film", ("--film",))],
)
def test_what_follows_a_saved_plan_may_fail(tmp_path, monkeypatch, name, options):
    monkeypatch.setattr(cli, name, broken)
    path = written(tmp_path, TOUCH)
    result = invoked("solve", path, "--out", tmp_path / "out", "--no-figures", *options)
    assert result.exit_code == 0, result.output
    assert "ValueError: 12 phases" in result.stderr
    assert "warning: " in result.stderr


def test_a_fault_of_our_own_is_a_sentence(monkeypatch):
    monkeypatch.setattr(cli, "load_anatomy", broken)
    result = invoked("tables")
    assert result.exit_code == 1
    assert "ValueError: 12 phases" in result.stderr
    assert "report it" in result.stderr


def test_too_little_memory_is_a_sentence(monkeypatch):
    def greedy(_):
        raise MemoryError

    monkeypatch.setattr(cli, "load_anatomy", greedy)
    result = invoked("tables")
    assert result.exit_code == 2
    assert "memory" in result.stderr


# --- standard output -----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("command", "reader", "code", "told"),
    [
        ("schema", ">/dev/full", 2, "standard output cannot be written (No space left on device)"),
        ("schema", "| :", 0, ""),
        ("tables", ">&-", 0, ""),
        ("schema", ">&- 2>&- <&-", 0, ""),
    ],
)
def test_what_only_prints_fails_where_nothing_can_be_printed(tmp_path, command, reader, code, told):
    run = f'{{ "$@"; echo $? >{tmp_path}/code; }} {reader}'
    words = [sys.executable, "-m", "trunk_ocp", command]
    ended = subprocess.run(
        ["sh", "-c", run, "sh", *words], env=ENVIRONMENT, capture_output=True, text=True, timeout=60
    )
    assert (tmp_path / "code").read_text() == f"{code}\n"
    assert "Traceback" not in ended.stderr
    assert told in ended.stderr
    assert bool(told) == bool(ended.stderr)


class Full(io.StringIO):
    """A device without room."""

    def fileno(self):
        return self.place.fileno()

    def write(self, text):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


@contextlib.contextmanager
def full_output(tmp_path, monkeypatch):
    stream = Full()
    stream.place = (tmp_path / "output").open("w")
    monkeypatch.setattr(sys, "stdout", stream)
    with stream.place, safe_streams() as output:
        yield output


def test_lost_output_is_an_error_where_it_is_all_there_is(tmp_path, monkeypatch):
    with full_output(tmp_path, monkeypatch) as output:
        print("something")
        with pytest.raises(InputError, match="No space left"):
            output.check()
        assert not output.lost  # said once


def test_a_reader_that_wants_no_more_is_no_error():
    stream = SafeStream(io.StringIO())
    stream.error = BrokenPipeError(errno.EPIPE, "Broken pipe")
    stream.check()
    assert not stream.lost


# --- numbers -------------------------------------------------------------------------------

NONSENSE = ("nan", "inf", "-1", "1e400", "x", "", "9" * 5000, "1" + "0" * 30)


def numeric_options():
    for name, command in every_command().items():
        for option in command.params:
            if isinstance(option.type, (Number, Numbers)):
                yield pytest.param(name, option, id=f"{name} {option.opts[-1]}")


@pytest.mark.parametrize(("command", "option"), [*numeric_options()])
def test_every_number_has_a_range(command, option):
    for text in NONSENSE:
        more = ["--to", "c"] if command == "export" else []
        result = invoked(command, "pick-fruit", f"{option.opts[-1]}={text}", *more)
        assert result.exit_code == 2, text
        assert option.opts[-1] in result.stderr
        assert len(result.stderr) < 400
        assert "Traceback" not in result.output


def test_no_option_takes_any_number():
    """Plain types of click know no range, and take what is not a number for one."""
    for command in every_command().values():
        for option in command.params:
            plain = (click.types.IntParamType, click.types.FloatParamType)
            assert not isinstance(option.type, plain), option.opts

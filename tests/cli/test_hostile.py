"""Bad input: never a traceback, never a hang, never a wrong answer called solved, no code run.

The strategies are those of `trust.inputs`, which tries many more; here are as many as fit into
a minute, always the same ones.
"""

import ast
import json
import os
import pickle
import re
import time
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import HealthCheck, given, settings
from plans import MOTIONS, POINT, REACH, ROD, TOUCH, shipped, written

import trunk_ocp
from trunk_ocp.cli import commands
from trunk_ocp.errors import InputError
from trunk_ocp.model.anatomy import load_anatomy
from trunk_ocp.model.loads import Loads
from trunk_ocp.planning import two_point, verification
from trunk_ocp.planning.labeled import dataset
from trunk_ocp.planning.options import Options
from trunk_ocp.planning.planner import plan_motion
from trunk_ocp.planning.status import Status
from trunk_ocp.planning.storage import load_plan, save_plan
from trunk_ocp.problem.build import load_motion
from trunk_ocp.rod.collocation import Mesh
from trunk_ocp.rod.statics import solve_statics
from trust import reference
from trust.answers import wrongs
from trust.inputs import cases
from trust.judge import Judge
from trust.trial import READING, tried

pytestmark = pytest.mark.slow

PACKAGE = Path(trunk_ocp.__file__).parent
GUARD = 30.0
"""Seconds that one case may take; each takes one or two, ten on a busy machine."""


def drawn(count):
    """Always the same examples, as many as asked for."""
    return settings(
        max_examples=count,
        derandomize=True,
        database=None,
        deadline=None,
        suppress_health_check=list(HealthCheck),
    )


# --- files drawn at random ---------------------------------------------------------------


@drawn(100)
@given(case=cases(("problem", "anatomy", "problem bytes", "anatomy bytes")))
def test_a_spoilt_file_is_refused_with_its_name_or_read(tmp_path_factory, recwarn, case):
    folder = tmp_path_factory.mktemp("case")
    for name, content in case.files.items():
        (folder / name).write_bytes(content)
    began, message = time.perf_counter(), None
    try:
        motion = load_motion(folder / "problem.toml")
    except InputError as error:
        message = str(error)
    if message is None:
        assert len(motion.steps) >= 1
    else:
        assert "problem.toml" in message
        assert len(message) < 10_000
    assert time.perf_counter() - began < GUARD
    assert not recwarn.list


@drawn(8)
@given(case=cases(("well-formed",)))
def test_a_well_formed_file_is_planned_and_what_is_called_solved_is(tmp_path_factory, case):
    verdict = case.judged(tmp_path_factory.mktemp("case"))
    assert not verdict.faults
    statuses = {status.name.lower() for status in Status}
    assert verdict.outcome in statuses | (
        {"refused"} if "passive-tip" in verdict.message else set()
    )


@drawn(60)
@given(case=cases(("solution",)))
def test_a_spoilt_solution_is_refused_or_is_a_plan(tmp_path_factory, case):
    verdict = case.judged(tmp_path_factory.mktemp("case"))
    assert not verdict.faults
    assert verdict.reading < GUARD


@drawn(8)
@given(case=cases(("problem", "anatomy", "problem bytes")))
def test_the_command_line_ends_with_a_code_and_a_message(tmp_path_factory, case):
    folder = tmp_path_factory.mktemp("case")
    for name, content in case.files.items():
        (folder / name).write_bytes(content)
    arguments = [folder / "problem.toml", "--out", folder / "out", "--max-iterations", 20]
    result = CliRunner().invoke(commands.solve, [*map(str, arguments), "--no-figures"])
    assert result.exit_code in (0, 2, 3, 4), result.output
    # A clean end, which click does not call an exception, or one on purpose.
    assert result.exit_code == 0 or isinstance(result.exception, SystemExit)
    assert "Traceback" not in result.output
    assert result.exit_code != 2 or "problem.toml" in result.stderr


# --- what is called solved is solved ------------------------------------------------------


@pytest.fixture(scope="module")
def touching(tmp_path_factory):
    """A plan of TOUCH."""
    return plan_motion(load_motion(written(tmp_path_factory.mktemp("touch"), TOUCH)))


@pytest.mark.parametrize("lookahead", [None, 1])
@pytest.mark.parametrize("text", [TOUCH, POINT], ids=["one step", "four steps"])
def test_a_solved_plan_is_solved_by_a_second_rod_code(tmp_path, text, lookahead):
    verdict = tried(written(tmp_path, text), lookahead)
    assert (verdict.outcome, verdict.checked, verdict.faults) == ("solved", True, [])


def test_a_solved_plan_is_solved_on_a_much_finer_mesh(touching):
    plan = touching
    trunk = plan.motion.trunk
    edges = np.unique([*np.linspace(0, trunk.length, 41), *trunk.edges])
    mesh = Mesh(tuple(edges.tolist()), 8)
    shape = solve_statics(trunk, plan.activations, plan.head, plan.loads, mesh)
    (target,) = tomllib.loads(TOUCH)["phases"][0]["targets"]
    tip = shape.position(np.array([target["Z"]]))[0, 0]
    assert np.linalg.norm(tip - target["position"]) <= 0.02  # the default tolerance
    assert plan.status is Status.SOLVED


@pytest.mark.parametrize(
    ("old", "new", "what"),
    [
        ("[0.6, 0.1, 1.2]", "[0.6, 0.1, 1.3]", "from its target"),
        ("[-3.0, 0.0]", "[-0.01, 0.0]", "bounds by"),
        ("[0.67, 1.35]", "[0.999, 1.001]", "extension"),
        ("[bounds]", "gravity = 0.0\n[bounds]", "not in equilibrium"),
        ("duration = 1.0", "duration = 1.0\nloads.tip_mass = 5.0", "not in equilibrium"),
        ("duration = 1.0", "duration = 1.0\nchange = [{ activation = 0.01 }]", "change by"),
    ],
)
def test_the_second_rod_code_finds_a_plan_of_another_problem_out(touching, old, new, what):
    assert any(what in wrong for wrong in wrongs(tomllib.loads(TOUCH.replace(old, new)), touching))


def test_the_second_rod_code_finds_nothing_wrong_with_the_plan_of_its_own_problem(touching):
    assert not wrongs(tomllib.loads(TOUCH), touching)


@pytest.mark.parametrize(("part", "wrong"), [("states", False), ("edges", True)])
def test_the_second_rod_code_judges_the_shape_not_its_moments(touching, part, wrong):
    """A plan 0.2 mm from its equilibrium is wrong; one whose moments are off by 0.1 % is not."""
    plan = touching
    values = getattr(plan.shape, part).copy()
    if part == "states":
        values[..., 4:] *= 1.001
    else:
        values[..., 1:, 0] += 2e-4
    found = wrongs(tomllib.loads(TOUCH), replace(plan, shape=replace(plan.shape, **{part: values})))
    assert len(found) == wrong
    assert all("not in equilibrium, off by 0.0002 m" in each for each in found)


@pytest.mark.parametrize("couple", [(0.0, 0.0, 0.0), (20.0, -10.0, 5.0)])
def test_the_judge_agrees_with_shooting_where_a_contact_bends_the_trunk(couple):
    trunk = load_anatomy("asian-elephant")
    load = Loads(9.8, (5.0, 0.0, 10.0), 1.3, (0.0, 30.0, 40.0), couple)
    activation = np.linspace(-1.5, 0.0, len(trunk.muscles))
    shape, head = solve_statics(trunk, activation, (0.1, -0.2), load), (0.1, -0.2)
    Z = np.array([0.0, 1.0, 1.5, trunk.length])
    rod = Judge(trunk, activation, np.array(head), load).solve(shape, Z)
    moment = reference.shoot(trunk, activation, head, load, shape.moment(np.zeros(1))[0])
    position, directors, _ = reference.march(trunk, activation, head, [load], moment, Z)
    for at, r, d in zip(Z, position[0], directors[0], strict=True):
        np.testing.assert_allclose(rod.at(at)[0], r, rtol=0, atol=1e-9)
        np.testing.assert_allclose(rod.at(at)[1], d, rtol=0, atol=1e-9)


def test_a_problem_comes_back_from_its_saved_plan(tmp_path):
    """File, motion, plan, folder and back: the same motion, the same plan."""
    path = written(tmp_path, ROD, "arm.toml")
    path = written(tmp_path, REACH + "position = [0.2, 0.1, 0.9]")
    motion = load_motion(path)
    plan = plan_motion(motion)
    save_plan(plan, tmp_path / "out")
    again = load_plan(tmp_path / "out")
    assert again.motion.spec == motion.spec
    assert again.motion.anatomy == motion.anatomy
    np.testing.assert_array_equal(again.x, plan.x)
    np.testing.assert_array_equal(again.shape.states, plan.shape.states)
    assert again.status is plan.status is Status.SOLVED


# --- numbers at the edge -----------------------------------------------------------------

NO_MUSCLE = ROD.split("muscles =")[0]
STILL = "activation = [0.0, 0.0]\nhead_z_deg = [0.0, 0.0]\nhead_y_deg = [0.0, 0.0]"
WIDE = "\n[tolerance]\nposition = 0.6\n"
FREE = REACH + "position = [0.1, 0.0, 0.9]" + WIDE


@pytest.mark.parametrize(
    ("problem", "anatomy"),
    [
        (FREE, NO_MUSCLE),
        (FREE, re.sub(r"(?m)^  .*low.*$", "", ROD)),
        (FREE.replace("activation = [-2.0, 0.0]", STILL), ROD),
        (FREE.replace("activation = [-2.0, 0.0]", STILL), NO_MUSCLE),
        (FREE.replace("[-2.0, 0.0]", "[-0.1, -0.1]"), ROD),
        (FREE.replace("[0.5, 1.5]", "[1.0, 1.0]"), ROD),
        (FREE.replace("position = [0.1", "position_weight = 0.0\nposition = [0.1"), ROD),
    ],
    ids=["no muscle", "one group", "nothing moves", "nothing can move", "equal bounds",
         "no stretch", "no weight"],
)  # fmt: skip
def test_little_freedom_is_freedom_enough(tmp_path, problem, anatomy):
    written(tmp_path, anatomy, "arm.toml")
    verdict = tried(written(tmp_path, problem))
    assert (verdict.outcome, verdict.checked, verdict.faults) == ("solved", True, [])


HUGE = {
    "tip force": ("duration = 1.0", "duration = 1.0\nloads.tip_force = [1e12, 0.0, 0.0]"),
    "gravity": ("[bounds]", "gravity = 1e6\n[bounds]"),
    "target": ("[0.6, 0.1, 1.2]", "[1e12, -1e12, 1e12]"),
    "weight": ("position =", "position_weight = 1e12\nposition ="),
    "hurry": ("duration = 1.0", "duration = 1e-12"),
    "leisure": ("duration = 1.0", "duration = 1e12"),
}


@pytest.mark.parametrize(("old", "new"), HUGE.values(), ids=HUGE)
def test_a_huge_number_ends_in_a_status(tmp_path, recwarn, old, new):
    plan = plan_motion(
        load_motion(written(tmp_path, TOUCH.replace(old, new))),
        options=Options(max_iterations=30),
        throw=False,
    )
    assert isinstance(plan.status, Status)
    if plan.status is Status.SOLVED:
        assert not wrongs(tomllib.loads(TOUCH.replace(old, new)), plan)
    assert not [w for w in recwarn.list if "trunk_ocp" in w.filename]


SIZES = ("1e308", "-1e308", "1e25", "1e-320", "1e-25", "nan", "inf", "-inf", "1" + 400 * "0")


@pytest.mark.parametrize("number", SIZES)
@pytest.mark.parametrize("key", ["gravity = 9.8", "position = 0.02", "Z = 1.75", "[-3.0, 0.0]"])
def test_a_number_beyond_all_sizes_is_refused_by_its_key(tmp_path, key, number):
    text = "gravity = 9.8\n" + TOUCH + "[tolerance]\nposition = 0.02\n"
    old = re.search(r"[\d.-]+", key).group()
    path = written(tmp_path, text.replace(key, key.replace(old, number, 1)))
    name = {"Z": "phases[1].targets[1].Z", "[": "bounds.activation"}.get(key[0], key.split()[0])
    with pytest.raises(InputError, match=r"expected|finite|greater|range|number") as caught:
        load_motion(path)
    assert name in str(caught.value)


@pytest.mark.parametrize("steps", [1001, 10**9, 10**400])
def test_more_steps_than_can_be_planned_are_refused(tmp_path, steps):
    path = written(tmp_path, TOUCH.replace("duration", f"steps = {steps}\nduration"))
    with pytest.raises(InputError, match=r"phases\[1\]\.steps"):
        load_motion(path)


def test_the_steps_of_all_phases_count_together(tmp_path):
    path = written(tmp_path, POINT.replace("steps = 2", "steps = 501"))
    with pytest.raises(InputError, match="1002 steps together"):
        load_motion(path)


@pytest.mark.parametrize("youngs_modulus", ["1.0e3", "1.0", "1.0e-6"])
def test_a_trunk_that_its_weight_crushes_is_told_by_its_passive_tip(tmp_path, youngs_modulus):
    """Weight that acts upward shortens a hanging trunk, at most to nothing."""
    written(tmp_path, ROD.replace("1.0e6", youngs_modulus), "arm.toml")
    target = 'position = [0.0, 0.0, 0.1]\norigin = "passive-tip"'
    path = written(tmp_path, f"gravity = -9.8\n{REACH}{target}")
    began = time.process_time()
    with pytest.raises(InputError, match=r"problem\.toml(?s:.*)passive trunk.*youngs_modulus"):
        load_motion(path)
    assert time.process_time() - began < READING


def test_a_rod_that_coils_without_end_is_given_up(tmp_path, monkeypatch):
    monkeypatch.setattr(two_point, "MAX_GROWTH", 0.0)
    monkeypatch.setattr(verification, "MAX_SLOPES", 10)
    plan = plan_motion(load_motion(written(tmp_path, TOUCH)), throw=False)
    assert plan.status is Status.UNVERIFIED
    assert np.isnan(plan.verification.position_difference).all()


# --- files that are none -----------------------------------------------------------------


def refused(path):
    began = time.perf_counter()
    with pytest.raises(InputError, match=re.escape(path.name)) as caught:
        load_motion(path)
    assert time.perf_counter() - began < GUARD
    return str(caught.value)


def test_what_is_no_regular_file_is_not_read(tmp_path):
    pipe, loop, zero = (tmp_path / name for name in ("pipe", "loop", "zero"))
    os.mkfifo(pipe)
    loop.symlink_to(loop)
    zero.symlink_to("/dev/zero")
    for path in (pipe, loop, zero, tmp_path, Path("/dev/zero"), Path("x" * 5000), Path("a\0b")):
        with pytest.raises(InputError):
            load_motion(path)
        with pytest.raises(InputError):
            load_anatomy(path)
        with pytest.raises(InputError):
            load_plan(path)
    (tmp_path / "solution.nc").symlink_to("/dev/zero")
    with pytest.raises(InputError, match="not a regular file"):
        load_plan(tmp_path)


@pytest.mark.parametrize("anatomy", ["/dev/zero", "pipe", "..", "", "x" * 150, "loop.toml"])
def test_an_anatomy_that_is_no_file_is_refused(tmp_path, anatomy):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "loop.toml").symlink_to("loop.toml")
    assert "anatomy" in refused(written(tmp_path, f'anatomy = "{anatomy}"\n' + TOUCH))


def test_a_problem_file_is_no_anatomy(tmp_path):
    assert "unknown key" in refused(written(tmp_path, 'anatomy = "problem.toml"\n' + TOUCH))


BYTES = {
    "several megabytes": b"# " + 5_000_000 * b"x",
    "deep lists": b"x = " + 5000 * b"[" + 5000 * b"]",
    "deep tables": b"x" + 5000 * b".x" + b" = 1",
    "deep inline tables": b"x = " + 5000 * b"{x=" + b"1" + 5000 * b"}",
    "a number of 5000 digits": b"steps = 1" + 5000 * b"0",
    "a long hexadecimal number": b"steps = 0x" + 5000 * b"f",
    "many unknown keys": b"".join(b"k%d = 1\n" % n for n in range(20_000)),
    "a long unknown key": 100_000 * b"k" + b" = 1",
    "many faulty entries": b"phases = [" + 50_000 * b"{}, " + b"]",
    "no text": bytes(range(256)),
    "another encoding": TOUCH.encode("utf-16"),
    "a NUL": TOUCH.encode() + b"\0",
    "nothing": b"",
}


@pytest.mark.parametrize("content", BYTES.values(), ids=BYTES)
def test_a_file_of_the_wrong_kind_is_refused_soon_and_briefly(tmp_path, content):
    (tmp_path / "odd.toml").write_bytes(content)
    assert len(refused(tmp_path / "odd.toml")) < 10_000


def test_what_other_editors_write_is_read(tmp_path):
    """A byte order mark, lines that end in two characters."""
    (tmp_path / "notepad.toml").write_bytes(
        b"\xef\xbb\xbf" + TOUCH.strip().replace("\n", "\r\n").encode()
    )
    assert load_motion(tmp_path / "notepad.toml").name == "touch"


# --- files are data ----------------------------------------------------------------------

CODE = "__import__('pathlib').Path('SENTINEL').touch()"


def test_nothing_in_a_problem_or_anatomy_file_is_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    phase = f'name = "{{0.__class__}} %s ${{x}} {CODE}"'
    text = TOUCH.replace('name = "reach"', phase)
    text = f'anatomy = "arm.toml"\ntitle = "{CODE} [/] [bold] {{title}}"\n' + text
    written(tmp_path, ROD.replace("soft-arm", CODE), "arm.toml")
    path = written(tmp_path, text.replace("Z = 1.75", "Z = 1.0"))
    result = CliRunner().invoke(commands.solve, [str(path), "--out", "[out]", "--no-figures"])
    assert result.exit_code in (0, 3), result.output
    assert CODE in result.stdout.replace("\n", "")
    for old, code in (("[-3.0, 0.0]", f'"{CODE}"'), ("1.75", f'"{CODE}"'), ("touch", CODE)):
        refused(written(tmp_path, TOUCH.replace(old, code)))
    assert not (tmp_path / "SENTINEL").exists()


@pytest.mark.parametrize("name", ["../../../../etc/passwd", "/etc/passwd", "{0}/x", "%s", "$HOME"])
def test_an_anatomy_elsewhere_is_read_as_data_or_not_at_all(tmp_path, name):
    message = refused(written(tmp_path, f'anatomy = "{name}"\n' + TOUCH))
    assert "root:" not in message


@pytest.mark.parametrize("text", ["red\\u001b[31m", "bell\\u0007", "two\\nlines", "\\u202ekcab"])
@pytest.mark.parametrize("key", ["title", "anatomy", "phase"])
def test_text_that_a_terminal_would_obey_is_refused(tmp_path, key, text):
    old = 'name = "reach"' if key == "phase" else "[bounds]"
    new = f'name = "{text}"' if key == "phase" else f'{key} = "{text}"\n[bounds]'
    message = refused(written(tmp_path, TOUCH.replace(old, new)))
    assert "control characters" in message
    assert message.replace("\n", "").isprintable()


def test_an_unknown_key_is_shown_without_its_control_characters(tmp_path):
    message = refused(written(tmp_path, '"\\u001b[2J" = 1\n' + TOUCH))
    assert message.replace("\n", "").isprintable()


class Planted:
    """Pickled, it would make a file when it is read."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return (Path.touch, (self.path,))


def test_nothing_in_a_solution_is_run(touching, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    sentinel = tmp_path / "SENTINEL"
    planted = pickle.dumps(Planted(sentinel))
    (tmp_path / "solution.nc").write_bytes(planted)
    with pytest.raises(InputError, match=r"solution\.nc"):
        load_plan(tmp_path)
    data = dataset(touching)
    for name, value in data.attrs.items():
        if isinstance(value, str):
            spoilt = data.assign_attrs({name: CODE})
            spoilt.to_netcdf(tmp_path / "solution.nc", engine="scipy")
            if name in ("title", "status", "source"):  # not what a plan is made from
                assert load_plan(tmp_path).status is Status.SOLVED
            else:
                with pytest.raises(InputError, match=r"solution\.nc"):
                    load_plan(tmp_path)
    assert not sentinel.exists()
    pickle.loads(planted)
    assert sentinel.exists()  # it would have


RUNS_CODE = {"eval", "exec", "compile", "__import__"}
STARTS_PROGRAMS = {"system", "popen", "import_module", "run_path"}
READS_OBJECTS = {"pickle", "cPickle", "dill", "joblib", "shelve", "marshal", "yaml", "subprocess"}


def test_the_package_has_no_way_to_run_what_it_reads():
    """Exceptions: `shooting_kernels` and `term_derivatives` run source that they wrote themselves,
    from the package's own symbols; numba compiles source only, and loads what it compiled from a
    folder that is the user's alone (`_support.compiled`). `run_checks` starts compilers and Octave,
    on exports just written, when a check is requested, and `webassembly` its compiler, on the
    package's own source; `film` only knows the error of matplotlib's writer.
    """
    found = set()
    for path in PACKAGE.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Call):
                plain, method = (getattr(node.func, kind, "") for kind in ("id", "attr"))
                found |= {(path.name, plain)} if plain in RUNS_CODE else set()
                found |= {(path.name, method)} if method in STARTS_PROGRAMS else set()
                for keyword in node.keywords:
                    off = isinstance(keyword.value, ast.Constant) and keyword.value.value is False
                    on = keyword.arg in ("allow_pickle", "shell") and not off
                    found |= {(path.name, str(keyword.arg))} if on else set()
            if isinstance(node, ast.Import | ast.ImportFrom):
                names = {alias.name.split(".")[0] for alias in node.names}
                names |= {(getattr(node, "module", None) or "").split(".")[0]}
                found |= {(path.name, name) for name in names & READS_OBJECTS}
    assert found == ALLOWED


ALLOWED = {
    ("shooting_kernels.py", "exec"),
    ("term_derivatives.py", "exec"),
    ("film.py", "subprocess"),
    ("run_checks.py", "subprocess"),
    ("webassembly.py", "subprocess"),
}


# --- slips of unit and sign --------------------------------------------------------------

# what | in the problem: old | new | what the warning must contain
SLIPS = r"""
positions in mm | [0.6, 0.1, 1.2] | [600.0, 100.0, 1200.0] | targets[1] & 600 & mm & 0.001
positions in cm | [0.6, 0.1, 1.2] | [60.0, 10.0, 120.0] | targets[1] & cm & 0.01
way points in mm | position = [0.6, 0.1, 1.2] | through = [[0.5, 600.0, 100.0, 900.0], [1.0, 600.0, 100.0, 1200.0]] | targets[1].through[2] = [1, 600, 100, 1200] & mm & 0.001
path in mm | position = [0.6, 0.1, 1.2] | path = [[600.0, 0.0, 900.0], [600.0, 100.0, 1200.0]] | targets[1].path[2] = [600, 100, 1200] & mm & 0.001
beyond reach | [0.6, 0.1, 1.2] | [5.0, 0.0, 0.0] | 5 m from the base & will be missed
percent | [-3.0, 0.0] | [-300.0, 0.0] | bounds.activation & percent & [-3, 0]
percent and wrong sign | [-3.0, 0.0] | [0, 100] | bounds.activation & percent & negative contracts; write [-1, 0]
wrong sign | [-3.0, 0.0] | [0.0, 3.0] | bounds.activation & negative contracts & [-3, 0]
one muscle's sign | [bounds] | [bounds]\nmuscles = { "*-dl" = [0.0, 2.0] } | *-dl & [-2, 0]
head in radians | [bounds] | [bounds]\nhead_z_deg = [-0.2, 0.2] | head_z_deg & radians & 11.4592
change in radians | duration = 1.0 | duration = 1.0\nchange = [{ head_y_deg = [-0.05, 0.05] }] | change[1].head_y_deg & radians
deviation in radians | duration = 1.0 | duration = 1.0\nauxiliary = { head_deviation_deg = 0.05 } | head_deviation_deg & radians
extension in percent | [0.67, 1.35] | [67.0, 135.0] | bounds.extension & percent
extension excluded | extension = [0.67, 1.35] | extension = [2.5, 3.0] | no plan can keep both & segment
change excluded | duration = 1.0 | duration = 1.0\nbounds = { activation = [-1.0, -0.5] }\nchange = [{ activation = 0.1 }] | R1-dl & no plan can keep both
gravity upwards | [bounds] | gravity = -9.8\n[bounds] | gravity & -9.8 & +Z points down
gravity in mm | [bounds] | gravity = 9800.0\n[bounds] | gravity & mm/s^2 & 9.8
tolerance in mm | [bounds] | tolerance = { position = 20.0 }\n[bounds] | tolerance.position & mm & 0.02
tolerance of meters | [bounds] | tolerance = { position = 5.0 }\n[bounds] | every point within 5 m & the trunk is 1.75 m long
jump of nothing | duration = 1.0 | duration = 1.0\nloads.jump = { pull = true, contact = true } | loads.jump.pull = true & no such load & nothing jumps
jump of no contact | duration = 1.0 | duration = 1.0\nloads.jump = { pull = true, contact = true } | loads.jump.contact = true & no such load
tolerance in degrees | [bounds] | tolerance = { direction = 3.0 }\n[bounds] | tolerance.direction & 0.052
duration in ms | duration = 1.0 | duration = 1500.0 | duration & ms & 1.5
mass in g | duration = 1.0 | duration = 1.0\nloads.tip_mass = 12000.0 | tip_mass & 12 for kg
log in g/cm^3 | duration = 1.0 | duration = 1.0\nloads.log = { contact_from = 1.4, radius = 0.07, length = 1.0, density = 0.8 } | density & 800 for kg
way points as a path | position = [0.6, 0.1, 1.2] | path = [[0.6, 0.1, 1.2], [0.7, 0.1, 1.2], [0.7, 0.2, 1.2], [0.6, 0.2, 1.2], [0.6, 0.1, 1.1]] | targets[1].path & 5 points & Bezier & through
way points beside steps, in words | position = [0.6, 0.1, 1.2] | through = [[0.25, 0.6, 0.1, 1.2], [1.0, 0.7, 0.1, 1.2]] | 1 of them lies between time steps
way points beside steps | position = [0.6, 0.1, 1.2] | through = [[0.25, 0.6, 0.1, 1.2], [1.0, 0.7, 0.1, 1.2]] | targets[1].through & 1 of them & steps = 4
way point at rest | position = [0.6, 0.1, 1.2] | through = [[0.0, 0.6, 0.1, 1.2], [1.0, 0.7, 0.1, 1.2]] | targets[1].through[1] & start of the motion & is ignored
nothing asked | Z = 1.75 | Z = 1.75\nposition_weight = 0.0 | every weight is 0
"""  # noqa: E501  # one row a slip


def rows():
    for line in SLIPS.strip().splitlines():
        what, old, new, pieces = (part.strip() for part in line.split(" | "))
        yield pytest.param(old, new.replace(r"\n", "\n"), pieces.split(" & "), id=what)


@pytest.mark.parametrize(("old", "new", "pieces"), list(rows()))
def test_a_slip_in_a_problem_file_is_planned_but_told(tmp_path, old, new, pieces):
    assert old in TOUCH
    path = written(tmp_path, TOUCH.replace(old, new, 1))
    warnings = load_motion(path).warnings
    fitting = [w for w in warnings if all(piece in w for piece in pieces)]
    assert fitting, warnings
    assert fitting[0].startswith(str(path))


ANATOMY_SLIPS = {
    "modulus in kPa": ("1.0e6", "1000.0", "youngs_modulus & kPa & 1e+06 for Pa"),
    "modulus in MPa": ("1.0e6", "1.0", "youngs_modulus & MPa & 1e+06 for Pa"),
    "density in g/cm^3": ("density = 1000.0", "density = 1.0", "density & g/cm^3 & 1000"),
    "length in mm": ("length = 1.0", "length = 1000.0", "length & mm or cm; write 1 or 10 for m"),
    "taper to a point": (
        "[material]",
        "taper_deg = 2.862\n[material]",  # atan(0.05) is 2.8624
        "taper_deg & nearly a point & write a smaller taper_deg",
    ),
    "taper in radians": (
        "[material]",
        "taper_deg = 0.04\n[material]",
        "taper_deg & radians & 2.29",
    ),
    "head in radians": (
        "[[segments]]",
        "head.xi_d_deg = 0.5236\n[[segments]]",
        "xi_d_deg & radians; 30.0",
    ),
    "muscles in one place": (
        "sector = [1.6, 3.1]",
        "sector = [1.0, 3.1]",
        "segments[1].muscles = R1-top and R1-low & they overlap & 0.02 to 0.05",
    ),
    "helix in radians": (
        'group = "low", architecture = "longitudinal"',
        'helix_deg = 0.5236, group = "low", architecture = "helical"',
        "segments[1].low.helix_deg & radians; 30.0",
    ),
}


@pytest.mark.parametrize(("old", "new", "pieces"), ANATOMY_SLIPS.values(), ids=ANATOMY_SLIPS)
def test_a_slip_in_an_anatomy_is_planned_but_told(tmp_path, old, new, pieces):
    assert old in ROD
    new_text = ROD.replace(old, new, 1)
    if "head." in new:
        new_text = ROD + "[head]\nxi_d_deg = 0.5236\n"
    written(tmp_path, new_text, "arm.toml")
    warnings = load_motion(written(tmp_path, FREE)).warnings
    fitting = [w for w in warnings if all(piece in w for piece in pieces.split(" & "))]
    assert fitting, warnings
    assert fitting[0].startswith(str(tmp_path / "arm.toml"))


def test_a_sector_in_degrees_is_refused_with_what_it_would_be(tmp_path):
    written(tmp_path, ROD.replace("sector = [0.0, 1.5]", "sector = [0.0, 99.0]"), "arm.toml")
    assert "would be [0.0000, 1.7279]" in refused(written(tmp_path, FREE))  # 99 pi / 180


def test_a_point_in_mm_is_refused_with_a_question(tmp_path):
    message = refused(written(tmp_path, TOUCH.replace("Z = 1.75", "Z = 1750.0")))
    assert "Is it in mm? Write 1.75." in message


@pytest.mark.parametrize("name", MOTIONS)
def test_no_shipped_motion_has_a_warning(name):
    assert shipped(name).warnings == ()


def test_the_command_line_prints_warnings_before_it_plans(tmp_path):
    path = written(tmp_path, TOUCH.replace("[bounds]", "[bounds]\nhead_z_deg = [-0.2, 0.2]"))
    result = CliRunner().invoke(commands.solve, [str(path), "--out", str(tmp_path), "--no-figures"])
    assert result.exit_code == 0, result.output
    assert result.stderr.startswith(f"warning: {path}: bounds.head_z_deg = [-0.2, 0.2]")
    assert json.loads((tmp_path / "horizon" / "summary.json").read_text())["status"] == "solved"


def test_there_are_no_more_warnings_than_one_reads(tmp_path):
    phase = TOUCH[TOUCH.index("[[phases]]") :].replace("duration = 1.0", "duration = 1e6")
    warnings = load_motion(written(tmp_path, TOUCH + 60 * phase)).warnings
    assert len(warnings) == 21
    assert "and 40 more" in warnings[-1]

"""A folder of results: of one problem file, and nothing in it says what is no longer so."""

import csv
import json
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner
from plans import POINT, TOUCH, written

from trunk_ocp.cli import commands
from trunk_ocp.motion_files import opensim
from trunk_ocp.motion_files.opensim import MAX_ROWS, sto_times
from trunk_ocp.planning.checkpoint import Checkpoint
from trunk_ocp.planning.planner import plan_motion
from trunk_ocp.planning.storage import load_plan, save_plan
from trunk_ocp.planning.tables import as_text
from trunk_ocp.problem.build import load_motion

pytestmark = pytest.mark.slow

FAR = TOUCH.replace("[0.6, 0.1, 1.2]", "[5.0, 0.1, 1.2]")
NEARBY = TOUCH.replace("[0.6, 0.1, 1.2]", "[0.6, 0.11, 1.2]")


def run(*arguments):
    return CliRunner().invoke(commands.solve, [*map(str, arguments), "--no-figures"])


def verb(*arguments):
    return CliRunner().invoke(commands.main, [*map(str, arguments)])


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def files(folder):
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


# --- two problems of one name ----------------------------------------------------------------


def test_another_file_of_the_same_name_does_not_replace_the_results(here):
    assert run(written(here, TOUCH, "a.toml")).exit_code == 0
    before = files(here / "results")
    result = run(written(here, NEARBY, "b.toml"))
    assert result.exit_code == 2
    for word in ("results/touch", "a.toml", "b.toml", "--out"):
        assert word in result.stderr
    assert files(here / "results") == before
    assert run("b.toml", "--out", "elsewhere").exit_code == 0
    assert files(here / "results") == before


@pytest.mark.parametrize("arguments", [("optima", "--starts", "0"), ("compare",), ("survey",)])
def test_no_other_command_replaces_them_either(here, arguments):
    assert run(written(here, TOUCH, "a.toml")).exit_code == 0
    written(here, NEARBY, "b.toml")
    result = verb(arguments[0], "b.toml", *arguments[1:])
    assert result.exit_code == 2
    assert "same name" in result.stderr


def test_an_edited_file_is_planned_again_without_a_word(here):
    for text in (TOUCH, NEARBY, TOUCH + "# the same again\n"):
        result = run(written(here, text, "a.toml"))
        assert (result.exit_code, result.stderr) == (0, "")
    assert verb("explain", "a.toml").exit_code == 0
    (here / "deeper").mkdir()
    assert run("deeper/../a.toml").exit_code == 0


def test_a_copy_of_the_file_is_the_same_problem(here):
    assert run(written(here, TOUCH, "a.toml")).exit_code == 0
    assert run(written(here, "# moved\n" + TOUCH, "b.toml")).exit_code == 0


def test_a_run_is_found_by_its_problem_file_or_refused_as_anothers(here):
    assert run(written(here, TOUCH, "a.toml")).exit_code == 0
    written(here, NEARBY, "b.toml")
    assert verb("explain", "a.toml").exit_code == 0
    assert verb("explain", "results/touch/horizon/solution.nc").exit_code == 0
    result = verb("explain", "b.toml")
    assert result.exit_code == 2
    assert "another problem with the same name" in result.stderr


def test_results_of_another_file_are_moved_aside_whole_and_the_folder_is_the_new_ones(here):
    """Named with --out, which no name protects."""
    assert run(written(here, TOUCH, "a.toml")).exit_code == 0
    assert run(written(here, NEARBY, "b.toml"), "--out", "results/touch").exit_code == 0
    out = here / "results" / "touch"
    earlier = load_plan(out / "earlier" / "horizon")
    assert earlier.motion.spec == load_motion(here / "a.toml").spec
    assert load_plan(out / "horizon").motion.spec == load_motion(here / "b.toml").spec
    result = verb("explain", "a.toml")
    assert result.exit_code == 2
    assert "another problem with the same name" in result.stderr
    assert verb("explain", "b.toml").exit_code == 0
    assert run("a.toml").exit_code == 2


def test_another_problem_in_the_same_folder_leaves_the_first_ones_plan(here):
    assert run(written(here, TOUCH, "a.toml"), "--out", "out").exit_code == 0
    (here / "out" / "source.json").unlink()  # as from an earlier version
    other = NEARBY.replace('name = "touch"', 'name = "other"')
    assert run(written(here, other, "b.toml"), "--out", "out").exit_code == 0
    assert load_plan(here / "out" / "earlier" / "horizon").motion.name == "touch"


def test_a_copy_of_the_file_moves_nothing_aside(here):
    assert run(written(here, TOUCH, "a.toml"), "--out", "out").exit_code == 0
    assert run(written(here, TOUCH, "b.toml"), "--out", "out").exit_code == 0
    assert not (here / "out" / "earlier").exists()


# --- what is out of date -----------------------------------------------------------------------


def drawn(out):
    """What a run with figures, and convert, leave beside a plan."""
    made = ["motion.html", "comparison.json", "figures/comparison.png", "figures/anatomy-x.pdf"]
    of_plan = ["motion.glb", "vtk/muscles.pvd", "vtk/muscles_0001.vtp", "figures/errors.pdf"]
    made += [f"horizon/{name}" for name in of_plan]
    mine = ["notes.txt", "horizon/mine.glb", "horizon/figures/mine.png", "horizon/vtk/mine.vtp"]
    for name in (*made, *mine):
        (out / name).parent.mkdir(parents=True, exist_ok=True)
        (out / name).write_text(name)
    return made, mine


def test_what_a_run_does_not_replace_is_moved_aside(here):
    out = here / "out"
    assert run(written(here, TOUCH), "--out", out, "--mode", "both").exit_code == 0
    made, mine = drawn(out)
    result = run(written(here, FAR), "--out", out)
    assert result.exit_code == 3
    assert f"{out}/earlier/" in result.stdout.replace("\n", "")
    for name in made:
        kept = out if name == "figures/anatomy-x.pdf" else out / "earlier"  # the same trunk
        assert (kept / name).read_text() == name
        assert (kept == out) or not (out / name).exists()
    for name in mine:
        assert (out / name).read_text() == name
    earlier = load_plan(out / "earlier" / "sequential")
    assert earlier.motion.spec == load_motion(written(here, TOUCH)).spec
    assert not (out / "sequential").exists()
    assert load_plan(out / "horizon", throw=False).missed


def test_the_same_plan_again_leaves_what_was_made_from_it(here):
    out = here / "out"
    assert run(written(here, TOUCH), "--out", out).exit_code == 0
    made, _ = drawn(out)
    assert run(written(here, TOUCH), "--out", out).exit_code == 0
    assert all((out / name).read_text() == name for name in made)
    assert not (out / "earlier").exists()


def test_saving_a_plan_from_python_moves_aside_what_was_made_from_another(here):
    plan, other = (
        plan_motion(load_motion(written(here, text)), lookahead=1) for text in (TOUCH, NEARBY)
    )
    save_plan(plan, "out/horizon")
    made = [name for name in drawn(here / "out")[0] if name.startswith("horizon/")]
    save_plan(plan, "out/horizon")  # the same: all stays
    assert all((here / "out" / name).exists() for name in made)
    save_plan(other, "out/horizon")
    for name in made:
        assert not (here / "out" / name).exists()
        kept = here / "out" / "horizon" / "earlier" / name.removeprefix("horizon/")
        assert kept.read_text() == name
    assert (here / "out" / "horizon" / "mine.glb").exists()


def unfinished(text, folder):
    """What a run leaves that ends before its plan is saved."""
    motion = load_motion(written(folder.parents[1], text, "unfinished.toml"))
    plan_motion(motion, 1, checkpoint=Checkpoint(folder / "resume.npz"))
    return (folder / "resume.npz").read_bytes()


def test_an_unfinished_run_is_kept_when_another_begins_in_its_place(here):
    content = unfinished(POINT, here / "out" / "sequential")
    result = run(written(here, POINT), "--out", "out", "--mode", "sequential")
    assert result.exit_code == 0
    kept = here / "out" / "earlier" / "sequential" / "resume.npz"
    assert kept.read_bytes() == content
    assert "out/earlier/" in result.stdout
    assert not (here / "out" / "sequential" / "resume.npz").exists()


def test_nothing_to_resume_names_the_unfinished_run_next_door(here):
    for name in ("sequential", "receding-2"):
        (here / "out" / name).mkdir(parents=True)
        (here / "out" / name / "resume.npz").write_bytes(b"PK")
    result = run(written(here, POINT), "--out", "out", "--lookahead", "3", "--resume")
    assert result.exit_code == 2
    assert "--lookahead 2 or --mode sequential" in result.stderr


def test_an_unfinished_run_of_another_problem_is_called_so(here):
    unfinished(POINT, here / "out" / "sequential")
    other = POINT.replace('name = "point"', 'name = "other"')
    result = run(written(here, other), "--out", "out", "--mode", "sequential", "--resume")
    assert result.exit_code == 2
    assert "unfinished run of point; expected one of other" in result.stderr


def test_a_folder_that_cannot_be_is_refused_with_where(here):
    result = run(written(here, TOUCH), "--out", "/proc/x")
    assert result.exit_code == 2
    assert "no folder can be created in /proc" in result.stderr


def test_what_was_moved_aside_before_is_never_replaced(here):
    out = here / "out"
    for text in (TOUCH, FAR, TOUCH):
        run(written(here, text), "--out", out, "--mode", "sequential")
        drawn(out)
    (out / "earlier" / "motion.html").write_text("older")
    run(written(here, FAR), "--out", out, "--mode", "sequential")
    assert (out / "earlier" / "motion.html").read_text() == "older"
    assert {path.name for path in out.glob("earlier*")} == {"earlier", "earlier-2", "earlier-3"}


def test_the_page_shows_only_plans_that_belong_together(here):
    for number, text in enumerate((TOUCH, NEARBY)):
        plan = plan_motion(load_motion(written(here, text)), lookahead=1 - number or None)
        save_plan(plan, here / "run" / ("sequential", "horizon")[number])
    result = verb("view", "run", "--no-browser")
    assert result.exit_code == 0
    assert "sequential: left out, as its problem" in result.stderr
    save_plan(plan, here / "alone" / "horizon")
    verb("view", "alone", "--no-browser")
    pages = [(here / name / "motion.html").read_bytes() for name in ("run", "alone")]
    assert pages[0] == pages[1]


def test_a_figure_that_a_question_does_not_draw_anew_is_moved_aside(here):
    assert run(written(here, TOUCH), "--out", "out").exit_code == 0
    figures = here / "out" / "horizon" / "figures"
    figures.mkdir()
    for name in ("redundancy.png", "errors.png", "mine.png"):
        (figures / name).write_text(name)
    assert verb("redundancy", "out", "--no-figures").exit_code == 0
    assert sorted(files(figures)) == ["earlier/redundancy.png", "errors.png", "mine.png"]


# --- texts of files --------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["=1+1", "+1", "-1", "@SUM(A1)", "＝1", " =1", "=HYPERLINK(1)"])  # noqa: RUF001
def test_a_phase_name_is_no_formula_to_a_spreadsheet(here, name):
    text = TOUCH.replace('name = "reach"', f'name = "{name}"')
    save_plan(plan_motion(load_motion(written(here, text))), here)
    with (here / "activations.csv").open(newline="", encoding="utf-8") as stream:
        _, _, row = csv.reader(stream)
    assert row[1] == f"'{name}"
    assert as_text("\tx") == "'\tx"
    assert as_text("lift - slowly") == "lift - slowly"


def test_markup_and_escapes_in_names_and_notes_are_shown_as_they_are(here):
    out = here / "[/y]"
    assert run(written(here, POINT), "--out", out).exit_code == 0
    plan = load_plan(out / "horizon")
    notes = ("[/nope] [red]x[/] \x1b[31mred\x1b]0;title\x07",)
    save_plan(replace(plan, notes=notes), out / "horizon")
    for arguments in (("explain",), ("redundancy", "--no-figures"), ("convert", "--to", "sto")):
        result = verb(arguments[0], out, *arguments[1:])
        assert result.exit_code == 0, result.output
        assert arguments[0] == "explain" or "[/y]" in result.output.replace("\n", "")
        assert "\x1b[31m" not in result.output
        assert "\x07" not in result.output
    told = verb("explain", out).output
    assert r"[/nope] [red]x[/] \x1b[31mred" in told


def test_what_is_wrong_with_a_file_reaches_the_terminal_as_text(here):
    out = here / "out"
    assert run(written(here, TOUCH), "--out", out).exit_code == 0
    path = out / "horizon" / "solution.nc"
    content = path.read_bytes()
    path.write_bytes(content.replace(b"activation\0\0", b"\x1b[31mxxxxx\0\0"))
    for command in ("explain", "view", "convert", "redundancy"):
        result = verb(command, out)
        assert result.exit_code == 2
        assert "\x1b" not in result.output


# --- long motions ------------------------------------------------------------------------------


@pytest.mark.parametrize("end", [0.004, 1.0, 999.0, 1e5, 1e9, 1e12])
def test_a_motion_of_any_length_has_a_bounded_number_of_rows(end):
    steps = end * (1 + np.arange(7)) / 7
    times = sto_times(steps)
    assert len(times) <= MAX_ROWS + 8
    assert (times[0], times[-1]) == (0.0, end)
    assert np.isin(steps, times).all()
    assert np.all(np.diff(times) > 0)


def test_a_motion_of_thirty_years_is_converted(here, monkeypatch):
    monkeypatch.setattr(opensim, "MAX_ROWS", 1000)  # as many would take seconds to write
    text = TOUCH.replace("duration = 1.0", "duration = 1e9")
    out = here / "out"
    assert run(written(here, text), "--out", out).exit_code == 0
    result = verb("convert", out)
    assert result.exit_code == 0, result.output
    with (out / "horizon" / "activations.sto").open() as stream:
        assert sum(1 for _ in stream) < 1030
    assert json.loads((out / "horizon" / "summary.json").read_text())["status"] == "solved"

"""Files: only what this program made is ever removed, and writers do not disturb each other."""

import os
import random
import time
from concurrent.futures import ThreadPoolExecutor

import pytest
from click.testing import CliRunner
from plans import TOUCH, written

from trunk_ocp._support import atomic_files as files
from trunk_ocp._support.atomic_files import alone, replacing, write
from trunk_ocp.cli import commands
from trunk_ocp.cli import solve as cli
from trunk_ocp.errors import InputError
from trunk_ocp.planning.planner import plan_motion
from trunk_ocp.planning.storage import load_plan, save_plan
from trunk_ocp.problem.build import load_motion

pytestmark = pytest.mark.slow

NAMES = (
    ".x.part", ".solution.123.part.nc", ".part", ".summary.4242.part.json", "..part.", ".lock",
    f".solution.trunk-ocp-{'0' * 32}.part.nc", f".x.trunk-ocp-{'f' * 32}.part", "resume (copy).npz",
    "resume.npz.bak", ".resume.npz", "notes.txt", "résumé.md", "summary.json.orig", "thesis.docx",
    "motion.html~", "mine.png", "muscles_1.vtp", "muscles.vtp", "source.json.bak", "-", "[y]",
)  # fmt: skip
FOLDERS = (
    ".", ".hidden", "horizon", "horizon/figures", "horizon/vtk", "figures", "earlier", "earlier/a",
    "sequential", "sequential-old", "earlier-2", "a/b/c/d", "receding-2", "horizon/.y.part",
)  # fmt: skip


@pytest.fixture(scope="module")
def plan(tmp_path_factory):
    return plan_motion(load_motion(written(tmp_path_factory.mktemp("problem"), TOUCH)))


def grown(folder, dice):
    """A random tree of a user's files in a folder; what they are."""
    made = {}
    for _ in range(dice.randint(1, 6)):
        place = folder / dice.choice(FOLDERS) / dice.choice([".", ".", f"own {dice.random()}"])
        path = place / dice.choice(NAMES)
        place.mkdir(parents=True, exist_ok=True)
        if not path.exists():
            path.write_bytes(dice.randbytes(9))
        made[path] = path.read_bytes()
    return made


def test_a_run_leaves_the_users_own_files_of_a_thousand_trees(tmp_path, monkeypatch, plan):
    """Planning itself is left out; all that runs do with files is done."""
    problem = written(tmp_path, TOUCH)
    monkeypatch.setattr(cli, "_plan", lambda *arguments: [plan])
    monkeypatch.setattr(cli, "_diagnose", lambda *arguments: None)
    for number in range(10):
        dice, out = random.Random(number), tmp_path / f"out{number}"
        trees = [grown(out, dice) for _ in range(100)]
        for _ in range(2):
            result = CliRunner().invoke(
                commands.solve, [str(problem), "--no-figures", "--out", str(out)]
            )
            assert result.exit_code == 0, result.output
        for path, content in (item for tree in trees for item in tree.items()):
            assert path.read_bytes() == content


def test_what_a_killed_writer_left_is_removed_and_what_is_being_written_is_not(tmp_path):
    place = tmp_path / "horizon" / "figures"
    place.mkdir(parents=True)
    dead, descriptor = files._created(place / "errors.png")
    os.close(descriptor)  # as the system does of a process that is killed
    files._unfinished.discard(dead)
    with replacing(place / "shapes.png") as living:
        living.write_text("half of it")
        with alone(tmp_path):
            assert not dead.exists()
            assert living.read_text() == "half of it"
    assert [path.name for path in place.iterdir()] == ["shapes.png"]


def test_threads_save_the_same_plan_into_one_folder(plan, tmp_path):
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(lambda _: save_plan(plan, tmp_path), range(8)))
    assert load_plan(tmp_path).status is plan.status
    assert len(list(tmp_path.iterdir())) == 3


def test_threads_see_whole_files_at_every_moment(tmp_path):
    path, texts = tmp_path / "file", {letter * 50_000 for letter in "abcd"}
    write(path, "a" * 50_000, lasting=False)
    end = time.monotonic() + 0.5

    def writes(text):
        while time.monotonic() < end:
            write(path, text, lasting=False)
        return True

    with ThreadPoolExecutor(4) as pool:
        running = [pool.submit(writes, text) for text in sorted(texts)]
        seen = set()
        while not all(task.done() for task in running):
            seen.add(path.read_text())
        assert all(task.result() for task in running)
    assert seen <= texts
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_a_name_as_long_as_names_may_be_can_be_written(tmp_path):
    path = tmp_path / ("n" * 250 + ".txt")
    assert write(path, "whole").read_text() == "whole"


def test_a_users_file_in_place_of_the_lock_is_kept_and_named(tmp_path):
    (tmp_path / files.LOCK).write_text("mine")
    with pytest.raises(InputError, match="is not a lock file of this program"), alone(tmp_path):
        pass
    assert (tmp_path / files.LOCK).read_text() == "mine"


def test_a_lock_that_a_killed_run_left_is_no_obstacle(tmp_path):
    (tmp_path / files.LOCK).touch()
    with alone(tmp_path):
        pass
    assert list(tmp_path.iterdir()) == []

"""Saved files from anybody: what they claim is held against the file, and none of it is obeyed."""

import io
import json
import os
import tracemalloc

import numpy as np
import pytest
from plans import TOUCH, written

from trunk_ocp._support.netcdf import read_netcdf
from trunk_ocp._support.provenance import fingerprint
from trunk_ocp._support.toml_files import printable
from trunk_ocp.errors import InputError
from trunk_ocp.planning.checkpoint import Checkpoint
from trunk_ocp.planning.labeled import dataset
from trunk_ocp.planning.options import Options
from trunk_ocp.planning.planner import plan_motion
from trunk_ocp.planning.status import Status
from trunk_ocp.planning.storage import load_plan, save_plan
from trunk_ocp.problem.build import load_motion
from trust import damaged

pytestmark = pytest.mark.slow


def test_damaged_files_are_refused_or_are_what_they_honestly_are(monkeypatch):
    """A few of what `trust.damaged` tries by the thousand, and times on a quiet machine."""
    monkeypatch.setattr(damaged, "SECONDS", float("inf"))
    report = damaged.run(120, seed=2)
    assert report["faults"] == []
    assert min(report["tried"].values()) > 40
    refused = sum(n for what, n in report["outcomes"].items() if what.endswith("refused"))
    assert refused > 60


# --- unfinished runs ---------------------------------------------------------------------------


def resumed(folder, change):
    """Resume the run of `trust.damaged` from a file whose texts a function has changed."""
    with np.load(io.BytesIO(damaged.originals().resume)) as data:
        arrays = {name: data[name] for name in data.files}
    progress = json.loads(arrays["progress"].tobytes())
    changed = change(progress)
    progress = progress if changed is None else changed
    arrays["progress"] = np.frombuffer(json.dumps(progress).encode(), np.uint8)
    np.savez(folder / "resume.npz", **arrays)
    checkpoint = Checkpoint(folder / "resume.npz", resume=True)
    return plan_motion(damaged.originals().motion, 1, checkpoint=checkpoint, throw=False)


def test_the_unfinished_run_itself_is_resumed(tmp_path):
    assert resumed(tmp_path, lambda progress: None).status is Status.SOLVED


def edit(*path, value):
    def change(progress):
        *outer, last = path
        for key in outer:
            progress = progress[key]
        progress[last] = value

    return change


@pytest.mark.parametrize(
    "change",
    [
        edit("stages", 0, "counters", "ipopt", value={"output_file": "outside"}),
        edit("stages", 0, "counters", "solve", value=0),
        edit("stages", 0, "counters", "iterations", value=-1),
        edit("stages", 0, "counters", "iterations", value="1"),
        edit("stages", 0, "counters", "solve_seconds", value=float("inf")),
        edit("stages", 0, "counters", value={}),
        edit("stages", 0, "shapes", "x", value=[10**12, 30]),
        edit("stages", 0, "shapes", "x", value=[-1, -30]),
        edit("stages", 0, "shapes", "more", value=[1]),
        edit("stages", 0, "mesh", "degree", value=True),
        edit("stages", 0, "mesh", "edges", value=[0.0, 1.75]),
        edit("stages", 0, "near", value=[1]),
        edit("stages", 0, "near", value=[[0]]),
        edit("stages", 0, "mode", value=["sequential"]),
        edit("stages", 0, "converged", value=1),
        edit("stages", 0, "failed", value=[{"stage": 1}]),
        edit("stages", value=[[]]),
        edit("stages", value=[None] * 100_000),
        edit("seconds", value=float("nan")),
        lambda progress: [progress],
        lambda progress: "x",
        lambda progress: json.loads("[" * 600 + "]" * 600),
    ],
)
def test_an_unfinished_run_with_other_keys_types_or_sizes_is_refused(tmp_path, change):
    with pytest.raises(InputError, match=r"resume\.npz: .*without --resume to start again"):
        resumed(tmp_path, change)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["resume.npz"]


def test_an_unfinished_run_that_is_compressed_is_refused(tmp_path):
    with np.load(io.BytesIO(damaged.originals().resume)) as data:
        np.savez_compressed(tmp_path / "resume.npz", **data)
    checkpoint = Checkpoint(tmp_path / "resume.npz", resume=True)
    with pytest.raises(InputError, match="without compression"):
        plan_motion(damaged.originals().motion, 1, checkpoint=checkpoint)


def read_resume(folder):
    checkpoint = Checkpoint(folder / "resume.npz", resume=True)
    return plan_motion(damaged.originals().motion, 1, checkpoint=checkpoint)


@pytest.mark.parametrize("make", [os.mkfifo, lambda path: path.symlink_to("/dev/zero")])
@pytest.mark.parametrize(
    ("name", "read"), [("resume.npz", read_resume), ("solution.nc", load_plan)]
)
def test_what_has_no_end_is_not_read(tmp_path, make, name, read):
    make(tmp_path / name)
    with pytest.raises(InputError, match="not a regular file"):
        read(tmp_path)


# --- saved plans -------------------------------------------------------------------------------


def refused(folder, data):
    data.to_netcdf(folder / "solution.nc", engine="scipy")
    with pytest.raises(InputError, match=r"solution\.nc: cannot be read as a plan") as caught:
        load_plan(folder, throw=False)
    assert printable(str(caught.value)) == str(caught.value)
    return str(caught.value)


def test_a_plan_is_read_from_its_file_as_well_as_from_its_folder(tmp_path):
    save_plan(damaged.originals().plan, tmp_path)
    for path in (tmp_path, str(tmp_path), tmp_path / "solution.nc", f"{tmp_path}/solution.nc"):
        np.testing.assert_array_equal(load_plan(path).x, damaged.originals().plan.x)
    with pytest.raises(InputError, match=r"elsewhere/solution\.nc: cannot be read"):
        load_plan(tmp_path / "elsewhere" / "solution.nc")


def test_only_steps_that_have_an_auxiliary_solution_may_be_near_one(tmp_path):
    """Else an edited file would be free of the bounds on change, and called solved."""
    data = damaged.originals().arrays
    elsewhere = data["near_activation"] - 3.5
    assert "violates its bounds" in refused(tmp_path, data.assign(near_activation=elsewhere))
    loose = json.loads(data.attrs["problem_json"])
    loose["phases"][0]["auxiliary"] = None
    spec = type(damaged.originals().motion.spec).model_validate_json(json.dumps(loose))
    honest = fingerprint(spec)
    edited = data.assign_attrs(problem_json=spec.model_dump_json(), problem_sha256=honest)
    assert "has no auxiliary solution" in refused(tmp_path, edited)
    assert "sequential" in refused(tmp_path, data.assign_attrs(plan_mode="horizon", lookahead=2))


@pytest.mark.parametrize("elements", [300, 1200])
def test_a_mesh_that_would_fill_the_memory_is_refused(tmp_path, elements):
    assert "nodes" in refused(tmp_path, damaged._finer(damaged.originals().arrays, elements))


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("solves", '[{"stage": "horizon"}]'),
        ("solves", "[[1, 2, 3]]"),
        ("solves", "[" * 5000 + "]" * 5000),
        ("solves", "[" + "[]," * 500_000 + "0]"),
        ("notes", '{"a": 1}'),
        ("notes", "[1]"),
        ("versions", '{"python": 3}'),
        ("options", "[]"),
        ("options", "1" * 5000),
    ],
)
def test_records_of_other_kinds_are_refused(tmp_path, name, text):
    data = damaged.originals().arrays
    assert refused(tmp_path, data.assign_attrs({f"{name}_json": text}))


def test_notes_and_records_of_solves_hold_nothing_that_a_terminal_obeys(tmp_path):
    data = damaged.originals().arrays
    solves = json.loads(data.attrs["solves_json"])
    solves[0]["detail"] = solves[0]["message"] = "\x1b]0;title\x07\u202e"
    changed = data.assign_attrs(
        notes_json=json.dumps(["\x1b[2J\nsolved"]), solves_json=json.dumps(solves)
    )
    changed.to_netcdf(tmp_path / "solution.nc", engine="scipy")
    plan = load_plan(tmp_path, throw=False)
    texts = [*plan.notes, plan.solves[0].detail, plan.solves[0].message]
    assert all(text.isprintable() for text in texts)
    assert plan.notes == (r"\x1b[2J\nsolved",)


def test_arrays_that_share_their_numbers_are_refused():
    """A header of a kilobyte may name the same megabytes many times."""
    numbers = bytes(800_000)
    entry = b"\0\0\0\1%b\0\0\0\0\0\0\1\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\6\0\0\0\0\0\0\4\0"
    header = b"CDF\1\0\0\0\0" + b"\0\0\0\n\0\0\0\1" + b"\0\0\0\1n\0\0\0" + b"\0\1\x86\xa0"
    variables = b"".join(entry % bytes([97 + i]) for i in range(20))
    content = header + b"\0" * 8 + b"\0\0\0\v\0\0\0\x14" + variables
    content += b"\0" * (1024 - len(content)) + numbers
    with pytest.raises(InputError, match="its arrays overlap"):
        read_netcdf(content)


def test_a_users_file_of_the_same_name_is_not_taken_for_an_unfinished_run(tmp_path):
    np.savez(tmp_path / "resume.npz", mine=np.arange(3))
    before = (tmp_path / "resume.npz").read_bytes()
    checkpoint = Checkpoint(tmp_path / "resume.npz")
    with pytest.raises(InputError, match="is not a file of an unfinished run"):
        plan_motion(damaged.originals().motion, 1, checkpoint=checkpoint)
    assert (tmp_path / "resume.npz").read_bytes() == before


@pytest.mark.parametrize(
    "left", [lambda: b"", lambda: bytes(4096), lambda: damaged.originals().resume[:500]]
)
def test_what_a_power_cut_left_of_an_unfinished_run_is_replaced(tmp_path, left):
    (tmp_path / "resume.npz").write_bytes(left())
    checkpoint = Checkpoint(tmp_path / "resume.npz")
    plan_motion(damaged.originals().motion, 1, checkpoint=checkpoint)
    checkpoint.remove()
    assert list(tmp_path.iterdir()) == []


def test_records_too_long_to_be_read_are_saved_without_their_histories(tmp_path, monkeypatch):
    plan = damaged.originals().plan
    monkeypatch.setattr("trunk_ocp.planning.records.MAX_BRACKETS", 30)
    save_plan(plan, tmp_path)
    again = load_plan(tmp_path)
    assert [s.message for s in again.solves] == [s.message for s in plan.solves]
    assert all(len(solve.history) == 1 for solve in again.solves)


def test_a_users_file_beside_an_unfinished_run_is_left_alone(tmp_path):
    """What `save` replaces is looked at before a run goes on, not only what it reads."""
    (tmp_path / "resume-newer.npz").write_bytes(damaged.originals().resume)
    np.savez(tmp_path / "resume.npz", mine=np.arange(3))
    before = (tmp_path / "resume.npz").read_bytes()
    with pytest.raises(InputError, match=r"resume\.npz: is not a file of an unfinished run"):
        read_resume(tmp_path)
    assert (tmp_path / "resume.npz").read_bytes() == before


# --- sizes: what a file can make its reader build ----------------------------------------------

MEMORY = 50_000_000
"""Bytes of Python objects while a file of two million characters is refused."""


def peak(work):
    """Most memory that Python objects took meanwhile, bytes."""
    tracemalloc.start()
    try:
        work()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize(
    "edit",
    [
        lambda spec: spec.update({f"k{i}": 0 for i in range(50_000)}),
        lambda spec: spec.update({f"k{i}": 0 for i in range(150_000)}),
        lambda spec: spec.update(phases=[{}] * 15_000),
        lambda spec: spec.update(phases=[{}] * 600_000),
        lambda spec: spec["phases"][0].update(targets=[1] * 40_000),
    ],
)
def test_a_problem_of_nothing_but_faults_is_refused_in_little_memory(tmp_path, edit):
    data = dataset(damaged.originals().plan)
    spec = json.loads(data.attrs["problem_json"])
    edit(spec)
    data.attrs["problem_json"] = json.dumps(spec)
    data.to_netcdf(tmp_path / "solution.nc", engine="scipy")

    def load():
        with pytest.raises(InputError, match=r"faults|too large") as caught:
            load_plan(tmp_path)
        assert len(str(caught.value)) < 1000

    assert peak(load) < MEMORY


def test_records_and_texts_without_end_are_refused_before_they_are_read(tmp_path):
    for attributes in (
        {"notes_json": json.dumps(["x" * 9_000_000])},
        {
            "notes_json": json.dumps(["x" * 6_000_000]),
            "options_json": f'{{"a": "{"x" * 6_000_000}"}}',
        },
        {"options_json": '{"a": [' + ",".join(["[]"] * 200_000) + "]}"},
        {f"more{number}": "x" * 6_000_000 for number in range(3)},
    ):
        assert "too large" in refused(
            tmp_path, dataset(damaged.originals().plan).assign_attrs(attributes)
        )


def test_a_fault_of_a_saved_problem_is_told_by_its_key(tmp_path):
    data = dataset(damaged.originals().plan)
    spec = json.loads(data.attrs["problem_json"])
    spec["phases"][0]["duration"] = "long"
    data.attrs["problem_json"] = json.dumps(spec)
    assert "no valid problem (phases.0.duration: " in refused(tmp_path, data)


def test_an_identity_with_any_number_of_changes_is_refused_with_a_few(tmp_path):
    with np.load(io.BytesIO(damaged.originals().resume)) as data:
        arrays = dict(data)
    identity = json.loads(arrays["identity"].tobytes())
    identity["problem"] |= {f"k{i}": 0 for i in range(100_000)}
    identity["problem_sha256"] = "0"
    arrays["identity"] = np.frombuffer(json.dumps(identity).encode(), np.uint8)
    np.savez(tmp_path / "resume.npz", **arrays)
    with pytest.raises(InputError, match="and more") as caught:
        read_resume(tmp_path)
    assert str(caught.value).count("->") == 3


def test_failures_too_long_to_be_read_are_kept_without_their_histories(tmp_path, monkeypatch):
    """So that the run can be resumed at all."""
    motion = load_motion(written(tmp_path, TOUCH.replace("[0.6, 0.1, 1.2]", "[5.0, 0.1, 1.2]")))
    options = Options(max_iterations=1)
    monkeypatch.setattr(
        "trunk_ocp.planning.checkpoint.fits", lambda text: '"history": [[' not in text
    )
    made = plan_motion(
        motion, 1, options, checkpoint=Checkpoint(tmp_path / "resume.npz"), throw=False
    )
    with np.load(tmp_path / "resume.npz") as data:
        failed = json.loads(data["progress"].tobytes())["stages"][0]["failed"]
    assert [solve["history"] for solve in failed] == [[]]
    again = Checkpoint(tmp_path / "resume.npz", resume=True)
    plan = plan_motion(motion, 1, options, checkpoint=again, throw=False)
    assert plan.status is made.status
    assert np.array_equal(plan.x, made.x)


def test_a_folder_of_plans_is_refused_with_the_plans_in_it(tmp_path):
    for name in ("horizon", "sequential"):
        save_plan(damaged.originals().plan, tmp_path / name)
    with pytest.raises(InputError) as caught:
        load_plan(tmp_path)
    assert f"expected {tmp_path / 'horizon'} or {tmp_path / 'sequential'}" in str(caught.value)
    with pytest.raises(
        InputError, match=r"solution\.nc: cannot be read as a plan \(no such file\)"
    ):
        load_plan(tmp_path / "receding-3")

"""Plans on disk: nothing is lost, everything is labeled, nothing broken is believed."""

import csv
import json
import math
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from plans import POINT, shipped, written

from trunk_ocp.errors import InputError
from trunk_ocp.planning.labeled import dataset
from trunk_ocp.planning.options import Options
from trunk_ocp.planning.planner import plan_motion
from trunk_ocp.planning.status import Status
from trunk_ocp.planning.storage import load_plan, save_plan, summary
from trunk_ocp.problem.build import load_motion
from trunk_ocp.reporting import Reporter

SECONDS = ("setup_seconds", "solve_seconds", "derivative_seconds", "total_seconds")


class Stop(Reporter):
    """Ends a plan after some iterations."""

    def __init__(self, after):
        self.left = after

    def iteration(self, progress):
        self.left -= 1
        self.stop = self.left <= 0


@pytest.fixture(scope="module")
def plans(tmp_path_factory):
    """A solved plan with auxiliary solutions, an unconverged one, and one cut short."""
    folder = tmp_path_factory.mktemp("problem")
    motion = load_motion(written(folder, POINT))
    log = shipped("lift-log")
    spec = log.spec.model_copy(update={"phases": log.spec.phases[:2]})
    lift = replace(log, spec=spec, phases=log.phases[:2], steps=log.steps[:2])
    made = {
        "solved": plan_motion(lift, lookahead=1),
        "unconverged": plan_motion(motion, options=Options(max_iterations=2), throw=False),
        "cut short": plan_motion(motion, lookahead=1, reporter=Stop(40), throw=False),
    }
    made["cut short"] = replace(made["cut short"], notes=("stopped by hand",))
    return made


KINDS = ("solved", "unconverged", "cut short")


@pytest.mark.parametrize("kind", KINDS)
def test_a_plan_comes_back_exactly(plans, tmp_path, kind):
    plan = plans[kind]
    save_plan(plan, tmp_path / "deep" / "folder")
    again = load_plan(tmp_path / "deep" / "folder", throw=False)
    for name in ("x", "tip_forces"):
        np.testing.assert_array_equal(getattr(again, name), getattr(plan, name))
    for name in ("states", "edges", "slopes"):
        np.testing.assert_array_equal(getattr(again.shape, name), getattr(plan.shape, name))
    assert again.auxiliary.keys() == plan.auxiliary.keys()
    for step, near in plan.auxiliary.items():
        np.testing.assert_array_equal(again.auxiliary[step], near)
    for name in ("lookahead", "mode", "weights", "mesh", "loads", "converged", "interrupted"):
        assert getattr(again, name) == getattr(plan, name)
    for name in (*SECONDS, "iterations", "notes", "solves"):
        assert getattr(again, name) == getattr(plan, name)
    assert again.motion.spec == plan.motion.spec
    assert again.motion.trunk == plan.motion.trunk
    assert again.status is plan.status
    assert again.objective == plan.objective


def test_the_kinds_are_what_they_say(plans):
    expected = (Status.SOLVED, Status.ITERATION_LIMIT, Status.INTERRUPTED)
    assert tuple(plans[kind].status for kind in KINDS) == expected
    assert set(plans["solved"].auxiliary) == {0, 1}
    assert 0 < len(plans["cut short"].x) < 4


@pytest.mark.parametrize("kind", KINDS)
def test_the_spreadsheet_has_a_row_for_each_step_and_rest(plans, tmp_path, kind):
    plan = plans[kind]
    save_plan(plan, tmp_path)
    with (tmp_path / "activations.csv").open(newline="") as stream:
        head, rest, *rows = csv.reader(stream)
    trunk = plan.motion.trunk
    if kind != "solved":
        marks = [row.pop() for row in (head, rest, *rows)]
        assert marks == ["status", *[plan.status.name.lower()] * (len(rows) + 1)]
    assert head == ["time_s", "phase", *trunk.muscles, "psi_z_rad", "psi_y_rad"]
    assert [float(value) for value in (rest[0], *rest[2:])] == 31 * [0.0]
    assert len(rows) == len(plan.x)
    numbers = np.array([[float(value) for value in (row[0], *row[2:])] for row in rows])
    np.testing.assert_allclose(numbers[:, 0], plan.motion.times[: len(rows)], rtol=1e-8)
    np.testing.assert_allclose(numbers[:, 1:], plan.x, rtol=1e-8)  # nine digits are written
    names = [plan.motion.phases[step.phase].name for step in plan.motion.steps]
    assert [row[1] for row in rows] == names[: len(rows)]


@pytest.mark.parametrize("kind", KINDS)
def test_the_summary_has_every_key_of_the_public_face(plans, tmp_path, kind):
    plan = plans[kind]
    save_plan(plan, tmp_path)
    report = json.loads((tmp_path / "summary.json").read_text())
    assert report["problem"] == plan.motion.name
    assert report["mode"] == plan.mode
    assert report["lookahead"] == plan.lookahead
    assert report["status"] == plan.status.name.lower()
    assert report["verified"] is plan.verified
    assert report["iterations"] == plan.iterations
    assert set(report["seconds"]) == {"setup", "solve", "derivatives", "total"}
    steps = report["timesteps"]
    assert len(steps) == len(plan.x)
    for step in steps:
        assert {"time", "objective", "position_error", "tangent_error"} <= set(step)
    assert report["objective"] == pytest.approx(sum(step["objective"] for step in steps))
    worst = max(max(step["position_error"]) for step in steps)
    assert report["max_position_error"] == worst
    assert report["max_verification_error"] == plan.verification.position_difference.max()


def test_the_summary_is_strict_json_even_where_a_number_is_not_finite(plans):
    plan = replace(plans["solved"], total_seconds=math.nan, solve_seconds=math.inf)
    report = json.loads(json.dumps(summary(plan), allow_nan=False))
    assert report["seconds"]["total"] is None
    assert report["seconds"]["solve"] is None


def test_the_solution_is_labeled(plans, tmp_path):
    plan = plans["solved"]
    save_plan(plan, tmp_path)
    with xr.open_dataset(tmp_path / "solution.nc", engine="scipy") as data:
        assert data["time"].values.tolist() == plan.motion.times.tolist()
        by_name = data["activation"].sel(muscle="L3-vr").values
        np.testing.assert_array_equal(by_name, plan.x[:, 27])
        np.testing.assert_array_equal(data["head"].sel(angle="psi_y").values, plan.x[:, 29])
        at = data["position"].isel(time=1).sel(Z=0.7, method="nearest")
        Z = np.array([float(at["Z"])])
        np.testing.assert_array_equal(at.values, plan.shape.position(Z)[1, 0])
        tangent = data["directors"].sel(director="d3").isel(Z=-1).values
        np.testing.assert_array_equal(tangent, plan.shape.directors(np.array([1.75]))[:, 0, 2])
        weight = data["contact_force"].sel(axis="Z").values
        np.testing.assert_allclose(weight, [0.0, 144.5203], atol=5e-5)  # DESIGN 2, printed
        assert data["time"].attrs["units"] == "s"
        assert data["position"].attrs["units"] == data["Z"].attrs["units"] == "m"
        assert data["tip_force"].attrs["units"] == "N"
        assert data["moment"].attrs["units"] == data["contact_couple"].attrs["units"] == "N m"
        assert data.attrs["status"] == "solved"


def test_saving_again_replaces(plans, tmp_path):
    save_plan(plans["solved"], tmp_path)
    save_plan(plans["unconverged"], tmp_path)
    assert load_plan(tmp_path, throw=False).status is Status.ITERATION_LIMIT
    assert {path.name for path in tmp_path.iterdir()} == {
        "summary.json",
        "activations.csv",
        "solution.nc",
    }


# --- files that are not plans -------------------------------------------------------------


def refused(folder):
    with pytest.raises(InputError, match=r"solution\.nc: cannot be read as a plan") as caught:
        load_plan(folder)
    return str(caught.value)


def test_a_folder_without_a_plan_is_refused(tmp_path):
    assert str(tmp_path) in refused(tmp_path)


@pytest.mark.parametrize("content", [b"", b"not a plan", b"CDF\x01", b"\x89HDF\r\n\x1a\n"])
def test_a_file_of_another_kind_is_refused(tmp_path, content):
    (tmp_path / "solution.nc").write_bytes(content)
    assert "solve-motion" in refused(tmp_path)


@pytest.mark.parametrize("share", [0.001, 0.01, 0.1, 0.5, 0.9, 0.999])
def test_a_truncated_file_is_refused(plans, tmp_path, share):
    save_plan(plans["solved"], tmp_path)
    path = tmp_path / "solution.nc"
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    assert str(path) in refused(tmp_path)


def rewritten(plan, folder, change):
    save_plan(plan, folder)
    changed = change(dataset(plan))
    changed.to_netcdf(folder / "solution.nc", engine="scipy")


@pytest.mark.parametrize("name", ["activation", "head", "tip_force", "edge", "state"])
def test_a_file_that_lacks_an_array_is_refused(plans, tmp_path, name):
    rewritten(plans["solved"], tmp_path, lambda data: data.drop_vars(name))
    assert name in refused(tmp_path)


@pytest.mark.parametrize("name", ["problem_json", "anatomy_json", "lookahead", "weight_rate"])
def test_a_file_that_lacks_an_attribute_is_refused(plans, tmp_path, name):
    def drop(data):
        del data.attrs[name]
        return data

    rewritten(plans["solved"], tmp_path, drop)
    assert name in refused(tmp_path)


@pytest.mark.parametrize("text", ["", "{}", "no JSON", '{"name": 3}'])
def test_a_file_with_a_broken_problem_is_refused(plans, tmp_path, text):
    rewritten(plans["solved"], tmp_path, lambda data: data.assign_attrs(problem_json=text))
    assert str(tmp_path) in refused(tmp_path)


def test_arrays_that_do_not_fit_the_problem_are_refused(plans, tmp_path):
    rewritten(plans["solved"], tmp_path, lambda data: data.isel(muscle=slice(0, 20)))
    assert str(tmp_path) in refused(tmp_path)

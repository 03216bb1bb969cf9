"""Simulated plans: what is compared, saved, drawn and printed."""

import json

import numpy as np
import pytest
import xarray as xr
from click.testing import CliRunner
from plans import POINT, written

from trunk_ocp.cli import commands
from trunk_ocp.errors import InputError
from trunk_ocp.planning.planner import plan_motion
from trunk_ocp.planning.simulated_plan import simulate
from trunk_ocp.planning.storage import save_plan
from trunk_ocp.problem.build import load_motion


@pytest.fixture(scope="module")
def plan(tmp_path_factory):
    return plan_motion(load_motion(written(tmp_path_factory.mktemp("point"), POINT)))


def test_a_simulation_is_compared_with_the_plan_at_each_time(plan):
    result = simulate(plan, 0.1)
    assert set(plan.times) <= set(result.simulation.times)
    at = int(np.argmin(np.abs(result.simulation.times - plan.times[1])))
    planned = plan.shape[0].position(result.Z)
    np.testing.assert_allclose(result.planned[at], planned, atol=1e-6)
    assert result.distance[0].max() < 1e-6  # it starts where the plan does
    report = result.summary()
    assert report["largest_distance"] == np.max(result.distance)
    assert 0.01 < report["largest_distance"] < 0.6  # it moves through 1 m
    assert report["energy_imbalance"] < 0.05 * report["work"]
    assert report["damping_time"] == 0.06


def test_the_command_writes_data_a_summary_and_a_figure(plan, tmp_path):
    folder = tmp_path / "horizon"
    save_plan(plan, folder)
    command = ["simulate", str(tmp_path), "--time-step", "0.1", "--damping-time", "0.1"]
    result = CliRunner().invoke(commands.main, command)
    assert result.exit_code == 0, result.output
    report = json.loads((folder / "simulation.json").read_text())
    assert (report["time_step"], report["damping_time"]) == (0.1, 0.1)
    assert f"up to {1e3 * report['largest_distance']:.3g} mm from the plan" in result.stdout
    with xr.open_dataset(folder / "simulation.nc", engine="scipy") as data:
        assert data["position"].shape == data["planned_position"].shape
        assert json.loads(data.attrs["summary_json"]) == report
        balance = data["kinetic"] + data["elastic"] - data["elastic"][0] + data["lost"]
        balance = balance - data["loads"] - data["muscles"] - data["head"]
        np.testing.assert_allclose(balance, data["imbalance"], atol=1e-9)
    assert list((folder / "figures").glob("simulation.*"))
    assert "warning" not in result.stdout
    coarse = [*command[:2], "--time-step", "0.5", "--damping-time", "0"]
    result = CliRunner().invoke(commands.main, coarse)
    report = json.loads((folder / "simulation.json").read_text())
    assert report["energy_imbalance"] > 0.05 * report["work"]
    assert "--time-step 0.25" in result.stdout


def test_numbers_out_of_range(plan):
    with pytest.raises(InputError, match="time_step"):
        simulate(plan, 0.0)
    with pytest.raises(InputError, match="damping_time"):
        simulate(plan, 0.1, -1.0)

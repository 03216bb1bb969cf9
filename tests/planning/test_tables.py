"""A plan as labeled arrays and as a table: the same numbers as in its files, and right ones."""

import csv
import io

import numpy as np
import pytest
import xarray as xr
from plans import POINT, written

from trunk_ocp.model.anatomy import load_anatomy
from trunk_ocp.model.loads import Loads
from trunk_ocp.planning.options import Options
from trunk_ocp.planning.planner import plan_motion
from trunk_ocp.planning.storage import SOLUTION, save_plan
from trunk_ocp.planning.tables import activations_table
from trunk_ocp.problem.build import load_motion
from trunk_ocp.rod.statics import solve_statics


@pytest.fixture(scope="module")
def motion(tmp_path_factory):
    """Two phases; the name of the first would be a formula to a spreadsheet."""
    text = POINT.replace('name = "reach"', 'name = "=reach"')
    return load_motion(written(tmp_path_factory.mktemp("point"), text))


@pytest.fixture(scope="module")
def plan(motion):
    return plan_motion(motion, lookahead=1)


@pytest.fixture(scope="module")
def table(plan):
    return plan.to_dataframe()


def test_the_labeled_arrays_are_those_of_the_file(plan, tmp_path):
    save_plan(plan, tmp_path)
    with xr.open_dataset(tmp_path / SOLUTION, engine="scipy") as saved:
        xr.testing.assert_equal(plan.to_xarray(), saved)
        assert plan.to_xarray().attrs.keys() == saved.attrs.keys()


def test_muscles_are_selected_by_name(plan):
    labeled = plan.to_xarray()
    dorsal = labeled.activation.sel(muscle="R1-dl", time=1.5)
    assert float(dorsal) == plan.activations[3, plan.motion.trunk.muscles.index("R1-dl")]
    assert labeled.position.dims == ("time", "Z", "axis")


def test_a_row_for_the_start_and_each_step(plan, table):
    assert table.index.tolist() == [0, 1, 2, 3, 4]
    assert table.index.name == "step"
    assert table.time_s.tolist() == [0.0, 0.5, 1.0, 1.25, 1.5]
    assert table.phase.tolist() == ["rest", "=reach", "=reach", "rise", "rise"]
    np.testing.assert_array_equal(table[list(plan.motion.trunk.muscles)], plan.trajectory[:, :-2])


def test_the_first_columns_are_those_of_the_spreadsheet(plan, table):
    names, *rows = csv.reader(io.StringIO(activations_table(plan)))
    assert table.columns[: len(names)].tolist() == names
    for row, line in zip(table.itertuples(index=False), rows, strict=True):
        assert line[1] == row[1] or line[1] == f"'{row[1]}"  # text there, whatever it looks like
        np.testing.assert_allclose([*row[2 : len(names)]], [*map(float, line[2:])], rtol=1e-8)


def test_the_tip_hangs_at_first_and_is_off_its_target_by_the_error(plan, table):
    trunk = load_anatomy("asian-elephant")
    rest = solve_statics(trunk, np.zeros(28), loads=Loads(9.8)).position([1.75])[0]
    tips = table[["tip_x_m", "tip_y_m", "tip_z_m"]].to_numpy()
    np.testing.assert_allclose(tips[0], rest, atol=1e-6)  # both meshes resolve it to 1e-6
    targets = [plan.motion.steps[t].targets[0].position for t in range(4)]
    off = np.linalg.norm(tips[1:] - np.array(targets), axis=1)
    check = plan.verification.position_difference.max()
    np.testing.assert_allclose(table.position_error_m[1:], off, atol=check + 1e-12)


def test_a_number_that_there_is_not_is_nan(table):
    assert table.loc[0, "position_error_m":].isna().all()
    assert table.direction_error.isna().all()  # no target asks for one
    assert (
        table.loc[1:, ["position_error_m", "stability_margin", "clearance_m"]]
        .notna()
        .all(axis=None)
    )


def test_qualities_add_up_to_those_of_the_plan(plan, table):
    assert table.objective.sum() == pytest.approx(plan.objective.paper, rel=1e-12)
    assert table.stability_margin[1:].tolist() == plan.stability.margin.tolist()
    assert table.clearance_m.min() == plan.clearance.min.gap


def test_a_plan_that_is_not_solved_says_so_in_every_row(motion):
    plan = plan_motion(motion, options=Options(max_iterations=1), throw=False)
    assert set(plan.to_dataframe().status) == {"iteration_limit"}

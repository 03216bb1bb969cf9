"""Bad arguments of public functions: always an InputError, never another exception."""

import inspect
from functools import cache

import numpy as np
import pytest
from plans import arm

import trunk_ocp as to
from trunk_ocp._support import process_pool
from trunk_ocp.errors import TrunkError

pytestmark = pytest.mark.slow

BAD = {
    "an object": object(),
    "a name": "lift-log",
    "no text": "",
    "a character no path has": "\0",
    "a dict of muscles": {"R1-dl": -0.2},
    "complex": 1 + 2j,
    "complex array": np.full(28, 1j),
    "nan": np.nan,
    "nans": np.full(28, np.nan),
    "infinite": np.inf,
    "an empty batch": np.zeros((0, 28)),
    "a scalar array": np.array(-0.1),
    "an empty list": [],
    "rows of different lengths": [[1.0], [1.0, 2.0]],
    "a wrong shape": np.zeros((2, 3)),
    "degrees": (90.0, 30.0),
    "negative": -1,
    "a fraction": 0.5,
    "a boolean": True,
    "None": None,
    "a huge number": 10**5000,
}


@cache
def trunk():
    return to.load_anatomy("asian-elephant")


@cache
def shape_map():
    return to.ShapeMap(trunk())


@pytest.fixture(scope="module")
def plan(tmp_path_factory):
    """Of a trunk with few muscles, for speed."""
    return to.plan_motion(arm(tmp_path_factory.mktemp("plan")), 1)


@pytest.fixture(scope="module")
def replanner(plan):
    return to.Replanner(plan)


REST, AHEAD = np.zeros(28), (0.0, 0.0)


def calls(plan, replanner, folder):
    """Every public callable with valid arguments."""
    motion, few = plan.motion, to.Options(max_iterations=2)
    shape = to.solve_statics(trunk(), REST)
    quick = {"options": few, "processes": 1}
    return {
        "load_anatomy": (to.load_anatomy, {"name_or_path": "asian-elephant"}),
        "load_motion": (to.load_motion, {"name_or_path": "lift-log"}),
        "save_plan": (to.save_plan, {"plan": plan, "folder": folder / "saved"}),
        "load_plan": (to.load_plan, {"folder": folder / "saved"}),
        "plan_motion": (to.plan_motion, {"motion": motion, "lookahead": 1, "options": few}),
        "plan_from": (to.plan_from, {"motion": motion, "x": plan.x, "options": few}),
        "compare": (to.compare, {"sequential": plan, "horizon": plan}),
        "plan_measures": (to.plan_measures, {"plan": plan}),
        "explain": (to.explain, {"plan": plan, "deep": False}),
        "find_optima": (to.find_optima, {"motion": motion, "starts": 0, **quick}),
        "compare_lookaheads": (to.compare_lookaheads, {"motion": motion, **quick}),
        "survey_limits": (to.survey_limits, {"motion": motion, **quick}),
        "smoothness_tradeoff": (
            to.smoothness_tradeoff,
            {"motion": motion, "weights": (1e-3,)} | quick,
        ),
        "export": (to.export, {"subject": trunk(), "to": "latex", "out": folder / "latex"}),
        "check_export": (to.check_export, {"folder": folder / "latex", "to": "latex"}),
        "solve_statics": (to.solve_statics, {"trunk": trunk(), "activation": REST}),
        "buckling_margin": (
            to.buckling_margin,
            {"shape": shape, "activation": REST, "loads": to.Loads()},
        ),
        "flutter": (to.flutter, {"shape": shape, "activation": REST, "loads": to.Loads()}),
        "natural_frequencies": (
            to.natural_frequencies,
            {"shape": shape, "activation": REST, "loads": to.Loads()},
        ),
        "simulate": (to.simulate, {"plan": plan, "time_step": 0.5}),
        "tip_jacobian": (
            to.tip_jacobian,
            {"shape": shape, "activation": REST, "head": AHEAD, "loads": to.Loads()},
        ),
        "Loads": (to.Loads, {}),
        "Options": (to.Options, {}),
        "Weights": (to.Weights, {}),
        "Checkpoint": (to.Checkpoint, {"path": folder / "resume.npz"}),
        "Replanner": (to.Replanner, {"plan": plan, "options": few}),
        "Replanner.__call__": (replanner, {"motion": motion}),
        "ShapeMap": (to.ShapeMap, {"trunk": trunk()}),
        "ShapeMap.__call__": (shape_map(), {"activation": REST}),
        "ShapeMap.unloaded": (shape_map().unloaded, {"activation": REST}),
        "ShapeMap.jacobian": (
            shape_map().jacobian,
            {"shapes": shape_map()(REST), "activation": REST},
        ),
        "Shape.position": (shape.position, {"Z": 1.0}),
        "Shape.directors": (shape.directors, {"Z": 1.0}),
        "Shape.moment": (shape.moment, {"Z": 1.0}),
        "Motion.limited": (motion.limited, {}),
        "Motion.shifted": (motion.shifted, {"offset": (0.0, 0.0, 0.0)}),
        "Plan.sample": (lambda t: plan.sample(t), {"t": 0.5}),
        "problem_schema": (to.problem_schema, {}),
    }


RETURNED_NOT_CALLED = {
    *("Clearance", "Flutter", "Gap"),
    *("Diagnosis", "Finding", "Motion", "Plan", "PointShapes", "Progress", "Reporter", "Shape"),
    *("SimulatedPlan", "Stability", "Status", "Trunk"),
    *("InputError", "PlanError", "SolverMissingError", "StaticsError", "TrunkError"),
}


def test_every_public_callable_is_listed(plan, replanner, tmp_path):
    aliases = {name for name in to.__all__ if getattr(to, name).__name__ != name}
    listed = calls(plan, replanner, tmp_path)
    assert {*to.__all__} - aliases - RETURNED_NOT_CALLED <= {*listed}


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("foresight", "compare_lookaheads"),
        ("front", "smoothness_tradeoff"),
        ("measure", "plan_measures"),
        ("optima", "find_optima"),
        ("stability", "buckling_margin"),
        ("survey", "survey_limits"),
    ],
)
def test_names_of_version_0_1_still_work(old, new):
    assert getattr(to, old) is getattr(to, new)
    assert {old, new} <= {*to.__all__}


def test_degrees_for_radians_are_asked_about():
    with pytest.raises(TrunkError, match="expected radians, got 90; is that in degrees"):
        to.solve_statics(trunk(), REST, (90.0, 30.0))


@pytest.mark.parametrize("kind", BAD)
def test_a_bad_argument_gets_a_sentence_or_works(plan, replanner, tmp_path, monkeypatch, kind):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(process_pool, "cores", lambda: 1)  # processes take long to start
    faults = []
    for name, (function, valid) in calls(plan, replanner, tmp_path).items():
        for argument in inspect.signature(function).parameters:
            try:
                function(**{**valid, argument: BAD[kind]})
            except TrunkError:
                continue
            except Exception as error:
                faults.append(f"{name}({argument}): {error!r}")
            else:
                if kind == "an object":
                    faults.append(f"{name} accepts any {argument}")
    assert faults == []


def test_numbers_of_numpy_are_numbers(plan):
    options = to.Options(starts=np.int64(2), weights=to.Weights(np.float32(0.5), np.int64(1)))
    assert (type(options.starts), type(options.weights.effort)) == (int, float)
    assert (options.starts, options.weights) == (2, to.Weights(0.5, 1.0))
    limited = plan.motion.limited(np.array(2.0), rate=np.float64(3.0))
    assert limited.spec == plan.motion.limited(2.0, rate=3.0).spec


def test_a_row_of_a_table_is_an_array_of_numbers():
    trunk = to.load_anatomy("asian-elephant")
    row = np.array([-0.1, *[0.0] * 27], dtype=object)
    given, plain = (to.solve_statics(trunk, x) for x in (row, row.astype(float)))
    np.testing.assert_array_equal(given.states, plain.states)
    with pytest.raises(TrunkError, match=r"activation.*array of real numbers"):
        to.solve_statics(trunk, np.array([*row[1:], "much"], dtype=object))


def test_a_missing_argument_is_reported_with_its_function():
    with pytest.raises(TypeError, match=r"plan_motion\(\) missing 1 required"):
        to.plan_motion()

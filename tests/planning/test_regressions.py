"""Mistakes that were made once, and are not to come back."""

import dataclasses
import json
import pickle
from itertools import pairwise

import numpy as np
import pytest

import trunk_ocp as to
from trunk_ocp.model.anatomy import AnatomySpec
from trunk_ocp.planning.planner import plan_motion
from trunk_ocp.problem.build import build_motion
from trunk_ocp.problem.problem_file import ProblemSpec

pytestmark = pytest.mark.slow

HEAD = """
name = "{name}"
[bounds]
activation = [-3.0, 0.0]
extension = [0.67, 1.35]
head_z_deg = [-10.0, 10.0]
head_y_deg = [-10.0, 10.0]
"""
PHASE = """
[[phases]]
name = "{name}"
duration = 1.0
{extra}
[[phases.targets]]
Z = {position_at}
position = {position}
[[phases.targets]]
Z = {direction_at}
d3 = {direction}
d3_weight = 0.3
"""


def written(tmp_path, *phases, name="reviewed"):
    path = tmp_path / f"{name}.toml"
    path.write_text(HEAD.format(name=name) + "".join(phases))
    return to.load_motion(path)


def phase(name, position_at=1.75, direction_at=1.75, extra="", position=(0.6, 0.2, 1.2)):
    return PHASE.format(
        name=name,
        extra=extra,
        position_at=position_at,
        direction_at=direction_at,
        position=list(position),
        direction=[0.3, 0.1, 0.9],
    )


@pytest.fixture(scope="module")
def swapped(tmp_path_factory):
    """Two steps with the same points, whose position and direction targets change places."""
    a = phase("a", 1.0, 1.75, position=(0.4, 0.0, 0.9))
    b = phase("b", 1.75, 1.0)
    return written(tmp_path_factory.mktemp("swapped"), a, b, name="swapped")


def test_a_window_is_not_solved_by_the_nlp_of_another(swapped):
    """Equal numbers of targets at equal points do not make an equal NLP."""
    together = plan_motion(swapped, 1)
    for i, step in enumerate(swapped.steps):
        alone = dataclasses.replace(swapped, steps=(step,), phases=swapped.phases)
        error = plan_motion(alone, 1).errors[0].position.max()
        assert together.errors[i].position.max() <= max(10 * error, 1e-3)


def test_a_replanner_refuses_targets_of_another_kind(swapped):
    again = to.Replanner(plan_motion(swapped))
    reversed_steps = dataclasses.replace(swapped, steps=swapped.steps[::-1])
    with pytest.raises(to.InputError, match="differs from the planned motion in structure"):
        again(reversed_steps)


def test_a_pull_in_a_receding_window_follows_the_step_it_names(tmp_path):
    motion = written(
        tmp_path,
        phase("1"),
        phase("2", position=(0.5, 0.3, 1.2)),
        phase("3", position=(0.4, 0.2, 1.3)),
        phase("4", extra="loads.pull = { force = 60.0, held_from_step = 2 }"),
    )
    plan = plan_motion(motion, 2)
    tangent = plan.shape.directors(np.array([1.75]))[1, 0, 2]
    # Inside the collocation's own accuracy.
    np.testing.assert_allclose(plan.tip_forces[3], 60.0 * tangent, atol=1e-2)


def test_a_plan_that_pulls_too_little_is_not_verified(tmp_path):
    motion = written(
        tmp_path, phase("1"), phase("2", extra="loads.pull = { force = 60.0, held_from_step = 1 }")
    )
    plan = plan_motion(motion, 1)
    forces = plan.tip_forces * 0.99
    loads = [
        dataclasses.replace(x, tip_force=tuple(f)) for x, f in zip(plan.loads, forces, strict=True)
    ]
    shape = to.solve_statics(motion.trunk, plan.activations, plan.head, loads, plan.mesh)
    weaker = dataclasses.replace(plan, tip_forces=forces, shape=shape)
    assert any("tip force" in fault for fault in weaker.verification.faults)
    assert not any("tip force" in fault for fault in plan.verification.faults)


def test_a_sequential_plan_outside_the_horizons_bounds_is_no_candidate(tmp_path):
    tight = """bounds = { activation = [-0.2, 0.0] }
auxiliary = { activation_deviation = 0.4 }"""
    motion = written(tmp_path, phase("1", extra=tight, position=(0.7, 0.3, 0.6)))
    plan = plan_motion(motion, throw=False)
    assert plan.x[0, :-2].min() >= -0.2 - 1e-6  # Ipopt's own relaxation is 1e-8
    assert plan.verified


def test_bounds_no_extension_allows_end_not_converged(tmp_path):
    motion = written(tmp_path, phase("1", extra="bounds = { activation = [-3.0, -2.9] }"))
    plan = plan_motion(motion, 1, throw=False)
    assert plan.status is to.Status.INFEASIBLE


def test_a_phase_cannot_leave_the_bounds_of_the_motion(tmp_path):
    with pytest.raises(to.InputError, match=r"phases\[1\].bounds: R1-dl"):
        written(tmp_path, phase("1", extra='bounds = { muscles = { "R1-dl" = [-5.0, -4.0] } }'))


def test_a_shifted_motion_is_replanned_from_the_multipliers(tmp_path):
    """To the optimum that planning anew from the same plan finds, in at most five iterations."""
    motion = to.load_motion("lift-log")
    plan = plan_motion(motion)
    again = to.Replanner(plan)
    pickled = pickle.loads(pickle.dumps(again))
    moved = motion.shifted((0.01, 0.0, 0.0))
    replanned = again(moved)
    assert replanned.status is to.Status.SOLVED
    assert replanned.iterations <= 5
    np.testing.assert_array_equal(pickled(moved).x, replanned.x)
    anew = plan_motion(moved, start=plan)
    # Re-planning stops at a tolerance of 1e-6, planning at 1e-8.
    assert replanned.objective.total == pytest.approx(anew.objective.total, abs=5e-6)


def test_many_segments_get_elements_of_a_lower_degree():
    """Cut into 12 segments the trunk has 13 elements; the answer is verified all the same."""
    motion = to.load_motion("lift-log")
    anatomy = motion.anatomy.model_dump(mode="json")
    pieces = []
    for part in anatomy["segments"]:
        edges = np.linspace(*part["Z_over_length"], 5).tolist()
        pieces += [{**part, "Z_over_length": list(pair)} for pair in pairwise(edges)]
    anatomy["segments"] = pieces
    spec = motion.spec.model_dump(mode="json")
    spec["phases"] = spec["phases"][:1]
    spec["phases"][0]["bounds"]["muscles"] = {}
    cut = build_motion(
        ProblemSpec.model_validate_json(json.dumps(spec)),
        AnatomySpec.model_validate_json(json.dumps(anatomy)),
    )
    plan = plan_motion(cut, 1)
    assert plan.mesh.elements >= 12
    assert plan.mesh.degree < 6
    assert plan.status is to.Status.SOLVED


@pytest.mark.parametrize("lookahead", [1, None])
def test_a_mesh_too_coarse_for_the_check_is_refined(tmp_path, lookahead):
    motion = written(tmp_path, phase("1"), phase("2", position=(0.5, 0.3, 1.2)))
    plan = plan_motion(motion, lookahead, to.Options(elements=3, degree=3))
    assert plan.mesh.elements > 3
    assert not plan.verification.too_coarse
    assert plan.converged

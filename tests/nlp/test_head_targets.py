"""Targets that turn with the head, such as the mouth, through the NLP, the check and files."""

import numpy as np
import pytest
from plans import shipped
from scipy.spatial.transform import Rotation

from trunk_ocp.errors import InputError
from trunk_ocp.model.anatomy import AnatomySpec
from trunk_ocp.nlp.window import Window
from trunk_ocp.planning.planner import plan_motion
from trunk_ocp.planning.storage import load_plan, save_plan
from trunk_ocp.problem.build import as_built, build_motion
from trunk_ocp.problem.mirror import is_symmetric, mirrored_motion
from trunk_ocp.problem.problem_file import ProblemSpec
from trunk_ocp.problem.weights import Weights
from trunk_ocp.rod.collocation import mesh_for
from trunk_ocp.scene.surroundings import marks

MOUTH = np.array([-0.2, 0.0, 0.16])
DIRECTION = np.array([-1.0, 0.0, -1.0]) / np.sqrt(2)
TIP = np.array([1.75])
S = -0.4375 * np.array([np.sin(np.radians(100)), 0.0, np.cos(np.radians(100))])
"""Pivot of the head, from section 3.9 of the paper."""


def eating(head_y_deg=(15.0, 20.0), head_z_deg=(-6.0, 6.0), point=MOUTH, gravity=9.8, **target):
    """One step that brings the tip to the mouth of a head that turns meanwhile."""
    anatomy = shipped("pick-fruit").anatomy.model_dump()
    anatomy["head"]["mouth"] = {"point": tuple(point), "direction": tuple(DIRECTION)}
    whole = {"origin": "mouth", "position": (0.0, 0.0, 0.0), "d3": tuple(DIRECTION), **target}
    problem = {
        "name": "eat",
        "gravity": gravity,
        "bounds": {"activation": (-3.0, 0.0), "extension": (0.67, 1.35)},
        "tolerance": {"position": 0.001, "direction": 0.01},
        "phases": (
            {
                "name": "eat",
                "duration": 2.0,
                "targets": ({"Z": 1.75, "position_weight": 8.0, **whole},),
                "bounds": {"head_y_deg": head_y_deg, "head_z_deg": head_z_deg},
            },
        ),
    }
    return build_motion(ProblemSpec.model_validate(problem), AnatomySpec.model_validate(anatomy))


def turned(head, vector):
    """A vector of the head's frame in space, by scipy's rotations."""
    return Rotation.from_euler("ZY", head).apply(vector)


def test_a_plan_reaches_the_mouth_where_it_is_after_the_head_turned():
    motion = eating(head_z_deg=(4.0, 6.0))
    plan = plan_motion(motion)
    assert plan.checked() is plan
    head = plan.head[0]
    assert np.degrees(head[1]) > 14.9
    mouth = S + turned(head, MOUTH - S)
    assert np.linalg.norm(mouth - MOUTH) > 0.05
    # The check integrates the rod with DOP853; the shape is the NLP's own.
    integrated, directors = plan.verification.at(0, 1.75)
    assert np.linalg.norm(integrated - mouth) < 1e-3
    assert np.linalg.norm(plan.shape.position(TIP)[0, 0] - mouth) < 1e-3
    assert np.linalg.norm(directors[2] - turned(head, DIRECTION)) < 0.01
    assert plan.errors[0].position[0] == pytest.approx(np.linalg.norm(integrated - mouth), abs=1e-9)
    (mark,) = marks(plan, 0)
    np.testing.assert_allclose(mark.target, mouth, rtol=0, atol=1e-12)
    np.testing.assert_allclose(mark.directions[0], turned(head, DIRECTION), rtol=0, atol=1e-12)


def test_without_weight_the_head_takes_the_whole_plan_along():
    """Nothing but gravity tells one head angle from another, so the muscles do the same."""
    still = plan_motion(eating((0.0, 0.0), (0.0, 0.0), gravity=0.0))
    moved = plan_motion(eating((20.0, 20.0), (5.0, 5.0), gravity=0.0))
    head = moved.head[0]
    np.testing.assert_allclose(np.degrees(head), (5.0, 20.0), atol=1e-6)
    np.testing.assert_allclose(moved.activations, still.activations, atol=1e-4)
    Z = np.linspace(0, 1.75, 8)
    expected = S + turned(head, still.shape.position(Z)[0] - S)
    np.testing.assert_allclose(moved.shape.position(Z)[0], expected, atol=1e-5)


def test_with_the_head_held_the_mouth_is_a_point_in_space():
    held = ((0.0, 0.0), (0.0, 0.0))
    mouth = plan_motion(eating(*held))
    space = plan_motion(eating(*held, origin="base", position=tuple(MOUTH)))
    assert mouth.motion.steps[0].targets[0].frame == "head"
    assert space.motion.steps[0].targets[0].frame == "space"
    # Ipopt's tolerance on a flat optimum.
    np.testing.assert_allclose(mouth.x, space.x, rtol=0, atol=1e-5)
    assert mouth.objective.total == pytest.approx(space.objective.total, rel=1e-6)


def window(motion):
    mesh = mesh_for(motion.trunk, None, 3, 6)
    return Window(motion, mesh, motion.steps, np.zeros(30), {}, 0, Weights(0.0, 0.0))


def drawn(w):
    """A decision vector near nothing in particular."""
    rng = np.random.default_rng(4)
    full = 0.3 * rng.normal(size=w.bounds["lbx"].size)
    for u in w.unknowns:
        for q, _ in u.points.values():
            full[q] /= np.linalg.norm(full[q])
    return full


def test_the_objective_of_targets_in_the_heads_frame_is_eq_42_squared():
    w = window(eating(d1=(0.0, 1.0, 0.0), d1_weight=0.5))
    full, u = drawn(w), w.unknowns[0]
    q, r = u.points[1.75]
    head = full[u.x[-2:]]
    directors = Rotation.from_quat(full[q][[1, 2, 3, 0]]).as_matrix().T
    offset = 1.75 * full[r] - S - turned(head, MOUTH - S)
    expected = 8 * offset @ offset
    for j, wanted, weight in ((0, (0.0, 1.0, 0.0), 0.5), (2, DIRECTION, 1.0)):
        expected += weight * np.sum((directors[j] - turned(head, wanted)) ** 2)
    f, _ = w.nlp.derivatives()["grad_f"](full, w.nlp.parameters)
    assert float(f) == pytest.approx(expected, rel=1e-12)
    assert w.worst_error(full) == pytest.approx(np.linalg.norm(offset), rel=1e-12)


def test_derivatives_of_targets_in_the_heads_frame_are_those_of_differences():
    w = window(eating())
    full, u, p = drawn(w), w.unknowns[0], w.nlp.parameters
    of_target = np.concatenate([*u.points[1.75], u.x[-2:]])
    derivatives, none = w.nlp.derivatives(), np.zeros(w.nlp.size[1])

    def gradient(x):
        return derivatives["grad_f"](x, p)[1].full().ravel()

    upper = derivatives["hess_lag"](full, p, 1.0, none).full()
    hessian = upper + np.triu(upper, 1).T
    _, slopes = w.target_errors(full)
    h = 1e-5
    for i in of_target:
        step = h * (np.arange(full.size) == i)
        low, high = full - step, full + step
        # Central differences: h^2 of truncation and 1e-16 / h of round-off, times numbers of ten.
        f = [float(derivatives["grad_f"](x, p)[0]) for x in (high, low)]
        assert gradient(full)[i] == pytest.approx((f[0] - f[1]) / (2 * h), abs=1e-7)
        difference = (gradient(high) - gradient(low)) / (2 * h)
        np.testing.assert_allclose(hessian[i], difference, rtol=0, atol=1e-7)
        error = (w.target_errors(high)[0] - w.target_errors(low)[0]) / (2 * h)
        np.testing.assert_allclose(slopes[:, [i]].toarray().ravel(), error, rtol=0, atol=1e-8)


def test_a_plan_with_a_mouth_is_read_back_as_it_was(tmp_path):
    plan = plan_motion(eating())
    save_plan(plan, tmp_path / "plan")
    read = load_plan(tmp_path / "plan")
    assert read.motion.steps[0].targets == plan.motion.steps[0].targets
    assert read.motion.trunk == plan.motion.trunk
    assert read.errors[0].position == pytest.approx(plan.errors[0].position, abs=1e-12)


def test_variants_of_targets_in_the_heads_frame():
    motion = eating()
    assert as_built(motion)
    assert is_symmetric(motion)
    moved = motion.shifted((0.0, 0.02, 0.01))
    (target,) = moved.steps[0].targets
    assert target.frame == "head"
    np.testing.assert_allclose(
        target.position, np.add(MOUTH, (0.0, 0.02, 0.01)), rtol=0, atol=1e-15
    )
    (image,) = mirrored_motion(moved).steps[0].targets
    head = np.array([0.1, 0.2])
    reflected, opposite = np.array([1, -1, 1]), np.array([-1, 1])
    np.testing.assert_allclose(
        image.position_at(motion.trunk, opposite * head),
        reflected * target.position_at(motion.trunk, head),
        atol=1e-15,
    )
    with pytest.raises(InputError, match="mouth is not its own mirror image"):
        mirrored_motion(eating(point=(-0.2, 0.01, 0.16)))


def test_a_position_from_the_base_may_turn_with_the_head():
    (target,) = eating(origin="base", frame="head", position=tuple(MOUTH)).steps[0].targets
    (mouth,) = eating().steps[0].targets
    assert target == mouth


def test_a_mouth_that_the_anatomy_does_not_have_is_named(tmp_path):
    """Once the shipped anatomy has a mouth, another one without is needed."""
    motion = eating()
    anatomy = motion.anatomy.model_copy(
        update={"head": motion.anatomy.head.model_copy(update={"mouth": None})}
    )
    with pytest.raises(InputError, match=r'origin = "mouth": the anatomy .* has no \[head\] mouth'):
        build_motion(motion.spec, anatomy)


def test_a_mouth_without_a_direction_is_refused():
    anatomy = eating().anatomy.model_dump()
    anatomy["head"]["mouth"]["direction"] = (0.0, 0.0, 0.0)
    with pytest.raises(ValueError, match="direction must not be the zero vector"):
        AnatomySpec.model_validate(anatomy)

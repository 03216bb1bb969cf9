"""A contact force on a lever that turns with the trunk, as a log hung from it: a potential."""

from dataclasses import replace

import numpy as np
import pytest
from discrete_rod import chain
from plans import shipped

from trunk_ocp.codegen.shape_model import build_model
from trunk_ocp.errors import InputError
from trunk_ocp.model.loads import Loads, couple_density, lever_density
from trunk_ocp.planning.planner import plan_motion
from trunk_ocp.planning.storage import load_plan, save_plan
from trunk_ocp.problem.build import as_built, build_motion
from trunk_ocp.problem.interpolation import loads_at
from trunk_ocp.problem.mirror import mirrored_controls, mirrored_motion
from trunk_ocp.rod.buckling import buckling_margin
from trunk_ocp.rod.collocation import mesh_for
from trunk_ocp.rod.equations import point_parameters, rates
from trunk_ocp.rod.flutter import flutter
from trunk_ocp.rod.shape_map import ShapeMap
from trunk_ocp.rod.statics import solve_statics
from trunk_ocp.rod.tip_jacobian import tip_jacobian

WEIGHT, OFFSET = 216.78, 0.525
HUNG = Loads(9.8, (10.0, -20.0, 30.0), 1.4, (0.0, 0.0, WEIGHT), contact_lever=-OFFSET)
DEAD = Loads(9.8, (10.0, -20.0, 30.0), 1.4, (0.0, 0.0, WEIGHT), (-OFFSET * WEIGHT, 0.0, 0.0))
TIP = np.array([1.75])


def hung(motion, phases=(1, 2)):
    """The off-center lift with the log hung in some phases."""
    changed = []
    for number, phase in enumerate(motion.spec.phases):
        if number in phases:
            log = phase.loads.log.model_copy(update={"hung": True})
            phase = phase.model_copy(update={"loads": phase.loads.model_copy(update={"log": log})})
        changed.append(phase)
    spec = motion.spec.model_copy(update={"phases": tuple(changed)})
    return build_motion(spec, motion.anatomy)


@pytest.fixture(scope="module")
def plan():
    return plan_motion(hung(shipped("lift-log-asymmetric")), lookahead=1)


def test_where_d2_is_e_Y_the_couple_is_that_of_eq_54(trunk):
    Z = np.array([1.0, 1.5, 1.7])
    of_lever = np.cross([0.0, 1.0, 0.0], lever_density(HUNG, trunk, Z))
    np.testing.assert_allclose(of_lever, couple_density(DEAD, trunk, Z), atol=1e-12)


def test_the_equations_have_the_couple_of_the_force_about_the_centerline(trunk):
    rng = np.random.default_rng(2)
    q = rng.normal(size=4)
    q /= np.linalg.norm(q)
    w = np.concatenate(
        [q, rng.normal(size=3), [1.1], rng.normal(size=3), [1.05], rng.normal(size=3)]
    )
    Z = np.array([1.6])
    with_lever = np.asarray(rates(True)(w, point_parameters(trunk, HUNG, Z, True))).ravel()
    x, y, z, s = q[1], q[2], q[3], q[0]
    d2 = np.array([2 * (x * y - s * z), s * s - x * x + y * y - z * z, 2 * (y * z + s * x)])
    arm = HUNG.contact_lever * d2
    couple = np.cross(arm, HUNG.contact_force)
    dead = replace(HUNG, contact_lever=0.0, contact_couple=tuple(couple))
    expected = np.asarray(rates()(w, point_parameters(trunk, dead, Z))).ravel()
    np.testing.assert_allclose(with_lever, expected, rtol=1e-13, atol=1e-13)


def compliance(trunk, activation, load, shape):
    """Derivative (3, 3) of the tip by the tip force, by central differences."""
    columns, step = [], 0.1
    for axis in np.eye(3):
        ends = [
            solve_statics(
                trunk,
                activation,
                loads=replace(load, tip_force=tuple(load.tip_force + sign * step * axis)),
                near=shape,
            ).position(TIP)[0]
            for sign in (1, -1)
        ]
        columns.append((ends[0] - ends[1]) / (2 * step))
    return np.stack(columns, axis=-1)


def test_the_tangent_is_symmetric_as_that_of_a_potential(trunk, draw):
    """Maxwell and Betti: the tip's compliance. With the couple of eq. (54) it is not symmetric."""
    activation = draw(trunk, 3, seed=4)[2]
    skew = []
    for load in (HUNG, DEAD):
        mesh = mesh_for(trunk, 1.4, elements=8, degree=8)
        shape = solve_statics(trunk, activation, loads=load, mesh=mesh)
        C = compliance(trunk, activation, load, shape)
        skew.append(np.abs(C - C.T).max() / np.abs(C).max())
    assert skew[0] < 1e-6  # of differences
    assert skew[1] > 1e-2


def test_a_chain_of_rotations_with_the_potential_is_as_stable(trunk, draw):
    activation = draw(trunk, 20, seed=1)[3]
    load = replace(HUNG, tip_force=(90.0, -100.0, -200.0))
    mesh = mesh_for(trunk, 1.4, elements=12, degree=8)
    shape = solve_statics(trunk, activation, loads=load, mesh=mesh)
    coarse, fine = (chain(trunk, activation, load, shape, n) for n in (40, 80))
    np.testing.assert_allclose(fine.stiffness, fine.stiffness.T, rtol=0, atol=1e-8)
    least = (4 * fine.eigenvalues[0] - coarse.eigenvalues[0]) / 3  # Richardson: of fourth order
    assert buckling_margin(shape, activation, load).margin == pytest.approx(least, abs=1e-5)
    assert fine.residual < coarse.residual / 3


def test_the_lift_is_planned_verified_and_does_not_flutter(plan):
    """Verified: integrated by a second implementation of the equations, with rotation matrices."""
    assert plan.checked() is plan
    assert plan.verification.position_difference.max() < 1e-4
    assert not any("flutter" in note for note in plan.notes)
    lever = {load.contact_lever for load in plan.loads[1:]}
    assert lever == {-OFFSET}
    for t in range(1, 10):
        free = flutter(plan.shape[t], plan.activations[t], plan.loads[t], 22.0)
        assert free.growth == 0
    # d2 stays near e_Y on the log, so that its offset is about that of eq. (54).
    assert np.all(plan.shape.directors(TIP)[1:, 0, 1, 1] > 0.7)


def test_a_hung_log_is_read_back_mirrored_and_interpolated(plan, tmp_path):
    save_plan(plan, tmp_path / "plan")
    read = load_plan(tmp_path / "plan")
    assert as_built(plan.motion)
    assert read.loads == plan.loads
    np.testing.assert_array_equal(read.shape.states, plan.shape.states)
    image = mirrored_motion(plan.motion)
    assert image.steps[3].loads.contact_lever == OFFSET
    t, Z = 3, np.linspace(0, 1.75, 6)
    x = mirrored_controls(plan.motion.trunk, plan.x[t])
    mirrored = solve_statics(plan.motion.trunk, x[:-2], x[-2:], image.steps[t].loads)
    expected = plan.shape.position(Z)[t] * [1, -1, 1]
    np.testing.assert_allclose(mirrored.position(Z), expected, atol=1e-4)
    between = loads_at(plan.motion, plan.loads, 1.2)  # while the weight is taken
    assert between.contact_lever == -OFFSET
    assert 0 < between.contact_force[2] < WEIGHT
    assert plan.sample(1.2).shape.position(TIP).shape == (1, 3)


def test_the_tips_derivatives_are_those_of_differences(trunk, draw):
    activation = draw(trunk, 3, seed=4)[2]
    shape = solve_statics(trunk, activation, loads=HUNG)
    position, _ = tip_jacobian(shape, activation, (0.0, 0.0), HUNG)
    h = 1e-4
    for muscle in (0, 17):
        step = h * (np.arange(28) == muscle)
        ends = (
            solve_statics(trunk, activation + s * step, loads=HUNG, near=shape).position(TIP)[0]
            for s in (1, -1)
        )
        difference = np.subtract(*ends) / (2 * h)
        np.testing.assert_allclose(position[:, muscle], difference, rtol=0, atol=1e-6)


def test_what_has_no_lever_says_so(trunk):
    with pytest.raises(InputError, match="ShapeMap has no contact force on a lever"):
        ShapeMap(trunk, HUNG)
    with pytest.raises(InputError, match="exports have no contact force on a lever"):
        build_model(trunk, loads=HUNG)
    with pytest.raises(InputError, match="hung in all phases or in none"):
        hung(shipped("lift-log-asymmetric"), phases=(1,))
    with pytest.raises(InputError, match="contact_from: missing"):
        Loads(contact_lever=0.1)
    with pytest.raises(InputError, match="contact_lever"):
        Loads(contact_from=1.0, contact_lever=float("nan"))

"""The independent check as a two-point problem: right plans pass, wrong ones do not."""

import math
from dataclasses import replace

import numpy as np
import pytest
from plans import soft_rod, thin_tipped, thin_tipped_spec, written
from scipy.integrate import DOP853

from trunk_ocp.analysis.diagnosis import explain
from trunk_ocp.model.activation import strains
from trunk_ocp.model.anatomy import build_trunk
from trunk_ocp.model.loads import Loads
from trunk_ocp.planning import two_point, verification
from trunk_ocp.planning.independent_rod import Rods, Sections, dop853
from trunk_ocp.planning.plan import Plan
from trunk_ocp.planning.planner import plan_motion
from trunk_ocp.planning.status import Status
from trunk_ocp.planning.two_point import _TwoPoint, equilibria
from trunk_ocp.planning.verification import MAX_TURN, verify
from trunk_ocp.problem.build import build_motion, load_motion
from trunk_ocp.problem.motion import Auxiliary, Bounds
from trunk_ocp.problem.problem_file import ProblemSpec
from trunk_ocp.problem.weights import Weights
from trunk_ocp.rod.collocation import mesh_for
from trunk_ocp.rod.linear_bvp import solve_linear_bvp
from trunk_ocp.rod.rod_batch import shape_of_states
from trunk_ocp.rod.statics import solve_statics
from trunk_ocp.scene.keyframes import for_blending
from trust.equilibria import judge_plans, judge_shapes
from trust.judge import Judge

pytestmark = pytest.mark.slow

LOAD = Loads(tip_force=(0.0, 0.0, 0.049))
GAMMA = np.array([[-0.1, -0.03]])


def held(trunk_spec, loads, Z, position):
    """A motion of one step that asks for one point."""
    spec = {
        "name": "hold",
        "anatomy": "arm.toml",
        "gravity": loads.gravity,
        "bounds": {"activation": (-1.0, 0.0), "extension": (0.3, 2.0)},
        "phases": (
            {
                "name": "hold",
                "duration": 1.0,
                "loads": {"tip_force": loads.tip_force},
                "targets": ({"Z": Z, "position": tuple(position)},),
            },
        ),
    }
    return build_motion(ProblemSpec.model_validate(spec), trunk_spec)


def plan_of(spec, loads, elements, activation=GAMMA):
    """A plan that says that a shape of statics on some mesh is what is asked for."""
    trunk = build_trunk(spec)
    x = np.hstack([activation, np.zeros((1, 2))])
    shape = solve_statics(trunk, activation, loads=[loads], mesh=mesh_for(trunk, None, elements))
    tip = shape.position([trunk.length])[0, 0]
    motion = held(spec, loads, trunk.length, tip.tolist())
    force = np.array([loads.tip_force])
    return Plan(motion, x, force, shape, "horizon", 1, Weights())


def spoilt(plan, **parts):
    """The same plan with other states, and the centerline that follows from them."""
    shape = shape_of_states(plan.motion.trunk, plan.mesh, plan.x, plan.loads, parts["states"])
    return replace(plan, shape=shape)


def test_a_right_plan_of_a_thin_tipped_arm_is_solved():
    plan = plan_of(thin_tipped_spec(), LOAD, 24)
    assert plan.verification.faults == []
    assert plan.status is Status.SOLVED
    judge = Judge(plan.motion.trunk, GAMMA[0], np.zeros(2), LOAD)
    assert judge.error(plan.shape[0]) < 1e-7
    # What the check holds against it is the equilibrium itself, though the plan is off by more.
    coarse = plan_of(thin_tipped_spec(), LOAD, 6)
    rod = judge.solve(coarse.shape[0])
    Z, line = rod.Z, rod.position
    path = equilibria(plan.motion.trunk, coarse.x, coarse.loads, coarse.shape, Z[::50])
    assert np.linalg.norm(path.position[0] - line[::50], axis=1).max() < 1e-8
    assert np.linalg.norm(coarse.shape.position(Z)[0] - line, axis=1).max() > 1e-7


@pytest.mark.parametrize("what", ["moments", "turned", "other load", "other activation"])
def test_a_wrong_plan_of_a_thin_tipped_arm_is_not(what):
    plan = plan_of(thin_tipped_spec(), LOAD, 24)
    states = plan.shape.states.copy()
    if what == "moments":
        states[..., 4:] *= 1.01
    if what == "turned":
        states[0, 20:, :, :4] @= np.eye(4) + 0.01 * np.eye(4, k=1) - 0.01 * np.eye(4, k=-1)
    wrong = spoilt(plan, states=states)
    if what == "other load":
        wrong = replace(plan, tip_forces=1.05 * plan.tip_forces)
    if what == "other activation":
        wrong = replace(plan, x=plan.x - [[0.002, 0.0, 0.0, 0.0]])
    assert wrong.status is Status.UNVERIFIED
    assert any("differ by" in fault for fault in wrong.verification.faults)


def test_where_there_is_no_equilibrium_nearby_the_plan_is_not_verified():
    plan = plan_of(thin_tipped_spec(), LOAD, 12)
    rng = np.random.default_rng(1)
    states = plan.shape.states * (1 + 0.5 * rng.normal(size=plan.shape.states.shape))
    assert spoilt(plan, states=states).status is Status.UNVERIFIED
    states[0, 3] = np.nan
    undone = spoilt(plan, states=states)
    assert undone.status is Status.UNVERIFIED
    assert any("differ by inf" in fault for fault in undone.verification.faults)


def test_the_limits_go_with_the_size_of_the_trunk():
    """The same arm at three sizes: what is off by a share of L is off at each."""
    for length in (0.005, 0.5, 50.0):
        loads = Loads(0.0, (0.0, 0.0, 0.049 * (length / 0.5) ** 2))
        plan = plan_of(thin_tipped_spec(0.02, length, 0.0), loads, 12)
        assert plan.status is Status.SOLVED
        for share, fine in ((2e-5, True), (2e-4, False)):
            edges = plan.shape.edges + np.array([share * length, 0, 0])
            moved = replace(plan, shape=replace(plan.shape, edges=edges))
            assert moved.verified == fine


def test_directors_inside_elements_are_held_against_the_independent_ones():
    """A mesh whose centerline passes may still be too coarse for directors at taper 0.9."""
    for elements in (3, 4, 6, 12, 24):
        plan = plan_of(thin_tipped_spec(0.036), LOAD, elements)
        if not plan.verification.too_coarse:
            break
    judge = Judge(plan.motion.trunk, GAMMA[0], np.zeros(2), LOAD)
    assert judge.error(plan.shape[0]) < 1e-4
    fine = plan_of(thin_tipped_spec(0.036), LOAD, 48).shape
    Z = np.linspace(0, 0.5, 400)
    off = np.linalg.norm(plan.shape.directors(Z) - fine.directors(Z), axis=-1).max()
    assert off < 5e-4


def test_a_compressed_plan_is_a_fault_and_a_strained_one_a_doubt():
    spec = thin_tipped_spec(0.0, 0.1, 0.0)
    area = math.pi * (0.04 * 0.1) ** 2 * 1e5
    passive = np.zeros((1, 2))
    strained = plan_of(spec, Loads(0.0, (0.0, 0.0, 1.5 * area)), 6, passive)
    assert strained.verified
    (doubt,) = strained.verification.doubts
    assert "stretch part of the trunk to 2.5 of its length" in doubt
    assert any("strain the trunk" in finding.what for finding in explain(strained).findings)
    easy = plan_of(spec, Loads(0.0, (0.0, 0.0, 0.5 * area)), 6, passive)
    assert easy.verification.doubts == []
    # Straight all along, the thrust of 1.6 E A would leave -0.6 of its length.
    crushed = replace(easy, tip_forces=np.array([[0.0, 0.0, -1.6 * area]]))
    crushed = spoilt(crushed, states=easy.shape.states)
    assert crushed.status is Status.UNVERIFIED
    assert "compress the trunk to -0.6 of its length" in crushed.verification.faults[0]
    assert any("Reduce the loads" in finding.advice for finding in explain(crushed).findings)


CONE = """
name = "touch"
anatomy = "cone.toml"
[bounds]
activation = [-2.0, 0.0]
extension = [0.7, 1.3]
[[phases]]
name = "one"
duration = 0.8
[[phases.targets]]
Z = 1.0
position = [0.1, 0.05, 0.9]
"""


def test_a_trunk_that_ends_almost_in_a_point_is_planned(tmp_path):
    ring = 'architecture = "longitudinal", radii_over_length = [0.02, 0.05]'
    pair = [
        f'{{ group = "{name}", {ring}, sector = [{a}, {b}] }}'
        for name, a, b in (("d", 0.0, 1.2), ("v", 1.9, 3.1))
    ]
    muscles = f"muscles = [{', '.join(pair)}]\n"
    text = soft_rod("cone") + muscles
    taper = math.degrees(math.atan(0.05 * (1 - 3e-5)))
    text = text.replace("\n[material]", f"taper_deg = {taper!r}\n\n[material]", 1)
    written(tmp_path, text, "cone.toml")
    plan = plan_motion(load_motion(written(tmp_path, CONE)), 1, throw=False)
    assert plan.status is Status.SOLVED
    assert math.isfinite(plan.objective.paper)


# --- gaps -------------------------------------------------------------------------------


def test_gaps_are_closed_as_by_all_equations_at_once():
    rng = np.random.default_rng(2)
    maps, gaps = rng.normal(size=(2, 3, 7, 7)), rng.normal(size=(2, 3, 7, 2))
    steps = solve_linear_bvp(maps, gaps)
    assert np.all(steps[:, 0, :4] == 0)  # the pose of the base
    assert np.all(steps[:, -1, 4:] == 0)  # the moment at the tip
    np.testing.assert_allclose(steps[:, 1:] - maps @ steps[:, :-1], gaps, atol=1e-10)


def test_a_rod_without_a_solution_is_no_fault_of_its_neighbors():
    rng = np.random.default_rng(3)
    maps, gaps = rng.normal(size=(4, 5, 6, 6)), rng.normal(size=(4, 5, 6, 1))
    alone = solve_linear_bvp(maps[3:], gaps[3:])
    maps[0, 2] = np.nan
    maps[1] = 0.0  # m(0) makes no difference
    gaps[2, 1] = np.inf
    steps = solve_linear_bvp(maps, gaps)
    assert np.isnan(steps[[0, 2]]).all()
    assert not np.isfinite(steps[1]).all()
    np.testing.assert_allclose(steps[3], alone[0], atol=1e-12)


def test_gaps_are_closed_where_marching_would_lose_every_digit():
    """y'' = 400 y over 60 units of 1 / 20: exp(60) is 1e26, the solution decays like exp(-x)."""
    K, h = 60, 1.0
    small = np.array([[np.cosh(h), np.sinh(h)], [np.sinh(h), np.cosh(h)]])
    maps = np.kron(small, np.eye(3))[None, None] * np.ones((1, K, 1, 1))
    gaps = np.zeros((1, K, 6, 1))
    gaps[0, 0, :3] = 1.0
    steps = solve_linear_bvp(maps, gaps)[0, :, :, 0]
    assert np.abs(steps).max() < 2
    np.testing.assert_allclose(steps[1:] - steps[:-1] @ maps[0, 0].T, gaps[0, :, :, 0], atol=1e-12)


# --- steps --------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def coarse():
    """A plan on a coarse mesh, whose shape is not quite the equilibrium."""
    return plan_of(thin_tipped_spec(), LOAD, 6)


def equilibrium(plan):
    Z = np.linspace(0, 0.5, 40)
    return equilibria(plan.motion.trunk, plan.x, plan.loads, plan.shape, Z)


def test_shorter_steps_lead_to_the_same_equilibrium(coarse, monkeypatch):
    path = equilibrium(coarse)
    monkeypatch.setattr(two_point, "TURN", 0.1)
    finer = equilibrium(coarse)
    np.testing.assert_allclose(path.position, finer.position, atol=1e-8)
    np.testing.assert_allclose(path.directors, finer.directors, atol=1e-7)


def test_steps_that_are_too_long_are_halved_or_nothing_is_found(coarse, monkeypatch):
    path = equilibrium(coarse)
    monkeypatch.setattr(two_point, "TURN", 2.0)
    np.testing.assert_allclose(equilibrium(coarse).position, path.position, atol=1e-8)
    monkeypatch.setattr(two_point, "MAX_HALVINGS", 0)
    assert np.isnan(equilibrium(coarse).position).all()
    assert coarse.status is not Status.SOLVED


def test_a_step_and_its_error_are_those_of_scipy(coarse):
    """The estimate of scipy's own step, and its interpolation, for the first interval."""
    nodes, (load,) = np.array([0.0, 0.02, 0.5]), coarse.loads
    trunk, units = coarse.motion.trunk, np.full(3, 1e-3)
    rods = _TwoPoint(trunk, coarse.x, coarse.loads, coarse.shape, nodes, units)
    rod = Rods(trunk, coarse.activations, [load], np.array([0.01]))
    unit = rods.unit[:, :, :1]

    def slope(at, y):
        return (rod.sections(np.array([at])).rates(y.reshape(15, 1, 1) * unit) / unit).ravel()

    start = (rods.starts[:, :, :1] / unit).ravel()
    scipys = DOP853(slope, 0.0, start, 0.02, first_step=0.02, rtol=1e-10, atol=1.0)
    scipys.step()
    assert scipys.t == 0.02
    estimate = scipys._estimate_error_norm(scipys.K, 0.02, np.ones(15))
    assert rods.error()[0, 0] == pytest.approx(estimate, rel=1e-6)
    Z = np.array([0.004, 0.013, 0.02])
    _, directors, moment = rods._at_points(Z)
    for i, at in enumerate(Z):
        expected = (scipys.dense_output()(at)[:, None] * unit[:, 0])[3:].reshape(3, 4)
        np.testing.assert_allclose(directors[0, i], expected[:, :3], atol=1e-12)
        np.testing.assert_allclose(moment[0, i], expected[:, 3], rtol=1e-10, atol=1e-14)


# --- what is tried in full by trust.equilibria ---------------------------------------------


def test_random_extreme_shapes_are_equilibria():
    tally = judge_shapes(6, seed=5)
    assert tally.faults == []
    assert tally.judged >= 3
    assert tally.undecided <= 1


def test_random_extreme_plans_are_what_they_say():
    tally = judge_plans(1, seed=5)
    assert tally.faults == []
    assert tally.judged >= 1


def test_the_judge_sees_a_shape_that_is_no_equilibrium():
    arm = thin_tipped()
    judge = Judge(arm, GAMMA[0], np.zeros(2), replace(LOAD, tip_force=(0.0, 0.0, 0.055)))
    shape = solve_statics(arm, GAMMA[0], loads=LOAD)
    assert judge.error(shape) > 1e-4


def test_verify_takes_no_steps_and_many():
    plan = plan_of(thin_tipped_spec(), LOAD, 12)
    none = verify(plan.motion, plan.x[:0], (), plan.part(0, 0), {})
    assert none.faults == none.doubts == []


# --- many steps -------------------------------------------------------------------------


def repeated(plan, count, states=None):
    """The plan's one step again and again, with states of their own if given."""
    x, trunk = np.repeat(plan.x, count, axis=0), plan.motion.trunk
    if states is None:
        states = np.repeat(plan.shape.states, count, axis=0)
    shape = shape_of_states(trunk, plan.mesh, x, plan.loads * count, states)
    motion = replace(plan.motion, steps=plan.motion.steps * count)
    forces = np.repeat(plan.tip_forces, count, axis=0)
    return replace(plan, motion=motion, x=x, tip_forces=forces, shape=shape)


def shaken(plan, count, seed=1):
    """States of steps, no equilibria at all."""
    states = np.repeat(plan.shape.states, count, axis=0)
    return states * (1 + np.random.default_rng(seed).normal(size=states.shape))


def slopes_of(plan, monkeypatch):
    """How many slopes of a rod the check of a plan takes."""
    taken = []
    real = Sections.rates

    def rates(self, y, *at):
        taken.append(y[0].size)
        return real(self, y, *at)

    with monkeypatch.context() as patched:
        patched.setattr(Sections, "rates", rates)
        assert plan.verification is not None
    return sum(taken)


def test_a_wrong_step_is_no_fault_of_the_others(monkeypatch):
    one = plan_of(thin_tipped_spec(), LOAD, 12)
    right = repeated(one, 6)
    states = right.shape.states.copy()
    states[[1, 4]] = shaken(one, 2)
    wrong = spoilt(right, states=states)
    limit = 12 * slopes_of(right, monkeypatch)  # it takes more iterations than the others
    assert slopes_of(wrong, monkeypatch) < limit
    bad = ~(wrong.verification.position_difference <= wrong.verification.max_position_difference)
    np.testing.assert_array_equal(np.flatnonzero(bad), [1, 4])
    assert right.status is Status.SOLVED
    assert wrong.status is Status.UNVERIFIED


def test_of_a_plan_that_is_wrong_all_along_not_every_step_is_solved(monkeypatch):
    one = plan_of(thin_tipped_spec(), LOAD, 12)
    solved = []

    def counted(trunk, x, *others):
        solved.append(len(x))
        return equilibria(trunk, x, *others)

    monkeypatch.setattr(verification, "equilibria", counted)
    wrong = repeated(one, 66, shaken(one, 66))
    assert wrong.status is Status.UNVERIFIED
    assert sum(solved) == 32
    assert np.all(~(wrong.verification.turn <= MAX_TURN))
    solved.clear()
    assert repeated(one, 66).verified
    assert sum(solved) == 66


def test_each_step_is_known_at_its_own_targets_alone():
    plan = plan_of(thin_tipped_spec(), LOAD, 12)
    (step,) = plan.motion.steps
    rng = np.random.default_rng(4)
    Z = rng.uniform(0.05, 0.5, (40, 30))
    steps = tuple(
        replace(step, targets=tuple(replace(step.targets[0], Z=z) for z in own))
        for own in Z.tolist()
    )
    many = repeated(plan, 40)
    many = replace(many, motion=replace(many.motion, steps=steps))
    check = many.verification
    assert [path.Z.size for path in check.targets] == [30] * 40
    np.testing.assert_array_equal(check.trajectory.Z, plan.verification.trajectory.Z)
    assert {0.0, 0.5} <= {*check.trajectory.Z}
    for t, i in ((0, 0), (17, 3), (39, 29)):
        position, directors = check.at(t, Z[t, i])
        np.testing.assert_allclose(position, plan.shape.position(Z[t, i])[0, 0], atol=1e-6)
        np.testing.assert_allclose(directors, plan.shape.directors(Z[t, i])[0, 0], atol=1e-5)
        away = np.linalg.norm(position - steps[t].targets[0].position)
        own = many.errors[t]
        assert own.position[list(own.position_Z).index(Z[t, i])] == pytest.approx(away)


# --- between steps ----------------------------------------------------------------------


def test_samples_are_resolved_where_the_mesh_of_the_plan_is_too_coarse():
    plan = plan_of(thin_tipped_spec(), LOAD, 1)
    sample = plan.sample(0.5)
    assert sample.shape.defect < 1e-5
    judge = Judge(plan.motion.trunk, sample.activation, sample.head, sample.loads)
    assert judge.error(sample.shape) < 1e-6
    coarse = sample.shape.on(plan.mesh)
    edges = sample.shape.position(np.asarray(plan.mesh.edges))
    np.testing.assert_allclose(coarse.edges, edges, atol=1e-12)
    np.testing.assert_allclose(coarse.position([0.5])[0], edges[-1], atol=2e-4)
    Z = plan.mesh.points.ravel()
    np.testing.assert_allclose(coarse.state(Z), sample.shape.state(Z), atol=1e-12)
    moments = for_blending(plan)
    assert moments.shape.mesh == plan.mesh
    assert len(moments.times) == len(moments.shape.states) >= 2


# --- bounds -----------------------------------------------------------------------------


def test_a_short_segment_is_held_to_the_bounds_on_extension():
    spec = thin_tipped_spec(0.0, 0.5, 0.0)
    (whole,) = spec.segments
    parts = tuple(
        whole.model_copy(update={"Z_over_length": edges, "muscles": muscles})
        for edges, muscles in (
            ((0.0, 0.501), ()),
            ((0.501, 0.509), whole.muscles),
            ((0.509, 1.0), ()),
        )
    )
    spec = spec.model_copy(update={"segments": parts})
    change = strains(build_trunk(spec), np.ones((1, 2)))[0, 1, 0] - 1
    for zeta_hat, excess in ((1.9, 0.0), (3.0, 1.0)):  # no more than 2 is allowed
        activation = np.full((1, 2), (zeta_hat - 1) / change)
        check = plan_of(spec, Loads(0.0, (0.0, 0.0, 0.01)), 12, activation).verification
        assert check.extension[0] == pytest.approx(excess, abs=1e-9)
        assert any("an extension bound" in fault for fault in check.faults) == (excess > 0)


def test_bounds_on_change_hold_unless_an_auxiliary_solution_binds():
    plan = plan_of(thin_tipped_spec(), LOAD, 24)
    (step,) = plan.motion.steps
    little = np.full(4, 0.01)
    for reach, free in ((math.inf, False), (0.5, True)):
        own = replace(step, change=Bounds(-little, little), auxiliary=Auxiliary(reach, math.inf))
        near = replace(plan, motion=replace(plan.motion, steps=(own,)), auxiliary={0: plan.x[0]})
        faults = near.verification.faults
        assert any("a bound on change" in fault for fault in faults) != free


@pytest.mark.parametrize("slope", [np.nan, np.inf, 1e300])
def test_an_integration_that_begins_without_a_number_ends(slope):
    def rates(at, y):
        return np.full_like(y, slope) * y

    assert dop853(rates, (0.0, 1.0), np.ones(3), np.array([1.0])) is None

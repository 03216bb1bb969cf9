"""Inertia of quasi-static motions: closed forms, differences of equilibria, reports."""

import math

import numpy as np
import pytest
from plans import POINT, shipped, written
from toys import SPEC, C, motion

from trunk_ocp.analysis.diagnosis import explain
from trunk_ocp.dynamics import quasi_static_motion
from trunk_ocp.dynamics.inertia import LEAST_LEVER, inertia_of
from trunk_ocp.dynamics.quasi_static_motion import instants_of
from trunk_ocp.dynamics.slowing import phases_with_inertia
from trunk_ocp.planning.planner import plan_motion
from trunk_ocp.planning.storage import summary
from trunk_ocp.problem.build import build_motion, load_motion
from trunk_ocp.problem.interpolation import interpolate_all, loads_before
from trunk_ocp.problem.problem_file import ProblemSpec
from trunk_ocp.problem.variants import slowed_spec
from trunk_ocp.rod.collocation import mesh_for
from trunk_ocp.rod.statics import solve_statics

FREE = {"activation": (-1.0, 0.0), "head_y_deg": (-180.0, 180.0)}


def toy(motion, gravity, **material):
    """A motion of the toy trunk with other material, under gravity."""
    anatomy = SPEC.model_copy(update={"material": SPEC.material.model_copy(update=material)})
    return build_motion(motion.spec.model_copy(update={"gravity": gravity}), anatomy)


def inertia(motion, x):
    """Inertia of controls x (steps, muscles + 2) of a motion without held directions."""
    return inertia_of(*state(motion, x))


def state(motion, x):
    """What `inertia_of` takes, for shapes in equilibrium."""
    x, loads = np.asarray(x, dtype=float), [step.loads for step in motion.steps]
    starts = {load.contact_from for load in loads} - {None}
    mesh = mesh_for(motion.trunk, *starts, elements=4)
    return motion, x, loads, solve_statics(motion.trunk, x[:, :-2], x[:, -2:], loads, mesh)


# --- closed forms --------------------------------------------------------------------------


def test_a_rod_that_shortens_accelerates_at_its_tip():
    """r = (1 + C gamma(t)) Z e_Z, and a cosine accelerates by pi^2 / (2 T^2) of its change."""
    duration, gamma = 0.8, -0.4
    short = toy(motion([(0.0, 0.0, 1.0)], [duration], FREE), 9.8, density=1000.0)
    found = inertia(short, [[gamma, gamma, 0.0, 0.0]])
    weightless = toy(motion([(0.0, 0.0, 1.0)], [duration], FREE), 0.0, density=1000.0)
    expected = abs(C * gamma) * math.pi**2 / (2 * duration**2)
    exact = inertia(weightless, [[gamma, gamma, 0.0, 0.0]])
    assert exact.acceleration[0] == pytest.approx(expected, rel=1e-4)
    assert np.isnan(exact.ratio[0])  # there is no weight to compare with
    assert found.ratio[0] == pytest.approx(0.0, abs=1e-5)  # it moves along its own axis
    assert found.frequencies.shape == (1, 3)


@pytest.mark.parametrize("tip_mass", [0.0, 5.0])
def test_a_stiff_rod_that_the_head_swings_is_a_pendulum(tip_mass):
    """I alpha / (m g lever); it starts hanging, where the least lever counts."""
    duration, turn, g = 1.3, 0.5, 9.8
    swung = motion([(0.0, 0.0, 1.0)], [duration], FREE)
    phase = swung.spec.phases[0]
    loads = phase.loads.model_copy(update={"tip_mass": tip_mass})
    phases = (phase.model_copy(update={"loads": loads}),)
    swung = swung.with_spec(swung.spec.model_copy(update={"phases": phases}))
    swung = toy(swung, g, density=1000.0, youngs_modulus=1e12)
    found = inertia(swung, [[0.0, 0.0, 0.0, turn]])
    mass = 1000.0 * math.pi * 0.05**2
    alpha = math.pi**2 / (2 * duration**2) * turn
    lever = mass / 2 + tip_mass
    start = (mass / 3 + tip_mass) * alpha / (g * lever * LEAST_LEVER)
    assert found.ratio[0] == pytest.approx(start, rel=1e-4)
    assert found.time[0] == 0
    assert found.acceleration[0] == pytest.approx(alpha, rel=1e-4)  # at 1 m


def test_ten_times_slower_is_a_hundred_times_less(tmp_path):
    fast = load_motion(written(tmp_path, POINT))
    rng = np.random.default_rng(1)
    x = np.column_stack([-0.2 * rng.random((4, 28)), 0.1 * rng.random((4, 2))])
    slow = fast.with_spec(slowed_spec(fast.spec, {0: 10.0, 1: 10.0}))
    a, b = inertia(fast, x), inertia(slow, x)
    np.testing.assert_allclose(b.ratio, a.ratio / 100, rtol=1e-3)
    np.testing.assert_allclose(b.acceleration, a.acceleration / 100, rtol=1e-3)
    np.testing.assert_allclose(b.frequencies, a.frequencies)
    # As much slower as is asked for, each phase has the ratio that is asked for.
    factors = {each.phase: each.factor for each in phases_with_inertia(fast, a, 0.02)}
    enough = fast.with_spec(slowed_spec(fast.spec, factors))
    for each in phases_with_inertia(enough, inertia(enough, x), 0.02):
        assert each.ratio == pytest.approx(0.02, rel=1e-3)
        assert each.factor == pytest.approx(1.0, rel=1e-3)


# --- differences of equilibria -------------------------------------------------------------


@pytest.mark.parametrize("name", ["lift-log", "lift-log-hung"])
def test_accelerations_are_second_differences_of_equilibria(name, draw, monkeypatch):
    """The log joins on the way, its load ramps, and where it hangs its lever turns."""
    moved = shipped(name)
    count, step, h = len(moved.steps), 4, 2e-3
    head = np.random.default_rng(2).uniform(-0.1, 0.1, (count, 2))
    x = np.column_stack([draw(moved.trunk, count, 3, strongest=0.3), head])
    parts = state(moved, x)
    for t in (1, step):
        found = instants_of(*parts, [t])
        middle = found.time[1]
        duration = moved.steps[t].duration
        times = middle + h * duration * np.arange(-2, 3)
        controls = interpolate_all(moved, np.vstack([moved.start, x]), times)
        near = parts[3][np.full(5, t)]
        loads = loads_before(moved, parts[2], t + 1, times)
        shapes = solve_statics(moved.trunk, controls[:, :-2], controls[:, -2:], loads, near=near)
        Z = near.mesh.points.ravel()
        weights = np.array([-1, 16, -30, 16, -1]) / 12 / (h * duration) ** 2  # of fourth order
        position = np.tensordot(weights, shapes.position(np.append(Z, 1.75)), 1)
        turned = np.tensordot(weights, shapes.directors(Z)[:, :, 1], 1)
        scale = np.abs(position).max()
        np.testing.assert_allclose(found.acceleration[1], position, atol=5e-4 * scale)
        scale = np.abs(turned).max()
        np.testing.assert_allclose(found.d2_acceleration[1], turned, atol=5e-4 * scale)
    coarse = inertia_of(*parts)
    monkeypatch.setattr(quasi_static_motion, "PER_STEP", 9)
    fine = inertia_of(*parts)
    assert np.all(coarse.ratio <= fine.ratio * (1 + 1e-9))
    np.testing.assert_allclose(coarse.largest, fine.largest, rtol=0.02)


# --- what plans report ---------------------------------------------------------------------


def test_a_plan_says_where_inertia_is_not_small(tmp_path):
    plan = plan_motion(load_motion(written(tmp_path, POINT)))
    report = summary(plan)
    steps = report["timesteps"]
    assert report["inertia_ratio"] == plan.inertia_ratio == max(s["inertia_ratio"] for s in steps)
    slackest = min((s["natural_frequencies"] for s in steps), key=lambda f: f[0])
    assert report["natural_frequencies"] == slackest == plan.natural_frequencies.tolist()
    assert plan.inertia_ratio > 0.1
    (finding,) = [f for f in explain(plan, deep=False).findings if "quasi-static" in f.what]
    worst = plan.inertia.worst
    name = plan.motion.phases[plan.motion.steps[worst].phase].name
    (detail,) = [detail for detail in finding.details if detail.startswith(f"{name}: ")]
    assert f"would be {plan.inertia_ratio:.2g} times the weight" in detail
    assert f"slow the phase by {math.sqrt(plan.inertia_ratio / 0.05):.2g}" in detail


def test_what_moves_at_once_is_not_counted(tmp_path):
    jumping = load_motion(written(tmp_path, POINT.replace('"hermite"', '"none"')))
    found = inertia(jumping, np.zeros((4, 30)) - 0.05 * np.append(np.ones(28), [0, 0]))
    assert np.all(np.isnan(found.ratio[2:]))
    assert np.all(np.isfinite(found.ratio[:2]))
    assert found.worst in (0, 1)


def test_controls_without_an_equilibrium_have_no_inertia(tmp_path):
    broken = load_motion(written(tmp_path, POINT))
    parts = list(state(broken, np.zeros((4, 30))))
    parts[1] = parts[1].copy()
    parts[1][0, :28] = -50.0  # collapses all segments
    found = inertia_of(*parts)
    assert np.isnan(found.ratio[:2]).all()
    assert np.isnan(found.frequencies[0]).all()
    assert found.ratio[3] == pytest.approx(0, abs=1e-9)
    nothing = inertia_of(broken, np.zeros((0, 30)), [], parts[3][:0])
    assert nothing.worst is None
    assert np.isnan(nothing.largest)
    assert np.isnan(nothing.natural_frequencies).all()
    assert not phases_with_inertia(broken, nothing)


def test_way_points_come_later_in_a_slower_problem():
    target = {"Z": 1.0, "through": ((0.0, 0.0, 0.0, 1.0), (1.0, 0.0, 0.1, 0.9))}
    phase = {"name": "a", "duration": 1.0, "steps": 2, "targets": (target,)}
    spec = ProblemSpec.model_validate(
        {"name": "a", "bounds": {"activation": (-1.0, 0.0), "extension": (0.5, 1.5)},
         "phases": (phase,)}
    )  # fmt: skip
    slow = slowed_spec(spec, {0: 3.0}).phases[0]
    assert slow.duration == 3.0
    assert [row[0] for row in slow.targets[0].through] == [0.0, 3.0]
    assert slowed_spec(spec, {}) == spec

"""Between time steps: section 5.2's interpolations, and an equilibrium at every instant."""

import numpy as np
import pytest
from plans import planned, shipped

from trunk_ocp.errors import InputError
from trunk_ocp.problem.interpolation import interpolate
from trust import reference

EXACT = 1e-12


def random_values(name, seed=5):
    """Values at time steps 0, 1, ...: three columns, zero at rest."""
    rng = np.random.default_rng(seed)
    return np.vstack([np.zeros((1, 3)), rng.normal(size=(len(shipped(name).steps), 3))])


@pytest.mark.parametrize("name", ["pick-fruit", "lift-log"])
def test_time_steps_are_reproduced(name):
    motion, values = shipped(name), random_values(name)
    for t, expected in zip(np.append(0.0, motion.times), values, strict=True):
        np.testing.assert_array_equal(interpolate(motion, values, t), expected)


def test_cosine_is_the_mean_in_the_middle_and_a_raised_cosine_elsewhere():
    motion, values = shipped("lift-log"), random_values("lift-log")
    middle = interpolate(motion, values, 1.2)  # phase 2 is from 1.0 to 1.4 s
    np.testing.assert_allclose(middle, (values[1] + values[2]) / 2, rtol=0, atol=EXACT)
    third = interpolate(motion, values, 1.0 / 3)  # (1 - cos(pi / 3)) / 2 = 1/4
    np.testing.assert_allclose(third, values[1] / 4, rtol=0, atol=EXACT)


def test_cosine_is_at_rest_at_both_ends():
    motion, values = shipped("lift-log"), random_values("lift-log")
    h = 1e-4
    for t in (h, 1.0 - h):
        nearest = values[0] if t < 0.5 else values[1]
        share = (1 - np.cos(np.pi * h)) / 2  # 2.5e-8: quadratic in h
        expected = share * np.abs(values[1]).max()
        assert np.abs(interpolate(motion, values, t) - nearest).max() <= expected + EXACT


def test_none_holds_the_earlier_step():
    motion, values = shipped("pick-fruit"), random_values("pick-fruit")
    for step in range(1, 21):
        between = motion.times[step - 1] + 0.99 * motion.steps[step].duration
        np.testing.assert_array_equal(interpolate(motion, values, between), values[step])


def test_hermite_is_smooth_inside_its_phase():
    motion, values = shipped("lift-log"), random_values("lift-log")
    h = 1e-6
    for knot in motion.times[2:9]:
        at = interpolate(motion, values, knot)
        left = (at - interpolate(motion, values, knot - h)) / h
        right = (interpolate(motion, values, knot + h) - at) / h
        # Second derivatives are of order 1 / (1/8 s)^2 = 64: each quotient is off by 64 h.
        np.testing.assert_allclose(left, right, rtol=0, atol=1e3 * h)


def test_hermite_is_at_rest_where_it_joins_its_neighbors():
    motion, values = shipped("lift-log"), random_values("lift-log")
    h = 1e-6
    for t, away in ((1.4, h), (2.4, -h)):
        rate = (interpolate(motion, values, t + away) - interpolate(motion, values, t)) / h
        assert np.abs(rate).max() <= 1e3 * h


@pytest.mark.parametrize("name", ["pick-fruit", "lift-log"])
def test_nothing_passes_beyond_its_neighbors(name):
    """So that bounds kept at time steps are kept in between."""
    motion, values = shipped(name), random_values(name)
    times = np.append(0.0, motion.times)
    for i in range(len(times) - 1):
        low = np.minimum(values[i], values[i + 1]) - EXACT
        high = np.maximum(values[i], values[i + 1]) + EXACT
        for t in np.linspace(times[i], times[i + 1], 12):
            at = interpolate(motion, values, t)
            assert np.all((low <= at) & (at <= high))


@pytest.mark.parametrize("t", [-1e-9, 2.4 + 1e-9, np.nan, np.inf])
def test_times_outside_the_motion_are_refused(t):
    with pytest.raises(InputError, match=r"expected a time from 0 to 2\.4 s"):
        interpolate(shipped("lift-log"), random_values("lift-log"), t)


def test_a_plan_cut_short_ends_where_it_was_cut():
    motion, values = shipped("lift-log"), random_values("lift-log")[:4]
    np.testing.assert_array_equal(interpolate(motion, values, motion.times[2]), values[3])
    with pytest.raises(InputError, match=r"from 0 to 1\.525 s"):
        interpolate(motion, values, 1.6)


# --- samples of a plan -------------------------------------------------------------------


def test_a_sample_at_a_time_step_is_that_step():
    plan = planned("lift-log", "sequential")
    Z = np.linspace(0, 1.75, 8)
    for step in (0, 1, 5, 9):
        sample = plan.sample(plan.motion.times[step])
        np.testing.assert_array_equal(sample.activation, plan.activations[step])
        np.testing.assert_array_equal(sample.head, plan.head[step])
        assert sample.loads.contact_force == plan.loads[step].contact_force
        # Two solvers on one mesh: Ipopt stops at 1e-8 relative, Newton's method at round-off.
        np.testing.assert_allclose(
            sample.shape.position(Z), plan.shape.position(Z)[step], rtol=0, atol=1e-6
        )


def test_a_motion_begins_with_the_passive_trunk():
    sample = planned("lift-log", "sequential").sample(0.0)
    assert not sample.activation.any()
    assert not sample.head.any()
    # DESIGN 2.10, printed with seven decimals; the planner's mesh is good for 0.1 mm.
    tip = sample.shape.position(np.array([1.75]))[0]
    np.testing.assert_allclose(tip, (0.6720968, 0, 1.6202937), rtol=0, atol=1e-4)


def test_activations_stay_within_bounds_between_steps():
    for name, strongest in (("pick-fruit", 3.0), ("lift-log", 3.5)):
        plan = planned(name, "sequential")
        values = np.vstack([np.zeros((1, 30)), plan.x])
        for t in np.linspace(0, plan.motion.times[-1], 101):
            activation = interpolate(plan.motion, values, min(t, plan.motion.times[-1]))[:28]
            assert activation.max() <= 1e-7  # Ipopt's own slack on bounds
            assert activation.min() >= -strongest - 1e-7


def test_a_log_is_taken_with_the_same_interpolation():
    log = planned("lift-log", "sequential")
    weight = log.loads[1].contact_force[2]
    forces = [log.sample(t).loads.contact_force[2] for t in (0.5, 1.0, 1.2, 1.4, 1.9)]
    np.testing.assert_allclose(forces, [0, 0, weight / 2, weight, weight], rtol=0, atol=1e-9)
    assert log.jumps == ()


@pytest.mark.parametrize(("name", "t"), [("lift-log", 1.17), ("lift-log", 2.03), ("pick-fruit", 3)])
def test_a_sampled_shape_is_an_equilibrium_from_the_right_base(name, t):
    plan = planned(name, "sequential")
    sample, Z = plan.sample(t), np.linspace(0, 1.75, 15)
    shape, trunk = sample.shape, plan.motion.trunk
    assert np.abs(shape.moment(np.array([1.75]))).max() <= 1e-6  # the tip is free; in N m
    r, d = reference.base(trunk, sample.head)
    np.testing.assert_allclose(shape.position(Z)[0], r, rtol=0, atol=1e-12)
    np.testing.assert_allclose(shape.directors(Z)[0], d, rtol=0, atol=1e-12)
    path, _, _ = reference.march(
        trunk, sample.activation, sample.head, [sample.loads], shape.moment(Z[:1]), Z, rtol=1e-8
    )
    # The planner's mesh: 0.1 mm is what verification allows.
    np.testing.assert_allclose(shape.position(Z), path[0], rtol=0, atol=1e-4)


@pytest.mark.parametrize("t", [-0.1, 2.5])
def test_samples_outside_the_plan_are_refused(t):
    with pytest.raises(InputError, match="expected a time from 0 to"):
        planned("lift-log", "sequential").sample(t)


@pytest.mark.parametrize("t", ["1.0", b"1", None, [1.0], np.array([1.0, 2.0]), 1j, object()])
def test_a_time_that_is_no_number_is_refused(t):
    with pytest.raises(InputError, match=r"t = .*: expected one number, a time in s"):
        planned("pick-fruit", "sequential").sample(t)

"""Motions of a user's own: the smallest file, paths, directors, another trunk."""

from dataclasses import replace

import numpy as np
import pytest
from plans import POINT, REACH, ROD, TOUCH, arm, written
from scipy.spatial.transform import Rotation

from trunk_ocp.errors import InputError
from trunk_ocp.planning.planner import plan_motion
from trunk_ocp.planning.status import Status
from trunk_ocp.problem.build import build_motion, load_motion


def solved(motion):
    plan = plan_motion(motion)
    assert plan.status is Status.SOLVED, (plan.missed, plan.verification.faults)
    return plan


def planned_text(folder, text):
    return solved(load_motion(written(folder, text)))


def test_the_smallest_problem_file_is_planned_and_verified(tmp_path):
    plan = planned_text(tmp_path, TOUCH)
    tip = plan.shape.position(np.array([1.75]))[0, 0]
    assert np.linalg.norm(tip - (0.6, 0.1, 1.2)) <= 0.02  # the default tolerance
    assert plan.verified


def test_a_path_is_followed_from_its_start_to_its_end(tmp_path):
    text = POINT.replace(
        "[[0.6, 0.1, 1.2], [0.7, 0.0, 1.1]]", "[[0.6, 0.1, 1.2], [0.8, 0.1, 1.1], [0.7, 0.0, 1.1]]"
    )
    plan = planned_text(tmp_path, text)
    first, last = (step.targets[0].position for step in plan.motion.steps[2:])
    # Quadratic Bezier (eq. 53) at t = 1/2: (c_1 + 2 p + c_end) / 4.
    np.testing.assert_allclose(first, (0.725, 0.075, 1.125), rtol=0, atol=1e-12)
    np.testing.assert_allclose(last, (0.7, 0.0, 1.1), rtol=0, atol=1e-12)
    assert max(errors.position.max() for errors in plan.errors) <= 0.02


WAY = [[0.6, 0.1, 1.2], [0.7, 0.0, 1.1], [0.8, 0.1, 1.0], [0.7, 0.2, 1.1]]


def through(folder, rows, steps, origin="base"):
    text = POINT.replace(
        "path = [[0.6, 0.1, 1.2], [0.7, 0.0, 1.1]]", f'through = {rows}\norigin = "{origin}"'
    )
    text = text.replace("duration = 0.5\nsteps = 2", f"duration = 0.5\nsteps = {steps}")
    return load_motion(written(folder, text))


def wanted(motion):
    """Positions that the second phase asks for."""
    return np.array([step.targets[0].position for step in motion.steps if step.phase == 1])


@pytest.mark.parametrize(
    ("steps", "at"), [(3, slice(1, None)), (4, slice(0, None)), (6, slice(1, None))]
)
def test_way_points_are_at_steps(tmp_path, steps, at):
    """From the end of the phase before on; with as many steps as points, one at each."""
    every = wanted(through(tmp_path, WAY, steps))
    found = every[1::2] if steps == 6 else every
    np.testing.assert_allclose(found, WAY[at], rtol=0, atol=1e-12)
    assert len(every) == steps


def test_way_points_have_their_own_times(tmp_path):
    rows = [[t, *point] for t, point in zip((0.0, 0.1, 0.3, 0.5), WAY, strict=True)]
    found = wanted(through(tmp_path, rows, 5))
    np.testing.assert_allclose(found[[0, 2, 4]], WAY[1:], rtol=0, atol=1e-12)


def test_between_way_points_the_curve_is_that_of_a_cubic(tmp_path):
    """Not-a-knot: points of one cubic are on that cubic, and so is all between them."""
    t = np.linspace(0.0, 0.5, 5)
    cubic = np.array([0.6 + t - 3 * t**3, 0.1 - t**2, 1.2 - t + 2 * t**3]).T
    found = wanted(through(tmp_path, np.column_stack([t, cubic]).tolist(), 10))
    t = np.linspace(0.05, 0.5, 10)
    expected = np.array([0.6 + t - 3 * t**3, 0.1 - t**2, 1.2 - t + 2 * t**3]).T
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9)


def test_before_the_first_and_after_the_last_way_point_is_where_they_are(tmp_path):
    rows = [[0.2, *WAY[0]], [0.3, *WAY[1]]]
    found = wanted(through(tmp_path, rows, 5))
    np.testing.assert_allclose(found, [WAY[0], WAY[0], WAY[1], WAY[1], WAY[1]], atol=1e-12)


def test_way_points_too_close_to_tell_apart_are_refused_by_row(tmp_path):
    """Two at the phase's end, up to rounding, would be at one time once they are clipped to it."""
    for last in ([0.5, 0.5 + 1e-10], [0.5 + 1e-10, 0.5 + 2e-10], [0.3, 0.3 + 1e-12]):
        times = [0.1, *last]
        rows = [[t, *point] for t, point in zip(times, WAY, strict=False)]
        with pytest.raises(InputError, match=r"through\[3\] is at t = 0\.[35].* after the row"):
            through(tmp_path, rows, 5)
    late = [[t, *point] for t, point in zip((0.0, 0.2, 0.5 + 1e-10), WAY, strict=False)]
    np.testing.assert_allclose(wanted(through(tmp_path, late, 5))[-1], WAY[2], atol=1e-8)


def test_way_points_may_be_measured_from_the_passive_tip(tmp_path):
    by = wanted(through(tmp_path, WAY, 4, "passive-tip")) - np.array(WAY)
    # The passive tip, DESIGN 2; to the digits that are given there.
    np.testing.assert_allclose(by, np.tile([0.6720968, 0, 1.6202937], (4, 1)), atol=1e-6)


def test_a_first_way_point_that_the_phase_before_does_not_reach_is_told(tmp_path):
    assert through(tmp_path, WAY, 3).warnings == ()
    (warning,) = through(tmp_path, [[0.5, 0.1, 1.2], *WAY[1:]], 3).warnings
    assert "through[1]" in warning
    assert "the end of the phase before" in warning


def test_a_plan_passes_through_all_way_points_without_stopping(tmp_path):
    motion = through(tmp_path, WAY, 4)
    assert motion.warnings == ()
    plan = solved(motion)
    tips = plan.verification.trajectory.position[2:, -1]
    assert np.linalg.norm(tips - WAY, axis=1).max() <= 0.02  # the default tolerance
    before, after = (
        plan.sample(t).shape.position(np.array([1.75]))[0] for t in motion.times[3] + [-0.01, 0.01]
    )
    assert np.linalg.norm(after - before) >= 0.002  # 0.1 m/s; the points are 1.4 m/s apart


def test_the_center_of_a_wrap_may_pass_through_way_points():
    spec = load_motion("lift-log").spec
    phases = [phase for phase in spec.phases if phase.wrap is not None and phase.wrap.path]
    assert phases
    phase = phases[0]
    rows = [[0.1, 0.0, 0.2], [0.2, 0.0, 0.1], [0.3, 0.0, 0.0]]
    wrap = phase.wrap.model_dump() | {"path": None, "through": tuple(map(tuple, rows))}
    changed = phase.model_copy(update={"wrap": type(phase.wrap).model_validate(wrap)})
    moving = [changed if p is phase else p for p in spec.phases]
    motion = build_motion(
        spec.model_copy(update={"phases": tuple(moving)}), load_motion("lift-log").anatomy
    )
    first = [s for s in motion.steps if s.phase == spec.phases.index(phase)]
    moved = np.subtract(first[-1].targets[-1].position, first[0].targets[-1].position)
    share = 2 * (1 - 1 / phase.steps)  # of the way, which is straight and even
    if phase.steps == 3:
        share = 2.0
    np.testing.assert_allclose(moved, np.multiply(share, [0.1, 0.0, -0.1]), atol=1e-9)


@pytest.mark.parametrize("director", [1, 2])
def test_d1_and_d2_can_be_asked_for(tmp_path, director):
    """The passive tip's own director, turned by a tenth of a radian about its tangent."""
    rest = load_motion("lift-log").trunk
    assert rest.length == 1.75
    tangent = np.array([0.312892, 0, 0.949789])  # d3(L) of the passive trunk, DESIGN 2
    across = {1: np.cross([0.0, 1, 0], tangent), 2: np.array([0.0, 1, 0])}[director]
    wanted = Rotation.from_rotvec(0.1 * tangent).apply(across)
    text = TOUCH.replace(
        "position = [0.6, 0.1, 1.2]", f"d{director} = {wanted.tolist()}\nd{director}_weight = 3.0"
    )
    plan = planned_text(tmp_path, text)
    (target,) = plan.motion.steps[0].targets
    assert [(j, w) for j, _, w in target.pairs()] == [(director - 1, 3.0)]
    reached = plan.verification.trajectory.directors[0, -1, director - 1]
    # 3 |error|^2 stands against an effort of 1e-5 |gamma|^2: 0.05 is the default tolerance.
    assert np.linalg.norm(reached - wanted / np.linalg.norm(wanted)) <= 0.05


def test_a_direction_need_not_be_of_unit_length(tmp_path):
    text = TOUCH.replace("position", "d3 = [0.0, 0.0, 7.0]\nposition")
    (target,) = load_motion(written(tmp_path, text)).steps[0].targets
    assert target.directions[2] == (0.0, 0.0, 1.0)


def test_a_trunk_of_its_own_stands_beside_the_problem_file(tmp_path):
    motion = arm(tmp_path, "position = [0.2, 0.1, 0.9]")
    assert motion.trunk.muscles == ("R1-top", "R1-low", "L1-top", "L1-low")
    plan = solved(motion)
    assert plan.x.shape == (1, 6)
    tip = plan.verification.trajectory.position[0, -1]
    assert np.linalg.norm(tip - (0.2, 0.1, 0.9)) <= 0.02


def test_a_symmetric_task_of_a_symmetric_trunk_is_done_symmetrically(tmp_path):
    """Target in the median plane, a strictly convex effort: right and left do the same."""
    plan = solved(arm(tmp_path, "position = [0.25, 0.0, 0.9]"))
    right, left = np.split(plan.activations[0], 2)
    # The optimum is flat: Ipopt's tolerance of 1e-8 on a curvature of 2e-5.
    np.testing.assert_allclose(right, left, rtol=0, atol=2e-3)
    assert abs(plan.shape.position(np.array([1.0]))[0, 0, 1]) <= 1e-4


def test_a_weightless_arm_rests_where_its_target_is(tmp_path):
    """Already there, so nothing needs to be done: effort and rate go to zero."""
    (tmp_path / "arm.toml").write_text(ROD)
    text = REACH.replace("[bounds]", "gravity = 0.0\n\n[bounds]", 1).replace(
        'anatomy = "arm.toml"\n\n', 'anatomy = "arm.toml"\n'
    )
    plan = planned_text(tmp_path, text + "position = [0.0, 0.0, 1.0]")
    # Ipopt keeps 1e-5-ish away from active bounds until its barrier is gone.
    assert np.abs(plan.x).max() <= 1e-3
    assert plan.errors[0].position.max() <= 1e-4


def test_a_motion_without_gravity_is_verified(tmp_path):
    """No load, no moment anywhere: the free tip's share of nothing is no fault."""
    plan = planned_text(tmp_path, TOUCH.replace("[bounds]", "gravity = 0.0\n\n[bounds]"))
    assert np.abs(plan.shape.moment(np.linspace(0, 1.75, 5))).max() <= 1e-3  # N m


def test_contact_may_start_at_the_base(tmp_path):
    text = TOUCH.replace(
        "duration = 1.0",
        "duration = 1.0\nloads.contact_from = 0.0\nloads.contact_force = [0.0, 0.0, 20.0]",
    )
    plan = planned_text(tmp_path, text)
    sample = plan.sample(0.5)
    assert sample.loads.contact_from == 0.0
    assert sample.loads.contact_force == pytest.approx((0, 0, 10.0))


def test_a_point_of_no_weight_cannot_be_missed(tmp_path):
    """Weight 0 asks for nothing, of positions as of directions."""
    asked = "\n[[phases.targets]]\nZ = 1.0\nposition = [9.0, 9.0, 9.0]\nposition_weight = 0.0\n"
    plan = planned_text(tmp_path, TOUCH + asked)
    assert plan.missed == []


def test_bounds_that_exclude_each_other_are_reported_not_raised(tmp_path):
    """No contraction, yet at least 1.2 times as long."""
    text = TOUCH.replace("[-3.0, 0.0]", "[0.0, 0.0]").replace("[0.67, 1.35]", "[1.2, 1.35]")
    plan = plan_motion(load_motion(written(tmp_path, text)), throw=False)
    assert plan.status is Status.INFEASIBLE


def test_a_start_from_another_trunk_is_refused(tmp_path):
    other = plan_motion(arm(tmp_path, "position = [0.2, 0.1, 0.9]"))
    motion = load_motion(written(tmp_path, POINT))
    with pytest.raises(InputError, match="start"):
        plan_motion(motion, start=replace(other, x=np.tile(other.x, (4, 1))))


def test_different_places_of_contact_are_refused(tmp_path):
    text = POINT.replace("steps = 2\n", "steps = 2\nloads.contact_from = 1.0\n", 1).replace(
        'interpolation = "hermite"', 'interpolation = "hermite"\nloads.contact_from = 1.2'
    )
    with pytest.raises(InputError, match=r"\[1\.0, 1\.2\].*one place"):
        load_motion(written(tmp_path, text))


def test_a_wrap_needs_room_between_its_points(tmp_path):
    """Points that coincide have no tangent: better refused than NaN."""
    wrap = (
        "[phases.wrap]\nZ = [0.8, 1.0]\npoints = 3\nlog_radius = 0.07\nangles_deg = [30.0, 30.0]\n"
        "center = [0.0, 0.0, 0.8]\nposition_weights = [1.0, 1.0, 1.0]\n"
        "d3_weights = [1.0, 1.0, 1.0]\n"
    )
    written(tmp_path, ROD, "arm.toml")
    path = written(tmp_path, REACH.replace("[[phases.targets]]\nZ = 1.0\n", wrap))
    with pytest.raises(InputError, match="wrap"):
        load_motion(path)

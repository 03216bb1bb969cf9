"""The three shipped motions say what sections 5, 6 and appendix B of the paper say."""

import math
from dataclasses import fields, is_dataclass, replace
from importlib import import_module
from pkgutil import walk_packages

import numpy as np
import pytest
from plans import POINT, TOUCH, shipped, written
from scipy.spatial.transform import Rotation

import trunk_ocp
from trunk_ocp.errors import InputError
from trunk_ocp.model.loads import Loads
from trunk_ocp.problem.build import load_motion
from trunk_ocp.problem.mirror import mirrored_motion
from trunk_ocp.problem.motion import HeldDirection, allowed
from trunk_ocp.problem.target_specs import TargetSpec

L = 1.75
EXACT = 1e-12  # decimals in the files are typed out to sixteen digits
PRINTED = 5e-5  # DESIGN prints loads with four decimals
PASSIVE_TIP = (0.6720968, 0.0, 1.6202937)  # r(L; 0) from DESIGN 2.10, printed to 1e-7 m
R_LOG = L / 24
W_LOG = math.pi * R_LOG**2 * (L / 2) * 1009 * 9.8
W_LONG_LOG = math.pi * R_LOG**2 * (0.75 * L) * 1009 * 9.8
LIFTS = ("lift-log", "lift-log-asymmetric")


def same(a, b, tolerance=EXACT):
    return np.allclose(a, b, rtol=0, atol=tolerance)


def change(step):
    """Bounds on change as (activations, psi_Z, psi_Y), each lower and upper."""
    low, high = step.change.lower, step.change.upper
    assert len({*low[:28]}) == len({*high[:28]}) == 1  # one bound for all muscles
    return [(low[i], high[i]) for i in (0, 28, 29)]


FREE = (-math.inf, math.inf)


def wrap_points(center):
    """Arc of eqs. (47)-(49): six points, and the one beyond the last."""
    Z = 0.8 * L + np.arange(6) * (L - 0.8 * L) / 5
    theta = math.pi / 2 + np.arange(7) * (-math.pi / 3 - math.pi / 2) / 5
    radius = 0.1185 * L - Z * math.tan(math.radians(4.81))
    distance = R_LOG + np.append(radius, radius[-1])
    e_Z = [Rotation.from_euler("y", angle).apply([0, 0, 1]) for angle in theta]
    return Z, np.asarray(center) + distance[:, None] * np.array(e_Z)


# --- pick a fruit ------------------------------------------------------------------------


def test_fruit_times_and_interpolation():
    motion = shipped("pick-fruit")
    expected = [1.5 + i * (2 / 3) / 20 for i in range(21)] + [1.5 + 2 / 3 + 2]
    assert same(motion.times, expected)
    assert same([step.duration for step in motion.steps], np.diff([0, *expected]))
    assert [p.interpolation for p in motion.phases] == ["cosine", "none", "cosine"]
    assert [step.phase for step in motion.steps] == [0] + 20 * [1] + [2]


def test_fruit_targets():
    motion = shipped("pick-fruit")
    goals = [step.targets for step in motion.steps]
    assert all(len(g) == 1 and g[0].Z == L for g in goals)
    assert all(g[0].position_weight == 8 and g[0].direction_weights[2] == 1 for g in goals)
    assert all(same(g[0].position, (0.7, 0.3, -0.2)) for g in goals[:21])  # eqs. (43), (44)
    assert same(goals[21][0].position, (-0.2, 0, 0.16))  # eq. (45)
    directions = [g[0].pairs() for g in goals]
    assert all(len(pairs) == 1 and pairs[0][0] == 2 for pairs in directions)
    assert same(directions[0][0][1], (0, 0, -1))
    assert all(pairs[0][1] == HeldDirection(0, L, 2) for pairs in directions[1:21])
    mouth = Rotation.from_euler("y", -3 * math.pi / 4).apply([0, 0, 1])
    assert same(directions[21][0][1], mouth)


def test_fruit_loads_pull_up_to_100_newton_then_carry_8_kilograms():
    motion = shipped("pick-fruit")
    steps = motion.steps
    assert all(step.loads == Loads(9.8) for step in steps[:21])
    assert steps[21].loads == Loads(9.8, (0, 0, 8 * 9.8))
    assert steps[0].pull is None
    assert steps[21].pull is None
    for T in range(1, 21):
        force, held = steps[T].pull
        assert force == pytest.approx(100 * T / 20, abs=EXACT)
        assert held == HeldDirection(0, L, 2)
    assert motion.held == (HeldDirection(0, L, 2),)
    assert motion.contact_from is None


def test_fruit_feasible_sets():
    steps = shipped("pick-fruit").steps
    for step in steps:
        assert same(step.box.lower[:28], -3.0)
        assert same(step.box.upper[:28], 0.0)
    assert same(steps[0].box.upper[28:], math.pi / 16)
    assert same(steps[0].box.lower[28:], -math.pi / 16)
    assert same(steps[21].box.lower[28:], (0, 11 * math.pi / 160))
    assert same(steps[21].box.upper[28:], (0, 21 * math.pi / 160))
    assert change(steps[0]) == change(steps[21]) == [FREE, FREE, FREE]
    for step in steps[1:21]:
        assert same(change(step), [(-0.02, 0.02), (0, 0), (0, 0)])  # 0.4 / 20


def test_fruit_auxiliary_problems():
    first, *pulling, last = shipped("pick-fruit").steps
    assert first.auxiliary is not None
    assert not first.auxiliary.binds  # "only as an initial guess"
    assert all(step.auxiliary is None for step in pulling)
    assert last.auxiliary.activation_deviation == 0.3
    assert math.isinf(last.auxiliary.head_deviation)


# --- lift a log --------------------------------------------------------------------------


@pytest.mark.parametrize("name", LIFTS)
def test_log_times_and_interpolation(name):
    motion = shipped(name)
    expected = [1.0, 1.4] + [1.4 + (i - 2) / 8 for i in range(3, 11)]
    assert same(motion.times, expected)
    assert [p.interpolation for p in motion.phases] == ["cosine", "cosine", "hermite"]
    assert [p.end for p in motion.phases] == pytest.approx([1.0, 1.4, 2.4], abs=EXACT)


@pytest.mark.parametrize("name", LIFTS)
def test_log_targets_lie_on_the_arc_along_the_path(name):
    """Eqs. (46)-(53), the first coefficient of (53) read as (1 - t)^2."""
    start = np.add(PASSIVE_TIP, (-0.4, 0, -0.45))
    middle, end = np.add(start, (0, 0, -0.4)), np.add(start, (0.2, 0, -0.6))
    Z, first = wrap_points(start)
    chords = np.diff(first, axis=0)
    tangents = chords / np.linalg.norm(chords, axis=1)[:, None]
    for T, step in enumerate(shipped(name).steps, 1):
        t = max(0.0, (T - 2) / 8)
        center = (1 - t) ** 2 * start + 2 * (1 - t) * t * middle + t**2 * end
        _, points = wrap_points(center)
        assert same([g.Z for g in step.targets], Z)
        assert same([g.position for g in step.targets], points[:6], 1e-7)
        entry, *between, exit_ = step.targets
        assert same(entry.directions[2], tangents[0])  # eqs. (48), (52)
        assert same(exit_.directions[2], tangents[5])  # eqs. (49), (52)
        assert not any(g.pairs() for g in between)


def test_log_weights():
    position = [7, 1, 1, 1, 1, 5]
    for step in shipped("lift-log").steps:
        assert [g.position_weight for g in step.targets] == position
        assert [g.direction_weights[2] for g in step.targets] == [1, 0, 0, 0, 0, 1]
    for step in shipped("lift-log-asymmetric").steps[1:]:
        assert [g.position_weight for g in step.targets] == position
        assert [g.direction_weights[2] for g in step.targets] == [0.5, 0, 0, 0, 0, 0.25]


def test_log_loads():
    motion = shipped("lift-log")
    assert motion.steps[0].loads == Loads(9.8)
    for step in motion.steps[1:]:
        assert step.loads.contact_from == pytest.approx(0.8 * L, abs=EXACT)
        assert same(step.loads.contact_force, (0, 0, W_LOG), 1e-9)
        assert same(step.loads.contact_force, (0, 0, 144.5203), PRINTED)
        assert step.loads.contact_couple == step.loads.tip_force == (0, 0, 0)


def test_asymmetric_loads_add_the_couple_of_eq_54():
    motion = shipped("lift-log-asymmetric")
    assert motion.steps[0].loads == Loads(9.8)
    for step in motion.steps[1:]:
        assert step.loads.contact_from == pytest.approx(0.8 * L, abs=EXACT)
        assert same(step.loads.contact_force, (0, 0, W_LONG_LOG), 1e-9)
        assert same(step.loads.contact_force, (0, 0, 216.7804), PRINTED)
        assert same(step.loads.contact_couple, (-0.3 * L * W_LONG_LOG, 0, 0), 1e-9)
        assert same(step.loads.contact_couple, (-113.8097, 0, 0), PRINTED)
        assert step.loads.tip_force == (0, 0, 0)


@pytest.mark.parametrize("name", LIFTS)
def test_the_index_sets_of_eq_b3(name):
    """x_12, x_13, x_14, x_26 ... from 1: segment 3 right and left; 11 and 25 are its dl."""
    box = shipped(name).steps[0].box
    lower = np.full(28, -3.0)
    lower[np.array([12, 13, 14, 26, 27, 28]) - 1] = -3.5
    lower[np.array([11, 25]) - 1] = 0.0
    assert same(box.lower[:28], lower)
    assert same(box.upper[:28], 0.0)
    assert same(box.upper[28:], (math.pi / 32, math.pi / 12))
    assert same(box.lower[28:], (-math.pi / 32, -math.pi / 12))


def test_log_changes_and_auxiliary_deviations():
    motion = shipped("lift-log")
    assert change(motion.steps[0]) == [FREE, FREE, FREE]
    for step in motion.steps[1:]:
        assert same(step.box.lower[:28], -3.5)
        assert same(step.box.upper[:28], 0.0)
        bound = math.pi / 64
        assert same(change(step), [(-0.4, 0.4), (-bound, bound), (0, bound)])
        # Nothing but the changes limits the head: nine of them from pi/12 stay inside the box.
        assert step.box.upper[29] >= math.pi / 12 + 9 * bound
    for step in motion.steps:
        assert (step.auxiliary.activation_deviation, step.auxiliary.head_deviation) == (0.4, 0)


def test_the_first_asymmetric_step_is_that_of_lift_log():
    """Appendix B.3: x*(1) is the same in both."""
    ours, theirs = (shipped(name).steps[0] for name in reversed(LIFTS))
    assert ours.targets == theirs.targets
    assert (ours.loads, ours.auxiliary) == (theirs.loads, theirs.auxiliary)
    assert np.array_equal(ours.box.lower, theirs.box.lower)
    assert np.array_equal(ours.box.upper, theirs.box.upper)


def test_asymmetric_changes():
    steps = shipped("lift-log-asymmetric").steps
    assert change(steps[1]) == [FREE, FREE, FREE]
    assert same(steps[1].box.upper[28:], math.pi / 12)
    assert same(steps[1].box.lower[28:], -math.pi / 12)
    for T, step in enumerate(steps[2:], 3):
        gamma = 1.0 if T == 5 else 0.7
        psi = math.pi / 32 if T in (3, 4) else math.pi / 64  # printed as -pi/64: a slip
        assert same(change(step), [(-gamma, gamma), (-psi, psi), (-psi, psi)])
    assert all(step.auxiliary is None for step in steps[1:])
    assert all(same(step.box.lower[:28], -3.5) for step in steps[1:])


@pytest.mark.parametrize("name", ["pick-fruit", *LIFTS])
def test_every_motion_has_the_measured_extension_limits_and_trunk(name):
    motion = shipped(name)
    assert motion.extension == (0.67, 1.35)
    assert motion.gravity == 9.8
    assert motion.name == name
    assert motion.trunk.name == "asian-elephant"


# --- bounds in general -------------------------------------------------------------------


def test_a_deviation_cuts_the_motions_own_bounds_not_the_auxiliary_ones():
    """Eq. (B.2): the neighborhood meets [-gamma_max, 0]; eq. (B.3) is the auxiliary's."""
    motion = shipped("lift-log")
    near = np.concatenate([np.full(28, -2.9), [0.05, 0.1]])
    box = allowed(motion, motion.steps[0], near)
    assert same(box.lower[:28], -3.3)
    assert same(box.upper[:28], -2.5)
    assert same(box.lower[28:], near[28:])
    assert same(box.upper[28:], near[28:])
    near[:28] = -0.1
    assert same(allowed(motion, motion.steps[0], near).upper[:28], 0.0)
    assert allowed(motion, motion.steps[0], None) is motion.steps[0].box


def test_later_patterns_and_later_changes_prevail(tmp_path):
    text = POINT.replace(
        "steps = 2\n\n",
        "steps = 2\n"
        'bounds.muscles = { "*" = [-2.0, 0.0], "L*" = [-1.0, 0.0], "L1-dl" = [-0.5, 0.0] }\n'
        "change = [{ activation = 0.3 }, { steps = [2, 2], activation = 0.1 }]\n\n",
        1,
    )
    first, second, third, _ = load_motion(written(tmp_path, text)).steps
    assert same(first.box.lower[:15], [*14 * [-2.0], -0.5])
    assert same(first.box.lower[15:28], -1.0)
    assert change(first)[0] == (-0.3, 0.3)
    assert change(second)[0] == (-0.1, 0.1)
    assert change(third) == [FREE, FREE, FREE]
    assert same(third.box.lower[:28], -3.0)  # the next phase has the motion's bounds again


def test_positions_may_be_measured_from_the_passive_tip(tmp_path):
    text = POINT.replace("Z = 1.75\nposition", 'Z = 1.75\norigin = "passive-tip"\nposition')
    target = load_motion(written(tmp_path, text)).steps[0].targets[0]
    assert same(target.position, np.add(PASSIVE_TIP, (0.6, 0.1, 1.2)), 1e-7)


def test_a_motion_cannot_be_changed_in_place():
    motion = shipped("lift-log")
    with pytest.raises(AttributeError):
        motion.steps = ()
    assert replace(motion, steps=motion.steps[:1]).times.tolist() == [1.0]


def test_patterns_are_as_many_as_are_matched_in_no_time(tmp_path, monkeypatch):
    """Names cost nothing and are not counted; the same pattern in every phase counts once."""
    monkeypatch.setattr("trunk_ocp.problem.muscle_patterns.MAX_MATCHES", 3 * 28)
    rows = [f'"{name}" = [-1.0, 0.0]' for name in shipped("lift-log").trunk.muscles]
    rows += [f'"{pattern}" = [-1.0, 0.0]' for pattern in ("R*", "L*", "*dl")]
    text = TOUCH + "[phases.bounds.muscles]\n" + "\n".join(rows)
    assert len(load_motion(written(tmp_path, text)).steps) == 1
    with pytest.raises(InputError, match=r"4 different patterns .* 28 muscles; expected at most 3"):
        load_motion(written(tmp_path, text + '\n"*vr" = [-1.0, 0.0]'))


def test_whatever_holds_arrays_can_be_compared_and_counted():
    """By identity: equality of arrays is no yes or no."""
    motion = shipped("lift-log")
    same = load_motion("lift-log")
    assert motion in [same, motion]
    assert motion != same
    assert len({motion, same, *motion.steps}) == 2 + len(motion.steps)
    assert motion.trunk == same.trunk
    assert motion.steps[0].loads == same.steps[0].loads
    assert motion.steps[0].targets == same.steps[0].targets


def test_no_class_compares_arrays():
    checked = 0
    for module in walk_packages(trunk_ocp.__path__, "trunk_ocp."):
        if "templates" in module.name or module.name.endswith("__main__"):
            continue
        for kind in vars(import_module(module.name)).values():
            if not (isinstance(kind, type) and is_dataclass(kind)):
                continue
            if any("ndarray" in str(field.type) for field in fields(kind)):
                assert kind.__eq__ is object.__eq__, kind
                checked += 1
    assert checked > 30


# --- the log -----------------------------------------------------------------------------


def test_a_step_has_the_log_that_its_targets_wrap_around():
    motion = shipped("lift-log")
    for number, step in enumerate(motion.steps):
        log, first = step.log, step.targets[0]
        assert (log.radius, log.length, log.offset) == (pytest.approx(R_LOG), L / 2, 0.0)
        assert log.mass == pytest.approx(W_LOG / 9.8)
        assert log.contact_from == (None if number == 0 else pytest.approx(0.8 * L))
        distance = np.linalg.norm(np.subtract(first.position, log.center))
        assert distance == pytest.approx(R_LOG + float(motion.trunk.radius(first.Z)), rel=1e-12)


def test_the_weight_of_a_log_turns_about_the_grip_as_its_couple_does():
    for motion in (shipped("lift-log-asymmetric"), mirrored_motion(shipped("lift-log-asymmetric"))):
        for step in motion.steps:
            if step.log.contact_from is None:
                continue
            arm = step.log.center[1] - step.targets[0].position[1]  # from the grip
            couple = np.cross([0.0, arm, 0.0], step.loads.contact_force)
            np.testing.assert_allclose(step.loads.contact_couple, couple, rtol=1e-12)


def test_a_mirrored_log_is_on_the_other_side():
    motion = shipped("lift-log-asymmetric")
    for step, image in zip(motion.steps, mirrored_motion(motion).steps, strict=True):
        np.testing.assert_allclose(image.log.center, np.array([1, -1, 1]) * step.log.center)
        assert image.log.offset == -step.log.offset != 0


def test_a_log_that_no_phase_carries_has_no_length_and_one_without_a_wrap_no_place(tmp_path):
    spec = shipped("lift-log").spec
    wrap, carry, _ = spec.phases
    light = shipped("lift-log").with_spec(spec.model_copy(update={"phases": (wrap,)}))
    assert (light.steps[0].log.length, light.steps[0].log.mass) == (None, None)
    target = TargetSpec(Z=1.75, position=(0.6, 0.1, 1.2))
    free = carry.model_copy(update={"wrap": None, "targets": (target,)})
    motion = shipped("lift-log").with_spec(spec.model_copy(update={"phases": (free,)}))
    assert motion.steps[0].log.center is None
    assert motion.steps[0].log.length == 0.875
    assert shipped("pick-fruit").steps[0].log is None


def test_a_target_names_the_section_that_it_comes_from():
    assert {target.source for target in shipped("lift-log").steps[1].targets} == {"phases[2].wrap"}
    assert shipped("pick-fruit").steps[-1].targets[0].source == "phases[3].targets[1]"

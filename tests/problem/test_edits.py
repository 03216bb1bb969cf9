"""Motions made and changed from Python are those that a file with the same values gives."""

import re

import numpy as np
import pytest
from plans import POINT, shipped, written
from toys import shortening

import trunk_ocp as to
from trunk_ocp._support.provenance import fingerprint
from trunk_ocp.errors import InputError
from trunk_ocp.problem.build import as_built, load_motion
from trunk_ocp.problem.mirror import is_symmetric, mirror_order, mirrored_motion

REACH = {"duration": 1.0, "steps": 3, "targets": [{"Z": 1.75, "position": [0.6, 0.1, 1.2]}]}
BOUNDS = {"activation": [-3.0, 0.0], "extension": [0.67, 1.35]}


def built(*phases, **sections):
    return to.Motion.build("built", phases or [REACH], bounds=BOUNDS, **sections)


@pytest.fixture(scope="module")
def point(tmp_path_factory):
    """Two phases, "reach" and "rise", with a target for the tip in each."""
    return load_motion(written(tmp_path_factory.mktemp("point"), POINT))


# --- building ------------------------------------------------------------------------------


def test_a_motion_from_python_is_that_of_the_file_which_says_the_same(tmp_path):
    rise = {"duration": 0.5, "steps": 2, "interpolation": "hermite"}
    path = np.array([[0.6, 0.1, 1.2], [0.7, 0.0, 1.1]])
    phases = (
        {**REACH, "name": "reach", "steps": 2},
        {**rise, "name": "rise", "targets": ({"Z": np.float32(1.75), "path": path},)},
    )
    motion = to.Motion.build("point", phases, bounds={"activation": (-3, 0)})
    same = load_motion(written(tmp_path, POINT))
    assert motion.spec == same.spec
    assert fingerprint([*motion.steps]) == fingerprint([*same.steps])
    assert as_built(motion)


def test_what_a_short_motion_leaves_out_has_defaults():
    motion = to.Motion.build("short", [REACH, REACH])
    assert [phase.name for phase in motion.phases] == ["phase 1", "phase 2"]
    assert motion.spec.bounds.activation == (-2.0, 0.0)
    assert to.Motion.build("wide", [REACH], bounds={"head_z_deg": [0, 1]}).spec.bounds.extension


FAULTS = {
    "a key": ({"stps": 2}, "stps = 2\n"),
    "a number": ({"duration": -1.0}, "duration = -1.0\n"),
    "a type": ({"duration": "1"}, 'duration = "1"\n'),
    "a target": ({"targets": [{"Z": 1.75}]}, "targets = [{ Z = 1.75 }]\n"),
    "a place": ({"targets": [{"Z": 17.5, "d3": [0, 0, 1]}]},
                "targets = [{ Z = 17.5, d3 = [0, 0, 1] }]\n"),
}  # fmt: skip


@pytest.mark.parametrize("name", FAULTS)
def test_faults_are_worded_as_those_of_a_file(tmp_path, name):
    keys, line = FAULTS[name]
    phase = {"name": "reach", "duration": 1.0, "targets": [{"Z": 1.75, "d3": [0, 0, 1]}], **keys}
    with pytest.raises(InputError) as caught:
        built(phase)
    rest = {"duration": "duration = 1.0\n", "targets": "targets = [{ Z = 1.75, d3 = [0, 0, 1] }]\n"}
    lines = [text for key, text in rest.items() if key not in keys]
    top = 'name = "built"\n[bounds]\nactivation = [-3.0, 0.0]\nextension = [0.67, 1.35]\n'
    text = f'{top}[[phases]]\nname = "reach"\n{line}{"".join(lines)}'
    with pytest.raises(InputError) as of_file:
        load_motion(written(tmp_path, text))
    assert str(caught.value).splitlines()[-1].strip() == str(of_file.value).splitlines()[-1].strip()


@pytest.mark.parametrize(
    "value", [float("nan"), 1e300, object(), {1, 2}, b"1", np.array([1j]), [[[1.0]]]]
)
def test_what_no_file_can_have_is_refused(value):
    with pytest.raises(InputError):
        built({**REACH, "duration": value})


@pytest.mark.parametrize("bounds", [None, (-1, 0), "wide", {"activation": None}])
def test_bounds_that_are_none_are_refused(bounds):
    with pytest.raises(InputError, match="bounds"):
        to.Motion.build("loose", [REACH], bounds=bounds)


def test_likely_mistakes_get_a_warning():
    motion = to.Motion.build("strong", [REACH], bounds={"activation": [0.0, 1.0]})
    assert "only lengthens" in motion.warnings[0]


# --- targets -------------------------------------------------------------------------------


@pytest.mark.parametrize("phase", ["reach", 1, np.int64(1)])
@pytest.mark.parametrize("position", [(0.5, 0.0, 1.0), np.array([0.5, 0, 1])])
def test_a_target_moves_in_its_phase_only(point, phase, position):
    moved = point.retarget(phase, position=position)
    assert [step.targets[0].position for step in moved.steps[:2]] == 2 * [(0.5, 0.0, 1.0)]
    same = zip(moved.steps[2:], point.steps[2:], strict=True)
    assert all(one.targets == other.targets for one, other in same)
    assert as_built(moved)
    assert point.steps[0].targets[0].position == (0.6, 0.1, 1.2)


def test_a_target_follows_way_points_one_for_each_step():
    rows = np.random.default_rng(0).normal(size=(3, 3))
    moved = built().retarget(through=rows)
    places = [step.targets[0].position for step in moved.steps]
    np.testing.assert_allclose(places, rows, rtol=1e-14, atol=1e-15)
    fixed = moved.retarget(position=rows[0])
    assert fixed.spec.phases[0].targets[0].through is None
    assert as_built(fixed)


def test_directions_and_weights_are_those_of_the_point_asked_for():
    both = {**REACH, "targets": [
        {"Z": 1.75, "position": [0.6, 0.1, 1.2], "d3": [0, 0, 1]}, {"Z": 0.9, "d2": [0, 1, 0]}
    ]}  # fmt: skip
    motion = built(both).retarget(Z=0.9, d2=(0, 3, 4), d2_weight=2.0)
    tip, middle = motion.retarget(Z=1.75, d3=[1, 0, 0], position_weight=5).steps[-1].targets
    assert middle.directions[1] == (0.0, 0.6, 0.8)
    assert middle.direction_weights[1] == 2.0
    assert (tip.directions[2], tip.position_weight) == ((1.0, 0.0, 0.0), 5.0)
    assert tip.position == (0.6, 0.1, 1.2)


def test_a_wrap_moves_with_its_log():
    log = shipped("lift-log")
    spec = log.spec.phases[0].wrap
    center = np.asarray(spec.center if spec.center is not None else spec.path[0]) + 0.01
    moved = log.retarget("wrap", center=center)
    alike = log.shifted((0.01, 0.01, 0.01))
    for one, other in zip(moved.steps[0].targets, alike.steps[0].targets, strict=True):
        np.testing.assert_allclose(one.position, other.position, atol=1e-14)
    assert as_built(moved)


REFUSED = {
    "a phase": (lambda m: m.retarget("raech", position=(0, 0, 1)), "reach, rise. Did you mean"),
    "phase 0": (lambda m: m.retarget(0, position=(0, 0, 1)), "number from 1 to 2"),
    "no phase": (lambda m: m.retarget(position=(0, 0, 1)), "expected one of reach, rise"),
    "a point": (lambda m: m.retarget(1, 0.9, position=(0, 0, 1)), "Z: 0.9 m; expected"),
    "a key": (lambda m: m.retarget(1, postion=(0, 0, 1)), "Did you mean position"),
    "a kind": (lambda m: m.retarget(1, d3=(0, 0, 1)), "targets[1].d3: the motion has none"),
    "a shape": (lambda m: m.retarget(1, position=(0, 1)), "targets[1].position"),
    "a number": (lambda m: m.retarget(1, position=(0, np.nan, 1)), "finite"),
    "a load": (lambda m: m.with_loads(tip_mas=3), "Did you mean tip_mass"),
    "a negative load": (lambda m: m.with_loads(tip_mass=-3), "phases[1].loads.tip_mass = -3"),
    "a log": (lambda m: m.with_loads(log={"density": 3.0}), "loads.log: missing in the motion"),
    "a muscle": (lambda m: m.weighted({"R9-*": 1}), 'weights.effort."R9-*": no such muscle'),
    "a weight": (lambda m: m.weighted(-1), "weights.effort = -1"),
    "a weight of a muscle": (lambda m: m.weighted({"*": -1}), "weights.effort.* = -1"),
    "a factor": (lambda m: m.weighted(terminal=0), "weights.terminal = 0"),
    "symmetry": (lambda m: m.weighted(symmetric=True), "not its own mirror image"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_does_not_fit_the_motion_is_refused(point, name):
    edit, message = REFUSED[name]
    with pytest.raises(InputError, match=re.escape(message)):
        edit(point)


def test_a_motion_keeps_the_kinds_of_its_targets():
    held = {**REACH, "targets": [{"Z": 1.75, "d3": {"held_from_step": 1}}]}
    motion = built({**REACH, "targets": [{"Z": 1.75, "d3": [0, 0, 1]}]}, held)
    for phase, value in ((1, {"held_from_step": 1}), (2, (0, 0, 1))):
        with pytest.raises(InputError, match="none of this kind"):
            motion.retarget(phase, d3=value)
    assert motion.retarget(2, d3={"held_from_step": 2}).steps[-1].targets[0].directions[2].step == 1


# --- loads ---------------------------------------------------------------------------------


def test_loads_change_in_one_phase_or_in_all(point):
    one = point.with_loads("rise", tip_mass=2.0)
    assert [step.loads.tip_force[2] for step in one.steps] == pytest.approx([0, 0, 19.6, 19.6])
    every = one.with_loads(tip_force=np.array([0, 0, 1.0]), gravity=10.0)
    assert [step.loads.tip_force[2] for step in every.steps] == [1.0, 1.0, 21.0, 21.0]
    assert {step.loads.gravity for step in every.steps} == {10.0}
    assert as_built(every)


def test_a_log_becomes_denser_where_it_is_carried():
    motion = shipped("lift-log")
    dense = motion.with_loads(log={"density": 900.0})
    for step, before in zip(dense.steps, motion.steps, strict=True):
        ratio = 900.0 / motion.spec.phases[-1].loads.log.density
        np.testing.assert_allclose(
            step.loads.contact_force, ratio * np.array(before.loads.contact_force), rtol=1e-14
        )
    assert dense.steps[-1].loads.contact_force[2] > 0
    assert as_built(dense)


# --- weights -------------------------------------------------------------------------------


def test_weights_replace_each_other_one_by_one(point):
    motion = point.weighted(rate=1e-3).weighted(effort={"*": 1e-4, "*1-dl": 1e-3})
    assert motion.weights == to.Weights({"*": 1e-4, "*1-dl": 1e-3}, 1e-3)
    assert motion.weights != to.Weights({"*": 1e-4}, 1e-3)
    assert as_built(motion)
    assert point.weights == to.Weights()


def test_later_patterns_override_earlier_ones_and_others_have_the_default():
    muscles = ("R1-dl", "R1-vr", "L1-dl", "L1-vr")
    effort = to.Weights({"*-dl": 2.0, "R1-dl": 3.0}).of_muscles(muscles)
    assert effort.tolist() == [3.0, to.Weights().effort, 2.0, to.Weights().effort]
    assert to.Weights({"R1-dl": 3.0, "*-dl": 2.0}).of_muscles(muscles)[0] == 2.0


def test_the_last_step_has_its_weights_times_the_factor():
    phase = {**REACH, "targets": [{**REACH["targets"][0], "d3": [0, 0, 1], "d3_weight": 0.5}]}
    steps = built(phase, weights={"terminal": 8.0}).steps
    weights = [(s.targets[0].position_weight, s.targets[0].direction_weights[2]) for s in steps]
    assert weights == [(1.0, 0.5), (1.0, 0.5), (8.0, 4.0)]


def test_efforts_change_sides_in_the_mirror(point):
    motion = point.weighted({"R*": 1e-3, "L1-dl": 1e-2, "*2-*": 1e-4})
    image, order = mirrored_motion(motion), mirror_order(motion.trunk)
    efforts = [each.weights.of_muscles(motion.trunk.muscles) for each in (motion, image)]
    np.testing.assert_array_equal(efforts[1], efforts[0][order])
    assert not np.array_equal(*efforts)
    midline = built({**REACH, "targets": [{"Z": 1.75, "position": [0.6, 0.0, 1.2]}]})
    assert is_symmetric(midline)
    assert not is_symmetric(midline.weighted({"R*": 1e-3}))


def test_a_motion_that_is_its_own_mirror_image_may_be_planned_alike_on_both_sides():
    midline = {**REACH, "targets": [{"Z": 1.75, "position": [0.6, 0.0, 1.2]}]}
    wide = {"head_z_deg": [-10.0, 45.0]}  # psi_Z is 0 whatever its bounds
    motion = to.Motion.build("both", [midline], bounds=wide, weights={"symmetric": True})
    assert all(step.box.lower[-2] == step.box.upper[-2] == 0 for step in motion.steps)
    assert shortening((-0.1,)).weighted(symmetric=True).spec.weights.symmetric
    for muscles in ({"R1-dl": [-1.0, 0.0]}, {"L*": [-1.0, 0.0]}):
        with pytest.raises(InputError, match="mirror image"):
            to.Motion.build("one", [midline], bounds={"muscles": muscles}).weighted(symmetric=True)

"""Variants of a motion are problems of their own, built from their spec."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from plans import MOTIONS, shipped, written

from trunk_ocp.analysis.lookahead_study import equal_bounds
from trunk_ocp.analysis.redundancy.ablation import motion_without
from trunk_ocp.errors import InputError
from trunk_ocp.model.solids import signed_distance
from trunk_ocp.problem.build import as_built, load_motion
from trunk_ocp.problem.mirror import mirrored_motion


def started(seed):
    """Start somewhere else."""

    def change(motion):
        rng = np.random.default_rng(seed)
        return motion.started(rng.uniform(-0.4, 0.1, len(motion.trunk.muscles) + 2))

    return change


OFFSETS = st.tuples(*[st.floats(-0.3, 0.3)] * 3)
MUSCLES = ("R1-dl", "L3-vr", "R2-ivo")
CHANGES = st.one_of(
    OFFSETS.map(lambda offset: lambda motion: motion.shifted(offset)),
    st.floats(0.5, 4.0).map(lambda most: lambda motion: motion.limited(activation=most)),
    st.floats(0.5, 9.0).map(lambda rate: lambda motion: motion.limited(rate=rate)),
    st.just(mirrored_motion),
    st.just(equal_bounds),
    st.sampled_from(["all", "none", "self,head", "log, obstacles"]).map(
        lambda kinds: lambda motion: motion.with_contact(kinds)
    ),
    st.sampled_from(MUSCLES).map(lambda name: lambda motion: motion_without(motion, (name,))),
    st.integers(0, 99).map(started),
    st.floats(0.0, 9.0).map(lambda mass: lambda motion: motion.with_loads(1, tip_mass=mass)),
    st.sampled_from([0.0, 1.6]).map(lambda g: lambda motion: motion.with_loads(gravity=g)),
    st.floats(0.1, 9.0).map(
        lambda w: lambda motion: motion.weighted({"R*": w, "*1-dl": 2 * w}, terminal=w)
    ),
)
HARD = """
name = "hard"
[bounds]
activation = [-3.0, 0.0]
extension = [0.67, 1.35]
head_z_deg = [-5.0, 20.0]
[bounds.muscles]
"*1-dl" = [-1.0, 0.0]
"R*" = [-2.5, 0.2]
"[L]3-*" = [-0.7, 0.0]
[[phases]]
name = "reach"
duration = 1.0
steps = 2
auxiliary = { activation_deviation = 0.4 }
change = [{ activation = 0.9, head_z_deg = [-4.0, 8.0] }, { steps = [2, 2], activation = 2.0 }]
loads.tip_mass = 2.0
loads.log = { contact_from = 1.4, radius = 0.05, length = 1.0, density = 500.0, offset = 0.2 }
[phases.bounds]
activation = [-2.0, 0.0]
muscles = { "L1-dl" = [-0.5, 0.0] }
[[phases.targets]]
Z = 1.75
origin = "passive-tip"
path = [[0.0, 0.1, -0.2], [0.1, 0.2, -0.1]]
d2 = [0.3, 0.9, 0.1]
[[phases]]
name = "pull"
duration = 0.3
loads.pull = { force = 20.0, along = "d2", held_from_step = 1 }
loads.contact_from = 1.4
loads.contact_couple = [1.0, 2.0, 3.0]
[phases.wrap]
Z = [1.4, 1.75]
points = 2
log_radius = 0.1
angles_deg = [50.0, -50.0]
center = [0.5, 0.2, 1.0]
position_weights = [1.0, 1.0]
d3_weights = [1.0, 0.0]
[contact]
obstacles = true
[[obstacles]]
name = "crate"
shape = "box"
center = [0.3, 0.8, 0.4]
half_sizes = [0.1, 0.2, 0.3]
rotation_deg = [20.0, -30.0, 40.0]
phases = ["pull"]
[[obstacles]]
name = "pole"
shape = "capsule"
from = [0.9, -0.8, 1.7]
to = [0.8, -0.9, -0.4]
radius = 0.1
clearance = 0.02
frame = "head"
Z = [0.5, 1.75]
[[obstacles]]
name = "slope"
shape = "half-space"
point = [0.0, 0.0, 2.5]
normal = [0.1, 0.2, -3.0]
"""


def many(count):
    return settings(
        max_examples=count,
        derandomize=True,
        database=None,
        deadline=None,
        suppress_health_check=list(HealthCheck),
    )


@pytest.fixture(scope="module")
def hard(tmp_path_factory):
    """A motion with bounds, loads and targets of every kind."""
    return load_motion(written(tmp_path_factory.mktemp("hard"), HARD))


def varied(motion, changes):
    for change in changes:
        motion = change(motion)
    return motion


@many(100)
@given(changes=st.lists(CHANGES, min_size=1, max_size=4), name=st.sampled_from([*MOTIONS, "hard"]))
def test_the_spec_of_a_variant_builds_it(hard, changes, name):
    try:
        motion = varied(hard if name == "hard" else shipped(name), changes)
    except InputError:  # a limit that leaves a muscle nothing
        return
    assert as_built(motion)


@pytest.mark.parametrize("name", MOTIONS)
def test_a_motion_moved_and_moved_back_asks_for_the_same(name):
    motion = shipped(name)
    back = motion.shifted((0.1, 0.02, -0.3)).shifted((-0.1, -0.02, 0.3))
    for step, same in zip(motion.steps, back.steps, strict=True):
        for target, other in zip(step.targets, same.targets, strict=True):
            assert (target.position is None) == (other.position is None)
            if target.position is not None:
                np.testing.assert_allclose(other.position, target.position, rtol=0, atol=1e-15)


def test_a_limit_narrows_and_never_widens(hard):
    motion = hard.limited(activation=0.9, rate=1.0)
    for step, before in zip(motion.steps, hard.steps, strict=True):
        assert np.all(step.box.lower[:-2] >= -0.9)
        assert np.all(step.box.lower >= before.box.lower)
        assert np.all(step.box.upper <= before.box.upper)
        assert np.all(step.change.upper[:-2] <= step.duration)
        assert np.all(step.change.upper <= before.change.upper)


@pytest.mark.parametrize(
    "offset",
    [
        (1.0, 2.0),
        (1.0, np.nan, 0.0),
        (np.inf, 0.0, 0.0),
        np.zeros((1, 3)),
        "abc",
        None,
        (1e30, 0, 0),
    ],
)
def test_an_offset_that_is_none_is_refused(offset):
    with pytest.raises(InputError, match="offset"):
        shipped("lift-log").shifted(offset)


def heavier(motion):
    steps = (
        replace(step, loads=replace(step.loads, tip_force=(0, 0, 9.0))) for step in motion.steps
    )
    return replace(motion, steps=tuple(steps))


def test_a_variant_is_built_from_the_spec_alone(hard):
    assert as_built(mirrored_motion(heavier(hard)).shifted((0.01, 0.0, 0.0)))


def test_obstacles_are_there_in_their_phases_and_stay_where_they_are(hard):
    reach, pull = hard.steps[0], hard.steps[-1]
    assert [solid.name for solid in reach.solids if solid.group == "obstacles"] == ["pole", "slope"]
    assert [solid.name for solid in pull.solids if solid.group == "obstacles"] == [
        "crate", "pole", "slope"
    ]  # fmt: skip
    assert hard.shifted((0.1, 0.2, 0.3)).steps[0].solids == reach.solids
    pole = reach.solids[-2]
    assert (pole.frame, pole.clearance, pole.Z) == ("head", 0.02, (0.5, 1.75))


def test_the_log_is_a_solid_wherever_it_has_a_place(hard):
    for name in ("lift-log", "lift-log-asymmetric"):
        for step in shipped(name).steps:
            (log,) = (solid for solid in step.solids if solid.group == "log")
            assert step.log.center == log.center
            assert log.sizes == (step.log.radius, step.log.length / 2)
            np.testing.assert_array_equal(log.axes[2], [0, 1, 0])
            np.testing.assert_array_equal(np.cross(log.axes[0], log.axes[1]), log.axes[2])
    assert not [solid for solid in hard.steps[0].solids if solid.group == "log"]


def test_obstacles_are_mirrored(hard):
    points = np.random.default_rng(3).uniform(-1, 2, (50, 3))
    image = mirrored_motion(hard)
    for step, other in zip(hard.steps, image.steps, strict=True):
        pairs = zip(step.solids, other.solids, strict=True)
        obstacles = [pair for pair in pairs if pair[0].group == "obstacles"]
        assert len(obstacles) >= 2
        for solid, reflected in obstacles:
            assert solid.name == reflected.name
            there = signed_distance(reflected, points * [1, -1, 1])[0]
            np.testing.assert_allclose(there, signed_distance(solid, points)[0], atol=1e-14)


@pytest.mark.parametrize("kinds", ["", "everything", "head self", "self,", "all,self", "none,log"])
def test_contact_with_what_does_not_exist_is_refused(kinds):
    with pytest.raises(InputError, match=r"contact = .*expected all, none, or some of self, head"):
        shipped("lift-log").with_contact(kinds)


def test_contact_of_a_variant_replaces_that_of_the_file(hard):
    assert hard.contact == {"obstacles"}
    assert hard.with_contact("all").contact == {"self", "head", "log", "obstacles"}
    assert hard.with_contact("self, log").contact == {"self", "log"}
    assert hard.with_contact("none").contact == set()
    assert shipped("pick-fruit").contact == set()

"""Time steps without targets: when they are, what loads, bounds and numbers they have."""

import numpy as np
import pytest
from plans import POINT, shipped, with_phases, written

from trunk_ocp.errors import InputError
from trunk_ocp.problem.build import load_motion
from trunk_ocp.problem.interpolation import loads_at
from trunk_ocp.problem.mirror import mirrored_motion
from trunk_ocp.problem.variants import refined_spec

MOTIONS = ("pick-fruit", "lift-log", "lift-log-asymmetric")
FREE = pytest.mark.parametrize("free", [1, 3])


def refined(motion, free, **update):
    return with_phases(motion, free_steps=free, **update)


@pytest.mark.parametrize("name", MOTIONS)
@FREE
def test_steps_with_targets_are_what_they_were(name, free):
    motion = shipped(name)
    finer = refined(motion, free)
    parts = free + 1
    assert len(finer.steps) == parts * len(motion.steps)
    for number, step in enumerate(motion.steps):
        same = finer.steps[parts * (number + 1) - 1]
        assert same.time == pytest.approx(step.time, rel=1e-12)
        assert same.duration == pytest.approx(step.duration / parts)
        assert (same.loads, same.phase, same.log) == (step.loads, step.phase, step.log)
        assert len(same.targets) == len(step.targets)
        assert all(not s.targets for s in finer.steps[parts * number : parts * (number + 1) - 1])
        np.testing.assert_allclose(parts * same.change.upper, step.change.upper)
        np.testing.assert_allclose(parts * same.change.lower, step.change.lower)
        if step.pull is not None:
            assert same.pull[0] == pytest.approx(step.pull[0])


@pytest.mark.parametrize("name", MOTIONS)
@FREE
def test_held_directions_come_from_the_same_steps(name, free):
    motion = shipped(name)
    finer = refined(motion, free)
    before = sorted((h.step, h.Z, h.director) for h in motion.held)
    after = sorted((h.step, h.Z, h.director) for h in finer.held)
    assert after == [((free + 1) * (step + 1) - 1, Z, j) for step, Z, j in before]


@pytest.mark.parametrize("name", MOTIONS)
@FREE
def test_loads_on_the_way_are_those_of_interpolation(name, free):
    """Without free steps, the loads at these instants follow from the steps around them."""
    motion = shipped(name)
    finer = refined(motion, free)
    loads = [step.loads for step in motion.steps]
    for step in finer.steps:
        if step.targets:
            continue
        wanted = loads_at(motion, loads, step.time)
        for part in ("tip_force", "contact_force", "contact_couple"):
            got = getattr(step.loads, part)
            np.testing.assert_allclose(got, getattr(wanted, part), rtol=1e-9, atol=1e-9)
        assert step.loads.gravity == pytest.approx(wanted.gravity)


@pytest.mark.parametrize("name", MOTIONS)
def test_a_mirrored_motion_has_mirrored_free_steps(name):
    motion = refined(shipped(name), 1)
    there = mirrored_motion(motion)
    back = mirrored_motion(there)
    assert len(there.steps) == len(motion.steps)
    for step, other, again in zip(motion.steps, there.steps, back.steps, strict=True):
        assert bool(step.targets) == bool(other.targets)
        force, mirrored = np.array(step.loads.contact_force), np.array(other.loads.contact_force)
        np.testing.assert_allclose(mirrored, force * [1, -1, 1])
        couple, turned = np.array(step.loads.contact_couple), np.array(other.loads.contact_couple)
        np.testing.assert_allclose(turned, couple * [-1, 1, -1])
        np.testing.assert_allclose(again.loads.contact_force, step.loads.contact_force)


def test_cosine_becomes_hermite_so_that_the_trunk_does_not_stop(tmp_path):
    motion = load_motion(written(tmp_path, POINT))
    kinds = [phase.interpolation for phase in refined(motion, 1).phases]
    assert kinds == ["hermite", "hermite"]
    assert [phase.interpolation for phase in refined(motion, 0).phases] == ["cosine", "hermite"]


def test_refining_doubles_steps_and_keeps_narrower_bounds(tmp_path):
    motion = load_motion(written(tmp_path, POINT))
    spec = refined_spec(motion.spec, {1: (0.4, 0.2, 0.1)})
    once = motion.with_spec(spec)
    assert [bool(s.targets) for s in once.steps] == [True, True, False, True, False, True]
    np.testing.assert_allclose(once.steps[-1].change.upper[-3:], [0.2, 0.1, 0.05])
    twice = motion.with_spec(refined_spec(spec, {1: (0.8, 0.4, 0.2)}))
    assert len(twice.steps) == 10
    np.testing.assert_allclose(twice.steps[-1].change.upper[-3:], [0.1, 0.05, 0.025])


@pytest.mark.parametrize("free", ["-1", "1.5", '"a"', "100000", "true"])
def test_numbers_of_free_steps_that_make_no_sense_are_refused(tmp_path, free):
    text = POINT.replace("steps = 2", f"steps = 2\nfree_steps = {free}", 1)
    with pytest.raises(InputError, match="free_steps"):
        load_motion(written(tmp_path, text))


def test_a_motion_of_too_many_steps_in_all_is_refused(tmp_path):
    text = POINT.replace("steps = 2", "steps = 900\nfree_steps = 15")
    with pytest.raises(InputError, match="steps"):
        load_motion(written(tmp_path, text))

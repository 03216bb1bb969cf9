"""What is dragged on the live page, as motions: against `retarget`, Bezier curves and the file."""

import numpy as np
import pytest
from plans import POINT, shipped, written

from trunk_ocp.errors import InputError
from trunk_ocp.problem.build import load_motion
from trunk_ocp.viewer.live_edits import EditableMotion, Edits

BY = np.array([0.03, -0.02, 0.05])


def dragged(motion, name, by=BY):
    """The motion with a handle moved."""
    editable = EditableMotion(motion)
    edits = editable.dragged(motion, Edits(), name, tuple(place(motion, name) + by))
    return editable.edited(edits)


def place(motion, name):
    handles = {handle.name: handle for handle in EditableMotion(motion).handles(motion)}
    return handles[name].position


def moves(motion, other):
    """How far the place of each target moved, (steps, targets, 3)."""
    return [
        np.subtract([t.position for t in b.targets], [t.position for t in a.targets])
        for a, b in zip(motion.steps, other.steps, strict=True)
    ]


@pytest.mark.parametrize("name", ["0:0", "0:3", "1:log", "5:2", "9:log", "9:0"])
def test_a_handle_is_where_it_was_dragged(name):
    motion = shipped("lift-log")
    assert place(dragged(motion, name), name) == pytest.approx(place(motion, name) + BY, abs=1e-12)


def test_a_place_that_the_motion_comes_back_to_moves_as_one():
    motion = shipped("pick-fruit")
    moved = dragged(motion, "0:0")
    fruit = tuple(np.add(motion.spec.phases[0].targets[0].position, BY))
    again = motion.retarget("reach", position=fruit).retarget("pull", position=fruit)
    for a, b in zip(moved.steps, again.steps, strict=True):
        assert a.targets[0].position == pytest.approx(b.targets[0].position, abs=1e-12)
    assert not moves(motion, moved)[-1].any()  # the mouth stays


def test_the_end_of_a_path_moves_alone_and_its_start_with_the_log_that_lies_there():
    motion = shipped("lift-log")
    end, start, middle = (moves(motion, dragged(motion, n)) for n in ("9:log", "0:log", "5:log"))
    for step in range(10):
        share = max(0, step - 1) / 8  # of the path of eight steps
        assert end[step] == pytest.approx(np.tile(share * BY, (6, 1)), abs=1e-12)
        assert start[step] == pytest.approx(np.tile((1 - share) * BY, (6, 1)), abs=1e-12)
        assert middle[step] == pytest.approx(np.tile(BY, (6, 1)), abs=1e-12)


def test_a_curve_through_points_bends_as_little_as_a_path(tmp_path):
    rows = "through = [[0.0, 0.6, 0.1, 1.2], [0.1, 0.7, 0.1, 1.2], [0.5, 0.7, 0.0, 1.1]]"
    text = POINT.replace("path = [[0.6, 0.1, 1.2], [0.7, 0.0, 1.1]]", rows)
    motion = load_motion(written(tmp_path, text))
    shares = [step[0] for step in moves(motion, dragged(motion, "3:0"))]
    assert shares == pytest.approx(np.outer([0, 0, 0.5, 1], BY), abs=1e-12)


def test_many_small_moves_are_as_good_as_one():
    motion = shipped("lift-log")
    editable, edits, now = EditableMotion(motion), Edits(), motion
    for _ in range(30):
        edits = editable.dragged(now, edits, "9:2", tuple(place(now, "9:2") + BY / 30))
        now = editable.edited(edits)
    for a, b in zip(now.steps, dragged(motion, "9:2").steps, strict=True):
        assert a.log.center == pytest.approx(b.log.center, abs=1e-12)


def test_what_turns_with_the_head_cannot_be_dragged():
    motion = shipped("feed-fruit")
    turning = [
        f"{number}:{n}"
        for number, step in enumerate(motion.steps)
        for n, target in enumerate(step.targets)
        if target.frame == "head"
    ]
    assert turning
    assert not {*turning} & {handle.name for handle in EditableMotion(motion).handles(motion)}
    for name in (turning[0], "9", "99:0", "x:y", ":", "0:log"):
        with pytest.raises(InputError, match="expected the name of a target"):
            EditableMotion(motion).dragged(motion, Edits(), name, (0.0, 0.0, 1.0))


def test_bounds_narrow_those_of_the_file_and_a_rate_limits_each_step():
    motion = shipped("lift-log")
    edits = Edits().bounded("*-dl", -0.5, 0.0).bounded("R2-vr", -0.2, -0.1).limited(2.0)
    edited = EditableMotion(motion).edited(edits)
    for before, after in zip(motion.steps, edited.steps, strict=True):
        for i, name in enumerate(motion.trunk.muscles):
            own = (before.box.lower[i], before.box.upper[i])
            low, high = {"R2-vr": (-0.2, -0.1)}.get(name, own)
            low = max(low, -0.5) if name.endswith("-dl") else low
            assert (after.box.lower[i], after.box.upper[i]) == (low, high)
        least = np.minimum(before.change.upper[:-2], 2.0 * before.duration)
        assert after.change.upper[:-2] == pytest.approx(least)


@pytest.mark.parametrize(
    ("muscles", "pair", "words"),
    [
        ("*-xx", (-1.0, 0.0), "no such muscle"),
        ("*", (0.0, -1.0), "lower bound is above the upper"),
        ("R3-dl", (-2.0, -1.0), "no value left"),
    ],
)
def test_bounds_that_cannot_be_are_refused_with_a_sentence(muscles, pair, words):
    with pytest.raises(InputError, match=words):
        EditableMotion(shipped("lift-log")).edited(Edits().bounded(muscles, *pair))

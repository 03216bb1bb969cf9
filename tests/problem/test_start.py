"""Where a motion starts: `[start]` in its file, `Motion.started` in Python."""

from dataclasses import fields

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plans import TOUCH, shipped, written
from toys import C, shortening

from trunk_ocp.errors import InputError
from trunk_ocp.problem.build import as_built, load_motion
from trunk_ocp.problem.mirror import mirrored_controls, mirrored_motion
from trunk_ocp.problem.problem_file import ProblemSpec
from trunk_ocp.problem.variants import silenced_spec

CHANGE = "duration = 1.0\nchange = [{ activation = 0.1 }]"


def touching(folder, start, change="duration = 1.0"):
    text = TOUCH.replace("[[phases]]", f"[start]\n{start}\n[[phases]]", 1)
    return load_motion(written(folder, text.replace("duration = 1.0", change)))


def activated(motion, **values):
    x0 = np.zeros(len(motion.trunk.muscles) + 2)
    for name, value in values.items():
        x0[motion.trunk.muscles.index(name.replace("_", "-"))] = value
    return x0


# --- in a file ---------------------------------------------------------------------------


def test_a_motion_starts_at_rest_unless_its_file_says_otherwise(tmp_path):
    motion = load_motion(written(tmp_path, TOUCH))
    np.testing.assert_array_equal(motion.start, np.zeros(30))
    assert not motion.warnings


def test_later_patterns_override_earlier_ones_and_angles_are_in_degrees(tmp_path):
    keys = 'activation = { "*-dl" = -0.2, "L*" = -0.1, "R1-dl" = -0.3 }\nhead_y_deg = -3.0'
    motion = touching(tmp_path, keys)
    for name, value in zip(motion.trunk.muscles, motion.start, strict=False):
        right = {"R1-dl": -0.3, "R2-dl": -0.2, "R3-dl": -0.2}.get(name, 0.0)
        assert value == (-0.1 if name.startswith("L") else right)
    assert motion.start[-2:].tolist() == [0.0, np.radians(-3.0)]
    assert not motion.warnings


@pytest.mark.parametrize(
    ("start", "message"),
    [
        ('activation = { "R1-xl" = -0.2 }', r'start\.activation\."R1-xl": no such .*R1-dl\?'),
        ('activation = { "X*" = -0.2 }', r'start\.activation\."X\*": no such muscle'),
        ('activation = { "*-dl" = -30.0 }', r"makes segment 1 -.* times as long; expected more"),
        ("activation = -0.2", r"start\.activation = -0\.2: "),
        ('activation = { "R1-dl" = nan }', r"start\.activation\.R1-dl = nan: "),
        ("head_x_deg = 1.0", r"start\.head_x_deg: unknown key\. Did you mean"),
        ("head_z_deg = [1.0, 2.0]", r"start\.head_z_deg = \[1\.0, 2\.0\]: "),
    ],
)
def test_an_impossible_start_is_refused(tmp_path, start, message):
    with pytest.raises(InputError, match=message):
        touching(tmp_path, start)


@pytest.mark.parametrize(
    ("start", "change", "words"),
    [
        ('activation = { "R1-dl" = 0.2 }', "duration = 1.0",
         'start.activation."R1-dl" = 0.2: outside the motion\'s bounds, -3 to 0, which count from '
         "step 1 on; negative contracts."),
        ('activation = { "R*" = 0.02 }', "duration = 1.0", "; so are 13 more."),
        ("head_z_deg = 95.0", "duration = 1.0", "start.head_z_deg = 95: outside"),
        ('activation = { "*-dl" = -2.9 }', "duration = 1.0",
         "times as long, outside the motion's bounds, 0.67 to 1.35"),
        ('activation = { "R1-dl" = 0.2 }', CHANGE, "cannot be reached by the changes allowed"),
    ],
)  # fmt: skip
def test_a_start_outside_bounds_is_legal_with_a_warning(tmp_path, start, change, words):
    assert any(words in warning for warning in touching(tmp_path, start, change).warnings)


def test_a_start_outside_bounds_that_a_change_can_leave_is_not_impossible(tmp_path):
    (warning,) = touching(tmp_path, 'activation = { "R1-dl" = 0.1 }', CHANGE).warnings
    assert "outside the motion's bounds" in warning


# --- in Python ---------------------------------------------------------------------------


ANGLES = st.floats(-1.5, 1.5)


@settings(max_examples=50, derandomize=True, database=None, deadline=None)
@given(seed=st.integers(0, 10**6), angles=st.tuples(ANGLES, ANGLES))
def test_a_started_motion_is_what_its_spec_builds(seed, angles):
    motion = shipped("pick-fruit")
    x0 = np.append(np.random.default_rng(seed).uniform(-0.5, 0.05, 28), angles)
    here = motion.started(x0)
    np.testing.assert_array_equal(here.start[:-2], x0[:-2])
    np.testing.assert_array_max_ulp(here.start[-2:], np.where(abs(x0[-2:]) < 1e-24, 0, x0[-2:]), 1)
    there = here.started(here.start)
    assert there.spec == here.spec
    again = ProblemSpec.model_validate_json(here.spec.model_dump_json())
    rebuilt = motion.with_spec(again)
    np.testing.assert_array_equal(rebuilt.start, here.start)


def test_starting_changes_nothing_else():
    """`started` is quick because it does not build the motion again; that would change nothing."""
    motion = shipped("lift-log")
    here = motion.started(activated(motion, R1_dl=-0.2, L3_vr=1e-30))
    assert here.spec.start.activation == {"R1-dl": -0.2}  # a file has no number as small as 1e-30
    assert as_built(here)
    kept = {field.name for field in fields(motion)} - {"spec", "start"}
    assert all(getattr(here, name) is getattr(motion, name) for name in kept)


def test_rest_is_the_start_of_a_motion_without_one():
    motion = shipped("lift-log")
    there_and_back = motion.started(activated(motion, R1_dl=-0.2)).started(np.zeros(30))
    assert there_and_back.spec == motion.spec
    np.testing.assert_array_equal(there_and_back.start, motion.start)


@pytest.mark.parametrize(
    ("x0", "message"),
    [
        (np.zeros(28), r"start: expected 30 finite values.*got shape \(28,\)"),
        (np.zeros((1, 30)), r"got shape \(1, 30\)"),
        (np.full(30, np.nan), r"start: expected 30 finite values"),
        (np.full(30, 1e30), r"start: no problem file can have it \(activation\.R1-dl: .*1e-24"),
        (np.full(30, -20.0), r"makes segment 1 .* times as long"),
        ({"R1-dl": -0.2}, r"expected an array of real numbers"),
        ("rest", r"expected an array of real numbers"),
    ],
)
def test_what_is_no_start_is_refused(x0, message):
    with pytest.raises(InputError, match=message):
        shipped("pick-fruit").started(x0)


# --- variants ----------------------------------------------------------------------------


def test_the_mirror_image_starts_in_the_mirror_image():
    motion = shipped("lift-log-asymmetric")
    x0 = np.random.default_rng(5).uniform(-0.3, 0.0, 30)
    image = mirrored_motion(motion.started(x0))
    np.testing.assert_array_equal(image.start, mirrored_controls(motion.trunk, x0))
    np.testing.assert_array_equal(mirrored_motion(image).start, motion.started(x0).start)


def test_patterns_of_one_side_are_mirrored(tmp_path):
    motion = touching(tmp_path, 'activation = { "*1-*" = -0.1, "R*-dl" = -0.2, "[L]2-vr" = -0.3 }')
    image = mirrored_controls(motion.trunk, motion.start)
    assert np.any(image != motion.start)
    np.testing.assert_array_equal(mirrored_motion(motion).start, image)


def test_a_muscle_that_is_taken_away_does_not_work_at_the_start_either(tmp_path):
    motion = touching(tmp_path, 'activation = { "*1-dl" = -0.1 }')
    without = motion.with_spec(silenced_spec(motion.spec, ("R1-dl",)))
    np.testing.assert_array_equal(without.start, activated(motion, L1_dl=-0.1))


@pytest.mark.parametrize(
    "variant",
    [
        lambda motion: motion.shifted((0.0, 0.0, 0.1)),
        lambda motion: motion.limited(activation=0.9, rate=1.0),
        lambda motion: motion.with_contact("self"),
    ],
)
def test_other_variants_start_where_the_motion_does(variant):
    x0 = np.array([-0.2, -0.2, 0.0, 0.0])
    motion = variant(shortening((-0.5, -0.5)).started(x0))
    np.testing.assert_array_equal(motion.start, x0)
    assert 1 + C * x0[0] < 1

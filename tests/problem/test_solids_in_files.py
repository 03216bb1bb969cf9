"""Solids of anatomy and problem files: faults, and warnings on what is probably wrong."""

import re

import pytest
from plans import TOUCH, written

from trunk_ocp.errors import InputError
from trunk_ocp.model.anatomy import anatomies_folder, load_anatomy
from trunk_ocp.problem.build import load_motion
from trunk_ocp.problem.mirror import mirrored_motion

ELEPHANT = (anatomies_folder() / "asian-elephant.toml").read_text()
MOUTH = "point = [-0.25, 0.0, 0.245]"
BALL = """
[[obstacles]]
name = "ball"
shape = "sphere"
center = [1.5, 0.0, 0.0]
radius = 0.1
"""


def other(folder, old, new):
    """A motion of an elephant whose file differs by one line."""
    assert old in ELEPHANT
    (folder / "other.toml").write_text(ELEPHANT.replace(old, new, 1))
    text = TOUCH.replace('name = "touch"', 'name = "touch"\nanatomy = "other.toml"', 1)
    return load_motion(written(folder, text))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("half_axes = [0.34, 0.33, 0.40]", "", r"head\.body\[1\].*half_axes is missing"),
        (
            "half_axes = [0.34, 0.33, 0.40]",
            "half_axes = [0.34, 0.33]",
            r"head\.body\[1\]\.half_axe",
        ),
        ("Z = [0.6, 1.75]", "Z = [0.6, 1.76]", r"head\.body\[1\]\.Z = \[0\.6, 1\.76\].* 1\.75 m"),
        ("Z = [0.6, 1.75]", 'frame = "space"', r"head\.body\[1\]\.frame: unknown key"),
        ("direction = [5.0, 0.0, 8.0]", "direction = [0, 0, 0]", r"head\.mouth.*zero vector"),
    ],
)
def test_a_fault_of_the_head_is_named(tmp_path, old, new, message):
    assert old in ELEPHANT
    path = tmp_path / "other.toml"
    path.write_text(ELEPHANT.replace(old, new, 1))
    with pytest.raises(InputError, match=message):
        load_anatomy(path)


@pytest.mark.parametrize("name", ["itself", "log", "trunk base"])
def test_parts_of_the_head_have_names_of_their_own(tmp_path, name):
    path = tmp_path / "other.toml"
    second = f'[[head.body]]\nname = "{name}"\nshape = "sphere"\ncenter = [0, 0, 1]\nradius = 0.1\n'
    first = second.replace(name, "trunk base")
    path.write_text(ELEPHANT + first + second)
    with pytest.raises(InputError, match=rf"{name} is the name of another solid"):
        load_anatomy(path)


def test_an_obstacle_needs_a_name_that_no_part_of_the_head_has(tmp_path):
    text = TOUCH + BALL.replace('"ball"', '"skull"')
    with pytest.raises(InputError, match=r'obstacles\[1\]\.name = "skull": .*another solid'):
        load_motion(written(tmp_path, text))


@pytest.mark.parametrize(("z", "side"), [(0.255, "outside"), (0.235, "inside")])
def test_a_mouth_off_the_head_is_a_warning(tmp_path, z, side):
    assert load_motion(written(tmp_path, TOUCH)).warnings == ()
    (warning,) = other(tmp_path, MOUTH, f"point = [-0.25, 0.0, {z}]").warnings
    assert "head.mouth.point" in warning
    assert re.search(rf"[78]\.\d+ mm {side} of the head", warning)  # 10 mm down, aslant


@pytest.mark.parametrize(
    ("old", "new", "key"),
    [("radius = 0.1", "radius = 1000.0", "radius"), ("[1.5,", "[1500.0,", "center")],
)
def test_an_obstacle_in_mm_is_a_warning(tmp_path, old, new, key):
    assert load_motion(written(tmp_path, TOUCH + BALL)).warnings == ()
    (warning,) = load_motion(written(tmp_path, TOUCH + BALL.replace(old, new))).warnings
    assert f"obstacles[1].{key}" in warning
    assert "looks like mm" in warning


def test_a_head_that_is_not_its_own_mirror_image_has_no_mirrored_motion(tmp_path):
    motion = other(tmp_path, 'name = "left ear"', 'name = "left ear"\nclearance = 0.01')
    with pytest.raises(InputError, match="not its own mirror image"):
        mirrored_motion(motion)

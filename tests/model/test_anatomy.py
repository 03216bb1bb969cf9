"""Anatomies: the shipped one is the paper's, others are possible, faults are named."""

import math

import numpy as np
import pytest

from trunk_ocp.errors import InputError
from trunk_ocp.model.anatomy import check_activation, load_anatomy

# Table 1, right side: inner and outer radius at Z = 0 over L, first and second sector angle.
TABLE_1 = {
    "1-dl": (0.0869, 0.1185, 0.0000, 1.7279),
    "1-ovo": (0.1027, 0.1185, 1.7279, 2.9845),
    "1-ivo": (0.0869, 0.1027, 1.7279, 3.1416),
    "1-dr": (0.0580, 0.0869, 0.0000, 1.5708),
    "1-vr": (0.0470, 0.0761, 1.5708, 3.1416),
    "2-dl": (0.1016, 0.1185, 0.0000, 2.0944),
    "2-ovo": (0.1016, 0.1185, 2.0944, 2.9217),
    "2-ivo": (0.0596, 0.1016, 1.0472, 3.1416),
    "2-dr": (0.0680, 0.1016, 0.0000, 1.0472),
    "2-vr": (0.0281, 0.0596, 1.0472, 3.1416),
    "3-dl": (0.0901, 0.1185, 0.0000, 0.7854),
    "3-ovo": (0.1024, 0.1185, 1.9635, 3.1416),
    "3-dr": (0.0579, 0.0876, 0.0000, 0.7854),
    "3-vr": (0.0318, 0.0766, 1.5708, 3.1416),
}

ROD = """
name = "rod"
length = 1.0
base_radius_over_length = 0.1
taper_deg = 2.0
[material]
youngs_modulus = 1.0e6
poisson_ratio = 0.5
density = 1000.0
"""
MUSCLE = """
[[segments]]
Z_over_length = [0.0, 1.0]
muscles = [{ group = "dl", architecture = "longitudinal", radii_over_length = [0.05, 0.1], \
sector = [0.0, 1.5] }]
"""


def test_shipped_trunk_has_the_muscles_of_table_1_in_the_order_of_the_unknowns(trunk):
    assert trunk.muscles == tuple(f"{side}{name}" for side in "RL" for name in TABLE_1)


@pytest.mark.parametrize("name", TABLE_1)
def test_shipped_muscles_are_those_of_table_1_and_mirror_by_eq_18(trunk, name):
    inner, outer, first, second = TABLE_1[name]
    right, left = (trunk.subdomains[trunk.muscles.index(side + name)] for side in "RL")
    # Products and differences of the printed numbers: exact to round-off.
    assert right.radii == pytest.approx((1.75 * inner, 1.75 * outer), rel=1e-15)
    assert left.radii == right.radii
    assert right.sector == (first, second)
    assert left.sector == pytest.approx((2 * math.pi - second, 2 * math.pi - first), rel=1e-15)
    helix = {"ovo": -math.pi / 6, "ivo": math.pi / 6}.get(name[2:], 0.0)  # section 3.2, 3.6
    assert (right.helix, left.helix) == pytest.approx((helix, -helix), rel=1e-15)
    assert right.segment == left.segment == int(name[0]) - 1


def test_shipped_trunk_has_the_dimensions_of_section_3_6(trunk):
    assert trunk.length == 1.75
    assert trunk.edges == pytest.approx((0, 0.875, 1.4875, 1.75), rel=1e-15)
    assert (trunk.youngs_modulus, trunk.poisson_ratio, trunk.density) == (1e6, 0.5, 1059.7)
    assert trunk.tan_taper == pytest.approx(math.tan(math.radians(4.81)), rel=1e-15)
    assert trunk.base_radius == pytest.approx(0.1185 * 1.75, rel=1e-15)
    # The paper rounds R_0(0) / R_0(L) to 3.46 and the taper to 4.81 deg: half a percent.
    assert trunk.radius(0) / trunk.radius(1.75) == pytest.approx(3.46, rel=5e-3)
    assert float(trunk.radius(1.75)) == pytest.approx(0.0601158, abs=5e-8)  # DESIGN, as printed


def test_shipped_head_is_that_of_section_3_9(trunk):
    head = trunk.head
    assert head.pivot_radius == pytest.approx(1.75 / 4, rel=1e-15)
    angles = tuple(np.degrees((head.xi_z, head.xi_y, head.xi_d)))
    assert angles == pytest.approx((0, 100, 30), rel=1e-14)


def test_a_rod_without_muscles_and_taper_is_an_anatomy(tmp_path):
    path = tmp_path / "rod.toml"
    path.write_text(ROD.replace("taper_deg = 2.0", "") + "[[segments]]\nZ_over_length = [0, 1]\n")
    rod = load_anatomy(path)
    assert (rod.muscles, rod.segments, rod.taper_rate) == ((), 1, 0.0)
    assert rod.radius(1.0) == rod.base_radius == pytest.approx(0.1)
    assert rod.head.pivot_radius == 0.0


def test_a_muscle_may_be_on_one_side_only(tmp_path):
    path = tmp_path / "left.toml"
    path.write_text(ROD + MUSCLE.replace("[0.0, 1.5] }", '[0.0, 1.5], sides = ["L"] }'))
    assert load_anatomy(path).muscles == ("L1-dl",)


def test_an_anatomy_loads_from_a_path_given_as_text_or_path(tmp_path):
    path = tmp_path / "rod.toml"
    path.write_text(ROD + MUSCLE)
    assert load_anatomy(str(path)) == load_anatomy(path)


# A fault: what is replaced in a good file, by what, and the words the message must have:
# key, offending value, expectation.
FAULTS = {
    "unknown key": ('name = "rod"', 'name = "rod"\nlenght = 1.0', ("lenght", "unknown", "length")),
    "unknown muscle key": (
        'group = "dl"',
        'group = "dl", angle = 1.0',
        ("angle", "unknown", "muscles[1]"),
    ),
    "missing key": ("length = 1.0\n", "", ("length", "missing")),
    "text as number": ("length = 1.0\n", 'length = "1.75"\n', ("length", "1.75", "number")),
    "negative length": ("length = 1.0\n", "length = -1.0\n", ("length", "-1.0", "greater than 0")),
    "infinite length": ("length = 1.0\n", "length = inf\n", ("length", "finite")),
    "zero radius": (
        "_length = 0.1\n",
        "_length = 0.0\n",
        ("base_radius_over_length", "0.0", "greater"),
    ),
    "negative modulus": ("modulus = 1.0e6", "modulus = -1.0", ("material.youngs_modulus", "-1.0")),
    "poisson ratio": ("ratio = 0.5", "ratio = 0.6", ("material.poisson_ratio", "0.6", "0.5")),
    "gap at the base": (
        "[0.0, 1.0]",
        "[0.1, 1.0]",
        ("segments[1].Z_over_length", "0.1", "start at 0"),
    ),
    "short of the tip": ("[0.0, 1.0]", "[0.0, 0.9]", ("0.9", "end at 1")),
    "backward segment": ("[0.0, 1.0]", "[0.0, 0.0]", ("segments[1].Z_over_length", "[0, 0]")),
    "three numbers": ("[0.0, 1.0]", "[0.0, 0.5, 1.0]", ("Z_over_length", "2")),
    "outside the trunk": ("[0.05, 0.1]", "[0.05, 0.2]", ("dl", "0.2", "outside the trunk", "0.1")),
    "swapped radii": ("[0.05, 0.1]", "[0.1, 0.05]", ("muscles[1]", "inner < outer")),
    "swapped sector": ("[0.0, 1.5]", "[1.5, 0.0]", ("muscles[1]", "first < second")),
    "whole turns": ("[0.0, 1.5]", "[0.0, 90.0]", ("muscles[1]", "2 pi")),
    "helix on a longitudinal": (
        "[0.0, 1.5]",
        "[0.0, 1.5], helix_deg = 30.0",
        ("helix_deg", "helical"),
    ),
    "helical without helix": ('"longitudinal"', '"helical"', ("helix_deg", "non-zero")),
    "helix of 90 degrees": ("[0.0, 1.5]", "[0.0, 1.5], helix_deg = 90.0", ("helix_deg", "90.0")),
    "unknown architecture": (
        '"longitudinal"',
        '"transverse"',
        ("architecture", "transverse", "radial"),
    ),
    "unknown side": ("[0.0, 1.5]", '[0.0, 1.5], sides = ["X"]', ("sides", "'X'", "'R'")),
    "side named twice": ("[0.0, 1.5]", '[0.0, 1.5], sides = ["R", "R"]', ("sides", "twice")),
    "taper too large": (
        "taper_deg = 2.0",
        "taper_deg = 6.0",
        ("taper_deg", "reaches 0 before the tip"),
    ),
    "negative taper": ("taper_deg = 2.0", "taper_deg = -1.0", ("taper_deg", "-1.0", "0")),
    "not TOML": ('name = "rod"', "name = ", ("not valid TOML",)),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_faulty_file_is_refused_with_file_key_value_and_expectation(tmp_path, fault):
    old, new, words = FAULTS[fault]
    good = ROD + MUSCLE
    assert good.count(old) == 1
    path = tmp_path / "mine.toml"
    path.write_text(good.replace(old, new))
    with pytest.raises(InputError) as caught:
        load_anatomy(path)
    for word in (str(path), *words):
        assert word in str(caught.value)


def test_a_gap_between_segments_is_named_with_both_its_ends(tmp_path):
    path = tmp_path / "gap.toml"
    second = "[[segments]]\nZ_over_length = [0.6, 1.0]\n"
    path.write_text(ROD + MUSCLE.replace("[0.0, 1.0]", "[0.0, 0.5]") + second)
    with pytest.raises(InputError, match=r"segments\[2\].Z_over_length must start at 0\.5.*0\.6"):
        load_anatomy(path)


def test_all_faults_of_a_file_are_reported_at_once(tmp_path):
    path = tmp_path / "two.toml"
    good = ROD + MUSCLE
    path.write_text(good.replace("length = 1.0\n", "length = 0\n").replace("1000.0", "-1"))
    with pytest.raises(InputError) as caught:
        load_anatomy(path)
    assert all(key in str(caught.value) for key in ("length", "material.density"))


def test_an_unknown_name_suggests_the_closest_shipped_one():
    with pytest.raises(InputError, match="Did you mean asian-elephant"):
        load_anatomy("asian-elefant")


@pytest.mark.parametrize(
    "bad", [0.0, np.zeros(27), np.zeros((28, 2)), np.full(28, np.nan), "a", ["a"] * 28]
)
def test_an_activation_of_wrong_size_or_not_finite_is_refused(trunk, bad):
    with pytest.raises(InputError, match="activation"):
        check_activation(trunk, bad)

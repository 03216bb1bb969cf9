"""Tables 2 and 3 of the paper come out of Table 1."""

import numpy as np
import pytest
from click.testing import CliRunner

from trunk_ocp.cli.commands import main
from trunk_ocp.model.anatomy import load_anatomy
from trunk_ocp.model.muscle_effects import MEASURES, effects, ranks, signs
from trust.reference import UNIT_RESPONSES

# Table 2: signs of extension, u1, u2, twist, isolated torsion.
TABLE_2 = {
    "dl": {"R": [-1, -1, 1, 0, 0], "L": [-1, 1, 1, 0, 0]},
    "ovo": {"R": [-1, -1, -1, 1, 1], "L": [-1, 1, -1, -1, -1]},
    "ivo": {"R": [-1, -1, -1, -1, -1], "L": [-1, 1, -1, 1, 1]},
    "dr": {"R": [1, 1, -1, 0, 0], "L": [1, -1, -1, 0, 0]},
    "vr": {"R": [1, 1, 1, 0, 0], "L": [1, -1, 1, 0, 0]},
}

# Table 3, strongest first; twist without the "(0)" groups.
TABLE_3 = [
    {
        "zeta": ["dl", "dr", "ovo", "vr", "ivo"],
        "u1": ["dl", "ovo", "ivo", "dr", "vr"],
        "u2": ["dl", "ovo", "ivo", "dr", "vr"],
        "u3": ["ovo", "ivo"],
    },
    {
        "zeta": ["ivo", "dl", "dr", "vr", "ovo"],
        "u1": ["dl", "ivo", "ovo", "dr", "vr"],
        "u2": ["dl", "ivo", "dr", "ovo", "vr"],
        "u3": ["ivo", "ovo"],
    },
    {
        "zeta": ["dl", "vr", "ovo", "dr"],
        "u1": ["dl", "ovo", "vr", "dr"],
        "u2": ["dl", "ovo", "vr", "dr"],
        "u3": ["ovo"],
    },
]


def test_every_sign_of_table_2(trunk):
    assert signs(trunk) == TABLE_2


@pytest.mark.parametrize("segment", [0, 1, 2])
def test_every_order_of_table_3(trunk, segment):
    found = ranks(trunk)[segment]
    for measure, expected in TABLE_3[segment].items():
        strong, none = found[measure]
        assert strong == expected
        assert len(strong) + len(none) == (5, 5, 4)[segment]
        assert set(none) == ({"dl", "dr", "vr"} if measure == "u3" else set())


def test_effects_are_those_of_the_independent_codes(trunk):
    """A contraction has the opposite effect of gamma = +1; printed with six decimals."""
    response = dict(zip(trunk.muscles, effects(trunk) * [1, 1.75, 1.75, 1.75], strict=True))
    for muscle, expected in UNIT_RESPONSES.items():
        np.testing.assert_allclose(-response[muscle], expected, rtol=0, atol=6e-7)


def test_left_muscles_mirror_right_ones(trunk):
    right, left = np.split(effects(trunk), 2)
    np.testing.assert_allclose(left, right * [1, -1, 1, -1], rtol=1e-12, atol=1e-15)


def words(row):
    return [{-1: "< 0", 0: "= 0", 1: "> 0"}[sign] for sign in row]


def test_the_command_prints_both_tables():
    result = CliRunner(env={"COLUMNS": "120"}).invoke(main, ["tables"])  # no folded cells
    assert result.exit_code == 0
    lines = [" ".join(line.split()) for line in result.stdout.splitlines()]
    for group, sides in TABLE_2.items():
        for side, row in sides.items():
            assert f"{group} {side} {' '.join(words(row))}" in lines
    for measure in MEASURES:
        assert any(measure in line for line in lines)
    text = " ".join(lines)
    for segment in TABLE_3:
        for order in segment.values():
            assert ", ".join(order) in text


def test_the_command_refuses_an_unknown_anatomy():
    result = CliRunner().invoke(main, ["tables", "--anatomy", "asian-elefant"])
    assert result.exit_code == 2
    assert "Did you mean asian-elephant?" in result.stderr
    assert "Traceback" not in result.output


def test_a_sign_that_differs_between_segments_is_not_hidden(build):
    muscle = {"group": "a", "architecture": "longitudinal", "radii_over_length": (0.02, 0.05)}
    dorsal, ventral = ({**muscle, "sector": s, "sides": ("R",)} for s in ((0.0, 1.0), (2.0, 3.0)))
    segments = (
        {"Z_over_length": (0.0, 0.5), "muscles": (dorsal,)},
        {"Z_over_length": (0.5, 1.0), "muscles": (ventral,)},
    )
    # Both shorten and bend to the right; one bends up, the other down; neither twists.
    assert signs(build(segments)) == {"a": {"R": [-1, -1, 2, 0, 0]}}


def test_a_muscle_all_around_neither_bends_nor_twists(build):
    ring = {
        "group": "ring",
        "architecture": "longitudinal",
        "radii_over_length": (0.0, 0.05),
        "sector": (0.0, 3.141592653589793),
    }
    trunk = build(({"Z_over_length": (0.0, 1.0), "muscles": (ring,)},))
    both = effects(trunk).sum(axis=0)
    # Eq. (5): a full cross-section contracts by gamma itself, -1 here.
    np.testing.assert_allclose(both, [-1, 0, 0, 0], rtol=0, atol=1e-12)


def test_the_table_of_a_trunk_without_muscles_says_so(tmp_path):
    path = tmp_path / "rod.toml"
    path.write_text(
        'name = "bare rod"\nlength = 1.0\nbase_radius_over_length = 0.05\n'
        "material = { youngs_modulus = 1e6, poisson_ratio = 0.5, density = 1000.0 }\n"
        "[[segments]]\nZ_over_length = [0.0, 1.0]\n"
    )
    assert load_anatomy(path).muscles == ()
    result = CliRunner().invoke(main, ["tables", "--anatomy", str(path)])
    assert (result.exit_code, result.stdout.strip()) == (0, "bare rod has no muscles.")

"""The study's page says what its data say, and no more."""

import copy
import json
import math

import numpy as np
import pytest

from study import data
from study.claims import CLAIMS
from study.observations import OBSERVATIONS, Seen, observed, uneven
from study.page import broken, fields, filled, page

FILES = sorted(data.DATA.glob("*.json"))


@pytest.fixture(scope="module")
def found():
    return fields()


def test_the_committed_page_is_made_from_the_committed_data():
    assert data.PAGE.read_text() == page()


def test_the_data_bear_out_every_sentence(found):
    assert broken(found) == []
    assert len(CLAIMS) > 20


def test_a_sentence_that_is_no_longer_true_is_found(found):
    other = copy.deepcopy(found)
    other["lift"]["moving"]["horizon"]["third"] = 1
    assert broken(other) == ["no turn is left in segment 3"]


def test_no_number_of_a_result_is_typed_into_the_text():
    """What is left of the template without fields, code, names and references has few numbers."""
    import re

    text = (data.ROOT / "study" / "page.md").read_text()
    bare = re.sub(r"\{[^{}\n]*\}|`[^`]*`|\(\.\./[^)]*\)", "", text)
    decimals = re.findall(r"\d+\.\d+", bare)
    assert set(decimals) <= {"6.2", "30.5"}


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_every_data_file_has_finite_numbers_of_six_digits(path):
    def refuse(name):
        raise AssertionError(name)

    def check(value):
        if isinstance(value, dict | list):
            for entry in value.values() if isinstance(value, dict) else value:
                check(entry)
        elif isinstance(value, float):
            assert math.isfinite(value)
            assert value == float(f"{value:.{data.DIGITS}g}")

    check(json.loads(path.read_text(), parse_constant=refuse))


def test_all_parts_are_there():
    parts = ["compare", "plans", "survey", "front", "redundancy"]
    expected = {f"{part}-{name}" for part in parts for name in data.MOTIONS}
    expected |= {
        f"optima-{name}-{mode}" for name in data.MOTIONS for mode in ("horizon", "sequential")
    }
    assert {path.stem for path in FILES} == expected | {"observations", "times"}


def test_files_are_small_enough_for_a_repository():
    sizes = [path.stat().st_size for path in data.DATA.iterdir()]
    assert sum(sizes) < 2e6
    assert max(path.stat().st_size for path in data.DATA.glob("*.png")) < 150e3


def test_every_rule_gives_its_committed_verdict():
    kept = data.read("observations")
    assert len(kept) == len(OBSERVATIONS)
    assert data.rounded(observed()) == kept


def test_the_paper_is_quoted_on_a_head_angle_within_three_degrees():
    (angle,) = (o for o in OBSERVATIONS if "30.5" in o.says)
    plans = data.read("plans-lift-log-asymmetric")
    for largest, agrees in ((28.0, True), (33.4, True), (27.0, False), (34.0, False)):
        head = plans["ways"]["horizon"]["head_deg"]
        plans["ways"]["horizon"]["head_deg"] = [[0.0, -largest] for _ in head]
        numbers, verdict = angle.numbers({"lift-log-asymmetric": Seen(plans, "horizon")})
        assert numbers["largest psi_Y"] == largest
        assert verdict is agrees


def test_means_are_over_the_muscles_and_phases_that_are_asked_for():
    plans = {
        "muscles": [
            {"name": "R1-dl", "group": "dl", "side": "R", "segment": 1},
            {"name": "L1-dl", "group": "dl", "side": "L", "segment": 1},
            {"name": "R2-vr", "group": "vr", "side": "R", "segment": 2},
        ],
        "phases": ["wrap", "lift", "lift"],
        "ways": {
            "paper": {
                "activations": [[-1.0, 0.0, -8.0], [-2.0, -4.0, 0.0], [-3.0, -6.0, -1.0]],
                "head_deg": [[1.0, -2.0], [0.0, 0.0], [0.0, 5.0]],
                "at_bound": [[], [], []],
            }
        },
    }
    seen = Seen(plans, "paper")
    assert seen.mean("dl") == pytest.approx(16 / 6)
    assert seen.mean("dl", side="L", phases=("lift",)) == pytest.approx(5.0)
    assert seen.mean(segment=2) == pytest.approx(3.0)
    assert seen.level("R1-dl", "wrap", "lift") == pytest.approx(2.0)
    assert seen.changes(1, 2) == pytest.approx(2.0)
    assert seen.head_travel == pytest.approx(3 + 3 + 5)
    assert uneven(1.0, 3.0) == pytest.approx(0.5)
    assert np.array_equal(seen.curve("L1-dl"), [0.0, 4.0, 6.0])


def test_fields_are_looked_up_and_scaled():
    found = {"a": {"b": [0.0123456, 5]}, "c": "yes"}
    text = "{a/b/0} {a/b/0:mm} {a/b/0:%} {a/b/1} {c} {a/b/0:.1e}"
    assert filled(text, found) == "0.0123 12.3 1 % 5 yes 1.2e-02"


def test_a_field_that_is_not_there_is_an_error():
    with pytest.raises(KeyError):
        filled("{a/b}", {"a": {}})

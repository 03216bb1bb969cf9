"""Every case of trust/validation holds, and docs/validation.md was made from these cases."""

import math
import re
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from trust.validation import CASES
from trust.validation.case import Case, CoveredByTest
from trust.validation.report import HEAD, UNDER, cells

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "validation.md"
EVALUATED = [case for case in CASES if isinstance(case, Case)]


@pytest.mark.parametrize("case", EVALUATED, ids=lambda case: case.name)
def test_the_computed_values_are_the_reference(case):
    assert case.error() <= case.tolerance


def test_the_page_was_made_from_these_cases():
    # Case, source and tolerance of every row, in order; the errors are those of one run.
    rows = [re.split(r"(?<!\\) \| ", line[2:-2]) for line in PAGE.read_text().splitlines()
            if line.startswith("| ") and line.count(" | ") == 3]  # fmt: skip
    found = [(row[0], row[1], row[3]) for row in rows if row[0] not in ("case", "---")]
    expected = [cells(case, "") for case in CASES]
    assert found == [(row[0], row[1], row[3]) for row in expected]


def test_the_page_has_the_present_prose():
    text = PAGE.read_text()
    assert all(part in text for part in (HEAD, *UNDER.values()))


def test_the_errors_on_the_page_are_within_the_tolerances():
    text = PAGE.read_text()
    for case in EVALUATED:
        name, source, _, limit = cells(case, "")
        (error,) = re.findall(
            re.escape(f"| {name} | {source} | ") + r"(\S+)" + re.escape(f" | {limit}"), text
        )
        assert float(error) <= case.tolerance * 1.05  # printed with two digits


def test_no_two_cases_share_a_name():
    names = Counter(case.name for case in CASES)
    assert names.most_common(1)[0][1] == 1


@pytest.mark.parametrize(
    "held", [c for c in CASES if isinstance(c, CoveredByTest)], ids=lambda c: c.name
)
def test_what_the_page_says_is_held_by_a_test_is(held):
    file, name = held.test.split("::")
    assert re.search(rf"^def {name}\(", (ROOT / file).read_text(), re.MULTILINE)


@pytest.mark.parametrize("name", ["beams", "convergence", "limits"])
def test_the_figures_are_there_and_small(name):
    path = ROOT / "docs" / "figures" / f"validation-{name}.png"
    assert f"figures/{path.name}" in PAGE.read_text()
    assert 5_000 < path.stat().st_size < 60_000


def case_of(computed, reference, tolerance=1.0):
    return Case("", "", "", lambda: (np.array(computed), np.array(reference)), tolerance, "")


def test_an_error_is_the_largest_difference():
    assert case_of([1.0, 2.0], [1.5, 1.75]).error() == 0.5


def test_a_case_that_computes_nan_fails():
    case = case_of([1.0, math.nan], [1.0, 1.0])
    assert not case.error() <= case.tolerance


def test_a_case_may_not_compare_shapes_that_numpy_would_stretch():
    with pytest.raises(ValueError, match=r"\(2,\) vs\. \(1,\)"):
        case_of([1.0, 1.0], [1.0]).error()

"""Steps that went too far are shortened by what their curvature cost, or halved."""

import math
from types import SimpleNamespace

import pytest

from trunk_ocp.nlp.step_search import MOST_REDUCED, StepSearch

START = 3.0


def search():
    return StepSearch(None, None, None, SimpleNamespace(objective=START), None, None)


@pytest.mark.parametrize("share", [1.0, 0.3])
@pytest.mark.parametrize("curved", [2.0, 50.0, 3e3])
def test_costs_of_curvature_then_take_half_of_the_gain(share, curved):
    """Of an objective START - s + curved s^4 of the share s, of which - s was expected."""

    def objective(s):
        return START - s + curved * s**4

    now = share * search()._reduction(-share, objective(share))
    if now < 0.5 * share:
        assert curved * now**4 == pytest.approx(now / 2)
    else:
        assert curved * (0.5 * share) ** 4 <= 0.5 * share / 2
    assert objective(now) < START


def test_reductions_have_limits():
    least, most = MOST_REDUCED
    assert search()._reduction(-1e-9, START + 1e9) == least
    assert search()._reduction(-1.0, START - 1.0 + 1e-3) == most


@pytest.mark.parametrize(("expected", "value"), [(-1.0, math.inf), (math.inf, 5.0), (0.2, 5.0)])
def test_steps_of_which_nothing_is_known_are_halved(expected, value):
    """Rods did not settle; bounds were to be restored; the model expected no decrease."""
    assert search()._reduction(expected, value) == 0.5

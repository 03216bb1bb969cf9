"""Solvers are kept for later solves in the process, each used by one solve at a time."""

import gc
import weakref

import numpy as np
import pytest
from toys import shortening

from trunk_ocp.nlp import idle_solvers
from trunk_ocp.nlp.idle_solvers import MAX_IDLE_SOLVERS, borrowed
from trunk_ocp.planning.planner import plan_motion
from trunk_ocp.reporting import Reporter


class Solver:
    pass


@pytest.fixture(autouse=True)
def no_idle_solvers(monkeypatch):
    monkeypatch.setattr(idle_solvers, "_idle", [])


def test_a_solver_is_used_again_but_never_twice_at_once():
    with borrowed("a", Solver) as outer:
        with borrowed("a", Solver) as inner, borrowed("b", Solver) as other:
            assert len({outer, inner, other}) == 3
        with borrowed("a", Solver) as again:
            assert again is inner
    with borrowed("a", Solver) as first, borrowed("a", Solver) as second:
        assert {first, second} == {outer, inner}


def test_the_least_recently_used_are_dropped():
    for key in range(MAX_IDLE_SOLVERS + 1):
        with borrowed(key, Solver):
            pass
        with borrowed(0, Solver) as used:
            pass
    with borrowed(0, Solver) as kept:
        assert kept is used
    assert [key for key, _ in idle_solvers._idle] == [*range(2, MAX_IDLE_SOLVERS + 1), 0]


def test_a_solver_that_raised_is_not_kept():
    with pytest.raises(ZeroDivisionError), borrowed("a", Solver):
        raise ZeroDivisionError
    assert idle_solvers._idle == []


def test_a_second_plan_needs_no_set_up_and_has_the_same_bits():
    motion = shortening([-0.1, -0.3], most=0.15)
    other = shortening([-0.1, -0.3, -0.2], most=0.15)  # between them: no mix-up
    first, _, second = (plan_motion(each, throw=False) for each in (motion, other, motion))
    assert first.setup_seconds > 0
    assert second.setup_seconds == 0
    assert second.iterations == first.iterations
    np.testing.assert_array_equal(second.x, first.x)


def test_a_plan_within_a_plan_of_the_same_motion():
    motion = shortening([-0.1, -0.3], most=0.15)
    inner = []

    class Planning(Reporter):
        def iteration(self, progress):
            if not inner:
                inner.append(None)
                inner.append(plan_motion(motion, throw=False))

    outer = plan_motion(motion, reporter=Planning(), throw=False)
    np.testing.assert_array_equal(inner[1].x, outer.x)
    assert inner[1].iterations == outer.iterations


def test_no_reporter_is_kept():
    reporter = Reporter()
    plan_motion(shortening([-0.1, -0.3], most=0.15), reporter=reporter, throw=False)
    gone = weakref.ref(reporter)
    del reporter
    gc.collect()
    assert gone() is None

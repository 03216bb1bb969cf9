"""Parts of a solve begin only if they would end before the deadline, by a clock set by hand."""

from types import SimpleNamespace

import pytest

from trunk_ocp.nlp import pace


@pytest.fixture
def clock(monkeypatch):
    """The time, which only passes when a test says so."""
    clock = SimpleNamespace(now=100.0)
    monkeypatch.setattr(pace, "time", SimpleNamespace(perf_counter=lambda: clock.now))
    return clock


def spend(judge, clock, name, seconds):
    with judge.part(name):
        clock.now += seconds


def test_a_part_begins_if_a_quarter_more_than_its_longest_time_fits(clock):
    judge = pace.Pace(110.0)
    for seconds in (1.0, 4.0, 1.0):  # the longest counts, not the last
        spend(judge, clock, "program", seconds)
    assert judge.seconds["program"] == 6.0
    clock.now = 105.0
    assert judge.allows("program")  # 105 + 1.25 * 4 = 110
    clock.now += 1e-6
    assert not judge.allows("program")


def test_parts_that_follow_each_other_count_together(clock):
    judge = pace.Pace(112.0)
    spend(judge, clock, "model", 2.0)
    spend(judge, clock, "trial", 4.0)
    assert clock.now == 106.0
    assert judge.allows("model")
    assert judge.allows("trial")
    assert not judge.allows("model", "trial")  # 106 + 1.25 * 6 > 112


def test_a_part_that_is_new_may_begin_until_the_deadline(clock):
    judge = pace.Pace(100.0)
    assert judge.allows("model")
    clock.now += 1e-6
    assert not judge.allows("model")
    assert not judge.allows()


def test_parts_that_fail_count(clock):
    judge = pace.Pace(110.0)

    def fail():
        clock.now += 5.0
        raise ArithmeticError

    def part():
        with judge.part("program"):
            fail()

    with pytest.raises(ArithmeticError):
        part()
    assert judge.seconds["program"] == 5.0
    assert not judge.allows("program")

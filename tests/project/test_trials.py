"""What the trials of `trust` count as wrong."""

import pytest

from trust.interrupts import Ended, wrong_answer

SOLVED = "SOLVED 4.4e-05"


@pytest.mark.parametrize(
    ("code", "output", "wrong"),
    [
        (0, SOLVED, False),
        (0, "KeyboardInterrupt", False),
        (0, "INTERRUPTED 1.0", False),
        (-2, SOLVED, False),  # Ctrl-C while Python ends, after the answer
        (-2, "", True),
        (-2, "SOLVED 9.9e-05", True),
        (0, "SOLVED 9.9e-05", True),
        (1, SOLVED, True),
    ],
)
def test_an_interrupted_call_may_raise_say_so_or_be_over(code, output, wrong):
    assert bool(wrong_answer(Ended(code, f"{output}\n", "", 0.1), SOLVED)) is wrong

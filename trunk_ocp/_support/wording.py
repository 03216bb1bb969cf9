"""Numbers and suggestions in sentences."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence

MAX_WORD = 60
"""Characters of a word that is compared with known ones."""


def rounded(value: float, digits: int = 2) -> str:
    """A number to some digits, without exponent below a million: 180, not 1.8e+02."""
    short = f"{value:.{digits}g}"
    return f"{float(short):g}" if abs(value) < 1e6 else short


def suggestion(word: str, known: Iterable[str], similarity: float = 0.6) -> str:
    """A question with the known word that is most similar, " Did you mean R1-dl?", or ""."""
    names = {name.lower(): name for name in known}
    close = difflib.get_close_matches(word[:MAX_WORD].lower(), names, 1, similarity)
    return f" Did you mean {names[close[0]]}?" if close else ""


def step_list(steps: Sequence[int]) -> str:
    """Step numbers in words: [1, 2, 3, 7] gives "steps 1 to 3, 7"."""
    runs: list[list[int]] = []
    for step in steps:
        if runs and step == runs[-1][-1] + 1:
            runs[-1].append(step)
        else:
            runs.append([step])
    words = [str(run[0]) if len(run) == 1 else f"{run[0]} to {run[-1]}" for run in runs]
    return f"step{'s' * (len(steps) > 1)} {', '.join(words)}"

"""What the words of page.md rely on, each a condition on the data."""

from __future__ import annotations

from collections.abc import Callable

from .page import Fields, less

BAD = 'status'


def _tracks_better(found: Fields) -> bool:
    return all(
        horizon["tracking"] < blind["tracking"]
        for short in ("lift", "tilt")
        for blind, horizon in zip(
            found[short]["front"]["blind"], found[short]["front"]["horizon"], strict=True
        )
    )

"""Multipliers of an NLP's optimum as a start of an NLP that has most rows in common with it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable, Iterator, Mapping

import numpy as np

from .outcome import Outcome
from .window import Window

Multipliers = Mapping[Hashable, np.ndarray]
"""Multipliers of variables and rows, by what these are."""


def multipliers_of(window: Window, outcome: Outcome) -> Multipliers:
    """The multipliers at an optimum of a window."""
    values = {name: np.asarray(lam).ravel() for name, lam in outcome.multipliers.items()}
    return {(name, *key): values[name][index] for name, key, index in _parts(window)}


def as_start(window: Window, known: Multipliers) -> dict[str, np.ndarray]:
    """Multipliers as arguments of a window's solve; 0 for rows that are not known."""
    bounds = window.bounds
    values = {"lam_x0": np.zeros(bounds["lbx"].size), "lam_g0": np.zeros(bounds["lbg"].size)}
    for name, key, index in _parts(window):
        if (found := known.get((name, *key))) is not None:
            values[name][index] = found
    return values


def _parts(window: Window) -> Iterator[tuple[str, tuple[Hashable, ...], np.ndarray]]:
    """Variables with bounds, and rows: name of the argument, what they are, and indices."""
    for t, unknowns in enumerate(window.unknowns, window.offset):
        for name in ("x", "strain", "tip_force", "edges"):
            yield "lam_x0", (t, name), getattr(unknowns, name)
    count: Counter[tuple[Hashable, ...]] = Counter()
    for block in window.blocks:
        place = b"" if block.Z is None else np.asarray(block.Z).tobytes()
        key = (block.step, block.meaning, place)
        count[key] += 1  # pairs of sections with the same first one are told apart by order
        yield "lam_g0", (*key, count[key]), block.rows - 1

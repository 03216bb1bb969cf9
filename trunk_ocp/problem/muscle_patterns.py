"""Patterns of muscle names in bounds, starts and weights: `R1-dl`, `*3-dl`, `L*`."""

from __future__ import annotations

import fnmatch
from collections.abc import Collection, Mapping
from functools import lru_cache

import numpy as np

from .._support.wording import suggestion
from ..errors import InputError
from .problem_file import ProblemSpec

MAX_MATCHES = 1_000_000
"""Most muscles times different patterns of a problem; half a second's work."""
MAX_NAMES_SHOWN = 100
MAX_PATTERN_SHOWN = 200  # characters


def matching_muscles(spec: ProblemSpec, muscles: tuple[str, ...]) -> dict[str, np.ndarray]:
    """Indices of the muscles that each pattern of a problem's bounds and start matches."""
    sections = (spec.bounds, *(phase.bounds for phase in spec.phases))
    keys = {key for section in sections for key in section.muscles} | set(spec.start.activation)
    return pattern_matches(keys, muscles, "bounds.muscles")


def pattern_matches(
    keys: Collection[str], muscles: tuple[str, ...], where: str
) -> dict[str, np.ndarray]:
    """Indices of the muscles that each name or pattern matches.

    Raises
    ------
    InputError
        If there are too many patterns for that many muscles; names the section, `where`.
    """
    patterns = {key for key in keys if set(key) & set("*?[")}
    if len(patterns) * len(muscles) > MAX_MATCHES:
        raise InputError(
            f"{where}: {len(patterns):,} different patterns in all phases and the start for "
            f"{len(muscles):,} muscles; expected at most {MAX_MATCHES // len(muscles):,}. Write "
            "the muscles' names, or use patterns that match more of them."
        )
    index = {name: [i] for i, name in enumerate(muscles)}
    matches = {name: index.get(name, []) for name in keys if name not in patterns}
    for pattern in patterns:
        matches[pattern] = [
            i for i, name in enumerate(muscles) if fnmatch.fnmatchcase(name, pattern)
        ]
    return {key: np.array(indices, dtype=int) for key, indices in matches.items()}


def muscles_of(
    pattern: str, matches: Mapping[str, np.ndarray], muscles: tuple[str, ...], where: str
) -> np.ndarray:
    """Indices of the muscles that a pattern of a section matches.

    Raises
    ------
    InputError
        If it matches none; names the section, `where`.
    """
    matching = matches[pattern]
    if not matching.size:
        raise InputError(
            f'{where}."{pattern[:MAX_PATTERN_SHOWN]}": no such muscle; expected a name or pattern '
            f"of {listed(muscles)}.{suggestion(pattern, muscles)}"
        )
    return matching


def listed(muscles: tuple[str, ...]) -> str:
    """Names of muscles for a message, `MAX_NAMES_SHOWN` at most."""
    hidden = len(muscles) - MAX_NAMES_SHOWN
    more = f" and {hidden:,} more" if hidden > 0 else ""
    return ", ".join(muscles[:MAX_NAMES_SHOWN]) + more


@lru_cache(maxsize=10_000)  # the same few patterns in every phase
def mirrored_pattern(pattern: str, muscles: tuple[str, ...]) -> list[str]:
    """Patterns that match the partners, on the other side, of the muscles that a pattern matches.

    A pattern such as `*1-dl` is its own partner; names replace one such as `[RL]1-dl` or `?2-*`
    if its matches are not the same on both sides.
    """
    other = {"R": "L", "L": "R"}
    if pattern[:1] in other:
        return [other[pattern[0]] + pattern[1:]]
    matches = [name for name in muscles if fnmatch.fnmatchcase(name, pattern)]
    partners = [other[name[0]] + name[1:] for name in matches]
    return [pattern] if set(partners) == set(matches) else partners

"""Muscles that share a part of the cross-section, so that their tissue would count twice."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations

from .._support.toml_files import Pair
from .anatomy import Muscle, Trunk

OVERLAP_TOL = 1e-3  # of a radius, and rad: edges that are meant to meet may overlap by rounding


def overlapping(trunk: Trunk) -> Iterator[tuple[Muscle, Muscle]]:
    """Pairs of muscles of one segment that overlap, segment by segment.

    Of a pair and its mirror image only the first.
    """
    yielded: set[tuple[int, frozenset[tuple[str, bool]]]] = set()
    for segment in range(trunk.segments):
        muscles = [muscle for muscle in trunk.subdomains if muscle.segment == segment]
        for one, two in combinations(muscles, 2):
            across = one.side != two.side
            pair = (segment, frozenset(((one.group, across), (two.group, across))))
            if pair not in yielded and _overlap(one, two):
                yielded.add(pair)
                yield one, two


def _overlap(one: Muscle, two: Muscle) -> bool:
    depth = OVERLAP_TOL * min(one.radii[1], two.radii[1])
    return _shared(one.radii, two.radii) > depth and _shared(one.sector, two.sector) > OVERLAP_TOL


def _shared(one: Pair, two: Pair) -> float:
    """Length that two intervals share; negative if there is a gap."""
    return min(one[1], two[1]) - max(one[0], two[0])

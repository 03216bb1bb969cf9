"""Where the page draws cross-sections of a trunk."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ..model.anatomy import Trunk

SECTIONS = 48  # cross-sections along the trunk, about


@dataclass(frozen=True, eq=False)
class Grid:
    """Points Z (n,) in m of the cross-sections; segment i begins at index `edges[i]`."""

    Z: np.ndarray
    edges: tuple[int, ...]


def section_grid(trunk: Trunk) -> Grid:
    """Cross-sections of a trunk; every edge between segments has one."""
    Z, edges = [np.zeros(1)], [0]
    for start, end in pairwise(trunk.edges):
        intervals = max(4, round(SECTIONS * (end - start) / trunk.length))
        Z.append(np.linspace(start, end, intervals + 1)[1:])
        edges.append(edges[-1] + intervals)
    return Grid(np.concatenate(Z), tuple(edges))

"""What the page gets for a trunk without a plan: the trunk at rest, which users may then move."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..errors import StaticsError
from ..model.anatomy import Trunk
from ..model.loads import Loads
from ..model.solids import pivot
from ..problem.step_solids import head_solids
from ..rod.shape import Shape
from ..rod.statics import solve_statics
from .payload import encoded, frames_of, solid_entry, trunk_of
from .sections import section_grid
from .try_it import trunk_controls


def still_payload(trunk: Trunk) -> dict[str, Any]:
    """Everything the page shows of a trunk, ready for JSON."""
    return {"name": "", "title": trunk.name, "trunk": "", "plans": [_still(trunk)]}


def _still(trunk: Trunk) -> dict[str, Any]:
    """A trunk as a plan of one instant: passive, under its weight if it can hold it."""
    loads, shape = _at_rest(trunk)
    grid = section_grid(trunk)
    return {
        "mode": "at rest",
        "still": True,
        "status": "at rest",
        "solved": True,
        "objective": None,
        "times": [0.0],
        "jumps": [],
        "held": [],
        "steps": [],
        "phases": [],
        "trunk": trunk_of(trunk, grid),
        "frames": frames_of(trunk, Shape.stack([shape]), grid.Z),
        "activation": encoded(np.zeros((1, len(trunk.muscles)))),
        "head": encoded(np.zeros((1, 2))),
        "pivot": pivot(trunk).tolist(),
        "solids": [solid_entry(solid, trunk, [True]) for solid in head_solids(trunk)],
        "objects": [],
        "targets": [],
        "arrows": [],
        "controls": trunk_controls(trunk, loads),
    }


def _at_rest(trunk: Trunk) -> tuple[Loads, Shape]:
    """The passive trunk under its weight; weightless if it has no equilibrium under it."""
    passive = np.zeros(len(trunk.muscles))
    try:
        return Loads(), solve_statics(trunk, passive, loads=Loads())
    except StaticsError:
        weightless = Loads(gravity=0.0)
        return weightless, solve_statics(trunk, passive, loads=weightless)

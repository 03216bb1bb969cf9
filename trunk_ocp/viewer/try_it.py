"""What the page needs to let users try controls: their bounds, the loads, the tables of the rod."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from typing import Any

import numpy as np

from ..model.anatomy import Trunk
from ..model.loads import Loads, mass_beyond
from ..planning.plan import Plan
from ..problem.interpolation import loads_at
from ..problem.motion import HEAD_LIMIT, Bounds, Step
from ..scene.moments import Moment, phase_at

ACTIVATION, EXTENSION = (-1.0, 0.0), (0.67, 1.35)
"""Bounds for a trunk without a motion: natural fibers, and the elephant's extension (eq. 42)."""
MASS_SHARE = 0.1  # of the trunk's own mass: the largest mass to try at the tip


def plan_controls(plan: Plan, moments: Sequence[Moment]) -> dict[str, Any]:
    """Bounds of each time step, and the loads at moments, of a plan."""
    motion = plan.motion
    loads = [loads_at(motion, plan.loads, m.time, m.after) for m in moments]
    masses = [motion.spec.phases[phase_at(motion, m.time, m.after)].loads.tip_mass for m in moments]
    boxes = [_box(list(steps)) for _, steps in groupby(motion.steps[: len(plan.x)], key=_bounds)]
    return {
        "boxes": boxes,
        "extension": list(motion.extension),
        "largest_mass": _largest_mass(motion.trunk, max(masses)),
        "loads": [_load(load, mass) for load, mass in zip(loads, masses, strict=True)],
    }


def trunk_controls(trunk: Trunk, loads: Loads) -> dict[str, Any]:
    """Bounds and loads for a trunk without a plan."""
    count = len(trunk.muscles)
    lower, upper = (
        [*[activation] * count, *[sign * HEAD_LIMIT] * 2]
        for activation, sign in zip(ACTIVATION, (-1, 1), strict=True)
    )
    return {
        "boxes": [{"from": 0.0, "to": 0.0, "lower": lower, "upper": upper}],
        "extension": list(EXTENSION),
        "largest_mass": _largest_mass(trunk, 0.0),
        "loads": [_load(loads, 0.0)],
    }


def _bounds(step: Step) -> tuple[bytes, bytes]:
    return step.box.lower.tobytes(), step.box.upper.tobytes()


def _box(steps: Sequence[Step]) -> dict[str, Any]:
    """Bounds on the controls that consecutive steps share."""
    box: Bounds = steps[0].box
    return {
        "from": steps[0].time - steps[0].duration,
        "to": steps[-1].time,
        # A control without a bound gets one, because a slider needs it.
        "lower": np.maximum(box.lower, -1e3).tolist(),
        "upper": np.minimum(box.upper, 1e3).tolist(),
    }


def _load(load: Loads, tip_mass: float) -> dict[str, Any]:
    """Loads as the page's physics takes them, and how much of them is a mass at the tip, in kg."""
    return {
        "gravity": load.gravity,
        "tip_force": list(load.tip_force),
        "contact_from": load.contact_from,
        "contact_force": list(load.contact_force),
        "contact_couple": list(load.contact_couple),
        "contact_lever": load.contact_lever,
        "tip_mass": tip_mass,
    }


def _largest_mass(trunk: Trunk, planned: float) -> float:
    """End of the scale of a mass at the tip, in kg: a round number."""
    rough = max(MASS_SHARE * float(mass_beyond(trunk, 0.0)), 2 * planned)
    if rough <= 0:
        return 1.0
    power = 10.0 ** np.floor(np.log10(rough))
    return float(next(step * power for step in (1, 2, 5, 10) if step * power >= 0.999 * rough))

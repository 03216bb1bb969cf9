"""Scenes that no plan can clear: targets inside bodies, and a trunk that starts in one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import StaticsError
from ..model.loads import Loads
from ..model.solids import Solid, signed_distance
from ..problem.motion import Motion
from ..problem.targets import Target
from ..rod.statics import solve_statics
from .clearance import COLLISION_TOL
from .gaps import Gap, gaps_at_start


@dataclass(frozen=True)
class Obstructions:
    """What makes it impossible to keep clear of the bodies that a motion asks to.

    `sentences` say it; `at_start` names the bodies that the trunk is in before it starts.
    """

    sentences: tuple[str, ...]
    at_start: frozenset[str]


def obstructions(motion: Motion) -> Obstructions:
    """What no plan of a motion can keep clear of.

    A point of the centerline cannot be in a body; nor can a plan change where the trunk hangs
    before it starts.
    """
    stuck = stuck_at_start(motion)
    sentences = (*_blocked_targets(motion), *map(_at_start, stuck))
    return Obstructions(sentences, frozenset(gap.body for gap in stuck))


def _blocked_targets(motion: Motion) -> list[str]:
    """Targets inside bodies, a sentence each."""
    tol = COLLISION_TOL * motion.trunk.length
    deepest: dict[tuple[str, str], tuple[float, str]] = {}
    for number, step in enumerate(motion.steps, 1):
        for solid in step.solids if motion.contact else ():
            for target in step.targets if solid.group in motion.contact else ():
                depth = _depth(target, solid)
                if depth > tol:
                    sentence = (
                        f"step {number}: {target.source}: the target at Z = {target.Z:g} m is "
                        f"{1e3 * depth:.3g} mm too deep in the {solid.name}; no plan reaches it "
                        "without a collision"
                    )
                    key = (target.source, solid.name)
                    deepest[key] = max(deepest.get(key, (0.0, "")), (depth, sentence))
    return [sentence for _, sentence in deepest.values()]


def _depth(target: Target, solid: Solid) -> float:
    """How far in m a target is beyond the clearance of a solid."""
    if target.position is None or target.position_weight == 0 or target.frame != solid.frame:
        return -np.inf  # what the head's angles decide is left to the plan
    if not solid.Z[0] <= target.Z <= solid.Z[1]:
        return -np.inf
    return solid.clearance - float(signed_distance(solid, np.asarray(target.position))[0])


def stuck_at_start(motion: Motion) -> list[Gap]:
    """Gaps where the motion starts that are smaller than it asks for."""
    tol, x0 = COLLISION_TOL * motion.trunk.length, motion.start[None]
    if not motion.contact:
        return []
    try:
        shape = solve_statics(motion.trunk, x0[:, :-2], x0[:, -2:], Loads(motion.gravity))
    except StaticsError:
        return []
    return [g for g in gaps_at_start(motion, shape) if g.group in motion.contact and g.depth > tol]


def _at_start(gap: Gap) -> str:
    """That the trunk is too close to a body before anything is planned."""
    return (
        f"at the start the trunk is {1e3 * gap.depth:.3g} mm too "
        f"close to {_the(gap)} at Z = {gap.Z:.2f} m; move it, or let it appear in a "
        "later phase"
    )


def _the(gap: Gap) -> str:
    return gap.body if gap.group == "self" else f"the {gap.body}"

"""Plausibility warnings on solids: a mouth in the air, an obstacle in mm."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..model.anatomy import Trunk
from ..model.solid_specs import ObstacleSpec
from ..model.solids import signed_distance
from .step_solids import head_solids

MOUTH_TOL = 1e-3  # m; distance of the mouth from the surface of the head
LARGEST = 100.0  # trunk lengths; dimensions and distances of an obstacle
LENGTHS = ("center", "from", "to", "point", "radius", "half_sizes", "half_axes", "clearance")


def of_mouth(trunk: Trunk) -> Iterator[tuple[str, object, str]]:
    """Key, value and text if the mouth is not on the surface of the head's body."""
    mouth, body = trunk.head.mouth, head_solids(trunk)
    if mouth is None or not body:
        return
    away = float(min(signed_distance(solid, np.array(mouth[0]))[0] for solid in body))
    if abs(away) > MOUTH_TOL:
        side = "outside" if away > 0 else "inside"
        yield "head.mouth.point", mouth[0], f"{1e3 * abs(away):.3g} mm {side} of the head's body"


def of_obstacles(
    obstacles: tuple[ObstacleSpec, ...], trunk: Trunk
) -> Iterator[tuple[str, object, str]]:
    """Key, value and text for each obstacle that is too large or too far away to be in m."""
    for number, obstacle in enumerate(obstacles, 1):
        for key in LENGTHS:
            value = getattr(obstacle, key)
            if value is not None and np.abs(value).max() > LARGEST * trunk.length:
                text = "looks like mm; write 0.001 times the value for m"
                yield f"obstacles[{number}].{key}", value, text

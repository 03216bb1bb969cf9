"""The mirror image of a motion and its plan in the plane Y = 0.

Muscles swap sides and psi_Z changes its sign. Positions, forces, d1 and d3 are reflected; couples
and d2, cross products of two of these, are reflected and reversed.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from ..errors import InputError
from ..model.anatomy import Trunk
from ..model.solids import Solid, signed_distance
from .motion import Motion, Step
from .step_solids import head_solids
from .targets import HeldDirection
from .variants import mirrored_spec

ROUND_OFF = 1e-9  # of the trunk's length, of the largest force and couple, and of activations


def mirror_order(trunk: Trunk) -> np.ndarray:
    """Index (muscles,) of each muscle's partner on the other side.

    Raises
    ------
    InputError
        If a muscle has none, or the head is not its own mirror image.
    """
    if trunk.head.xi_z != 0:
        raise InputError(f"{trunk.name}: its head is not its own mirror image (xi_z_deg is not 0).")
    body, points = head_solids(trunk), _points(trunk.length)
    if not np.allclose(_measured(body, points), _measured(body, points * [1, -1, 1])):
        raise InputError(f"{trunk.name}: the body of its head is not its own mirror image.")
    if any(y != 0 for _, y, _ in trunk.head.mouth or ()):
        raise InputError(f"{trunk.name}: its mouth is not its own mirror image (Y is not 0).")
    places = {name: index for index, name in enumerate(trunk.muscles)}
    partners = [{"R": "L", "L": "R"}[m.side] + m.name[1:] for m in trunk.subdomains]
    for name, partner in zip(trunk.muscles, partners, strict=True):
        if partner not in places:
            raise InputError(f"{trunk.name}: {name} has no partner {partner} on the other side.")
    return np.array([places[partner] for partner in partners], dtype=int)


def mirrored_controls(trunk: Trunk, x: np.ndarray) -> np.ndarray:
    """Activations and head angles (..., muscles + 2) in the mirror."""
    count = len(trunk.muscles)
    order = np.concatenate([mirror_order(trunk), [count, count + 1]]).astype(int)
    image = np.array(x, dtype=float)[..., order]
    image[..., -2] *= -1
    return image


def mirrored_motion(motion: Motion) -> Motion:
    """The motion with targets, loads, bounds and start mirrored.

    Raises
    ------
    InputError
        If the trunk is not its own mirror image.
    """
    mirror_order(motion.trunk)
    return motion.with_spec(mirrored_spec(motion.spec, motion.trunk.muscles))


def is_symmetric(motion: Motion) -> bool:
    """Whether a motion is its own mirror image: trunk, start, targets, loads, bounds, weights.

    To round-off.
    """
    try:
        return asks_the_same(motion, mirrored_motion(motion))
    except InputError:  # the trunk itself is not symmetric
        return False


def asks_the_same(motion: Motion, other: Motion) -> bool:
    """Whether motions of one trunk have the same start, targets, loads, bounds, effort weights."""
    if not np.allclose(motion.start, other.start, rtol=0, atol=ROUND_OFF):
        return False
    units, muscles = _units(motion), motion.trunk.muscles
    efforts = [each.weights.of_muscles(muscles) for each in (motion, other)]
    return np.array_equal(efforts[0], efforts[1]) and all(
        np.allclose(_numbers(a, *units), _numbers(b, *units), rtol=0, atol=ROUND_OFF)
        for a, b in zip(motion.steps, other.steps, strict=True)
    )


def _units(motion: Motion) -> tuple[float, float, float]:
    """Length of the trunk, m, and the largest force, N, and couple, N m, of a motion."""
    forces, couples = [0.0], [0.0]
    for step in motion.steps:
        forces += [math.hypot(*step.loads.tip_force), math.hypot(*step.loads.contact_force)]
        forces += [abs(step.pull[0])] if step.pull is not None else []
        couples.append(math.hypot(*step.loads.contact_couple))
    return motion.trunk.length, max(forces) or 1.0, max(couples) or 1.0


def _numbers(step: Step, length: float, force: float, couple: float) -> np.ndarray:
    """Every number of a step that a mirror may change, in these units."""
    loads = step.loads
    parts = [np.asarray(f) / force for f in (loads.tip_force, loads.contact_force)]
    parts.append(np.asarray(loads.contact_couple) / couple)
    parts.append(np.array([loads.contact_lever / length]))
    parts += [step.box.lower, step.box.upper, step.change.lower, step.change.upper]
    if step.pull is not None:
        parts.append(np.array([step.pull[0] / force]))
    for target in step.targets:
        if target.position is not None and target.position_weight > 0:
            parts.append(np.asarray(target.position) / length)
        parts += [
            np.asarray(direction)
            for _, direction, _ in target.pairs()
            if not isinstance(direction, HeldDirection)
        ]
    for frame in ("space", "head"):
        solids = (solid for solid in step.solids if solid.frame == frame)
        parts.append(_measured(solids, _points(length)).ravel() / length)
    return np.concatenate(parts)


def _points(length: float) -> np.ndarray:
    """Points (n, 3) in m around a trunk in no particular order, which distinguish solids."""
    return length * np.random.default_rng(0).uniform(-1, 1, (20, 3))


def _measured(solids: Iterable[Solid], points: np.ndarray) -> np.ndarray:
    """Distances of each solid from points, its clearance and its part of the trunk: a row each.

    Rows are sorted, because the order of solids says nothing.
    """
    rows = [[*signed_distance(solid, points)[0], solid.clearance, *solid.Z] for solid in solids]
    return np.array(sorted(rows))

"""The other hand: a motion and its plan seen in a mirror, the plane Y = 0.

Muscles swap sides and psi_Z changes its sign. Positions, forces, d1 and d3 are reflected; d2 and
couples, which a right-handed frame makes of two of these, are reflected and reversed.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ..errors import InputError
from ..model.anatomy import Trunk
from ..model.loads import Loads, Vector, vector
from .built import as_built
from .motion import Bounds, Motion, Step, build_motion
from .targets import Direction, HeldDirection, Target
from .variants import mirrored_spec

ROUND_OFF = 1e-9  # of the trunk's length, of the largest force and couple, and of activations
REFLECT = np.array([1.0, -1.0, 1.0])


def mirror_order(trunk: Trunk) -> np.ndarray:
    """Index (muscles,) of each muscle's partner on the other side.

    Raises
    ------
    InputError
        If a muscle has none, or the head at rest looks to one side.
    """
    if trunk.head.xi_z != 0:
        raise InputError(f"{trunk.name}: its head is no mirror image of itself (xi_z_deg).")
    places = {name: index for index, name in enumerate(trunk.muscles)}
    partners = [{"R": "L", "L": "R"}[m.side] + m.name[1:] for m in trunk.subdomains]
    for name, partner in zip(trunk.muscles, partners, strict=True):
        if partner not in places:
            raise InputError(f"{trunk.name}: {name} has no partner {partner} on the other side.")
    return np.array([places[partner] for partner in partners], dtype=int)


def mirrored_unknowns(trunk: Trunk, x: np.ndarray) -> np.ndarray:
    """Activations and head angles (..., muscles + 2) in the mirror."""
    count = len(trunk.muscles)
    order = np.concatenate([mirror_order(trunk), [count, count + 1]]).astype(int)
    image = np.array(x, dtype=float)[..., order]
    image[..., -2] *= -1
    return image


def mirrored_motion(motion: Motion) -> Motion:
    """The same motion to the other side: targets, loads and bounds.

    Raises
    ------
    InputError
        If the trunk is not its own mirror image.
    """
    mirror_order(motion.trunk)
    spec = mirrored_spec(motion.spec, motion.trunk.muscles)
    if as_built(motion):
        return replace(build_motion(spec, motion.anatomy), warnings=motion.warnings)
    return replace(
        motion,
        spec=spec,
        steps=tuple(_step(motion.trunk, step) for step in motion.steps),
        box=_box(motion.trunk, motion.box),
    )


def is_symmetric(motion: Motion) -> bool:
    """Whether a motion is its own mirror image: trunk, targets, loads and bounds, to round-off."""
    try:
        image = mirrored_motion(motion)
    except InputError:  # of a trunk that has no other side
        return False
    units = _units(motion)
    return all(
        np.allclose(_numbers(a, *units), _numbers(b, *units), rtol=0, atol=ROUND_OFF)
        for a, b in zip(motion.steps, image.steps, strict=True)
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
    """All that a mirror may change in a step, one after the other, in these units."""
    loads = step.loads
    parts = [np.asarray(f) / force for f in (loads.tip_force, loads.contact_force)]
    parts.append(np.asarray(loads.contact_couple) / couple)
    parts += [step.box.lower, step.box.upper, step.change.lower, step.change.upper]
    if step.pull is not None:
        parts.append(np.array([step.pull[0] / force]))
    for target in step.targets:
        if target.position is not None and target.position_weight > 0:
            parts.append(np.asarray(target.position) / length)
        parts += [
            np.asarray(wanted)
            for _, wanted, _ in target.pairs()
            if not isinstance(wanted, HeldDirection)
        ]
    return np.concatenate(parts)


def _step(trunk: Trunk, step: Step) -> Step:
    pull = step.pull
    if pull is not None and pull[1].director == 1:
        pull = (-pull[0], pull[1])  # the direction it is held along is d2 of the mirror image
    return replace(
        step,
        targets=tuple(_target(target) for target in step.targets),
        loads=_loads(step.loads),
        pull=pull,
        box=_box(trunk, step.box),
        change=_box(trunk, step.change),
    )


def _target(target: Target) -> Target:
    d1, d2, d3 = (
        _direction(d, sign) for d, sign in zip(target.directions, (1, -1, 1), strict=True)
    )
    position = None if target.position is None else vector(REFLECT * target.position)
    return replace(target, position=position, directions=(d1, d2, d3))


def _direction(direction: Direction | None, sign: int) -> Direction | None:
    if direction is None or isinstance(direction, HeldDirection):
        return direction
    return vector(sign * REFLECT * direction)


def _loads(loads: Loads) -> Loads:
    def polar(force: Vector) -> Vector:
        return vector(REFLECT * force)

    return replace(
        loads,
        tip_force=polar(loads.tip_force),
        contact_force=polar(loads.contact_force),
        contact_couple=vector(-REFLECT * loads.contact_couple),
    )


def _box(trunk: Trunk, box: Bounds) -> Bounds:
    lower, upper = mirrored_unknowns(trunk, box.lower), mirrored_unknowns(trunk, box.upper)
    lower[-2], upper[-2] = upper[-2], lower[-2]
    return Bounds(lower, upper)

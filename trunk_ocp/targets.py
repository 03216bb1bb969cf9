"""Where points of the trunk should be at a time step (eqs. 41-53)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from .anatomy import Trunk
from .errors import InputError, StaticsError
from .loads import Loads, Vector, vector
from .problem_file import HeldSpec, PhaseSpec, ProblemSpec, TargetSpec, Vec3, WrapSpec
from .statics import solve_statics


@dataclass(frozen=True)
class Held:
    """A director (0, 1, 2) at Z that the trunk reaches at time step `step` (from 0)."""

    step: int
    Z: float
    director: int


Direction = Vector | Held


@dataclass(frozen=True)
class Target:
    """What eq. (42) asks of one point Z (m): position (m) and directors, with weights."""

    Z: float
    position: Vector | None
    position_weight: float
    directions: tuple[Direction | None, Direction | None, Direction | None]
    direction_weights: Vector

    def pairs(self) -> list[tuple[int, Direction, float]]:
        """The directors that count: (index, desired direction, weight)."""
        return [
            (j, d, w)
            for j, (d, w) in enumerate(zip(self.directions, self.direction_weights, strict=True))
            if d is not None and w > 0
        ]


def all_targets(spec: ProblemSpec, trunk: Trunk) -> list[tuple[Target, ...]]:
    """Targets of every time step, with numbers in place of paths and arcs.

    Raises
    ------
    InputError
        For points off the trunk, or directions held from a step that is not earlier.
    """
    origins = {"base": np.zeros(3), "passive-tip": np.zeros(3)}
    parts = (part for p in spec.phases for part in (*p.targets, p.wrap) if part)
    if any(part.origin == "passive-tip" for part in parts):
        origins["passive-tip"] = np.array(_passive_tip(trunk, spec.gravity))
    found: list[tuple[Target, ...]] = []
    for number, phase in enumerate(spec.phases, 1):
        for i in range(1, phase.steps + 1):
            where = f"phases[{number}]"
            found.append(phase_targets(phase, i, trunk, origins, len(found), where))
    return found


@lru_cache(maxsize=32)  # targets are built again for every small move of a control loop
def _passive_tip(trunk: Trunk, gravity: float) -> Vector:
    """Where the tip of the trunk at rest is under its own weight, m."""
    try:
        rest = solve_statics(trunk, np.zeros(len(trunk.muscles)), loads=Loads(gravity))
        return vector(rest.position(np.array([trunk.length]))[0])
    except StaticsError as error:
        raise InputError(
            'origin = "passive-tip": the passive trunk does not hold its own weight '
            f"({error}) Expected a youngs_modulus in Pa, a density in kg/m^3 and a gravity in "
            'm/s^2 that fit together; or measure from origin = "base".'
        ) from None


def phase_targets(
    phase: PhaseSpec, i: int, trunk: Trunk, origins: dict[str, np.ndarray], step: int, where: str
) -> tuple[Target, ...]:
    """Targets of step i of a phase, with numbers in place of paths and arcs."""
    targets = [
        _point(spec, i / phase.steps, trunk, origins, step, f"{where}.targets[{n}]")
        for n, spec in enumerate(phase.targets, 1)
    ]
    if phase.wrap is not None:
        for Z in phase.wrap.Z:
            _check_on_trunk(Z, trunk, f"{where}.wrap.Z")
        targets += _arc(phase.wrap, i / phase.steps, trunk, origins, f"{where}.wrap")
    return tuple(targets)


def _point(
    spec: TargetSpec, t: float, trunk: Trunk, origins: dict[str, np.ndarray], step: int, where: str
) -> Target:
    _check_on_trunk(spec.Z, trunk, f"{where}.Z")
    position = None
    if spec.path is not None:
        position = vector(origins[spec.origin] + _bezier(spec.path, t))
    elif spec.position is not None:
        position = vector(origins[spec.origin] + np.asarray(spec.position))
    directions: list[Direction | None] = []
    for j, wanted in enumerate((spec.d1, spec.d2, spec.d3)):
        if isinstance(wanted, HeldSpec):
            check_earlier(wanted.held_from_step, step, f"{where}.d{j + 1}.held_from_step")
            directions.append(Held(wanted.held_from_step - 1, spec.Z, j))
        else:
            directions.append(None if wanted is None else vector(_unit(np.asarray(wanted))))
    weights = (spec.d1_weight, spec.d2_weight, spec.d3_weight)
    return Target(
        spec.Z,
        position,
        spec.position_weight,
        (directions[0], directions[1], directions[2]),
        weights,
    )


def _arc(
    spec: WrapSpec, t: float, trunk: Trunk, origins: dict[str, np.ndarray], where: str
) -> list[Target]:
    """Targets of a wrapping arc (eqs. 46-52): contact on the ventral side of a cylinder."""
    center = _bezier(spec.path, t) if spec.path is not None else np.asarray(spec.center)
    Z = np.linspace(*spec.Z, spec.points)
    theta = np.radians(np.linspace(*spec.angles_deg, spec.points))
    theta = np.append(theta, 2 * theta[-1] - theta[-2])  # the fictitious point of eq. (49)
    distance = spec.log_radius + trunk.radius(np.append(Z, Z[-1]))
    points = (
        origins[spec.origin]
        + center
        + distance[:, None]
        * np.stack([np.sin(theta), np.zeros_like(theta), np.cos(theta)], axis=-1)
    )
    chords = np.diff(points, axis=0)
    if not np.all(np.linalg.norm(chords, axis=1) > 0):
        raise InputError(
            f"{where}.angles_deg = {list(spec.angles_deg)}: neighbouring points of the wrap "
            "coincide; expected different angles at both ends."
        )
    return [
        Target(
            float(Z[p]),
            vector(points[p]),
            spec.position_weights[p],
            (None, None, vector(_unit(chords[p]))),
            (0.0, 0.0, spec.d3_weights[p]),
        )
        for p in range(spec.points)
    ]


def _bezier(points: Sequence[Vec3], t: float) -> np.ndarray:
    """Point of a Bezier curve (eq. 53, whose first coefficient must read (1 - t)^2)."""
    layer = np.asarray(points, dtype=float)
    while len(layer) > 1:  # de Casteljau
        layer = (1 - t) * layer[:-1] + t * layer[1:]
    return layer[0]


def _unit(v: np.ndarray) -> np.ndarray:
    return v / np.linalg.norm(v)


def _check_on_trunk(Z: float, trunk: Trunk, where: str) -> None:
    if not 0 <= Z <= trunk.length:
        units = (("cm", 1e-2), ("mm", 1e-3))
        fits = (f" Is it in {u}? Write {f * Z:g}." for u, f in units if 0 < f * Z <= trunk.length)
        raise InputError(
            f"{where} = {Z:g}: expected a point of the trunk, 0 to {trunk.length:g} m."
            f"{next(fits, '') if Z > 5 * trunk.length else ''}"
        )


def check_earlier(number: int, step: int, where: str) -> None:
    """Raise InputError unless time step `number` (from 1) comes before step `step` (from 0)."""
    if number > step:
        raise InputError(f"{where} = {number}: expected an earlier time step, 1 to {step}.")

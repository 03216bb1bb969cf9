"""Targets of a time step: positions and directions of points of the trunk (eqs. 41-53)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np
from scipy.interpolate import CubicSpline

from .._support.toml_files import Vec3
from ..errors import InputError, StaticsError
from ..model.anatomy import Trunk
from ..model.loads import Loads, Vector, vector
from ..model.solids import from_head_frame, turn
from ..rod.statics import solve_statics
from .problem_file import PhaseSpec, ProblemSpec
from .target_specs import HeldSpec, TargetSpec, WayPoint, WrapSpec

MAX_WEIGHT_STRAIN = 10.0  # density g L / E of a passive trunk; 0.02 for the elephant's


@dataclass(frozen=True)
class HeldDirection:
    """The director (0, 1, 2) at Z (m) that the trunk reaches at time step `step` (from 0)."""

    step: int
    Z: float
    director: int


Direction = Vector | HeldDirection


@dataclass(frozen=True)
class Target:
    """What eq. (42) asks of one point Z (m): position (m) and directors, with weights.

    `source` is the section of the problem file that it comes from, such as "phases[1].targets[2]"
    or "phases[3].wrap". In the frame "head", position and fixed directions are those at head
    angles 0, and turn with the head; held directions stay fixed in space.
    """

    Z: float
    position: Vector | None
    position_weight: float
    directions: tuple[Direction | None, Direction | None, Direction | None]
    direction_weights: Vector
    source: str = ""
    frame: Literal["space", "head"] = "space"

    def pairs(self) -> list[tuple[int, Direction, float]]:
        """Directors with a direction and a weight: (director, desired direction, weight)."""
        return [
            (j, d, w)
            for j, (d, w) in enumerate(zip(self.directions, self.direction_weights, strict=True))
            if d is not None and w > 0
        ]

    def position_at(self, trunk: Trunk, head: np.ndarray) -> np.ndarray:
        """Position in m and in space at head angles (..., 2) in rad, (3,) or (..., 3)."""
        place = np.asarray(self.position, dtype=float)
        if self.frame == "space":
            return place
        return from_head_frame(trunk, place[None], head)[..., 0, :]

    def direction_at(self, direction: Vector, head: np.ndarray) -> np.ndarray:
        """A fixed direction in space at head angles (..., 2) in rad, (3,) or (..., 3)."""
        fixed = np.asarray(direction, dtype=float)
        if self.frame == "space":
            return fixed
        turned: np.ndarray = fixed @ turn(head)
        return turned


def origins_of(spec: ProblemSpec, trunk: Trunk) -> dict[str, np.ndarray]:
    """Points (3,) in m from which a problem's positions are measured, by their names in the file.

    Raises
    ------
    InputError
        If positions are measured from the passive tip and the trunk does not hold its own weight,
        or from the mouth and the anatomy has none.
    """
    origins = {"base": np.zeros(3)}
    parts = [part for p in spec.phases for part in (*p.targets, p.wrap) if part]
    if any(part.origin == "passive-tip" for part in parts):
        origins["passive-tip"] = np.array(_passive_tip(trunk, spec.gravity))
    if any(part.origin == "mouth" for part in parts):
        if trunk.head.mouth is None:
            raise InputError(
                f'origin = "mouth": the anatomy of {trunk.name} has no [head] mouth = {{ point, '
                "direction }; add it there, or measure from another origin."
            )
        origins["mouth"] = np.array(trunk.head.mouth[0])
    return origins


@lru_cache(maxsize=32)  # targets are built again for every small move of a control loop
def _passive_tip(trunk: Trunk, gravity: float) -> Vector:
    """Position (3,) in m of the tip of the trunk at rest under its own weight."""
    strain = trunk.density * abs(gravity) * trunk.length / trunk.youngs_modulus
    try:
        if strain > MAX_WEIGHT_STRAIN:  # the search would take long, and mean nothing
            raise StaticsError(f"its weight alone would strain it by {strain:.2g}.", 0.0)
        rest = solve_statics(trunk, np.zeros(len(trunk.muscles)), loads=Loads(gravity))
        return vector(rest.position(np.array([trunk.length]))[0])
    except StaticsError as error:
        raise InputError(
            'origin = "passive-tip": the passive trunk does not hold its own weight '
            f"({error}) Expected a youngs_modulus in Pa, a density in kg/m^3 and a gravity in "
            'm/s^2 that are consistent; or measure from origin = "base".'
        ) from None


def phase_targets(
    phase: PhaseSpec,
    i: float,
    trunk: Trunk,
    origins: dict[str, np.ndarray],
    earlier: Sequence[int],
    where: str,
) -> tuple[Target, ...]:
    """Targets of step i of a phase (from 1), with numbers in place of paths and arcs.

    Parameters
    ----------
    origins : dict
        See `origins_of`.
    earlier : sequence of int
        Numbers, from 0, of the motion's time steps with targets before this one.
    where : str
        Key of the phase, for messages.

    Raises
    ------
    InputError
        For points off the trunk, directions held from a step that is not earlier, and wraps whose
        points coincide.
    """
    targets = []
    for n, spec in enumerate(phase.targets, 1):
        place = _place(spec, spec.position, phase, i, origins)
        targets.append(_point(spec, place, trunk, earlier, f"{where}.targets[{n}]"))
    if phase.wrap is not None:
        for Z in phase.wrap.Z:
            _on_trunk(Z, trunk, f"{where}.wrap.Z")
        center = np.asarray(wrap_center(phase, i, origins))
        targets += _arc(phase.wrap, center, trunk, f"{where}.wrap")
    return tuple(targets)


def wrap_center(phase: PhaseSpec, i: float, origins: dict[str, np.ndarray]) -> Vector | None:
    """Center (3,) in m of the arc that a phase wraps around at its step i; None without a wrap."""
    wrap = phase.wrap
    return None if wrap is None else _place(wrap, wrap.center, phase, i, origins)


def _place(
    spec: TargetSpec | WrapSpec,
    fixed: Vec3 | None,
    phase: PhaseSpec,
    i: float,
    origins: dict[str, np.ndarray],
) -> Vector | None:
    """Position in m of a target or a wrap's center at step i of its phase; None if it has none."""
    if spec.path is not None:
        place = bezier(spec.path, i / phase.steps)
    elif spec.through is not None:
        curve = _curve(spec.through, phase.duration, phase.steps)
        place = curve(np.clip(phase.duration * i / phase.steps, curve.x[0], curve.x[-1]))
    elif fixed is not None:
        place = np.asarray(fixed)
    else:
        return None
    return vector(origins[spec.origin] + place)


@lru_cache(maxsize=32)  # every step of a phase asks for it
def _curve(rows: tuple[WayPoint, ...], duration: float, steps: int) -> CubicSpline:
    """The curve through way points, over time in s from the phase's start."""
    return CubicSpline(*way_points(rows, duration, steps))


def way_points(
    rows: Sequence[WayPoint], duration: float, steps: int
) -> tuple[np.ndarray, np.ndarray]:
    """Times (n,) in s and places (n, 3) in m of way points of a phase of `duration` in s.

    Rows without a time are at equal intervals: one at each step if their number is that of the
    steps, else from the phase's start to its end.
    """
    table = np.asarray(rows, dtype=float)
    if table.shape[1] == 4:
        return np.minimum(table[:, 0], duration), table[:, 1:]
    first = duration / steps if len(table) == steps else 0.0
    return np.linspace(first, duration, len(table)), table


def _point(
    spec: TargetSpec, position: Vector | None, trunk: Trunk, earlier: Sequence[int], where: str
) -> Target:
    Z = _on_trunk(spec.Z, trunk, f"{where}.Z")
    directions: list[Direction | None] = []
    for j, direction in enumerate((spec.d1, spec.d2, spec.d3)):
        if isinstance(direction, HeldSpec):
            number, key = direction.held_from_step, f"{where}.d{j + 1}.held_from_step"
            directions.append(HeldDirection(earlier_step(number, earlier, key), Z, j))
        else:
            directions.append(None if direction is None else vector(_unit(np.asarray(direction))))
    weights = (spec.d1_weight, spec.d2_weight, spec.d3_weight)
    return Target(
        Z,
        position,
        spec.position_weight,
        (directions[0], directions[1], directions[2]),
        weights,
        where,
        "head" if spec.origin == "mouth" else spec.frame,
    )


def _arc(spec: WrapSpec, center: np.ndarray, trunk: Trunk, where: str) -> list[Target]:
    """Targets of a wrapping arc (eqs. 46-52): contact on the ventral side of a cylinder."""
    first, last = trunk.clipped(spec.Z).tolist()
    Z = np.linspace(first, last, spec.points)
    theta = np.radians(np.linspace(*spec.angles_deg, spec.points))
    theta = np.append(theta, 2 * theta[-1] - theta[-2])  # the fictitious point of eq. (49)
    distance = spec.log_radius + trunk.radius(np.append(Z, Z[-1]))
    points = center + distance[:, None] * np.stack(
        [np.sin(theta), np.zeros_like(theta), np.cos(theta)], axis=-1
    )
    chords = np.diff(points, axis=0)
    if not np.all(np.linalg.norm(chords, axis=1) > 0):
        raise InputError(
            f"{where}.angles_deg = {list(spec.angles_deg)}: neighboring points of the wrap "
            "coincide; expected different angles at both ends."
        )
    return [
        Target(
            float(Z[p]),
            vector(points[p]),
            spec.position_weights[p],
            (None, None, vector(_unit(chords[p]))),
            (0.0, 0.0, spec.d3_weights[p]),
            where,
        )
        for p in range(spec.points)
    ]


def bezier(points: Sequence[Vec3], t: float) -> np.ndarray:
    """Point of a Bezier curve (eq. 53, whose first coefficient must read (1 - t)^2)."""
    layer = np.asarray(points, dtype=float)
    while len(layer) > 1:  # de Casteljau
        layer = (1 - t) * layer[:-1] + t * layer[1:]
    return layer[0]


def _unit(v: np.ndarray) -> np.ndarray:
    return v / np.linalg.norm(v)


def _on_trunk(Z: float, trunk: Trunk, where: str) -> float:
    """Z clipped to the trunk if it is outside by round-off; InputError if by more."""
    if 0 <= Z <= trunk.length:
        return Z
    Z = float(trunk.clipped(Z))
    if not 0 <= Z <= trunk.length:
        units = [(u, f * Z) for u, f in (("mm", 1e-3), ("cm", 1e-2)) if f * Z <= trunk.length]
        names, values = " or ".join(u for u, _ in units), " or ".join(f"{v:g}" for _, v in units)
        hint = f" Is it in {names}? Write {values}." if units and Z > 5 * trunk.length else ""
        raise InputError(
            f"{where} = {Z:.12g}: expected a point of the trunk, 0 to {trunk.length:.12g} m.{hint}"
        )
    return Z


def earlier_step(number: int, earlier: Sequence[int], where: str) -> int:
    """Number, from 0, of the time step that a file calls `number`, from 1.

    Raises
    ------
    InputError
        If it is not among the earlier ones.
    """
    if number > len(earlier):
        raise InputError(f"{where} = {number}: expected an earlier time step, 1 to {len(earlier)}.")
    return earlier[number - 1]

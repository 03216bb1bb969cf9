"""The solids that are there at a time step: parts of the head, the log, and obstacles."""

from __future__ import annotations

from ..errors import InputError
from ..model.anatomy import Trunk
from ..model.loads import Vector
from ..model.solid_specs import ObstacleSpec
from ..model.solids import SELF, Axes, Solid, built_solid
from .motion import LENGTH_OVER_RADIUS, Log
from .problem_file import PhaseSpec, ProblemSpec

LOG_NAME = "log"
LOG_AXES: Axes = ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))  # the third, e_Y, is its own


def head_solids(trunk: Trunk) -> tuple[Solid, ...]:
    """What the head consists of."""
    return tuple(built_solid(spec, "head", "head") for spec in trunk.head.body)


def phase_obstacles(spec: ProblemSpec, phase: PhaseSpec) -> tuple[Solid, ...]:
    """Obstacles that are there in a phase."""
    there = (o for o in spec.obstacles if o.phases is None or phase.name in o.phases)
    return tuple(built_solid(obstacle, "obstacles", obstacle.frame) for obstacle in there)


def log_solids(log: Log | None) -> tuple[Solid, ...]:
    """The log at a step, if it has a place."""
    if log is None or log.center is None:
        return ()
    return (log_solid(log.center, log.radius, log.length or LENGTH_OVER_RADIUS * log.radius),)


def log_solid(center: Vector, radius: float, length: float) -> Solid:
    """A log along e_Y; center, radius and length in m."""
    return Solid(LOG_NAME, "log", "cylinder", center, LOG_AXES, (radius, length / 2))


def check_obstacles(obstacles: tuple[ObstacleSpec, ...], trunk: Trunk) -> None:
    """Raise InputError unless names are all different and parts of the trunk are on the trunk."""
    names = [LOG_NAME, SELF, *(solid.name for solid in trunk.head.body)]
    for number, obstacle in enumerate(obstacles, 1):
        where = f"obstacles[{number}]"
        if obstacle.name in names:
            raise InputError(
                f'{where}.name = "{obstacle.name}": is the name of another solid; expected one of '
                "its own."
            )
        names.append(obstacle.name)
        if obstacle.Z is not None and obstacle.Z[1] > trunk.length:
            raise InputError(
                f"{where}.Z = [{obstacle.Z[0]:g}, {obstacle.Z[1]:g}]: expected at most the "
                f"trunk's length, {trunk.length:g} m."
            )

"""What the page gets: the moving trunk's cross-sections, its muscles and its surroundings.

Not surfaces but what makes them: centerline, quaternions and section scale at about 50 points of
the trunk and up to 120 times. The page computes x = r + s f (X d_1 + Y d_2) itself, as
`scene.body` does; that is a fifth of the size. Arrays are float32 in base64.
"""

from __future__ import annotations

import base64
import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from ..errors import InputError
from ..model.anatomy import Muscle, Trunk
from ..model.solids import Solid, pivot
from ..planning.plan import Plan
from ..planning.status import Status
from ..problem.interpolation import with_marks
from ..problem.motion import Motion, Step
from ..problem.step_solids import head_solids
from ..rod.shape import Shape
from ..scene.body import core_radius, frames, outline
from ..scene.colors import MASS, group_colors
from ..scene.moments import Moment, moments_at, phase_at
from ..scene.solid_meshes import color_of, obstacles, solid_surface
from ..scene.surfaces import shaded
from ..scene.surroundings import Mark, Places, logs, marks, tip_mass
from .physics_tables import physics_tables
from .sections import Grid, section_grid
from .try_it import plan_controls

SAMPLE_RATE = 25.0  # per second of motion
MIN_SAMPLES, MAX_SAMPLES = 24, 120  # of a motion, however short or long


def payload(plans: Sequence[Plan]) -> dict[str, Any]:
    """Everything the page shows, ready for JSON."""
    spec = plans[0].motion.spec
    return {
        "name": spec.name,
        "title": spec.title or spec.name,
        "trunk": plans[0].motion.trunk.name,
        "plans": [_plan(plan) for plan in plans],
    }


def _plan(plan: Plan) -> dict[str, Any]:
    moments = _moments(plan)
    return {
        **_outcome(plan),
        "steps": [float(t) for t in plan.motion.times[: len(plan.x)]],
        "phases": [{"name": phase.name, "end": phase.end} for phase in plan.motion.phases],
        "trunk": trunk_of(plan.motion.trunk, section_grid(plan.motion.trunk)),
        "pivot": pivot(plan.motion.trunk).tolist(),
        "solids": _solids(plan, moments),
        **moving(plan, moments),
    }


def moving(plan: Plan, moments: Sequence[Moment], at: Places | None = None) -> dict[str, Any]:
    """What a plan of the same motion with other numbers changes on the page; `at`: see `marks`."""
    times, trunk = [moment.time for moment in moments], plan.motion.trunk
    targets = _marks(plan, at)
    return {
        # Unrounded: rounding must not move a time to the other side of a jump.
        "times": times,
        "jumps": list(plan.jumps),
        "held": _held(plan.motion, times),
        "frames": frames_of(trunk, _shapes(plan, moments), section_grid(trunk).Z),
        "activation": encoded(np.array([moment.activation for moment in moments])),
        "head": encoded(np.array([moment.head for moment in moments])),
        "objects": [*_logs(plan, moments), *_mass(plan, moments)],
        "targets": _targets(targets),
        "arrows": _arrows(targets),
        "controls": plan_controls(plan, moments),
    }


def _outcome(plan: Plan) -> dict[str, Any]:
    J = plan.objective.paper
    return {
        "mode": plan.mode,
        "status": plan.check().value,
        "solved": plan.check() is Status.SOLVED,
        "objective": J if math.isfinite(J) else None,
    }


def sample_times(plan: Plan) -> np.ndarray:
    """Times (n,) in s to sample a plan at: evenly spread, jumps, and the time steps if they fit."""
    steps = plan.motion.times[: len(plan.x)]
    steps = steps if len(steps) <= MAX_SAMPLES // 2 else np.array(plan.jumps)
    end = float(plan.motion.times[len(plan.x) - 1])
    most = max(MIN_SAMPLES, MAX_SAMPLES - len(steps))
    count = int(np.clip(np.ceil(SAMPLE_RATE * end) + 1, MIN_SAMPLES, most))
    return with_marks(np.linspace(0.0, end, count), steps.tolist(), 1e-9 * end)


def _moments(plan: Plan) -> list[Moment]:
    """The moving trunk; where loads jump, both sides: two moments at the same time.

    Where the trunk has no equilibrium there is no moment, and the page interpolates.
    """
    moments = moments_at(plan, sample_times(plan))
    if not moments:
        raise InputError(f"{plan.motion.name}: the trunk has no equilibrium at any time to show.")
    return moments


def _held(motion: Motion, times: Sequence[float]) -> list[bool]:
    """Whether the trunk keeps its shape from each sample to the next, and then jumps."""
    middles = (np.array(times[:-1]) + np.array(times[1:])) / 2
    return [
        motion.phases[phase_at(motion, time)].interpolation == "none" for time in middles.tolist()
    ]


def _logs(plan: Plan, moments: Sequence[Moment]) -> list[dict[str, Any]]:
    return [
        {
            "kind": "log",
            "radius": log.radius,
            "length": log.length,
            "center": encoded(np.array([log.center(plan, moment.time) for moment in moments])),
        }
        for log in logs(plan)
    ]


def _mass(plan: Plan, moments: Sequence[Moment]) -> list[dict[str, Any]]:
    """The mass at the tip, and whether it is `shown` in each sample."""
    mass = tip_mass(plan)
    if mass is None:
        return []
    centers = [mass.center(plan, moment) for moment in moments]
    known = [mass.place if center is None else center for center in centers]
    return [
        {
            "kind": "fruit",
            "radius": mass.radius,
            "mass": mass.mass,
            "color": MASS,
            "shown": [center is not None for center in centers],
            "center": encoded(np.array(known)),
        }
    ]


def _targets(targets: Sequence[tuple[Step, Mark]]) -> list[dict[str, Any]]:
    """Positions that points of the trunk should have, and from when to when, in s."""
    places: dict[tuple[object, ...], dict[str, Any]] = {}
    for step, mark in targets:
        if mark.placed:
            position = mark.target.tolist()
            place = {
                "name": mark.source,
                "Z": mark.Z,
                "position": position,
                "from": step.time - step.duration,
            }
            places.setdefault((mark.source, mark.Z, *position), place)["to"] = step.time
    return list(places.values())


def _arrows(targets: Sequence[tuple[Step, Mark]]) -> list[dict[str, Any]]:
    """Directions that points of the trunk should have, where, and from when to when, in s."""
    return [
        {
            "Z": mark.Z,
            "director": director,
            "position": mark.target.tolist(),
            "direction": direction.tolist(),
            "from": step.time - step.duration,
            "to": step.time,
        }
        for step, mark in targets
        for director, direction in zip(mark.directors, mark.directions, strict=True)
    ]


def _marks(plan: Plan, at: Places | None) -> list[tuple[Step, Mark]]:
    """Every target of every planned step."""
    steps = plan.motion.steps[: len(plan.x)]
    return [(step, mark) for number, step in enumerate(steps) for mark in marks(plan, number, at)]


def trunk_of(trunk: Trunk, grid: Grid) -> dict[str, Any]:
    """The bodies of a trunk on a grid of cross-sections."""
    return {
        "Z": encoded(grid.Z),
        "taper": encoded(trunk.taper(grid.Z)),
        "tables": physics_tables(trunk),
        "radius": trunk.base_radius,
        "length": trunk.length,
        "colors": group_colors(trunk),
        "muscles": [_muscle(muscle, trunk.subdomains, grid) for muscle in trunk.subdomains],
        "cores": [
            {"first": first, "last": last, "radius": core_radius(trunk, segment)}
            for segment, (first, last) in enumerate(pairwise(grid.edges))
        ],
    }


def _muscle(muscle: Muscle, others: Sequence[Muscle], grid: Grid) -> dict[str, Any]:
    return {
        "name": muscle.name,
        "group": muscle.group,
        "side": muscle.side,
        "segment": muscle.segment,
        "architecture": muscle.architecture,
        "first": grid.edges[muscle.segment],
        "last": grid.edges[muscle.segment + 1],
        "hollow": muscle.radii[0] > 0,
        "outer": any(covers(muscle, other) for other in others),
        "outline": encoded(thinned(outline(muscle), muscle.radii[0] > 0)),
    }


def covers(muscle: Muscle, other: Muscle) -> bool:
    """Whether a muscle hides another that is nearer to the center."""
    (low, high), (first, second) = muscle.sector, other.sector
    overlap = min(high, second) - max(low, first)
    return muscle.segment == other.segment and other.radii[0] < muscle.radii[0] and overlap > 1e-3


def thinned(section: np.ndarray, hollow: bool) -> np.ndarray:
    """About half of an outline's points, with the ends of arcs; the page shades them smoothly."""
    m = len(section)
    arc = m // 2 if hollow else m - 1
    kept = np.unique(np.linspace(0, arc - 1, arc // 2 + 1).round().astype(int))
    back = m - 1 - kept[::-1] if hollow else np.array([m - 1])
    return section[np.concatenate([kept, back])]


def _shapes(plan: Plan, moments: Sequence[Moment]) -> Shape:
    return Shape.stack([moment.shape[0] for moment in moments], plan.mesh)


def frames_of(trunk: Trunk, shape: Shape, Z: np.ndarray) -> dict[str, str]:
    """Cross-sections as position, quaternion (scalar first) and the scale of a radius."""
    at = frames(trunk, shape, Z)
    q = shape.state(Z)[..., :4]
    return {
        "position": encoded(at.position),
        "quaternion": encoded(q / np.linalg.norm(q, axis=-1, keepdims=True)),
        "scale": encoded(at.scale),
    }


def _solids(plan: Plan, moments: Sequence[Moment]) -> list[dict[str, Any]]:
    """Parts of the head and obstacles, and whether they are `shown` in samples."""
    trunk = plan.motion.trunk
    return [
        solid_entry(solid, trunk, shown)
        for solid, shown in zip(_all_solids(plan), shown_solids(plan, moments), strict=True)
    ]


def solid_entry(solid: Solid, trunk: Trunk, shown: list[bool]) -> dict[str, Any]:
    """A solid at head angles 0."""
    surface = shaded(solid_surface(solid, trunk.length).body)
    return {
        "name": solid.name,
        "group": solid.group,
        "turns": solid.frame == "head",
        "bounded": solid.shape != "half-space",
        "color": color_of(solid),
        "shown": shown,
        "points": encoded(surface.vertices[0]),
        "normals": encoded(surface.normals[0]),
        "triangles": surface.triangles.ravel().tolist(),
    }


def shown_solids(plan: Plan, moments: Sequence[Moment]) -> list[list[bool]]:
    """Whether each solid of the page is there, moment by moment."""
    phases = [phase_at(plan.motion, moment.time, moment.after) for moment in moments]
    there = _solids_of_phases(plan)
    return [[solid in there[phase] for phase in phases] for solid in _all_solids(plan)]


def _all_solids(plan: Plan) -> list[Solid]:
    # In order, unlike a set, so that a page has the same bytes every time.
    return [*dict.fromkeys(solid for phase in _solids_of_phases(plan) for solid in phase)]


def _solids_of_phases(plan: Plan) -> list[tuple[Solid, ...]]:
    return [
        (*head_solids(plan.motion.trunk), *obstacles(plan, phase))
        for phase in range(len(plan.motion.phases))
    ]


def encoded(array: np.ndarray) -> str:
    """Little-endian float32 in base64."""
    return base64.b64encode(np.ascontiguousarray(array, dtype="<f4").tobytes()).decode("ascii")

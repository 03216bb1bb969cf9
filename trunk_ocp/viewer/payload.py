"""What the page is told: the moving trunk's cross-sections, its muscles and what they act on.

Not surfaces but what makes them: centerline, quaternions and section scale at some 50 points of
the trunk and up to some 120 instants. The page computes x = r + s f (X d_1 + Y d_2) itself, as
`body` does, and is a fifth of the size. Arrays are float32 in base64.
"""

from __future__ import annotations

import base64
import contextlib
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import InputError, StaticsError
from ..model.anatomy import Muscle, Trunk
from ..model.head import base_pose
from ..model.quaternions import about_y, about_z, directors, product
from ..planning.plan import Plan, Sample, Status
from ..problem.interpolation import with_marks
from ..problem.motion import Motion
from ..rod.shape import Shape
from ..scene.body import frames, outline
from ..scene.carried import arrows, carried, targets
from ..scene.colors import group_colors

SECTIONS = 48  # cross-sections along the trunk, about
RATE = 25.0  # samples for each second of motion
FEWEST, MOST = 24, 120  # samples of a motion, however short or long


def payload(plans: Sequence[Plan]) -> dict[str, Any]:
    """Everything the page shows, as JSON takes it."""
    spec = plans[0].motion.spec
    return {
        "name": spec.name,
        "title": spec.title or spec.name,
        "trunk": plans[0].motion.trunk.name,
        "plans": [_plan(plan) for plan in plans],
    }


def _plan(plan: Plan) -> dict[str, Any]:
    trunk = plan.motion.trunk
    samples = _samples(plan)
    grid = section_grid(trunk)
    shape = Shape.stack([sample.shape for sample in samples])
    motion, J = plan.motion, plan.objective.paper
    return {
        "mode": plan.mode,
        "status": plan.status.value,
        "solved": plan.status is Status.SOLVED,
        "objective": J if math.isfinite(J) else None,
        # With all their digits: on which side of a jump a time is must not depend on rounding.
        "times": [sample.time for sample in samples],
        "jumps": list(plan.jumps),
        "held": _held(motion, [sample.time for sample in samples]),
        "steps": [float(t) for t in motion.times[: len(plan.x)]],
        "phases": [{"name": phase.name, "end": phase.end} for phase in motion.phases],
        "trunk": _trunk(trunk, grid),
        "frames": _frames(trunk, shape, grid.Z),
        "activation": encoded(np.array([sample.activation for sample in samples])),
        "head": encoded(np.array([sample.head for sample in samples])),
        "pivot": _pivot(trunk),
        "objects": [
            {**thing.description, "center": encoded(thing.center)}
            for thing in carried(plan, samples, shape)
        ],
        "targets": targets(plan),
        "arrows": arrows(plan),
    }


def instants(plan: Plan) -> np.ndarray:
    """Times (n,) in s to sample a plan at: evenly spread, and at its time steps if they fit.

    Where loads jump in any case.
    """
    steps = plan.motion.times[: len(plan.x)]
    steps = steps if len(steps) <= MOST // 2 else np.array(plan.jumps)
    end = float(plan.motion.times[len(plan.x) - 1])
    count = int(np.clip(np.ceil(RATE * end) + 1, FEWEST, max(FEWEST, MOST - len(steps))))
    return with_marks(np.linspace(0.0, end, count), steps.tolist(), 1e-9 * end)


def _samples(plan: Plan) -> list[Sample]:
    """The moving trunk, without the instants for which there is no equilibrium, if any.

    Where loads jump, both sides: two samples at the same time.
    """
    samples = []
    for t in instants(plan).tolist():
        for after in (False, True) if t in plan.jumps else (False,):
            # Between steps, where nothing was planned, the page interpolates.
            with contextlib.suppress(StaticsError):
                samples.append(plan.sample(t, after=after))
    if not samples:
        raise InputError(f"{plan.motion.name}: no instant of the plan has an equilibrium to show.")
    return samples


def _held(motion: Motion, times: Sequence[float]) -> list[bool]:
    """Whether the trunk keeps still from each sample to the next, and then jumps."""
    ends = [phase.end for phase in motion.phases[:-1]]
    middles = (np.array(times[:-1]) + np.array(times[1:])) / 2
    return [
        motion.phases[number].interpolation == "none"
        for number in np.searchsorted(ends, middles).tolist()
    ]


@dataclass(frozen=True, eq=False)
class Grid:
    """Points Z (n,) in m of the cross-sections; segment i begins at number `edges[i]`."""

    Z: np.ndarray
    edges: tuple[int, ...]


def section_grid(trunk: Trunk) -> Grid:
    """Cross-sections of a trunk, on every edge between segments."""
    Z, edges = [np.zeros(1)], [0]
    for start, end in zip(trunk.edges[:-1], trunk.edges[1:], strict=True):
        intervals = max(4, round(SECTIONS * (end - start) / trunk.length))
        Z.append(np.linspace(start, end, intervals + 1)[1:])
        edges.append(edges[-1] + intervals)
    return Grid(np.concatenate(Z), tuple(edges))


def _trunk(trunk: Trunk, grid: Grid) -> dict[str, Any]:
    return {
        "taper": encoded(trunk.taper(grid.Z)),
        "radius": trunk.base_radius,
        "length": trunk.length,
        "colors": group_colors(trunk),
        "muscles": [_muscle(muscle, grid) for muscle in trunk.subdomains],
        "cores": [
            {"first": first, "last": last, "radius": _core(trunk, segment)}
            for segment, (first, last) in enumerate(
                zip(grid.edges[:-1], grid.edges[1:], strict=True)
            )
        ],
    }


def _core(trunk: Trunk, segment: int) -> float:
    """Radius in m at Z = 0 of what no muscle of a segment reaches into."""
    inner = (muscle.radii[0] for muscle in trunk.subdomains if muscle.segment == segment)
    return min(inner, default=trunk.base_radius)


def _muscle(muscle: Muscle, grid: Grid) -> dict[str, Any]:
    return {
        "name": muscle.name,
        "group": muscle.group,
        "side": muscle.side,
        "segment": muscle.segment,
        "architecture": muscle.architecture,
        "first": grid.edges[muscle.segment],
        "last": grid.edges[muscle.segment + 1],
        "hollow": muscle.radii[0] > 0,
        "outline": encoded(thinned(outline(muscle), muscle.radii[0] > 0)),
    }


def thinned(section: np.ndarray, hollow: bool) -> np.ndarray:
    """Some half of an outline's points, ends of arcs among them: the page draws them smoothly."""
    m = len(section)
    arc = m // 2 if hollow else m - 1
    kept = np.unique(np.linspace(0, arc - 1, arc // 2 + 1).round().astype(int))
    back = m - 1 - kept[::-1] if hollow else np.array([m - 1])
    return section[np.concatenate([kept, back])]


def _frames(trunk: Trunk, shape: Shape, Z: np.ndarray) -> dict[str, str]:
    """Cross-sections as position, quaternion (scalar first) and the scale of a radius."""
    at = frames(trunk, shape, Z)
    q = shape.state(Z)[..., :4]
    return {
        "position": encoded(at.position),
        "quaternion": encoded(q / np.linalg.norm(q, axis=-1, keepdims=True)),
        "scale": encoded(at.scale),
    }


def _pivot(trunk: Trunk) -> dict[str, Any]:
    """The sphere on which the head moves the base (eq. 35)."""
    base, _ = base_pose(trunk.head, 0.0, 0.0)
    rest = directors(product(about_z(trunk.head.xi_z), about_y(trunk.head.xi_y)))[2]
    radius = trunk.head.pivot_radius
    return {
        "radius": radius,
        "center": [float(r - radius * s) for r, s in zip(base, rest, strict=True)],
    }


def encoded(array: np.ndarray) -> str:
    """Little-endian float32 in base64."""
    return base64.b64encode(np.ascontiguousarray(array, dtype="<f4").tobytes()).decode("ascii")

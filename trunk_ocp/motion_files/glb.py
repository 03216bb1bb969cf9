"""A motion as one glTF file (.glb), which Blender and web viewers open.

Each muscle is a separate mesh that morphs through the shapes of the key frames, and so is the skin
around them. The morph targets of glTF are differences from the first shape; the weights blend two
neighbors at a time. Parts of the head are meshes that turn about its pivot; obstacles, logs, the
mass at the tip and targets are meshes that move, and have no size where they are not there.
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from .._support.atomic_files import write
from ..model.anatomy import Muscle, Trunk
from ..planning.plan import Plan
from ..rod.shape import Shape
from ..scene.body import Body, disc, round_body
from ..scene.body import frames as frames_of
from ..scene.colors import EXTRA_COLORS, group_colors
from ..scene.keyframes import JUMP_DURATION, Keyframes, for_blending
from ..scene.surfaces import coarse_body, coarse_outline, shaded
from .glb_file import GlbFile
from .glb_surroundings import add_objects, add_solids, add_targets

TARGET_BYTES = 5_000_000  # for the shapes; the JSON that describes them adds up to 15 %
SECTIONS = (4, 24)  # minimum and maximum cross-sections of a muscle
AROUND = 24  # points around the whole trunk
SKIN, SKIN_OPACITY, SKIN_RADIUS = "#9A8F86", 0.3, 1.01

# Columns are the model's axes (X forward, Y right, Z down) in glTF's: +Z forward, -X right,
# +Y up. As a quaternion x, y, z, w.
UPRIGHT = (0.5, -0.5, 0.5, 0.5)


def write_glb(plan: Plan, path: str | Path) -> Path:
    """Write a plan as an animation, a node for each muscle; returns the path.

    Lengths are in m and times in s from the start; a root node rotates the model's axes to glTF's.
    Key frames are the time steps, the trunk just after each jump of the loads, and some in between
    where blending alone would depart from the motion. Each node's `extras` have the muscle's group,
    side, segment, and activation at the root's `times`; `extras.time_steps` are the planned time
    steps. The node "skin" is the whole trunk, translucent; a trunk without muscles is a single
    mesh. Other nodes are parts of the head, obstacles, logs, the tip mass and targets, as
    `extras.solid` says; an obstacle is there in `extras.phases`. Long motions get fewer
    cross-sections, so that the file stays below about 6 MB.

    Raises
    ------
    InputError
        If the plan has no time steps, or the file cannot be written.
    """
    frames = for_blending(plan)
    trunk = plan.motion.trunk
    parts: list[Muscle | None] = list(trunk.subdomains) or [None]
    sections = sections_within(parts, len(frames.times), len(trunk.edges) - 1)
    file = GlbFile()
    keys, weights = weight_keys(frames)
    file.sampler_of(keys, weights.ravel(), "SCALAR")
    colors = group_colors(trunk)
    names = [f"{time:.6g} s" for time in frames.times[1:].tolist()]
    for i, part in enumerate(parts):
        surface = shaded(coarse_body(trunk, part, frames.shape, sections))
        name = part.name if part else trunk.name
        extras = _extras(part, frames.activation[:, i]) if part else {}
        color = colors[part.group] if part else EXTRA_COLORS[4]
        file.morphing_node(name, surface, color, names, extras)
    if trunk.subdomains:
        skin = shaded(skin_body(trunk, frames.shape, sections))
        file.morphing_node("skin", skin, SKIN, names, {}, opacity=SKIN_OPACITY)
    at = weights_to_shapes(weights)
    add_solids(file, plan, keys, frames.times[at])
    add_objects(file, plan, keys, frames, at)
    add_targets(file, plan)
    return write(path, file.glb(_root(plan, frames)))


def skin_body(trunk: Trunk, shape: Shape, sections: int) -> Body:
    """The whole trunk in shapes (H,), a little thicker than its muscles, so that it covers them."""
    Z = np.unique(np.concatenate([np.linspace(*ends, sections) for ends in pairwise(trunk.edges)]))
    return round_body(disc(SKIN_RADIUS * trunk.base_radius)[::2], frames_of(trunk, shape, Z))


def sections_within(parts: list[Muscle | None], frames: int, segments: int) -> int:
    """Cross-sections of each muscle, so that all shapes, with the skin, take `TARGET_BYTES`."""
    points = [len(coarse_outline(part)[0]) if part else AROUND * segments for part in parts]
    points += [AROUND * segments] if parts != [None] else []
    per_section, caps = sum(points) + 4 * len(points), 2 * sum(points)  # edges have two normals
    room = TARGET_BYTES / (24 * frames)  # a vertex is a position and a normal, 24 bytes
    return int(np.clip((room - caps) / per_section, *SECTIONS))


def weight_keys(frames: Keyframes) -> tuple[np.ndarray, np.ndarray]:
    """Times (k,) in s and weights (k, n - 1) of all shapes but the first, which is the base.

    At each key frame one weight is 1, so between two of them their sum is. Where a phase holds
    the earlier shape, another key just before the jump does so.
    """
    count = len(frames.times)
    times, shapes = [frames.times[0]], [0]
    for i in range(1, count):
        if frames.held[i]:
            step = frames.times[i] - frames.times[i - 1]
            times.append(frames.times[i] - min(JUMP_DURATION, step / 2))
            shapes.append(i - 1)
        times.append(frames.times[i])
        shapes.append(i)
    return np.array(times), np.eye(count)[shapes, 1:]


def weights_to_shapes(weights: np.ndarray) -> np.ndarray:
    """Index (k,) of the shape that each row of weights (k, n - 1) shows."""
    return np.where(weights.any(axis=1), 1 + weights.argmax(axis=1), 0)


def _extras(muscle: Muscle, activation: np.ndarray) -> dict[str, Any]:
    return {
        "group": muscle.group,
        "side": muscle.side,
        "segment": muscle.segment + 1,
        "architecture": muscle.architecture,
        "activation": [round(value, 6) for value in activation.tolist()],
    }


def _root(plan: Plan, frames: Keyframes) -> dict[str, Any]:
    """The node that holds all muscles and rotates them upright."""
    motion = plan.motion
    return {
        "name": motion.trunk.name,
        "rotation": UPRIGHT,
        "extras": {
            "title": motion.spec.title or motion.name,
            "status": plan.check().value,
            "times": [round(time, 6) for time in frames.times.tolist()],
            "time_steps": [round(step.time, 6) for step in motion.steps[: len(plan.x)]],
            "phases": [{"name": phase.name, "end": round(phase.end, 6)} for phase in motion.phases],
            "activation": "negative contracts",
        },
    }

"""A motion as one glTF file (.glb), which Blender and web viewers open.

Each muscle is a separate mesh that morphs through the shapes of the key frames. The morph targets
of glTF are differences from the first shape; the weights blend two neighbors at a time. Parts of
the head are meshes that turn about its pivot, and obstacles are meshes.
"""

from __future__ import annotations

import json
import struct
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from .._support.atomic_files import write
from ..model.anatomy import Muscle
from ..model.quaternions import about_y, about_z, product
from ..model.solids import Solid, pivot
from ..planning.plan import Plan
from ..problem.step_solids import head_solids
from ..scene.colors import EXTRA_COLORS, group_colors
from ..scene.keyframes import JUMP_DURATION, Keyframes, for_blending
from ..scene.moments import curves
from ..scene.solid_meshes import color_of, obstacles, solid_surface
from ..scene.surfaces import Surface, coarse_body, coarse_outline, shaded

FLOAT, UINT = 5126, 5125
VERTICES, INDICES = 34962, 34963

TARGET_BYTES = 5_000_000  # for the shapes; the JSON that describes them adds up to 15 %
SECTIONS = (4, 24)  # minimum and maximum cross-sections of a muscle

# Columns are the model's axes (X forward, Y right, Z down) in glTF's: +Z forward, -X right,
# +Y up. As a quaternion x, y, z, w.
UPRIGHT = (0.5, -0.5, 0.5, 0.5)


def write_glb(plan: Plan, path: str | Path) -> Path:
    """Write a plan as an animation, a node for each muscle; returns the path.

    Lengths are in m and times in s from the start; a root node rotates the model's axes to glTF's.
    Key frames are the time steps, the trunk just after each jump of the loads, and some in between
    where blending alone would depart from the motion. Each node's `extras` have the muscle's group,
    side, segment, and activation at the root's `times`; `extras.time_steps` are the planned time
    steps. A trunk without muscles is a single mesh. Other nodes are parts of the head or obstacles,
    as `extras.solid` says; an obstacle is there in `extras.phases`. Long motions get fewer
    cross-sections, so that the file stays below about 6 MB.

    Raises
    ------
    InputError
        If the plan has no time steps, or the file cannot be written.
    """
    frames = for_blending(plan)
    trunk = plan.motion.trunk
    parts: list[Muscle | None] = list(trunk.subdomains) or [None]
    sections = sections_within(parts, len(frames.times))
    file = _File()
    keys, weights = weight_keys(frames)
    file.sampler_of(keys, weights.ravel(), "SCALAR")
    colors = group_colors(trunk)
    names = [f"{time:.6g} s" for time in frames.times[1:].tolist()]
    for i, part in enumerate(parts):
        surface = shaded(coarse_body(trunk, part, frames.shape, sections))
        name = part.name if part else trunk.name
        extras = _extras(part, frames.activation[:, i]) if part else {}
        color = colors[part.group] if part else EXTRA_COLORS[4]
        file.morphing_mesh(name, surface, color, names, extras)
    _add_solids(file, plan, keys, frames.times[weights_to_shapes(weights)])
    return write(path, file.glb(_root(plan, frames)))


def sections_within(parts: list[Muscle | None], frames: int) -> int:
    """Cross-sections of each muscle, so that all shapes take about `TARGET_BYTES`."""
    points = np.array([len(coarse_outline(part)[0]) if part else 24 for part in parts])
    per_section, caps = (points + 4).sum(), 2 * points.sum()  # four edges have two normals
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


def _add_solids(file: _File, plan: Plan, keys: np.ndarray, times: np.ndarray) -> None:
    """Add head and obstacles; the head turns at `keys` (k,) in s as it does at `times` (k,)."""
    motion = plan.motion
    phases: dict[Solid, list[str]] = {solid: [] for solid in head_solids(motion.trunk)}
    for number, phase in enumerate(motion.phases):
        for solid in obstacles(plan, number):
            phases.setdefault(solid, []).append(phase.name)
    sampler = -1
    if any(solid.frame == "head" for solid in phases):
        z, y = curves(plan, times)[:, -2:].T
        turns = np.stack(product(about_z(z), about_y(y)), axis=-1)[:, [1, 2, 3, 0]]
        sampler = file.sampler_of(keys, turns, "VEC4")
    for solid, names in phases.items():
        surface = shaded(solid_surface(solid, motion.trunk.length).body)
        extras = {"solid": solid.group} | ({"phases": names} if names else {})
        turning = (pivot(motion.trunk), sampler) if solid.frame == "head" else None
        file.still_mesh(solid.name, surface, color_of(solid), extras, turning)


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


def _linear(color: str) -> list[float]:
    """Color "#rrggbb" (sRGB) as glTF's linear RGBA."""
    parts = np.array([int(color[i : i + 2], 16) for i in (1, 3, 5)]) / 255
    linear = np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
    return [*np.round(linear, 5).tolist(), 1.0]


@dataclass
class _File:
    """A glTF file under construction: one binary buffer, and lists of its contents."""

    buffer: bytearray = field(default_factory=bytearray)
    views: list[dict[str, Any]] = field(default_factory=list)
    accessors: list[dict[str, Any]] = field(default_factory=list)
    meshes: list[dict[str, Any]] = field(default_factory=list)
    materials: list[dict[str, Any]] = field(default_factory=list)
    nodes: list[dict[str, Any]] = field(default_factory=list)
    samplers: list[dict[str, Any]] = field(default_factory=list)
    channels: list[dict[str, Any]] = field(default_factory=list)

    def store(
        self, arrays: np.ndarray, kind: str, target: int | None = None, bounds: bool = False
    ) -> list[int]:
        """Append arrays (n, count, ...) of float or int to the buffer; return their accessors."""
        integer = np.issubdtype(arrays.dtype, np.integer)
        arrays = np.ascontiguousarray(arrays, "<u4" if integer else "<f4")
        view = {"buffer": 0, "byteOffset": len(self.buffer), "byteLength": arrays.nbytes}
        if target is not None:
            view["target"] = target
        if target == VERTICES:
            view["byteStride"] = 12
        self.buffer += arrays.tobytes()
        first = len(self.accessors)
        for i, array in enumerate(arrays):
            accessor = {
                "bufferView": len(self.views),
                "byteOffset": i * array.nbytes,
                "componentType": UINT if integer else FLOAT,
                "count": len(array),
                "type": kind,
            }
            if bounds:
                rows = array.reshape(len(array), -1)
                accessor |= {"min": rows.min(axis=0).tolist(), "max": rows.max(axis=0).tolist()}
            self.accessors.append(accessor)
        self.views.append(view)
        return list(range(first, len(self.accessors)))

    def sampler_of(self, times: np.ndarray, values: np.ndarray, kind: str) -> int:
        """Store values (n, ...) of a kind at times (k,) in s; return the number of the sampler."""
        (time,) = self.store(times[None], "SCALAR", bounds=True)
        (value,) = self.store(values[None], kind)
        self.samplers.append({"input": time, "output": value, "interpolation": "LINEAR"})
        return len(self.samplers) - 1

    def morphing_mesh(
        self, name: str, surface: Surface, color: str, shapes: list[str], extras: dict[str, Any]
    ) -> None:
        """Add a node with its own morphing mesh and material."""
        base = surface.vertices[:1].astype("f4"), surface.normals[:1].astype("f4")
        position = self.store(base[0], "VEC3", VERTICES, bounds=True)
        normal = self.store(base[1], "VEC3", VERTICES)
        # Differences from the rounded base, so that the sums are right to the last digit.
        moves = self.store(surface.vertices[1:] - base[0], "VEC3", VERTICES, bounds=True)
        turns = self.store(surface.normals[1:] - base[1], "VEC3", VERTICES)
        (indices,) = self.store(surface.triangles.reshape(1, -1), "SCALAR", INDICES)
        primitive = {
            "attributes": {"POSITION": position[0], "NORMAL": normal[0]},
            "indices": indices,
            "targets": [{"POSITION": p, "NORMAL": n} for p, n in zip(moves, turns, strict=True)],
        }
        weights = {"weights": [0.0] * len(shapes), "extras": {"targetNames": shapes}}
        node = self._node(name, primitive, color, extras, weights)
        self.channels.append({"sampler": 0, "target": {"node": node, "path": "weights"}})

    def still_mesh(
        self,
        name: str,
        surface: Surface,
        color: str,
        extras: dict[str, Any],
        turning: tuple[np.ndarray, int] | None,
    ) -> None:
        """Add a node with a mesh that keeps its shape; it may turn about a point by a sampler."""
        origin = np.zeros(3) if turning is None else turning[0]
        (position,) = self.store(surface.vertices[:1] - origin, "VEC3", VERTICES, bounds=True)
        (normal,) = self.store(surface.normals[:1], "VEC3", VERTICES)
        (indices,) = self.store(surface.triangles.reshape(1, -1), "SCALAR", INDICES)
        attributes = {"POSITION": position, "NORMAL": normal}
        node = self._node(name, {"attributes": attributes, "indices": indices}, color, extras, {})
        if turning is not None:
            self.nodes[node]["translation"] = origin.tolist()
            self.channels.append(
                {"sampler": turning[1], "target": {"node": node, "path": "rotation"}}
            )

    def _node(
        self,
        name: str,
        primitive: dict[str, Any],
        color: str,
        extras: dict[str, Any],
        mesh: dict[str, Any],
    ) -> int:
        """Add a node with its own mesh and material, and return its number."""
        look = {"baseColorFactor": _linear(color), "metallicFactor": 0.0}
        primitive = primitive | {"material": len(self.materials)}
        self.materials.append(
            {"name": name, "pbrMetallicRoughness": look | {"roughnessFactor": 0.6}}
        )
        self.nodes.append({"name": name, "mesh": len(self.meshes), "extras": extras})
        self.meshes.append({"name": name, "primitives": [primitive], **mesh})
        return len(self.nodes) - 1

    def glb(self, root: dict[str, Any]) -> bytes:
        """The file: a header, then JSON and the buffer as chunks of whole words."""
        nodes = range(len(self.nodes))
        content = {
            "asset": {"version": "2.0", "generator": f"trunk_ocp {version('trunk_ocp')}"},
            "scene": 0,
            "scenes": [{"nodes": [len(nodes)]}],
            "nodes": [*self.nodes, root | {"children": list(nodes)}],
            "meshes": self.meshes,
            "materials": self.materials,
            "animations": [
                {"name": "motion", "samplers": self.samplers, "channels": self.channels}
            ],
            "accessors": self.accessors,
            "bufferViews": self.views,
            "buffers": [{"byteLength": len(self.buffer)}],
        }
        text = json.dumps(content, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        chunks = struct.pack("<I4s", len(text), b"JSON") + text
        chunks += struct.pack("<I4s", len(self.buffer), b"BIN\0") + self.buffer
        return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks

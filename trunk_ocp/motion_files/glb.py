"""A motion as one glTF file (.glb), which Blender and web viewers open.

Each muscle is a separate mesh that morphs through the shapes of the key frames. The morph targets
of glTF are differences from the first shape; the weights blend two neighbors at a time.
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
from ..planning.plan import Plan
from ..scene.colors import EXTRA_COLORS, group_colors
from ..scene.keyframes import JUMP_DURATION, Keyframes, for_blending
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

    Lengths are in m and times in s from rest; a root node rotates the model's axes to glTF's.
    Key frames are the time steps, the trunk just after each jump of the loads, and some in between
    where blending alone would depart from the motion. Each node's `extras` have the muscle's group,
    side, segment, and activation at the root's `times`; `extras.time_steps` are the planned time
    steps. A trunk without muscles is a single mesh. Long motions get fewer cross-sections, so that
    the file stays below about 6 MB.

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
    file.animate(keys, weights)
    colors = group_colors(trunk)
    names = [f"{time:.6g} s" for time in frames.times[1:].tolist()]
    for i, part in enumerate(parts):
        surface = shaded(coarse_body(trunk, part, frames.shape, sections))
        name = part.name if part else trunk.name
        extras = _extras(part, frames.activation[:, i]) if part else {}
        color = colors[part.group] if part else EXTRA_COLORS[4]
        file.morphing_mesh(name, surface, color, names, extras)
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
            "status": plan.status.value,
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
    sampler: dict[str, Any] = field(default_factory=dict)

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

    def animate(self, times: np.ndarray, weights: np.ndarray) -> None:
        """Set the weights (k, targets) that all meshes share, at times (k,) in s."""
        (time,) = self.store(times[None], "SCALAR", bounds=True)
        (value,) = self.store(weights.reshape(1, -1), "SCALAR")
        self.sampler = {"input": time, "output": value, "interpolation": "LINEAR"}

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
            "material": len(self.materials),
            "targets": [{"POSITION": p, "NORMAL": n} for p, n in zip(moves, turns, strict=True)],
        }
        look = {"baseColorFactor": _linear(color), "metallicFactor": 0.0}
        self.materials.append(
            {"name": name, "pbrMetallicRoughness": look | {"roughnessFactor": 0.6}}
        )
        self.nodes.append({"name": name, "mesh": len(self.meshes), "extras": extras})
        self.meshes.append(
            {
                "name": name,
                "primitives": [primitive],
                "weights": [0.0] * len(shapes),
                "extras": {"targetNames": shapes},
            }
        )

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
                {
                    "name": "motion",
                    "samplers": [self.sampler],
                    "channels": [
                        {"sampler": 0, "target": {"node": node, "path": "weights"}}
                        for node in nodes
                    ],
                }
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

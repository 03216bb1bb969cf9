"""A glTF file under construction: buffer, meshes, nodes and animation, whatever they show."""

from __future__ import annotations

import json
import struct
from dataclasses import dataclass, field
from importlib.metadata import version
from typing import Any

import numpy as np

from ..scene.surfaces import Surface

FLOAT, UINT = 5126, 5125
VERTICES, INDICES = 34962, 34963


def _linear(color: str) -> list[float]:
    """Color "#rrggbb" (sRGB) as glTF's linear RGB."""
    parts = np.array([int(color[i : i + 2], 16) for i in (1, 3, 5)]) / 255
    linear = np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
    return np.round(linear, 5).tolist()


@dataclass
class GlbFile:
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

    def sampler_of(
        self, times: np.ndarray, values: np.ndarray, kind: str, steps: bool = False
    ) -> int:
        """Store values (n, ...) of a kind at times (k,) in s; return the number of the sampler.

        Between times values are blended, or with `steps` hold until the next.
        """
        (time,) = self.store(times[None], "SCALAR", bounds=True)
        (value,) = self.store(values[None], kind)
        between = "STEP" if steps else "LINEAR"
        self.samplers.append({"input": time, "output": value, "interpolation": between})
        return len(self.samplers) - 1

    def animate(self, node: int, path: str, sampler: int) -> None:
        """Let a sampler drive the translation, rotation, scale or weights of a node."""
        self.channels.append({"sampler": sampler, "target": {"node": node, "path": path}})

    def morphing_node(
        self,
        name: str,
        surface: Surface,
        color: str,
        shapes: list[str],
        extras: dict[str, Any],
        opacity: float = 1.0,
    ) -> int:
        """Add a node with its own morphing mesh and material, driven by sampler 0."""
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
        mesh = self._mesh(name, primitive, self.material(name, color, opacity), weights)
        node = self.node(name, mesh, extras)
        self.animate(node, "weights", 0)
        return node

    def still_mesh(self, name: str, surface: Surface, color: str, opacity: float = 1.0) -> int:
        """Add a mesh that keeps its shape, with its own material."""
        (position,) = self.store(surface.vertices[:1], "VEC3", VERTICES, bounds=True)
        (normal,) = self.store(surface.normals[:1], "VEC3", VERTICES)
        (indices,) = self.store(surface.triangles.reshape(1, -1), "SCALAR", INDICES)
        primitive = {"attributes": {"POSITION": position, "NORMAL": normal}, "indices": indices}
        return self._mesh(name, primitive, self.material(name, color, opacity), {})

    def node(self, name: str, mesh: int, extras: dict[str, Any], **placed: list[float]) -> int:
        """Add a node that shows a mesh, perhaps `placed` by translation, rotation or scale."""
        self.nodes.append({"name": name, "mesh": mesh, "extras": extras, **placed})
        return len(self.nodes) - 1

    def material(self, name: str, color: str, opacity: float) -> int:
        """Add a material."""
        look = {"baseColorFactor": [*_linear(color), opacity], "metallicFactor": 0.0}
        material = {"name": name, "pbrMetallicRoughness": look | {"roughnessFactor": 0.6}}
        self.materials.append(material | ({"alphaMode": "BLEND"} if opacity < 1 else {}))
        return len(self.materials) - 1

    def _mesh(
        self, name: str, primitive: dict[str, Any], material: int, extra: dict[str, Any]
    ) -> int:
        primitive = primitive | {"material": material}
        self.meshes.append({"name": name, "primitives": [primitive], **extra})
        return len(self.meshes) - 1

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

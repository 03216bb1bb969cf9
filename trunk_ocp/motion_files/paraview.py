"""Muscles and centerline as VTK files, one for each time step, with .pvd files that list them.

Coordinates are the model's: X forward, Y to the right, Z down, in m.
"""

from __future__ import annotations

import base64
import zlib
from dataclasses import dataclass, field
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

from .._support.atomic_files import write
from ..model.anatomy import Trunk
from ..model.loads import vector
from ..planning.plan import Plan
from ..problem.step_solids import log_solid
from ..rod.shape import Shape
from ..scene.body import Body, muscle_body, trunk_body
from ..scene.keyframes import Keyframes, at_steps
from ..scene.moments import curves
from ..scene.solid_meshes import head_and_obstacles, placed
from ..scene.surroundings import logs

LINE_PIECES = 40  # of the centerline, in each segment
GROUPS = {"head": 0, "log": 1, "obstacles": 2}
VTK_TYPES = {"f4": "Float32", "f8": "Float64", "i4": "Int32"}


def write_vtk(plan: Plan, folder: str | Path) -> tuple[Path, ...]:
    """Write `muscles.pvd` and `centerline.pvd`, which ParaView opens, and the files they list.

    Where there is a head, a log or an obstacle, also `surroundings.pvd`.

    There is a file for each time step, and another one millisecond after each jump of the loads.

    The triangles of all muscles are cells with the arrays `muscle` (index in an activation vector;
    the field array `muscle_names` has the names), `activation`, `segment` (1 is at the base) and
    `side` (1 right, -1 left). A trunk without muscles is one surface with muscle -1. The centerline
    has `Z` in m and `moment` in N m, in the directors, at its points, and `extension`, |dr/dZ|, at
    the middle of each piece; the ends of segments are points. The triangles of the surroundings
    are cells with the array `group`: 0 head, 1 log, 2 obstacles.

    Raises
    ------
    InputError
        If the plan has no time steps, or a file cannot be written.
    """
    folder = Path(folder)
    frames = at_steps(plan)
    trunk = plan.motion.trunk
    contents = {
        "muscles": _muscle_files(trunk, frames),
        "centerline": _line_files(trunk, frames),
        "surroundings": _surrounding_files(plan, frames.times),
    }
    collections = []
    for name, files in contents.items():
        paths = [folder / f"{name}_{i:04d}.vtp" for i in range(len(files))]
        for path, content in zip(paths, files, strict=True):
            write(path, content)
        if paths:  # last, so that a collection never lists a file that does not exist yet
            collections.append(write(folder / f"{name}.pvd", _collection(frames.times, paths)))
    return tuple(collections)


def _muscle_files(trunk: Trunk, frames: Keyframes) -> list[bytes]:
    bodies, labels = _bodies(trunk, frames.shape)
    counts = [len(body.triangles) for body in bodies]
    starts = np.cumsum([0, *(body.vertices.shape[1] for body in bodies[:-1])])
    cells = np.concatenate([b.triangles + s for b, s in zip(bodies, starts, strict=True)])
    muscle, segment, side = np.repeat(np.array(labels, dtype="i4"), counts, axis=0).T
    points = np.concatenate([body.vertices for body in bodies], axis=1)
    known = np.concatenate([frames.activation, np.zeros((len(frames.times), 1))], axis=1)
    constant = {"muscle": muscle, "segment": segment, "side": side}
    return [
        PolyData(
            points[i],
            "Polys",
            cells,
            {"activation": known[i, muscle], **constant},  # muscle -1 takes the last, a zero
            names=trunk.muscles,
            time=time,
        ).xml()
        for i, time in enumerate(frames.times.tolist())
    ]


def _bodies(trunk: Trunk, shape: Shape) -> tuple[list[Body], list[tuple[int, int, int]]]:
    """Bodies of all muscles, and (muscle, segment, side) of each."""
    if not trunk.subdomains:
        return [trunk_body(trunk, shape)], [(-1, 0, 0)]
    bodies = [muscle_body(trunk, muscle, shape) for muscle in trunk.subdomains]
    labels = [
        (i, muscle.segment + 1, 1 if muscle.side == "R" else -1)
        for i, muscle in enumerate(trunk.subdomains)
    ]
    return bodies, labels


def _line_files(trunk: Trunk, frames: Keyframes) -> list[bytes]:
    ends = zip(trunk.edges[:-1], trunk.edges[1:], strict=True)
    Z = np.unique(np.concatenate([np.linspace(a, b, LINE_PIECES + 1) for a, b in ends]))
    cells = np.stack([np.arange(len(Z) - 1), np.arange(1, len(Z))], axis=-1)
    points, moment = frames.shape.position(Z), frames.shape.moment(Z)
    extension, _ = frames.shape.strain((Z[:-1] + Z[1:]) / 2)
    return [
        PolyData(
            points[i],
            "Lines",
            cells,
            {"extension": extension[i]},
            {"Z": Z, "moment": moment[i]},
            time=time,
        ).xml()
        for i, time in enumerate(frames.times.tolist())
    ]


def _surrounding_files(plan: Plan, times: np.ndarray) -> list[bytes]:
    """Head, logs and obstacles at times in s; no file if there are none."""
    heads = curves(plan, times)[:, -2:]
    scenes = [_surroundings(plan, *at) for at in zip(times.tolist(), heads, strict=True)]
    if not any(scenes):
        return []
    return [_solid_file(scene, time) for scene, time in zip(scenes, times.tolist(), strict=True)]


def _surroundings(plan: Plan, time: float, head: np.ndarray) -> list[tuple[int, Body]]:
    """Group and surface of each solid at a time in s and head angles (2,) in rad."""
    solids = head_and_obstacles(plan, time, head)
    for log in logs(plan):
        solid = log_solid(vector(log.center(plan, time)), log.radius, log.length)
        solids.append((solid, placed(plan.motion.trunk, solid, head)))
    return [(GROUPS[solid.group], surface.body) for solid, surface in solids]


def _solid_file(scene: list[tuple[int, Body]], time: float) -> bytes:
    starts = np.cumsum([0, *(body.vertices.shape[1] for _, body in scene)])
    cells = [body.triangles + start for (_, body), start in zip(scene, starts, strict=False)]
    groups = [np.full(len(body.triangles), group) for group, body in scene]
    return PolyData(
        np.concatenate([np.zeros((0, 3)), *(body.vertices[0] for _, body in scene)]),
        "Polys",
        np.concatenate([np.zeros((0, 3), dtype=int), *cells]),
        {"group": np.concatenate([np.zeros(0), *groups]).astype("i4")},
        time=time,
    ).xml()


@dataclass(frozen=True, eq=False)
class PolyData:
    """A VTK surface or line, to be written as XML (.vtp).

    points (v, 3); cells (c, k) of one kind, "Polys" or "Lines"; arrays on cells (c, ...) and on
    points (v, ...); time in s.
    """

    points: np.ndarray
    kind: str
    cells: np.ndarray
    cell_data: dict[str, np.ndarray]
    point_data: dict[str, np.ndarray] = field(default_factory=dict)
    names: tuple[str, ...] = ()
    time: float = 0.0

    def xml(self) -> bytes:
        """Contents of the file."""
        count, corners = self.cells.shape
        offsets = np.arange(1, count + 1, dtype="i4") * corners
        lines = [
            '<?xml version="1.0"?>',
            '<VTKFile type="PolyData" version="1.0" byte_order="LittleEndian" '
            'header_type="UInt32" compressor="vtkZLibDataCompressor">',
            "<PolyData><FieldData>",
            _array("TimeValue", np.array([self.time]), "NumberOfTuples"),
            *_names(self.names),
            "</FieldData>",
            f'<Piece NumberOfPoints="{len(self.points)}" NumberOf{self.kind}="{count}"><Points>',
            _array("Points", self.points.astype("f4")),
            f"</Points><{self.kind}>",
            _array("connectivity", self.cells.astype("i4").ravel()),
            _array("offsets", offsets),
            f"</{self.kind}><CellData>",
            *(_array(*item) for item in self.cell_data.items()),
            "</CellData><PointData>",
            *(_array(*item) for item in self.point_data.items()),
            "</PointData></Piece></PolyData></VTKFile>",
        ]
        return ("\n".join(lines) + "\n").encode()


def _array(name: str, values: np.ndarray, count: str = "") -> str:
    """A `DataArray` (n, ...): base64 of a header (blocks, size, last size, packed size) and data.

    count : name of the attribute with the number of values, which field data need.
    """
    values = np.ascontiguousarray(values)
    kind = VTK_TYPES[values.dtype.str[1:]]
    raw = values.astype(values.dtype.newbyteorder("<")).tobytes()
    packed = zlib.compress(raw, 6)
    header = np.array([1, len(raw), 0, len(packed)], dtype="<u4").tobytes()
    code = (base64.b64encode(header) + base64.b64encode(packed)).decode()
    components = values.shape[1] if values.ndim > 1 else 1
    length = f' {count}="{len(values)}"' if count else ""
    return (
        f'<DataArray type="{kind}" Name="{name}" NumberOfComponents="{components}"{length} '
        f'format="binary">{code}</DataArray>'
    )


def _names(names: tuple[str, ...]) -> list[str]:
    """Names of the muscles in VTK's format for text: character codes, a zero after each name."""
    if not names:
        return []
    codes = " ".join(str(code) for name in names for code in (*name.encode(), 0))
    head = f'<Array type="String" Name="muscle_names" NumberOfTuples="{len(names)}" format="ascii">'
    return [f"{head}{codes}</Array>"]


def _collection(times: np.ndarray, paths: list[Path]) -> bytes:
    """A .pvd file, which gives ParaView the time of each file."""
    entries = [
        f'<DataSet timestep="{time!r}" part="0" file={quoteattr(path.name)}/>'
        for time, path in zip(times.tolist(), paths, strict=True)
    ]
    lines = [
        '<?xml version="1.0"?>',
        '<VTKFile type="Collection" version="0.1" byte_order="LittleEndian">',
        "<Collection>",
        *entries,
        "</Collection></VTKFile>",
    ]
    return ("\n".join(lines) + "\n").encode()

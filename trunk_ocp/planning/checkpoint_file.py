"""Reading what an unfinished run left: known keys, known types, bounded sizes, nothing else.

The file is a zip archive of three flat arrays as `numpy.savez` writes it, uncompressed: two texts
in JSON, and every number of the stages one after the other.
"""

from __future__ import annotations

import contextlib
import io
import math
import struct
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from .._support.toml_files import MAX_JSON, MAX_PARTS, parts_of, printable, read_bytes
from ..errors import InputError
from ..nlp.ipopt import Solve
from ..problem.motion import Motion
from ..problem.targets import HeldDirection
from ..rod.collocation import Mesh
from ..rod.equations import STATES
from .plan import MODES
from .records import MOST_TEXT as MOST_RECORDS
from .records import amount, check_near, count, entries, flag, json_of, number, solve_of, table
from .state import REFINEMENTS, Options, State, first_mesh

COUNTERS = ("iterations", "setup_seconds", "solve_seconds", "derivative_seconds")
MEMBERS = ("identity", "progress", "values")
MOST_TEXT = 2 * MAX_JSON + MOST_RECORDS
"""Bytes of all but the numbers: problem and anatomy, and records."""
MOST_STAGES = REFINEMENTS + 2  # the sequential plan, the plan, and once more for each refinement
END = struct.Struct("<4s4H2LH")  # of a zip archive without a comment
LONGEST_REASON = 300  # characters


@dataclass(eq=False)
class Stage:
    """A pass as far as it has come: how it was made, what it has decided, what it has cost.

    previous : (H, muscles + 2), unknowns of the last window; None before the first.
    failed : the solves that did not converge; records of the others are not kept.
    """

    mode: str
    mesh: Mesh
    state: State
    previous: np.ndarray | None
    counters: dict[str, float]
    failed: list[Solve] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class Unfinished:
    """What a file has: what its plan depends on, as it says, and what is not looked at yet."""

    path: Path
    identity: dict[str, Any]
    progress: dict[str, Any]
    values: np.ndarray

    def stages(self, motion: Motion) -> tuple[float, list[Stage]]:
        """Seconds spent and stages of a plan of this motion.

        Raises
        ------
        InputError
            If they are not of such a plan.
        """
        with _reading(self.path):
            seconds = amount(self.progress["seconds"])
            return seconds, _stages(self.progress, self.values, motion)


def read_unfinished(path: Path, motion: Motion, options: Options) -> Unfinished:
    """Read a file that is to be of a plan of this motion, which its identity tells.

    Raises
    ------
    InputError
        If it is damaged, or larger than that of such a plan.
    """
    content = read_bytes(path, _most(motion, options))
    with _reading(path):
        identity, progress, values = _members(content)
        if parts_of(_text(identity)) > 2 * MAX_PARTS + 1000:  # problem, anatomy, and little else
            raise InputError("its problem or anatomy is too large")
        depends, told = (table(json_of(_text(part))) for part in (identity, progress))
        return Unfinished(path, depends, told, values)


@contextlib.contextmanager
def _reading(path: Path) -> Iterator[None]:
    """Any error within is the file's: damaged ones break their readers in ways of their own."""
    try:
        yield
    except Exception as error:
        reason = printable(f"{error}")[:LONGEST_REASON]
        raise InputError(
            f"{path}: cannot be read as an unfinished run ({reason}); run without --resume to "
            "start anew."
        ) from None


def _most(motion: Motion, options: Options) -> int:
    """Bytes that the file of a plan may have: every stage whole, each mesh twice the last."""
    mesh, unknowns = first_mesh(motion, options), len(motion.trunk.muscles) + 2
    states = mesh.elements * (mesh.degree + 1) * STATES * 2 ** (REFINEMENTS + 2)
    step = MOST_STAGES * (4 * unknowns + 3 + 3 * len(motion.held)) + states
    return MOST_TEXT + 8 * step * len(motion.steps)


def _members(content: bytes) -> list[np.ndarray]:
    """The three arrays of an archive; nothing in it is larger than it is itself."""
    mark, _, _, here, every, directory, _, comment = END.unpack(content[-END.size :])
    if (mark, here, every, comment) != (b"PK\x05\x06", 3, 3, 0) or directory > 1000:
        raise InputError("expected an archive of three arrays")
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        if sorted(archive.namelist()) != [f"{name}.npy" for name in MEMBERS]:
            raise InputError(f"expected {', '.join(MEMBERS)}")
        for member in archive.infolist():
            size = member.file_size
            if member.compress_type != zipfile.ZIP_STORED or size > len(content):
                raise InputError("expected an archive without compression")
        return [
            _array(archive.read(f"{name}.npy"), "<f8" if name == "values" else "|u1")
            for name in MEMBERS
        ]


def _array(content: bytes, kind: str) -> np.ndarray:
    """A flat array of a type, from the bytes of a .npy file that must have just its size."""
    stream = io.BytesIO(content)
    if np.lib.format.read_magic(stream) != (1, 0):
        raise InputError("expected arrays of the first .npy format")
    shape, _, dtype = np.lib.format.read_array_header_1_0(stream)
    start = stream.tell()
    if dtype.str != kind or shape != ((len(content) - start) // dtype.itemsize,):
        raise InputError(f"expected a flat array of {kind}")
    return np.frombuffer(content, dtype, offset=start)


def _text(values: np.ndarray) -> str:
    return values.tobytes().decode("utf-8")


def _stages(told: dict[str, Any], values: np.ndarray, motion: Motion) -> list[Stage]:
    records = entries(told["stages"])
    if len(records) > MOST_STAGES or not np.all(np.isfinite(values)):
        raise InputError("expected finite numbers of a few stages")
    stages = []
    for record in records:
        stage, values = _stage(table(record), values, motion)
        stages.append(stage)
    if values.size:
        raise InputError("expected no more numbers than its stages have")
    return stages


def _stage(told: dict[str, Any], values: np.ndarray, motion: Motion) -> tuple[Stage, np.ndarray]:
    """A stage, whose arrays are the first of the values, and the other values."""
    arrays, values = _arrays(told, values)
    mesh_of = table(told["mesh"])
    mesh = Mesh(tuple(number(Z) for Z in entries(mesh_of["edges"])), count(mesh_of["degree"], 1))
    held = [_held(entry) for entry in entries(told["held"])]
    near = [count(step) for step in entries(told["near"])]
    rows = {name: list(array) for name, array in arrays.items()}
    state = State(
        x=rows["x"],
        tip_forces=rows["tip_forces"],
        states=rows["states"],
        held=dict(zip(held, rows.get("held", []), strict=True)),
        auxiliary=arrays.get("auxiliary"),
        near=dict(zip(near, rows.get("near", []), strict=True)),
        converged=flag(told["converged"]),
    )
    if told["mode"] not in MODES:
        raise InputError("mode: expected that of a plan")
    _check(state, arrays, mesh, str(told["mode"]), motion)
    counters = table(told["counters"])
    if set(counters) != set(COUNTERS):
        raise InputError(f"counters: expected {', '.join(COUNTERS)}")
    return (
        Stage(
            str(told["mode"]),
            mesh,
            state,
            arrays.get("previous"),
            {
                name: count(value) if name == "iterations" else amount(value)
                for name, value in counters.items()
            },
            [solve_of(record) for record in entries(told["failed"])],
        ),
        values,
    )


def _arrays(told: dict[str, Any], values: np.ndarray) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """The arrays of a stage by name, and the values after them."""
    arrays = {}
    for name, sizes in table(told["shapes"]).items():
        shape = [count(size, 1) for size in entries(sizes)]
        size = math.prod(shape)
        if size > values.size:
            raise InputError("expected as many numbers as its stages have")
        arrays[name] = values[:size].reshape(shape)
        values = values[size:]
    return arrays, values


def _held(value: Any) -> HeldDirection:
    step, Z, director = entries(value)
    return HeldDirection(count(step), number(Z), count(director))


def _check(
    state: State, arrays: dict[str, np.ndarray], mesh: Mesh, mode: str, motion: Motion
) -> None:
    """Raise InputError unless a stage fits its motion."""
    steps, unknowns = len(state.x), len(motion.trunk.muscles) + 2
    expected: dict[str, tuple[int, ...]] = {
        "x": (steps, unknowns),
        "tip_forces": (steps, 3),
        "states": (steps, mesh.elements, mesh.degree + 1, STATES),
        "held": (len(state.held), 3),
        "near": (len(state.near), unknowns),
        "auxiliary": (unknowns,),
    }
    if "previous" in arrays:
        expected["previous"] = (len(arrays["previous"]), unknowns)
    for name, array in arrays.items():
        if array.shape != expected.get(name):
            raise InputError(f"{name}: expected an array of the motion's size")
    asked = {
        t for t, step in enumerate(motion.steps[:steps]) if mode == "sequential" and step.follows
    }
    held = {held for held in motion.held if held.step < steps}
    if steps > len(motion.steps) or set(state.near) != asked or set(state.held) != held:
        raise InputError("expected time steps of the motion and what they refer to")
    if state.converged:
        check_near(motion, np.array(state.x), state.near)

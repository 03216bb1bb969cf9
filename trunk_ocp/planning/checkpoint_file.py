"""Reading the file of an unfinished run, which is untrusted: known keys, types and sizes only.

The file is an uncompressed zip archive of three flat arrays, as `numpy.savez` writes it: two texts
in JSON, and the concatenated numbers of all stages.
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
from ..nlp.outcome import Solve
from ..problem.motion import Motion
from ..problem.targets import HeldDirection
from ..rod.collocation import Mesh
from ..rod.equations import STATES
from .decided_steps import DecidedSteps
from .options import REFINEMENTS, Options, first_mesh
from .plan import MODES
from .records import MAX_TEXT as MAX_RECORDS
from .records import amount, check_auxiliary, count, entries, flag, json_of, number, solve_of, table

COUNTERS = ("iterations", "setup_seconds", "solve_seconds", "derivative_seconds")
MEMBERS = ("identity", "progress", "values")
MAX_TEXT = 2 * MAX_JSON + MAX_RECORDS
"""Bytes of problem, anatomy and records, that is, of all but the numbers."""
MAX_STAGES = REFINEMENTS + 2  # the sequential plan, the plan, and one for each refinement
END = struct.Struct("<4s4H2LH")  # of a zip archive without a comment
MAX_REASON_LENGTH = 300  # characters


@dataclass(eq=False)
class Stage:
    """One planning run so far: its mesh, the decided steps and their cost.

    Attributes
    ----------
    previous : (H, muscles + 2)
        Controls of the last window; None before the first.
    failed : list of Solve
        The solves that did not converge; records of the others are not kept.
    """

    mode: str
    mesh: Mesh
    state: DecidedSteps
    previous: np.ndarray | None
    counters: dict[str, float]
    failed: list[Solve] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class Unfinished:
    """Content of a file: the identity of its plan, and stages that are not validated yet."""

    path: Path
    identity: dict[str, Any]
    progress: dict[str, Any]
    values: np.ndarray

    def stages(self, motion: Motion) -> tuple[float, list[Stage]]:
        """Seconds spent and stages of a plan of this motion.

        Raises
        ------
        InputError
            If they do not fit the motion.
        """
        with _reading(self.path):
            seconds = amount(self.progress["seconds"])
            return seconds, _stages(self.progress, self.values, motion)


def read_unfinished(path: Path, motion: Motion, options: Options) -> Unfinished:
    """Read the file of an unfinished run of this motion; the caller checks its identity.

    Raises
    ------
    InputError
        If it is damaged, or larger than the file of such a plan can be.
    """
    content = read_bytes(path, _largest_size(motion, options))
    with _reading(path):
        identity, progress, values = _members(content)
        if parts_of(_text(identity)) > 2 * MAX_PARTS + 1000:  # problem, anatomy, and little else
            raise InputError("its problem or anatomy is too large")
        identity_table, progress_table = (
            table(json_of(_text(text))) for text in (identity, progress)
        )
        return Unfinished(path, identity_table, progress_table, values)


@contextlib.contextmanager
def _reading(path: Path) -> Iterator[None]:
    """Turn any error within into an InputError: damaged files break readers in many ways."""
    try:
        yield
    except Exception as error:
        reason = printable(f"{error}")[:MAX_REASON_LENGTH]
        raise InputError(
            f"{path}: cannot be read as an unfinished run ({reason}); run without --resume to "
            "start again."
        ) from None


def _largest_size(motion: Motion, options: Options) -> int:
    """Largest size in bytes of a plan's file: all stages complete, each mesh twice the last."""
    mesh, unknowns = first_mesh(motion, options), len(motion.trunk.muscles) + 2
    states = mesh.elements * (mesh.degree + 1) * STATES * 2 ** (REFINEMENTS + 2)
    step = MAX_STAGES * (4 * unknowns + 3 + 3 * len(motion.held)) + states
    return MAX_TEXT + 8 * step * len(motion.steps)


def _members(content: bytes) -> list[np.ndarray]:
    """The three arrays of an archive, none of which is larger than the archive."""
    mark, _, _, here, total, directory, _, comment = END.unpack(content[-END.size :])
    if (mark, here, total, comment) != (b"PK\x05\x06", 3, 3, 0) or directory > 1000:
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
    """A flat array of a type, from the bytes of a .npy file of exactly that size."""
    stream = io.BytesIO(content)
    if np.lib.format.read_magic(stream) != (1, 0):
        raise InputError("expected arrays of .npy format 1.0")
    shape, _, dtype = np.lib.format.read_array_header_1_0(stream)
    start = stream.tell()
    if dtype.str != kind or shape != ((len(content) - start) // dtype.itemsize,):
        raise InputError(f"expected a flat array of {kind}")
    return np.frombuffer(content, dtype, offset=start)


def _text(values: np.ndarray) -> str:
    return values.tobytes().decode("utf-8")


def _stages(progress: dict[str, Any], values: np.ndarray, motion: Motion) -> list[Stage]:
    records = entries(progress["stages"])
    if len(records) > MAX_STAGES or not np.all(np.isfinite(values)):
        raise InputError("expected finite numbers of a few stages")
    stages = []
    for record in records:
        stage, values = _stage(table(record), values, motion)
        stages.append(stage)
    if values.size:
        raise InputError("expected no more numbers than its stages have")
    return stages


def _stage(record: dict[str, Any], values: np.ndarray, motion: Motion) -> tuple[Stage, np.ndarray]:
    """A stage, whose arrays come first among the values, and the remaining values."""
    arrays, values = _arrays(record, values)
    mesh_of = table(record["mesh"])
    mesh = Mesh(tuple(number(Z) for Z in entries(mesh_of["edges"])), count(mesh_of["degree"], 1))
    held = [_held(entry) for entry in entries(record["held"])]
    auxiliary = [count(step) for step in entries(record["near"])]
    rows = {name: list(array) for name, array in arrays.items()}
    state = DecidedSteps(
        x=rows["x"],
        tip_forces=rows["tip_forces"],
        states=rows["states"],
        held=dict(zip(held, rows.get("held", []), strict=True)),
        unloaded=arrays.get("auxiliary"),
        auxiliary=dict(zip(auxiliary, rows.get("near", []), strict=True)),
        converged=flag(record["converged"]),
    )
    if record["mode"] not in MODES:
        raise InputError("mode: expected that of a plan")
    _check(state, arrays, mesh, str(record["mode"]), motion)
    counters = table(record["counters"])
    if set(counters) != set(COUNTERS):
        raise InputError(f"counters: expected {', '.join(COUNTERS)}")
    return (
        Stage(
            str(record["mode"]),
            mesh,
            state,
            arrays.get("previous"),
            {
                name: count(value) if name == "iterations" else amount(value)
                for name, value in counters.items()
            },
            [solve_of(record) for record in entries(record["failed"])],
        ),
        values,
    )


def _arrays(record: dict[str, Any], values: np.ndarray) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Arrays of a stage by name, and the remaining values."""
    arrays = {}
    for name, sizes in table(record["shapes"]).items():
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
    state: DecidedSteps, arrays: dict[str, np.ndarray], mesh: Mesh, mode: str, motion: Motion
) -> None:
    """Raise InputError unless a stage fits its motion."""
    steps, unknowns = len(state.x), len(motion.trunk.muscles) + 2
    expected: dict[str, tuple[int, ...]] = {
        "x": (steps, unknowns),
        "tip_forces": (steps, 3),
        "states": (steps, mesh.elements, mesh.degree + 1, STATES),
        "held": (len(state.held), 3),
        "near": (len(state.auxiliary), unknowns),
        "auxiliary": (unknowns,),
    }
    if "previous" in arrays:
        expected["previous"] = (len(arrays["previous"]), unknowns)
    for name, array in arrays.items():
        if array.shape != expected.get(name):
            raise InputError(f"{name}: expected an array of the motion's size")
    following = {
        t for t, step in enumerate(motion.steps[:steps]) if mode == "sequential" and step.follows
    }
    held = {held for held in motion.held if held.step < steps}
    known = set(state.auxiliary) in (following, following & {0})  # the latter to start a horizon
    if steps > len(motion.steps) or not known or set(state.held) != held:
        raise InputError(
            "expected the motion's time steps, held directions and auxiliary solutions"
        )
    if state.converged:
        check_auxiliary(motion, state.auxiliary)

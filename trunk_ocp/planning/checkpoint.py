"""Going on with a plan that was cut off: what was decided so far, on disk after every window.

What the next window finds depends on the decided steps, the solution of the window before and the
plan that a horizon starts from, and on nothing else. So a plan that is resumed has the same
bits as one that never stopped.
"""

from __future__ import annotations

import io
import json
import os
import time
from collections.abc import Iterator, Mapping
from dataclasses import asdict
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from .._support.arguments import check_arguments
from .._support.atomic_files import write
from .._support.provenance import fingerprint, plain, versions
from ..errors import InputError
from ..nlp.ipopt import Optimizer
from ..problem.motion import Motion
from ..rod.collocation import Mesh
from .checkpoint_file import COUNTERS, Stage, read_unfinished
from .plan import Plan
from .records import fits
from .state import Options, State

FILE = "resume.npz"
WORTH_LASTING = 1.0  # s of work worth waiting for a disk, in case of a power cut
SHOWN = 3  # changes told one by one
LONGEST_KEY = 100  # characters


class Checkpoint:
    """A file from which a plan is resumed if its process ends before it does.

    Written whole after every window by `plan_motion`; remove it when the plan is saved. At every
    moment the file is there, or its successor is beside it.

    Parameters
    ----------
    path : str or Path
        The file, such as `results/lift-log/horizon/resume.npz`.
    resume : bool
        Go on from what the file has; otherwise start anew and replace it.

    Attributes
    ----------
    seconds : float
        Wall time that the plan had taken before this process.
    """

    @check_arguments
    def __init__(self, path: str | Path, resume: bool = False) -> None:
        self.path, self.resume = Path(path), resume
        if not self.path.name:
            raise InputError(f"path = {path!r}: expected the name of a file.")
        self.seconds = 0.0
        self._newer = self.path.with_name(f"{self.path.stem}-newer{self.path.suffix}")
        self._began = self._saved = time.perf_counter()
        self._identity_json = b""
        self._found: list[Stage] = []
        self._stages: list[Stage] = []
        self._failed = False

    @property
    def exists(self) -> bool:
        """Whether there is something to resume."""
        return self._newer.exists() or self.path.exists()

    def files(self) -> list[Path]:
        """What an unfinished run left, other than what a power cut emptied.

        Raises
        ------
        InputError
            If what has the name of such a file is something else.
        """
        return [path for path in self._own_files() if not _is_empty(path)]

    def open(
        self, motion: Motion, mode: str, lookahead: int, options: Options, start: Plan | None
    ) -> None:
        """Begin a plan, from what the file has if it is to be resumed.

        Raises
        ------
        InputError
            If there is nothing to resume, or if it is not of this very plan; names what changed.
        """
        self._began = time.perf_counter()
        identity = _identity(motion, mode, lookahead, options, start)
        self._identity_json = json.dumps(identity).encode()
        self._found, self._stages = [], []
        if not self.resume:
            self.remove()
            return
        if not self.exists:
            raise InputError(
                f"{self.path}: there is nothing to resume; expected an unfinished run here. Run "
                "without --resume to start anew."
            )
        newest = self._newer if self._newer.exists() else self.path
        found = read_unfinished(newest, motion, options)
        self._own_files()  # the other one as well, which `save` replaces
        name = _name(found.identity)
        if name != motion.name:
            raise InputError(
                f"{self.path}: is an unfinished run of {name}; expected one of {motion.name}. "
                f"Resume it with that problem, or name another folder with --out."
            )
        changes = _changes(found.identity, identity)
        if changes:
            raise InputError(
                f"{self.path}: cannot be resumed, because {' and '.join(changes)}; expected the "
                "same problem, anatomy, options and versions. Undo the change, or run without "
                "--resume to start anew."
            )
        self.seconds, self._found = found.stages(motion)

    def enter(
        self, mode: str, mesh: Mesh, window: int, optimizer: Optimizer
    ) -> tuple[State, np.ndarray | None]:
        """What the next pass has decided already, and the unknowns of its last window.

        Parameters
        ----------
        window : int
            Time steps of its windows.

        Raises
        ------
        InputError
            If the file has another pass in its place.
        """
        number = len(self._stages)
        stage = Stage(mode, mesh, State(), None, {})
        if number < len(self._found):
            stage = self._found[number]
            ahead = window if stage.previous is None else len(stage.previous)
            if (stage.mode, stage.mesh, ahead) != (mode, mesh, window):
                raise InputError(
                    f"{self.path}: has other passes than this plan; expected those of an "
                    "unfinished run of it. Run without --resume to start anew."
                )
            for name in COUNTERS:
                setattr(optimizer, name, stage.counters.get(name, 0))
            optimizer.solves[:] = stage.failed
        self._stages.append(stage)
        return stage.state, stage.previous

    def save(self, optimizer: Optimizer, previous: np.ndarray) -> None:
        """Write what has been decided; if the disk is full, say so once and go on without."""
        stage = self._stages[-1]
        stage.previous = previous
        stage.counters = {name: getattr(optimizer, name) for name in COUNTERS}
        stage.failed = [solve for solve in optimizer.solves if not solve.converged]
        progress: dict[str, Any] = {
            "seconds": self.seconds + time.perf_counter() - self._began,
            "stages": [_described(stage) for stage in self._stages],
        }
        text = json.dumps(progress)
        if not fits(text):  # thousands of iterations that failed
            for told in progress["stages"]:
                told["failed"] = [solve | {"history": ()} for solve in told["failed"]]
            text = json.dumps(progress)
        # Few members and one array: each costs time, and this is written after every window.
        values = [array.ravel() for stage in self._stages for array in _arrays(stage).values()]
        content = io.BytesIO()
        np.savez(
            content,
            identity=np.frombuffer(self._identity_json, np.uint8),
            progress=np.frombuffer(text.encode(), np.uint8),
            values=np.concatenate(values),
        )
        now = time.perf_counter()
        lasting, self._saved = now - self._saved > WORTH_LASTING, now
        try:
            write(self._newer, content.getvalue(), lasting)
            # Not by replacing, for which a file system may wait for its disk.
            self.path.unlink(missing_ok=True)
            self._newer.rename(self.path)
        except (InputError, OSError) as error:
            if not self._failed:
                optimizer.reporter.note(f"Going on, but this could not be resumed: {error}")
            self._failed = True

    def remove(self) -> None:
        """Remove the file: the plan is saved.

        Raises
        ------
        InputError
            If what has its name is something else.
        """
        for path in self._own_files():
            path.unlink(missing_ok=True)

    def _own_files(self) -> list[Path]:
        """The file and its successor, as far as they are there; InputError for what is no such."""
        folder = self.path.parent
        if folder.exists() and not folder.is_dir():
            raise InputError(
                f"{folder}: is a file where results would go; move it away, or name another "
                "folder with --out."
            )
        there = [path for path in (self._newer, self.path) if os.path.lexists(path)]
        for path in there:
            if not _is_ours(path):
                raise InputError(
                    f"{path}: is not a file of an unfinished run, which would be replaced; move it "
                    "away, or name another folder with --out."
                )
        return there


def _is_ours(path: Path) -> bool:
    """Whether a file begins as one of ours, or has nothing in it, as a power cut may leave it."""
    if path.is_symlink() or not path.is_file():
        return False
    head = _head(path)
    return _is_empty(path) or (head.startswith(b"PK\3\4") and b"identity.npy" in head)


def _is_empty(path: Path) -> bool:
    return not _head(path).strip(b"\0")


def _head(path: Path) -> bytes:
    with path.open("rb") as stream:
        return stream.read(100)


def _identity(
    motion: Motion, mode: str, lookahead: int, options: Options, start: Plan | None
) -> dict[str, Any]:
    """What a plan depends on, as JSON has it."""
    begun = None if start is None else fingerprint([start.x, start.shape.states, start.mesh])
    return {
        "problem": plain(motion.spec),
        "anatomy": plain(motion.anatomy),
        "problem_sha256": fingerprint(motion.spec),
        "anatomy_sha256": fingerprint(motion.anatomy),
        "options": asdict(options) | {"mode": mode, "lookahead": lookahead},
        "versions": {name: told for name, told in versions().items() if name != "platform"},
        "steps": fingerprint(motion.steps),
        "start": begun,
    }


def _name(identity: dict[str, Any]) -> str:
    """Name of the problem of a run, as its file says."""
    problem = identity.get("problem")
    return str(problem.get("name") if isinstance(problem, dict) else None)[:LONGEST_KEY]


def _changes(old: dict[str, Any], new: dict[str, Any]) -> list[str]:
    """What differs between two identities, a clause each; empty if nothing does."""
    named = {
        "problem": "the problem",
        "anatomy": "the anatomy",
        "versions": "the version",
        "options": "the options",
    }
    clauses = []
    for part, name in named.items():
        if f"{part}_sha256" in new and old.get(f"{part}_sha256") == new[f"{part}_sha256"]:
            continue
        # No more than are shown: a file from anywhere may have any number of them.
        differences = list(islice(_differences(old.get(part), new[part]), SHOWN + 1))
        if differences:
            told = [*differences[:SHOWN], *(["and more"] if len(differences) > SHOWN else [])]
            clauses.append(f"{name} changed ({', '.join(told)})")
    if not clauses and old.get("steps") != new["steps"]:
        clauses.append("the time steps changed")
    if not clauses and old.get("start") != new["start"]:
        clauses.append("the plan that it starts from changed")
    return clauses


def _differences(old: Any, new: Any, key: str = "") -> Iterator[str]:
    """`key: old -> new` for every entry that differs, entries of lists counted from one."""
    if isinstance(old, Mapping) and isinstance(new, Mapping):
        for name in sorted({*old, *new}):
            yield from _differences(old.get(name), new.get(name), f"{key}.{name}".lstrip("."))
    elif isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        for number, pair in enumerate(zip(old, new, strict=True), 1):
            yield from _differences(*pair, f"{key}[{number}]")
    elif old != new:
        yield f"{key[:LONGEST_KEY]}: {_short(old)} -> {_short(new)}"


def _short(value: Any) -> str:
    if isinstance(value, list | dict) and len(value) > 10:
        return f"{len(value)} entries"
    text = json.dumps(value)
    return text if len(text) <= 40 else text[:37] + "..."


def _described(stage: Stage) -> dict[str, Any]:
    """What of a stage is no array, and the shapes of its arrays."""
    return {
        "mode": stage.mode,
        "mesh": {"edges": stage.mesh.edges, "degree": stage.mesh.degree},
        "held": [[held.step, held.Z, held.director] for held in stage.state.held],
        "near": list(stage.state.near),
        "converged": stage.state.converged,
        "counters": stage.counters,
        "failed": [asdict(solve) for solve in stage.failed],
        "shapes": {name: array.shape for name, array in _arrays(stage).items()},
    }


def _arrays(stage: Stage) -> dict[str, np.ndarray]:
    """Arrays of a stage that are not empty, by name."""
    state = stage.state
    lists = {
        "x": state.x,
        "tip_forces": state.tip_forces,
        "states": state.states,
        "held": list(state.held.values()),
        "near": list(state.near.values()),
    }
    optional = {"auxiliary": state.auxiliary, "previous": stage.previous}
    return {name: np.array(rows) for name, rows in lists.items() if rows} | {
        name: array for name, array in optional.items() if array is not None
    }

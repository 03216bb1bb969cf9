"""Resuming an interrupted plan: the decided steps are on disk after every window.

The solution of the next window depends only on the decided steps, the solution of the window
before and the plan that a horizon starts from. So a resumed plan has the same bits as one that was
not interrupted.
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
from .decided_steps import DecidedSteps
from .options import Options
from .plan import Plan
from .records import fits

FILE = "resume.npz"
MIN_FLUSH_INTERVAL = 1.0  # s of work that is worth a flush to disk, in case of a power cut
MAX_CHANGES_SHOWN = 3
MAX_KEY_LENGTH = 100  # characters


class Checkpoint:
    """A file from which a plan is resumed if its process ends before it does.

    `plan_motion` replaces it after every window; remove it when the plan is saved. At any time
    the file exists, or its successor beside it does.

    Parameters
    ----------
    path : str or Path
        The file, such as `results/lift-log/horizon/resume.npz`.
    resume : bool
        Resume from the file; otherwise start again and replace it.

    Attributes
    ----------
    seconds : float
        Wall time that the plan took before this process.
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
        """Files that an unfinished run left, except empty ones, which a power cut leaves.

        Raises
        ------
        InputError
            If a file of that name is something else.
        """
        return [path for path in self._own_files() if not _is_empty(path)]

    def open(
        self, motion: Motion, mode: str, lookahead: int, options: Options, start: Plan | None
    ) -> None:
        """Begin a plan, from the file if it is to be resumed.

        Raises
        ------
        InputError
            If there is nothing to resume, or it belongs to another plan; names the differences.
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
                "without --resume to start again."
            )
        newest = self._newer if self._newer.exists() else self.path
        found = read_unfinished(newest, motion, options)
        self._own_files()  # check the other file as well, which `save` replaces
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
                "--resume to start again."
            )
        self.seconds, self._found = found.stages(motion)

    def enter(
        self, mode: str, mesh: Mesh, window: int, optimizer: Optimizer
    ) -> tuple[DecidedSteps, np.ndarray | None]:
        """Steps that the next run has decided already, and the controls of its last window.

        Parameters
        ----------
        window : int
            Time steps of its windows.

        Raises
        ------
        InputError
            If the file has a different run at this point.
        """
        number = len(self._stages)
        stage = Stage(mode, mesh, DecidedSteps(), None, {})
        if number < len(self._found):
            stage = self._found[number]
            ahead = window if stage.previous is None else len(stage.previous)
            if (stage.mode, stage.mesh, ahead) != (mode, mesh, window):
                raise InputError(
                    f"{self.path}: has other stages than this plan; expected those of an "
                    "unfinished run of it. Run without --resume to start again."
                )
            for name in COUNTERS:
                setattr(optimizer, name, stage.counters.get(name, 0))
            optimizer.solves[:] = stage.failed
        self._stages.append(stage)
        return stage.state, stage.previous

    def save(self, optimizer: Optimizer, previous: np.ndarray) -> None:
        """Write the decided steps; if the disk is full, report it once and continue without."""
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
            for record in progress["stages"]:
                record["failed"] = [solve | {"history": ()} for solve in record["failed"]]
            text = json.dumps(progress)
        # Few members and one array, because each takes time after every window.
        values = [array.ravel() for stage in self._stages for array in _arrays(stage).values()]
        content = io.BytesIO()
        np.savez(
            content,
            identity=np.frombuffer(self._identity_json, np.uint8),
            progress=np.frombuffer(text.encode(), np.uint8),
            values=np.concatenate(values),
        )
        now = time.perf_counter()
        flush, self._saved = now - self._saved > MIN_FLUSH_INTERVAL, now
        try:
            write(self._newer, content.getvalue(), flush)
            # Not os.replace, with which some file systems wait for the disk.
            self.path.unlink(missing_ok=True)
            self._newer.rename(self.path)
        except (InputError, OSError) as error:
            if not self._failed:
                optimizer.reporter.note(f"Continuing, but this run could not be resumed: {error}")
            self._failed = True

    def remove(self) -> None:
        """Remove the file: the plan is saved.

        Raises
        ------
        InputError
            If a file of that name is something else.
        """
        for path in self._own_files():
            path.unlink(missing_ok=True)

    def _own_files(self) -> list[Path]:
        """The file and its successor, if they exist; InputError if they are something else."""
        folder = self.path.parent
        if folder.exists() and not folder.is_dir():
            raise InputError(
                f"{folder}: is a file, expected a folder for results; move it away, or name "
                "another folder with --out."
            )
        existing = [path for path in (self._newer, self.path) if os.path.lexists(path)]
        for path in existing:
            if not _is_checkpoint(path):
                raise InputError(
                    f"{path}: is not a file of an unfinished run, and would be replaced; move it "
                    "away, or name another folder with --out."
                )
        return existing


def _is_checkpoint(path: Path) -> bool:
    """Whether a file begins like a checkpoint, or is empty, as after a power cut."""
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
    """Everything that a plan depends on, ready for JSON."""
    # By muscle, because in a table of patterns the order counts, which comparisons disregard.
    effort = options.weights_for(motion).of_muscles(motion.trunk.muscles)
    return {
        "problem": plain(motion.spec),
        "anatomy": plain(motion.anatomy),
        "problem_sha256": fingerprint(motion.spec),
        "anatomy_sha256": fingerprint(motion.anatomy),
        "options": asdict(options) | {"mode": mode, "lookahead": lookahead},
        "versions": {key: text for key, text in versions().items() if key != "platform"},
        "steps": fingerprint([motion.steps, effort]),
        "start": None if start is None else fingerprint([start.x, start.shape.states, start.mesh]),
    }


def _name(identity: dict[str, Any]) -> str:
    """Name of the problem of a run, from its file."""
    problem = identity.get("problem")
    return str(problem.get("name") if isinstance(problem, dict) else None)[:MAX_KEY_LENGTH]


def _changes(old: dict[str, Any], new: dict[str, Any]) -> list[str]:
    """Differences between two identities, a clause each."""
    clauses = []
    for part in ("problem", "anatomy", "versions", "options"):
        if f"{part}_sha256" in new and old.get(f"{part}_sha256") == new[f"{part}_sha256"]:
            continue
        # Compare no further than is shown, because an untrusted file may differ anywhere.
        differences = list(islice(_differences(old.get(part), new[part]), MAX_CHANGES_SHOWN + 1))
        if differences:
            more = ["and more"] if len(differences) > MAX_CHANGES_SHOWN else []
            shown = [*differences[:MAX_CHANGES_SHOWN], *more]
            clauses.append(f"the {part} changed ({', '.join(shown)})")
    if not clauses and old.get("steps") != new["steps"]:
        clauses.append("the time steps or the weights of muscles changed")
    if not clauses and old.get("start") != new["start"]:
        clauses.append("the plan that it starts from changed")
    return clauses


def _differences(old: Any, new: Any, key: str = "") -> Iterator[str]:
    """`key: old -> new` for every entry that differs, entries of lists numbered from 1."""
    if isinstance(old, Mapping) and isinstance(new, Mapping):
        for name in sorted({*old, *new}):
            yield from _differences(old.get(name), new.get(name), f"{key}.{name}".lstrip("."))
    elif isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        for number, pair in enumerate(zip(old, new, strict=True), 1):
            yield from _differences(*pair, f"{key}[{number}]")
    elif old != new:
        yield f"{key[:MAX_KEY_LENGTH]}: {_short(old)} -> {_short(new)}"


def _short(value: Any) -> str:
    if isinstance(value, list | dict) and len(value) > 10:
        return f"{len(value)} entries"
    text = json.dumps(value)
    return text if len(text) <= 40 else text[:37] + "..."


def _described(stage: Stage) -> dict[str, Any]:
    """A stage without its arrays, but with their shapes."""
    return {
        "mode": stage.mode,
        "mesh": {"edges": stage.mesh.edges, "degree": stage.mesh.degree},
        "held": [[held.step, held.Z, held.director] for held in stage.state.held],
        "near": list(stage.state.auxiliary),
        "converged": stage.state.converged,
        "counters": stage.counters,
        "failed": [asdict(solve) for solve in stage.failed],
        "shapes": {name: array.shape for name, array in _arrays(stage).items()},
    }


def _arrays(stage: Stage) -> dict[str, np.ndarray]:
    """Nonempty arrays of a stage by name."""
    state = stage.state
    lists = {
        "x": state.x,
        "tip_forces": state.tip_forces,
        "states": state.states,
        "held": list(state.held.values()),
        "near": list(state.auxiliary.values()),
    }
    # The file keeps its first names: "near" for the auxiliary solutions of the decided steps,
    # "auxiliary" for the latest of them.
    optional = {"auxiliary": state.unloaded, "previous": stage.previous}
    return {name: np.array(rows) for name, rows in lists.items() if rows} | {
        name: array for name, array in optional.items() if array is not None
    }

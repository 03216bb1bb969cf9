"""Going on with a plan that was cut off: what was decided so far, on disk after every window.

What the next window finds depends on the decided steps, the solution of the window before and the
plan that a horizon starts from, and on nothing else. So a plan that is gone on with has the same
bits as one that never stopped.
"""

from __future__ import annotations

import io
import json
import time
import zipfile
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .collocation import Mesh
from .errors import InputError
from .files import write
from .motion import Motion
from .planner import Options, Pass, State
from .provenance import fingerprint, plain, versions
from .solution import Plan
from .targets import Held

FILE = "resume.npz"
COUNTERS = ("iterations", "setup_seconds", "solve_seconds", "derivative_seconds")
SHOWN = 3  # changes told one by one


@dataclass
class Stage:
    """A pass as far as it has come: how it was made, what it has decided, what it has cost.

    previous : (H, muscles + 2), unknowns of the last window; None before the first.
    """

    mode: str
    mesh: Mesh
    state: State
    previous: np.ndarray | None
    counters: dict[str, float]


class Checkpoint:
    """A file that a plan is gone on with, if its process ends before it does.

    Written whole after every window, in well under a millisecond, by `plan_motion`; remove it
    when the plan is saved.

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

    def __init__(self, path: str | Path, resume: bool = False) -> None:
        self.path, self.resume = Path(path), resume
        self.seconds = 0.0
        self._began = time.perf_counter()
        self._identity: dict[str, Any] = {}
        self._found: list[Stage] = []
        self._stages: list[Stage] = []
        self._failed = False

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
        self._identity = _identity(motion, mode, lookahead, options, start)
        self._found, self._stages = [], []
        if not self.resume:
            self.path.unlink(missing_ok=True)
            return
        identity, seconds, self._found = _read(self.path)
        changes = _changes(identity, self._identity)
        if changes:
            raise InputError(
                f"{self.path}: cannot be resumed, because {' and '.join(changes)}; expected the "
                "same problem, anatomy, options and versions. Undo the change, or run without "
                "--resume to start anew."
            )
        self.seconds = seconds

    def enter(self, work: Pass) -> tuple[State, np.ndarray | None]:
        """What the next pass has decided already, and the unknowns of its last window.

        Raises
        ------
        InputError
            If the file has another pass in its place.
        """
        number = len(self._stages)
        stage = Stage(work.mode, work.mesh, State(), None, {})
        if number < len(self._found):
            stage = self._found[number]
            if (stage.mode, stage.mesh) != (work.mode, work.mesh):
                raise InputError(
                    f"{self.path}: has other passes than this plan; expected those of an "
                    "unfinished run of it. Run without --resume to start anew."
                )
            for name, value in stage.counters.items():
                setattr(work.optimiser, name, value)
        self._stages.append(stage)
        return stage.state, stage.previous

    def save(self, work: Pass, previous: np.ndarray) -> None:
        """Write what has been decided; if the disk is full, say so once and go on without."""
        stage = self._stages[-1]
        stage.previous = previous
        stage.counters = {name: getattr(work.optimiser, name) for name in COUNTERS}
        metadata = {
            "identity": self._identity,
            "seconds": self.seconds + time.perf_counter() - self._began,
            "stages": [_described(stage) for stage in self._stages],
        }
        text = json.dumps(metadata).encode()
        arrays: dict[str, Any] = {"metadata": np.frombuffer(text, np.uint8)}
        for number, each in enumerate(self._stages):
            arrays |= {f"{number}.{name}": array for name, array in _arrays(each)}
        content = io.BytesIO()
        np.savez(content, **arrays)
        try:
            write(self.path, content.getvalue(), lasting=False)
        except InputError as error:
            if not self._failed:
                work.optimiser.reporter.note(f"Going on, but this could not be resumed: {error}")
            self._failed = True

    def remove(self) -> None:
        """Remove the file: the plan is saved."""
        self.path.unlink(missing_ok=True)


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
        differences = list(_differences(old.get(part), new[part]))
        if differences:
            more = len(differences) - SHOWN
            told = [*differences[:SHOWN], *([f"and {more} more"] if more > 0 else [])]
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
        yield f"{key}: {_short(old)} -> {_short(new)}"


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 40 else text[:37] + "..."


def _described(stage: Stage) -> dict[str, Any]:
    """What of a stage is no array."""
    return {
        "mode": stage.mode,
        "mesh": asdict(stage.mesh),
        "held": [[held.step, held.Z, held.director] for held in stage.state.held],
        "near": list(stage.state.near),
        "converged": stage.state.converged,
        "counters": stage.counters,
    }


def _arrays(stage: Stage) -> Iterator[tuple[str, np.ndarray]]:
    """Arrays of a stage that are not empty, by name."""
    state = stage.state
    lists = {
        "x": state.x,
        "tip_forces": state.tip_forces,
        "states": state.states,
        "held": list(state.held.values()),
        "near": list(state.near.values()),
    }
    yield from ((name, np.array(rows)) for name, rows in lists.items() if rows)
    optional = {"auxiliary": state.auxiliary, "previous": stage.previous}
    yield from ((name, array) for name, array in optional.items() if array is not None)


def _read(path: Path) -> tuple[dict[str, Any], float, list[Stage]]:
    """Identity, seconds spent and stages of a file.

    Raises
    ------
    InputError
        If there is none, or if it is damaged.
    """
    if not path.exists():
        raise InputError(
            f"{path}: there is nothing to resume; expected an unfinished run here. Run without "
            "--resume to start anew."
        )
    try:
        with np.load(io.BytesIO(path.read_bytes()), allow_pickle=False) as data:
            arrays = {name: data[name] for name in data.files}
        metadata = json.loads(arrays["metadata"].tobytes())
        stages = [
            _stage(told, {name: arrays.get(f"{number}.{name}") for name in NAMES})
            for number, told in enumerate(metadata["stages"])
        ]
        identity, seconds = metadata["identity"], float(metadata["seconds"])
    except (OSError, ValueError, LookupError, TypeError, EOFError, zipfile.BadZipFile) as error:
        raise InputError(
            f"{path}: cannot be read as an unfinished run ({error}); run without --resume to "
            "start anew."
        ) from None
    return identity, seconds, stages


NAMES = ("x", "tip_forces", "states", "held", "near", "auxiliary", "previous")


def _stage(told: dict[str, Any], arrays: dict[str, np.ndarray | None]) -> Stage:
    rows = {name: [] if array is None else list(array) for name, array in arrays.items()}
    held = [Held(step, Z, director) for step, Z, director in told["held"]]
    return Stage(
        told["mode"],
        Mesh(tuple(told["mesh"]["edges"]), told["mesh"]["degree"]),
        State(
            x=rows["x"],
            tip_forces=rows["tip_forces"],
            states=rows["states"],
            held=dict(zip(held, rows["held"], strict=True)),
            auxiliary=arrays["auxiliary"],
            near=dict(zip(told["near"], rows["near"], strict=True)),
            converged=told["converged"],
        ),
        arrays["previous"],
        told["counters"],
    )

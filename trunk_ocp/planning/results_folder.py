"""Folders of results: the problem file they belong to, and outdated files in them.

Outdated files are never deleted. A run moves those that it does not replace to `earlier/`, and only
files with names that this program gives; all other files stay where they are.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from .._support.atomic_files import write
from .._support.provenance import fingerprint
from .._support.toml_files import is_file, printable, read_bytes, shipped
from ..errors import InputError
from ..problem.build import problems_folder
from ..problem.motion import Motion
from .plan import Plan

SOURCE = "source.json"
EARLIER = "earlier"
MODE = re.compile(r"horizon|sequential|receding-[0-9]+")
RESULTS = ("activations.csv", "summary.json", "solution.nc")
FIGURE = r"\.(pdf|png|svg)"
OF_PLAN = {
    ".": re.compile(
        r"diagnosis\.json|redundancy\.json|motion\.glb|activations\.sto|film\.(gif|mp4)"
        r"|simulation\.(json|nc)"
    ),
    "figures": re.compile(
        r"(activations|errors|shapes|muscles-[a-z]+|redundancy|simulation)"
        r"(-[0-9]+)?" + FIGURE  # with its page
    ),
    "vtk": re.compile(r"(muscles|centerline)(\.pvd|_[0-9]{4}\.vtp)"),
}
OF_RUN = {
    ".": re.compile(r"motion\.html|comparison\.json"),
    "figures": re.compile(r"(comparison|anatomy-[a-z]+)" + FIGURE),
}
"""Files made from one plan, or from all plans of a run, by their folder."""
MAX_SUMMARY_SIZE = 20_000_000  # bytes


# --- the problem of a folder --------------------------------------------------------------------


def default_folder(problem: str, motion: Motion) -> Path:
    """Folder `results/NAME` for a motion read from `problem`, a shipped name or a path.

    Raises
    ------
    InputError
        If it has results of another problem file with the same name.
    """
    folder = Path("results") / motion.name
    record = _table(folder / SOURCE)
    if record and not is_of(folder, problem) and _hashes_in(record) != hashes(motion):
        raise InputError(
            f"{folder}: has results of another problem with the same name, "
            f"{_shown(record, folder)}; expected results of {problem} or none. Name another folder "
            "with --out, or rename one of the two problems."
        )
    return folder


def sign(folder: Path, problem: str, motion: Motion) -> None:
    """Record the problem file of a folder's results."""
    problem_hash, anatomy_hash = hashes(motion)
    record = {
        "file": _source(problem, folder),
        "problem_sha256": problem_hash,
        "anatomy_sha256": anatomy_hash,
    }
    write(folder / SOURCE, json.dumps(record, indent=2) + "\n")


def is_of(folder: Path, problem: str) -> bool:
    """Whether a folder's results belong to a problem file, or have no record of one."""
    record = _table(folder / SOURCE)
    return not record or record.get("file") == _source(problem, folder)


def problem_file_of(folder: Path) -> Path | None:
    """The user's problem file that a folder's results are from; None if there is none."""
    path = Path(os.path.normpath(folder / str(_table(folder / SOURCE).get("file"))))
    return path if is_file(path) else None


def _source(problem: str, folder: Path) -> str:
    """A shipped name, or the path of a problem file as seen from a folder."""
    path = shipped(problem, problems_folder())
    if path.parent == problems_folder():
        return path.stem
    try:
        return Path(os.path.relpath(path.resolve(), folder.resolve())).as_posix()
    except ValueError:  # another drive, on Windows
        return path.resolve().as_posix()


def _shown(record: dict[str, Any], folder: Path) -> str:
    """The problem file of a folder, as a path from the working directory if it exists."""
    file = printable(str(record.get("file")))[:300]
    path = Path(os.path.normpath(folder / file))
    return str(path) if is_file(path) else file


def hashes(motion: Motion) -> tuple[str, str]:
    """Fingerprints of a motion's problem and anatomy."""
    return fingerprint(motion.spec), fingerprint(motion.anatomy)


def _hashes_in(record: dict[str, Any]) -> tuple[Any, Any]:
    """Fingerprints in a source.json or a summary.json."""
    return record.get("problem_sha256"), record.get("anatomy_sha256")


def _table(path: Path) -> dict[str, Any]:
    """Content of a JSON file; empty if it cannot be read."""
    with contextlib.suppress(InputError, ValueError, RecursionError):
        content = json.loads(read_bytes(path, MAX_SUMMARY_SIZE))
        return content if isinstance(content, dict) else {}
    return {}


# --- outdated files -------------------------------------------------------------------


@dataclass
class Aside:
    """Files that were moved aside, as (old path, new path), and the folder they are in now."""

    folder: Path
    moved: list[tuple[Path, Path]] = field(default_factory=list)
    keep_all: bool = False
    """Whether replaced files stay as well, because they belong to another problem."""

    def settle(self) -> Path | None:
        """Remove files that have been replaced since; return the folder if any are left in it."""
        for before, now in self.moved:
            if before.exists() and not self.keep_all:
                now.unlink(missing_ok=True)
        _remove_empty({now.parent for _, now in self.moved}, self.folder.parent)
        return self.folder if self.moved and self.folder.exists() else None


def set_aside(folder: Path, plans: Sequence[tuple[str, Plan, str]], problem: str) -> Aside:
    """Move aside the files that new plans of a problem file make outdated in a folder.

    These are files made from an earlier version of a plan, and plans of another problem or anatomy
    with the files made from them. Files made from an unchanged plan stay. An edited problem file is
    the same problem, whose new plans replace the earlier ones.

    Parameters
    ----------
    plans
        Folder name, plan and activations.csv of each new plan.
    """
    motion = plans[0][1].motion
    summaries = [summary for path in modes(folder) if (summary := _table(path / "summary.json"))]
    other = any(_hashes_in(summary) != hashes(motion) for summary in summaries) and (
        not is_of(folder, problem)
        or any(summary.get("problem") != motion.name for summary in summaries)
    )
    return _move(list(_out_of_date(folder, plans, other)), folder, other)


def set_derived_aside(own: Path, motion: Motion, table: str) -> None:
    """Move aside files made from a folder's plan, if a different plan is to be saved there."""
    summary = _table(own / "summary.json")
    if summary and not (_hashes_in(summary) == hashes(motion) and _unchanged(own, table)):
        _move(list(_files(own, OF_PLAN)), own)


def set_unfinished_aside(folder: Path, files: Sequence[Path]) -> Path | None:
    """Move files of unfinished runs aside before new ones replace them; their new folder."""
    return _move(files, folder).settle()


def _move(stale: Sequence[Path], folder: Path, keep_all: bool = False) -> Aside:
    """Move files of a folder to a new subfolder."""
    number, aside = 1, folder / EARLIER
    while aside.exists() or aside.is_symlink():
        number += 1
        aside = folder / f"{EARLIER}-{number}"
    moved = []
    for path in stale:
        target = aside / path.relative_to(folder)
        target.parent.mkdir(parents=True, exist_ok=True)
        os.replace(path, target)
        moved.append((path, target))
    _remove_empty({path.parent for path in stale}, folder)
    return Aside(aside, moved, keep_all)


def set_figures_aside(folder: Path, *names: str) -> None:
    """Move aside figures that are not drawn again, by their names without the suffix."""
    pattern = re.compile("(" + "|".join(map(re.escape, names)) + ")" + FIGURE)
    _move(list(_files(folder, {".": pattern})), folder)


def modes(folder: Path) -> list[Path]:
    """Folders of plans in a folder, by the names that this program gives."""
    with contextlib.suppress(OSError):
        return sorted(
            path for path in folder.iterdir() if MODE.fullmatch(path.name) and not path.is_symlink()
        )
    return []


def _out_of_date(
    folder: Path, plans: Sequence[tuple[str, Plan, str]], other: bool
) -> Iterator[Path]:
    new = {name: (plan, table) for name, plan, table in plans}
    expected = hashes(plans[0][1].motion)
    changed = other_anatomy = False
    with contextlib.suppress(OSError):
        for own in modes(folder):
            summary = _table(own / "summary.json")
            if not summary:
                continue
            found = _hashes_in(summary)
            if found == expected and (own.name not in new or _unchanged(own, new[own.name][1])):
                continue
            changed, other_anatomy = True, other_anatomy or found[1] != expected[1]
            yield from _files(own, OF_PLAN)
            if own.name not in new or (other and found != expected):
                yield from (own / name for name in RESULTS if _is_own_file(own / name))
    if changed:
        for path in _files(folder, OF_RUN):
            if other_anatomy or not path.name.startswith("anatomy-"):
                yield path


def _unchanged(own: Path, table: str) -> bool:
    with contextlib.suppress(InputError):
        return read_bytes(own / "activations.csv", MAX_SUMMARY_SIZE) == table.encode()
    return False


def _files(folder: Path, names: dict[str, re.Pattern[str]]) -> Iterator[Path]:
    """Files with names that this program gives, in a folder and its subfolders."""
    for part, name in names.items():
        place = folder / part
        if place.is_symlink() or not place.is_dir():
            continue
        for path in sorted(place.iterdir()):
            if name.fullmatch(path.name) and _is_own_file(path):
                yield path


def _is_own_file(path: Path) -> bool:
    return path.is_file() and not path.is_symlink()


def _remove_empty(folders: set[Path], top: Path) -> None:
    """Remove folders that are empty now, and then empty ones above them, below `top`."""
    for folder in sorted(folders, key=lambda path: len(path.parts), reverse=True):
        place = folder
        while top in place.parents:
            try:
                place.rmdir()
            except OSError:
                break
            place = place.parent

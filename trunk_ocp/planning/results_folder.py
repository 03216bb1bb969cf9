"""What belongs together in a folder of results: which problem file it is of, what is out of date.

Nothing is ever deleted for being out of date. What a run does not replace it moves to `earlier/`,
file by file, and only files of the names that this program gives; whatever else is in the folder
stays where it is.
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
    ),
    "figures": re.compile(r"(activations|errors|shapes|muscles-[a-z]+|redundancy)" + FIGURE),
    "vtk": re.compile(r"(muscles|centerline)(\.pvd|_[0-9]{4}\.vtp)"),
}
OF_RUN = {
    ".": re.compile(r"motion\.html|comparison\.json"),
    "figures": re.compile(r"(comparison|anatomy-[a-z]+)" + FIGURE),
}
"""Files that are made from the plan, or the plans, of a run, by the folder they are in."""
LARGEST_SUMMARY = 20_000_000  # bytes


# --- whose folder it is --------------------------------------------------------------------


def default_folder(problem: str, motion: Motion) -> Path:
    """`results/NAME` of a motion that was read from `problem`, a shipped name or a path.

    Raises
    ------
    InputError
        If it has results of another problem file that has the same name.
    """
    folder = Path("results") / motion.name
    told = _table(folder / SOURCE)
    if told and not is_of(folder, problem) and _hashes_in(told) != hashes(motion):
        raise InputError(
            f"{folder}: has results of another problem with the same name, {_shown(told, folder)}; "
            f"expected results of {problem} or none. Name another folder with --out, or give one "
            "of the two problems another name."
        )
    return folder


def sign(folder: Path, problem: str, motion: Motion) -> None:
    """Keep of which problem file a folder's results are."""
    problem_hash, anatomy_hash = hashes(motion)
    told = {
        "file": _source(problem, folder),
        "problem_sha256": problem_hash,
        "anatomy_sha256": anatomy_hash,
    }
    write(folder / SOURCE, json.dumps(told, indent=2) + "\n")


def is_of(folder: Path, problem: str) -> bool:
    """Whether nothing speaks against a folder's results being of a problem file."""
    told = _table(folder / SOURCE)
    return not told or told.get("file") == _source(problem, folder)


def _source(problem: str, folder: Path) -> str:
    """A shipped name, or the path of a problem file as seen from a folder."""
    path = shipped(problem, problems_folder())
    if path.parent == problems_folder():
        return path.stem
    try:
        return Path(os.path.relpath(path.resolve(), folder.resolve())).as_posix()
    except ValueError:  # another drive, on Windows
        return path.resolve().as_posix()


def _shown(told: dict[str, Any], folder: Path) -> str:
    """The problem file of a folder as a user would name it here."""
    file = printable(str(told.get("file")))[:300]
    path = Path(os.path.normpath(folder / file))
    return str(path) if is_file(path) else file


def hashes(motion: Motion) -> tuple[str, str]:
    """Fingerprints of a motion's problem and anatomy: plans with the same belong together."""
    return fingerprint(motion.spec), fingerprint(motion.anatomy)


def _hashes_in(told: dict[str, Any]) -> tuple[Any, Any]:
    """The same of a source.json or a summary.json."""
    return told.get("problem_sha256"), told.get("anatomy_sha256")


def _table(path: Path) -> dict[str, Any]:
    """A table in JSON; an empty one if there is none that can be read."""
    with contextlib.suppress(InputError, ValueError, RecursionError):
        found = json.loads(read_bytes(path, LARGEST_SUMMARY))
        return found if isinstance(found, dict) else {}
    return {}


# --- what is out of date -------------------------------------------------------------------


@dataclass
class Aside:
    """Files that were moved aside, as (where they were, where they are), and their folder."""

    folder: Path
    moved: list[tuple[Path, Path]] = field(default_factory=list)
    whole: bool = False
    """Whether all of it stays, as it is of another problem."""

    def settle(self) -> Path | None:
        """Remove what has been replaced since; the folder, if anything in it has not been."""
        for before, now in self.moved:
            if before.exists() and not self.whole:
                now.unlink(missing_ok=True)
        _remove_empty({now.parent for _, now in self.moved}, self.folder.parent)
        return self.folder if self.moved and self.folder.exists() else None


def set_aside(folder: Path, plans: Sequence[tuple[str, Plan, str]], problem: str) -> Aside:
    """Move aside what is out of date once plans of a problem file are saved to a folder.

    That is what was made from an earlier plan in place of a new one, and plans of another problem
    or anatomy with all that was made from them. A plan that comes out as before leaves its own.
    A file that was edited is the same problem, whose new plan replaces the one before.

    plans : folder name, plan and activations.csv of each new plan.
    """
    motion = plans[0][1].motion
    summaries = [told for own in modes(folder) if (told := _table(own / "summary.json"))]
    other = any(_hashes_in(told) != hashes(motion) for told in summaries) and (
        not is_of(folder, problem) or any(told.get("problem") != motion.name for told in summaries)
    )
    return _move(list(_out_of_date(folder, plans, other)), folder, other)


def set_derived_aside(own: Path, motion: Motion, table: str) -> None:
    """Move aside what was made from a folder's plan, if one with another table is saved there."""
    told = _table(own / "summary.json")
    if told and not (_hashes_in(told) == hashes(motion) and _unchanged(own, table)):
        _move(list(_files(own, OF_PLAN)), own)


def set_unfinished_aside(folder: Path, files: Sequence[Path]) -> Path | None:
    """Move files of unfinished runs aside, as others begin in their place; where they are now."""
    return _move(files, folder).settle()


def _move(stale: Sequence[Path], folder: Path, whole: bool = False) -> Aside:
    """Move files of a folder to a folder in it that was not there before."""
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
    return Aside(aside, moved, whole)


def set_figures_aside(folder: Path, *names: str) -> None:
    """Move figures aside, by their names without the ending, that are not drawn anew."""
    wanted = re.compile("(" + "|".join(map(re.escape, names)) + ")" + FIGURE)
    _move(list(_files(folder, {".": wanted})), folder)


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
            told = _table(own / "summary.json")
            if not told:
                continue
            found = _hashes_in(told)
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
        return read_bytes(own / "activations.csv", LARGEST_SUMMARY) == table.encode()
    return False


def _files(folder: Path, names: dict[str, re.Pattern[str]]) -> Iterator[Path]:
    """Files of a folder that have one of our names, by the folder in it."""
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
    """Remove folders that have nothing in them any more, and so those above them, below `top`."""
    for folder in sorted(folders, key=lambda path: len(path.parts), reverse=True):
        place = folder
        while top in place.parents:
            try:
                place.rmdir()
            except OSError:
                break
            place = place.parent

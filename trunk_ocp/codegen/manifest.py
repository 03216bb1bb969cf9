"""The files of an export in their folder: what an earlier export wrote there, and nothing else.

`export.json` records the hash of every file. It may come from anybody, so a file counts as ours
only if it has one of the names that exports write and still the recorded content.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
from pathlib import Path

from .._support.atomic_files import write
from .._support.toml_files import read_bytes
from ..errors import InputError

Files = dict[str, str | bytes]
MANIFEST = "export.json"
MADE_BY = "trunk-ocp export"
LARGEST_MANIFEST = 100_000
"""Bytes; an export has some 20 files."""

_NAMES = """
README.txt CMakeLists.txt example.c check.c check.m check.py check.csv check_unloaded.csv
trunk.c trunk.h trunk_shape.c trunk_shape.m trunk_example.m
trunk_numpy.py trunk_jax.py trunk_torch.py trunk.onnx
loaded.casadi loaded_jacobian.casadi loaded_second.casadi
unloaded.casadi unloaded_jacobian.casadi
trunk_formulas.py trunk_formulas.tex check_formulas.py check_formulas.csv
nlp.casadi nlp_grad_f.casadi nlp_jac_g.casadi nlp_hess_l.casadi solve.py
nlp.c nlp.h nlp_data.c nlp_mex.c nlp.m nlp_example.m
layout.json unknowns.csv rows.csv parameters.csv nlp_check.csv
"""
NAMES = frozenset(_NAMES.split())
"""Every file that an export may consist of, besides `MANIFEST`."""


def write_files(folder: Path, files: Files, about: dict[str, str]) -> list[Path]:
    """Write an export into a folder, in place of an earlier one; returns the paths.

    Files of the earlier export that the new one does not have are removed.

    Raises
    ------
    InputError
        If a file is in the way that no export wrote, or that was changed since. Nothing is
        written or removed then.
    """
    ours = _ours(folder)
    in_the_way = sorted(
        name for name in (*files, MANIFEST) if _is_there(folder / name) and name not in ours
    )
    if in_the_way:
        raise InputError(
            f"{folder / in_the_way[0]}: is there already, and not as an export wrote it; expected "
            "a new folder, or one with an export whose files are unchanged. Move the file away, "
            "or name another folder with --out."
        )
    hashes = {name: hashlib.sha256(_bytes(content)).hexdigest() for name, content in files.items()}
    manifest = json.dumps({"made_by": MADE_BY, **about, "files": hashes}, indent=1)
    for name in ours - {*files, MANIFEST}:
        (folder / name).unlink(missing_ok=True)
    everything: Files = files | {MANIFEST: manifest}
    return [write(folder / name, text, lasting=False) for name, text in everything.items()]


def _ours(folder: Path) -> set[str]:
    """Names of files that an earlier export wrote to the folder and nobody has changed."""
    if not _is_there(folder / MANIFEST):
        return set()
    recorded = {}
    # Damaged or made by hand: nothing is ours then, and the file itself is in the way.
    with contextlib.suppress(ValueError, TypeError, LookupError, RecursionError, InputError):
        if not (folder / MANIFEST).is_symlink():
            manifest = json.loads(read_bytes(folder / MANIFEST, LARGEST_MANIFEST))
            recorded = {**manifest["files"]} if manifest["made_by"] == MADE_BY else {}
    if not recorded:
        return set()
    names = NAMES & {*recorded}
    return {MANIFEST} | {name for name in names if _has(folder / name, recorded[name])}


def _has(path: Path, recorded: object) -> bool:
    """Whether a path is a regular file, no link to one, with the recorded hash."""
    if path.is_symlink() or not path.is_file():
        return False
    try:
        with path.open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest() == recorded
    except OSError:  # not ours to read, so not ours
        return False


def _is_there(path: Path) -> bool:
    """Whether a name is taken, be it by a link that leads nowhere."""
    return path.exists() or path.is_symlink()


def _bytes(content: str | bytes) -> bytes:
    return content.encode() if isinstance(content, str) else content

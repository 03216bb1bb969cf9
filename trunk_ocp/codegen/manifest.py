"""Writes the files of an export in place of an earlier one, and touches no other file.

The manifest `export.json` records the hash of every file. Anybody may have written it, so a file
counts as an export's only if it has one of the names that exports write and the recorded content.
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
"""Bytes; an export has about 20 files."""

_NAMES = """
README.txt CMakeLists.txt example.c check.c check.m check.py check.csv check_unloaded.csv
trunk.c trunk.h trunk_shape.c trunk_shape.m trunk_example.m
trunk_numpy.py trunk_jax.py trunk_torch.py
loaded.casadi loaded_jacobian.casadi loaded_second.casadi
unloaded.casadi unloaded_jacobian.casadi
trunk_formulas.py trunk_formulas.tex check_formulas.py check_formulas.csv
nlp.casadi nlp_grad_f.casadi nlp_jac_g.casadi nlp_hess_l.casadi solve.py
nlp.c nlp.h nlp_data.c nlp_mex.c nlp.m nlp_example.m
layout.json unknowns.csv rows.csv parameters.csv nlp_check.csv
"""
NAMES = frozenset(_NAMES.split())
"""Every file that an export may consist of, besides `MANIFEST`."""
_EARLIER_NAMES = """
trunk.onnx programme.c programme.h programme_data.c programme_mex.c programme.m programme_example.m
programme_check.csv
"""
EARLIER_NAMES = frozenset(_EARLIER_NAMES.split())
"""Files of version 0.1, which a new export replaces."""


def write_files(folder: Path, files: Files, about: dict[str, str]) -> list[Path]:
    """Write an export into a folder, in place of an earlier one; returns the paths.

    Files of the earlier export that the new one does not have are removed.

    Raises
    ------
    InputError
        If a file of that name exists that no export wrote, or that was changed since. Nothing is
        written or removed in this case.
    """
    replaceable = _exported(folder)
    conflicts = sorted(
        name for name in (*files, MANIFEST) if _exists(folder / name) and name not in replaceable
    )
    if conflicts:
        raise InputError(
            f"{folder / conflicts[0]}: exists and is not as an export wrote it; expected a new "
            "folder, or one with an export whose files are unchanged. Move the file away, or name "
            "another folder with --out."
        )
    hashes = {name: hashlib.sha256(_bytes(content)).hexdigest() for name, content in files.items()}
    manifest = json.dumps({"made_by": MADE_BY, **about, "files": hashes}, indent=1)
    for name in replaceable - {*files, MANIFEST}:
        (folder / name).unlink(missing_ok=True)
    contents: Files = files | {MANIFEST: manifest}
    return [write(folder / name, text, lasting=False) for name, text in contents.items()]


def _exported(folder: Path) -> set[str]:
    """Names of unchanged files that an earlier export wrote to the folder."""
    if not _exists(folder / MANIFEST):
        return set()
    recorded = {}
    # If it is damaged or written by hand, no file may be replaced, the manifest included.
    with contextlib.suppress(ValueError, TypeError, LookupError, RecursionError, InputError):
        if not (folder / MANIFEST).is_symlink():
            manifest = json.loads(read_bytes(folder / MANIFEST, LARGEST_MANIFEST))
            recorded = {**manifest["files"]} if manifest["made_by"] == MADE_BY else {}
    if not recorded:
        return set()
    names = (NAMES | EARLIER_NAMES) & {*recorded}
    return {MANIFEST} | {name for name in names if _has(folder / name, recorded[name])}


def _has(path: Path, recorded: object) -> bool:
    """Whether a path is a regular file, not a link, with the recorded hash."""
    if path.is_symlink() or not path.is_file():
        return False
    try:
        with path.open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest() == recorded
    except OSError:  # not readable
        return False


def _exists(path: Path) -> bool:
    """Whether a name is taken, also by a broken link."""
    return path.exists() or path.is_symlink()


def _bytes(content: str | bytes) -> bytes:
    return content.encode() if isinstance(content, str) else content

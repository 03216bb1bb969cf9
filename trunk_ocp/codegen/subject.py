"""Subject of an export: a problem or an anatomy, shipped or from a file."""

from __future__ import annotations

import tomllib
from pathlib import Path

from .._support.toml_files import MAX_FILE_SIZE, read_bytes, shipped
from ..model.anatomy import Trunk, anatomies_folder, load_anatomy
from ..problem.build import load_motion, problems_folder
from ..problem.motion import Motion


def load_subject(name_or_path: str) -> Motion | Trunk:
    """A motion or a trunk, from a shipped name or a file of either kind.

    Raises
    ------
    InputError
        If there is no such name or file, or the file is invalid.
    """
    path = shipped(name_or_path, anatomies_folder(), problems_folder())
    return load_motion(path) if is_problem(path) else load_anatomy(path)


def is_problem(path: Path) -> bool:
    """Whether a file is a problem; either reader reports a file that cannot be parsed."""
    try:
        content = tomllib.loads(read_bytes(path, MAX_FILE_SIZE).decode())
    except (UnicodeDecodeError, tomllib.TOMLDecodeError, RecursionError):
        return False
    return "phases" in content or "anatomy" in content

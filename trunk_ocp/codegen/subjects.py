"""What `trunk-ocp export` is asked about: a problem or an anatomy, shipped or a file."""

from __future__ import annotations

import tomllib
from pathlib import Path

from .._support.toml_files import MAX_FILE_SIZE, read_bytes, shipped
from ..model.anatomy import Trunk, anatomies_folder, load_anatomy
from ..problem.motion import Motion, load_motion, problems_folder


def load_subject(name_or_path: str) -> Motion | Trunk:
    """A motion or a trunk, by a shipped name or a file of either kind.

    Raises
    ------
    InputError
        If it is none of them, or if the file is faulty.
    """
    path = shipped(name_or_path, anatomies_folder(), problems_folder())
    return load_motion(path) if _is_problem(path) else load_anatomy(path)


def _is_problem(path: Path) -> bool:
    """Whether a file is a problem; one that cannot be read may be told so by either reader."""
    try:
        content = tomllib.loads(read_bytes(path, MAX_FILE_SIZE).decode())
    except (UnicodeDecodeError, tomllib.TOMLDecodeError, RecursionError):
        return False
    return "phases" in content or "anatomy" in content

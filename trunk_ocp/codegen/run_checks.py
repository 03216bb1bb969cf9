"""Running an export in its own environment: compilers, Octave, programs."""

from __future__ import annotations

import contextlib
import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from .manifest import NAMES
from .request import CheckError, ToolMissingError

PATIENCE = 120.0
"""Seconds after which a check is given up."""


def tool(command: str, what: str, install: str) -> str:
    """Path of a program.

    Raises
    ------
    ToolMissingError
        If it is not installed; `install` is the line that does it.
    """
    path = shutil.which(command)
    if path is None:
        raise ToolMissingError(f"{command} ({what}) is not installed; get it with: {install}")
    return path


def run(command: Sequence[str], folder: Path, **variables: str) -> str:
    """Run a program in a folder, with more environment variables; what it printed.

    Raises
    ------
    CheckError
        If it fails; the message is what it said.
    """
    try:
        ended = subprocess.run(
            command,
            cwd=folder,
            env=os.environ | variables,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            timeout=PATIENCE,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise CheckError(f"{command[0]} did not end within {PATIENCE:.0f} s.") from None
    if ended.returncode != 0:
        said = ended.stdout.strip() or f"nothing, and ended with code {ended.returncode}"
        raise CheckError(f"{Path(command[0]).name} in {folder} said:\n{said}")
    return ended.stdout


@contextlib.contextmanager
def in_a_copy(folder: Path) -> Iterator[Path]:
    """A copy of an export that is gone afterwards, so that nothing built stays in its folder.

    Without any other file of the folder: a numpy.py there would be imported instead of NumPy.
    """
    with tempfile.TemporaryDirectory() as temporary:
        for path in (folder / name for name in NAMES):
            if path.is_file():
                shutil.copy(path, temporary)
        yield Path(temporary)


OCTAVE = "apt-get install octave octave-dev"


def build_mex(folder: Path, name: str, sources: Sequence[str]) -> str:
    """Compile a MEX file with Octave's compiler; what that printed.

    Raises
    ------
    CheckError, ToolMissingError
        If it does not compile, or Octave is not installed.
    """
    compiler = tool("mkoctfile", "Octave's compiler", OCTAVE)
    return run([compiler, "--mex", "-o", f"{name}.mex", *sources], folder, HOME=str(folder))


def run_octave(folder: Path, script: str) -> str:
    """Run a script or function of a folder in Octave, without anybody's settings or history.

    Raises
    ------
    CheckError, ToolMissingError
        If it ends with an error, or Octave is not installed.
    """
    octave = tool("octave", "GNU Octave", OCTAVE)
    quiet = ["--no-gui", "--norc", "--quiet", "--no-history"]
    return run([octave, *quiet, "--eval", script], folder, HOME=str(folder))

"""Runs the checks of exports in their own environments: compilers, Octave, Python."""

from __future__ import annotations

import contextlib
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from .manifest import NAMES
from .request import CheckError, ToolMissingError

STRICT = ("-std=c99", "-pedantic", "-Wall", "-Wextra", "-Wconversion", "-Werror")
TIMEOUT = 120.0
"""Seconds after which a check is stopped."""


def tool(command: str, what: str, install: str) -> str:
    """Path of a program.

    Raises
    ------
    ToolMissingError
        If it is not installed; `install` is the command that installs it.
    """
    path = shutil.which(command)
    if path is None:
        raise ToolMissingError(f"{command} ({what}) is not installed; get it with: {install}")
    return path


def run(command: Sequence[str], folder: Path, **variables: str) -> str:
    """Run a program in a folder, with extra environment variables; returns its output.

    Raises
    ------
    CheckError
        If it fails; the message has its output.
    """
    try:
        process = subprocess.run(
            command,
            cwd=folder,
            env=os.environ | variables,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            timeout=TIMEOUT,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise CheckError(f"{command[0]} did not finish within {TIMEOUT:.0f} s.") from None
    if process.returncode != 0:
        output = process.stdout.strip() or "(no output)"
        code = f"exit code {process.returncode}"
        raise CheckError(f"{Path(command[0]).name} in {folder} failed ({code}):\n{output}")
    return process.stdout


@contextlib.contextmanager
def in_a_copy(folder: Path) -> Iterator[Path]:
    """Temporary copy of an export, so that nothing that is built stays in its folder.

    Only files of the export are copied: a numpy.py in the folder would be imported as NumPy.
    """
    with tempfile.TemporaryDirectory() as temporary:
        for path in (folder / name for name in NAMES):
            if path.is_file():
                shutil.copy(path, temporary)
        yield Path(temporary)


OCTAVE = "apt-get install octave octave-dev"


def build_mex(folder: Path, name: str, sources: Sequence[str]) -> str:
    """Compile a MEX file with Octave's compiler; returns its output.

    Raises
    ------
    CheckError, ToolMissingError
        If it does not compile, or Octave is not installed.
    """
    compiler = tool("mkoctfile", "Octave's compiler", OCTAVE)
    return run([compiler, "--mex", "-o", f"{name}.mex", *sources], folder, HOME=str(folder))


def run_octave(folder: Path, script: str) -> str:
    """Run a script or function of a folder in Octave, without user settings or history.

    Raises
    ------
    CheckError, ToolMissingError
        If it fails, or Octave is not installed.
    """
    octave = tool("octave", "GNU Octave", OCTAVE)
    quiet = ["--no-gui", "--norc", "--quiet", "--no-history"]
    return run([octave, *quiet, "--eval", script], folder, HOME=str(folder))


def run_python(folder: Path, script: str = "check.py") -> str:
    """Run the self-check of a Python export in a copy of it; returns its output.

    Raises
    ------
    CheckError
        If the export does not reproduce its check files.
    """
    with in_a_copy(folder) as copy:
        return run([sys.executable, script], copy)


def run_c(folder: Path, *sources: str) -> str:
    """Compile check.c with other sources in a copy of an export, and run it; returns its output.

    Warnings of the compiler are errors.

    Raises
    ------
    ToolMissingError
        If there is no C compiler.
    CheckError
        If the program does not compile, or does not reproduce the check files.
    """
    compiler = tool("cc", "a C compiler", "apt-get install gcc")
    with in_a_copy(folder) as copy:
        run([compiler, *STRICT, "-O2", "-o", "check", "check.c", *sources, "-lm"], copy)
        return run([str(copy / "check")], copy)


def run_mex(folder: Path, name: str, *sources: str) -> str:
    """Compile a MEX file with Octave's compiler, and run check.m; returns its output.

    Raises
    ------
    ToolMissingError
        If Octave or its compiler is not installed.
    CheckError
        If it does not compile, or does not reproduce the check files.
    """
    with in_a_copy(folder) as copy:
        build_mex(copy, name, sources)
        return run_octave(copy, "check")

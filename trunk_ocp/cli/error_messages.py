"""Errors and warnings as sentences on standard error, never as a traceback."""

from __future__ import annotations

import contextlib
import logging
import traceback
from collections.abc import Iterator
from pathlib import Path

import click

from ..errors import TrunkError
from .exit_codes import BAD_INPUT, INTERNAL_ERROR, INTERRUPTED

PACKAGE = Path(__file__).parent.parent

# matplotlib warns about missing fonts and unwritable settings that it replaces by itself. Set here,
# as processes that only draw import this module, too.
logging.getLogger("matplotlib").setLevel(logging.ERROR)


def report_user_error(error: TrunkError | OSError | MemoryError) -> int:
    """Print an error that a user can fix, and return the exit code."""
    # Imported here because it is slow, and help does not need it.
    from .._support.toml_files import printable

    if isinstance(error, MemoryError):
        message = "not enough memory. Try a smaller problem or fewer processes."
    else:
        message = printable(str(error), lines=True)
    click.echo(f"Error: {message}", err=True)
    return BAD_INPUT


def report_interrupt() -> int:
    """Print that Ctrl-C ended the command early, and return the exit code."""
    click.echo("Interrupted; nothing more was saved.", err=True)
    return INTERRUPTED


def report_internal_error(error: Exception) -> int:
    """Ask for a bug report, and return the exit code."""
    click.echo(
        f"Error: {error_summary(error)}. This is a bug in trunk_ocp: please report it with the "
        "command you ran and its input files.",
        err=True,
    )
    return INTERNAL_ERROR


@contextlib.contextmanager
def warn_on_failure(consequence: str) -> Iterator[None]:
    """Turn any error of an optional step into a warning; the plans are already saved."""
    try:
        yield
    except Exception as error:
        warn(f"{consequence}: {error_summary(error)}")


def warn(text: str) -> None:
    """Print a warning; it does not change the exit code."""
    click.echo(f"warning: {text}", err=True)


def error_summary(error: BaseException) -> str:
    """One line for an error; with its type and source line unless it is meant for users."""
    if isinstance(error, TrunkError):
        return str(error)
    return f"{type(error).__name__}: {error}{_source_line(error)}"


def _source_line(error: BaseException) -> str:
    """Last line of this package in a traceback, such as " (planner.py:12)"."""
    frames = traceback.extract_tb(error.__traceback__)
    ours = [frame for frame in frames if Path(frame.filename).is_relative_to(PACKAGE)]
    return f" ({Path(ours[-1].filename).name}:{ours[-1].lineno})" if ours else ""

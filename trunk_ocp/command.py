"""What all commands share: how errors end them, and which finished run a user means."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import click
from rich.console import Console

from .checkpoint import FILE
from .errors import InputError, TrunkError
from .interrupts import INTERRUPTED
from .solution import Plan, Status
from .storage import load_plan

BAD_INPUT = 2


@contextmanager
def clean_errors() -> Iterator[None]:
    """Errors a user can mend become a message and exit code 2."""
    try:
        yield
    except (TrunkError, OSError) as error:
        click.echo(f"Error: {error}", err=True)
        sys.exit(BAD_INPUT)
    except KeyboardInterrupt:
        _interrupted()
    except (RuntimeError, SystemError) as error:
        if "KeyboardInterrupt" not in f"{error} {error.__cause__!r}":
            raise
        _interrupted()  # in the middle of CasADi, which makes an error of its own of it


def _interrupted() -> None:
    click.echo("Interrupted; nothing more was saved.", err=True)
    sys.exit(INTERRUPTED)


def finished(run: str) -> tuple[Path, dict[Path, Plan]]:
    """Folder of a finished run, given it or a problem's name, and its plans by their folders."""
    named = Path(run).stem if run.endswith(".toml") else run
    folder = Path(run) if Path(run).is_dir() else Path("results") / named
    found = sorted(folder.glob("*/solution.nc")) or sorted(folder.glob("solution.nc"))
    if not found and any(folder.glob(f"*/{Path(FILE).stem}*.npz")):
        raise InputError(
            f"{folder}: has an unfinished run only. Go on with it first: the same solve-motion "
            "command with --resume."
        )
    if not found:
        raise InputError(
            f"{run}: no finished run here or in {folder}/; expected a folder that solve-motion "
            "wrote. Plan the motion first: solve-motion PROBLEM --out DIR."
        )
    return folder, {path.parent: load_plan(path.parent, throw=False) for path in found}


def verdict(console: Console, plan: Plan) -> None:
    """How a plan ended, in colour, and its notes."""
    colour = "green" if plan.status is Status.SOLVED else "yellow"
    planned, steps = len(plan.x), len(plan.motion.steps)
    part = "" if planned == steps else f" ({planned} of {steps} time steps)"
    console.print(f"[{colour}]{plan.mode}: {plan.status.value}{part}[/]", soft_wrap=True)
    for sentence in plan.notes:
        console.print(f"  {sentence}", soft_wrap=True)

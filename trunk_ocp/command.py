"""What commands about plans share: which finished run a user means, and how its plans ended."""

from __future__ import annotations

from pathlib import Path

from rich.console import Console

from .checkpoint import FILE
from .ending import clean_errors as clean_errors
from .errors import InputError
from .solution import Plan, Status
from .storage import load_plan


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

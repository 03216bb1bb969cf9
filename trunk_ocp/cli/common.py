"""What commands about plans share: which finished run a user means, and how its plans ended."""

from __future__ import annotations

from pathlib import Path

from rich.console import Console

from .._support.toml_files import is_file, printable, read_toml
from ..errors import InputError
from ..planning.checkpoint import FILE
from ..planning.plan import Plan, Status
from ..planning.results_folder import is_of
from ..planning.storage import SOLUTION, load_plan
from ..problem.problem_file import ProblemSpec
from .ending import clean_errors as clean_errors


def finished(run: str) -> tuple[Path, dict[Path, Plan]]:
    """Folder of a finished run, given it or a problem's name or file, and its plans by folder.

    Raises
    ------
    InputError
        If there is none, or one that cannot be read.
    """
    folder = _folder_of(run)
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


def _folder_of(run: str) -> Path:
    path = Path(run)
    if path.name == SOLUTION and is_file(path):
        return path.parent
    if path.is_dir():
        return path
    if not run.endswith(".toml"):
        return Path("results") / run
    if not is_file(path):
        return Path("results") / path.stem
    folder = Path("results") / read_toml(path, ProblemSpec).name
    if not is_of(folder, run):
        raise InputError(
            f"{folder}: has results of another problem with the same name as in {run}; expected "
            "those of this file. Name the folder that you mean instead of the file."
        )
    return folder


def tell(console: Console, text: str) -> None:
    """Print a line that has words of files or names of folders in it: as it is, obeyed by none."""
    console.print(printable(text), markup=False, soft_wrap=True)


def verdict(console: Console, plan: Plan) -> None:
    """How a plan ended, in color, and its notes."""
    color = "green" if plan.status is Status.SOLVED else "yellow"
    planned, steps = len(plan.x), len(plan.motion.steps)
    part = "" if planned == steps else f" ({planned} of {steps} time steps)"
    console.print(f"[{color}]{plan.mode}: {plan.status.value}{part}[/]", soft_wrap=True)
    for sentence in plan.notes:
        tell(console, f"  {sentence}")

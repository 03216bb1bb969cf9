"""What several commands do with plans: find those of a finished run, print how they ended."""

from __future__ import annotations

import re
from pathlib import Path

from rich.console import Console

from .._support.toml_files import is_file, printable, read_toml
from .._support.wording import suggestion
from ..errors import InputError
from ..model.anatomy import anatomies_folder
from ..planning.checkpoint import FILE
from ..planning.plan import Plan
from ..planning.results_folder import is_of
from ..planning.status import Status
from ..planning.storage import SOLUTION, load_plan
from ..problem.build import load_motion, problems_folder
from ..problem.motion import Motion
from ..problem.problem_file import ProblemSpec


def load_problem(problem: str, contact: str | None) -> Motion:
    """Load a motion, with the contact that --contact asks for."""
    motion = load_motion(problem)
    return motion if contact is None else motion.with_contact(contact)


def load_run(run: str) -> tuple[Path, dict[Path, Plan]]:
    """Load the plans of a finished run.

    Parameters
    ----------
    run : str
        A folder of results, the solution.nc in it, or a problem's name or file.

    Returns
    -------
    tuple
        The run's folder, and its plans by their folders.

    Raises
    ------
    InputError
        If there is no finished run, or its files cannot be read.
    """
    folder = _run_folder(run)
    solutions = sorted(folder.glob("*/solution.nc")) or sorted(folder.glob("solution.nc"))
    if not solutions and any(folder.glob(f"*/{Path(FILE).stem}*.npz")):
        raise InputError(
            f"{folder}: this run is unfinished. Finish it first: repeat its solve-motion command "
            "with --resume."
        )
    if not solutions:
        raise InputError(_no_run(run, folder))
    return folder, {path.parent: load_plan(path.parent, throw=False) for path in solutions}


def _no_run(run: str, folder: Path) -> str:
    """The sentence for a run that is not there: what it could be instead, or how to plan it."""
    known = {
        path.stem
        for path in (*problems_folder().glob("*.toml"), *anatomies_folder().glob("*.toml"))
    }
    if run.endswith(".toml") and not is_file(Path(run)):
        return f"{run}: no such file, and no finished run in {folder}/.{suggestion(run, known)}"
    hint = "" if run in known else suggestion(run, known)
    return (
        f"{run}: no finished run in {folder}/. Plan it first, solve-motion {run}, or give the "
        f"folder that has its results.{hint}"
    )


def _run_folder(run: str) -> Path:
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
            f"{folder}: these results are for another problem with the same name as {run}. Give "
            "the folder of results instead of the problem file."
        )
    return folder


def folder_name(name: str) -> str:
    """Turn the name of an anatomy or a problem into one that any file system accepts."""
    return re.sub(r"[^\w.]+", "-", name)[:50].strip("-") or "trunk"


def print_plain(console: Console, text: str) -> None:
    """Print a line with names from files in it, without interpreting them as markup."""
    console.print(printable(text), markup=False, soft_wrap=True)


def print_outcome(console: Console, plan: Plan) -> None:
    """Print how a plan ended, in color, and its notes."""
    color = "green" if plan.status is Status.SOLVED else "yellow"
    planned, steps = len(plan.x), len(plan.motion.steps)
    part = "" if planned == steps else f" ({planned} of {steps} time steps)"
    console.print(f"[{color}]{plan.mode}: {plan.status.value}{part}[/]", soft_wrap=True)
    for note in plan.notes:
        print_plain(console, f"  {note}")
    if (gap := plan.clearance.min) is not None:
        body = "itself" if gap.group == "self" else f"the {gap.body}"
        asked = f" ({1e3 * gap.least:g} mm asked)" if gap.least > 0 else ""
        where = f"at Z = {gap.Z:.2f} m and {gap.time:.3g} s"
        print_plain(console, f"  smallest gap: {1e3 * gap.gap:.3g} mm to {body}{asked}, {where}")
    if (step := plan.inertia.worst) is not None:
        ratio, when = plan.inertia.ratio[step], plan.inertia.time[step]
        slowest = plan.natural_frequencies[0]
        words = f"up to {ratio:.2g} times the weight, at {when:.3g} s"
        print_plain(console, f"  inertia left out: {words}; the trunk swings at {slowest:.2g} Hz")

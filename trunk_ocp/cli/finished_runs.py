"""Commands about a finished run: `trunk-ocp explain`, `view` and `convert`."""

from __future__ import annotations

import json
import sys
import webbrowser
from collections.abc import Callable
from pathlib import Path

import click
from rich.console import Console

from .._support.toml_files import printable
from ..analysis.bound_sensitivity import effects
from ..analysis.diagnosis import explain, save_diagnosis
from ..errors import InputError
from ..planning.plan import Plan, Status
from ..planning.results_folder import hashes
from ..planning.storage import SOLUTION, finite
from .commands import resume_command
from .common import clean_errors, finished, tell, verdict
from .tables import findings, history_table

RELAXED = "If a bound were relaxed by 1 % (one of 0: as given), all else planned anew around it:"


@click.command("explain")
@click.argument("run", metavar="PROBLEM|DIR", default="pick-fruit")
@click.option("--json", "as_json", is_flag=True, help="Print it as JSON, and no more.")
def explain_run(run: str, as_json: bool) -> None:
    """Say why a finished run is what it is.

    Of a plan that failed: which constraints do not hold, where and by how much, which bounds
    would have to give, how the solve went, what to try next. Of a solved one: what it leans on,
    and what a little more of each bound would bring. It is kept as diagnosis.json.
    """
    console = Console(quiet=as_json, highlight=False)
    with clean_errors():
        _, plans = finished(run)
        told = {}
        for folder, plan in plans.items():
            with console.status(f"{plan.mode}: asking each bound what it costs"):
                diagnosis = explain(plan)
            save_diagnosis(diagnosis, folder)
            told[folder.name] = diagnosis.as_json()
            verdict(console, plan)
            for line in findings(diagnosis):
                console.print(line, soft_wrap=True)
            command = plan.options.get("command")
            if plan.status is Status.INTERRUPTED and isinstance(command, dict):
                tell(console, f"Resume with: {resume_command(command)}")
            if diagnosis.history:
                console.print(history_table(diagnosis))
            if sentences := effects(diagnosis.responses, plan.motion.trunk.length):
                console.print(RELAXED)
                for sentence in sentences:
                    tell(console, f"    {sentence}")
        if as_json:
            click.echo(json.dumps(finite(told), indent=2))
        sys.exit(max(plan.status.exit_code for plan in plans.values()))


@click.command("view")
@click.argument("run", metavar="PROBLEM|DIR", default="pick-fruit")
@click.option("--no-browser", is_flag=True, help="Only write the page and say where it is.")
def view(run: str, no_browser: bool) -> None:
    """Open the page of a finished run in a browser: turn the trunk, play, pick muscles.

    It is one file, motion.html, that needs neither server nor network.
    """
    from ..viewer import write_page
    from .draw_run import PAGE

    with clean_errors():
        folder, plans = finished(run)
        plans = _together(plans)
        pair = [plan for plan in plans.values() if plan.mode != "receding"] or [*plans.values()]
        order = sorted(pair, key=lambda plan: plan.mode == "horizon")  # as in solve-motion
        page = write_page(order[:2], folder / PAGE).resolve()
        click.echo(printable(str(page)))
        if not no_browser and not webbrowser.open(page.as_uri()):
            click.echo("No browser was found here; open this file in one.", err=True)


def _together(plans: dict[Path, Plan]) -> dict[Path, Plan]:
    """Plans of the problem and anatomy of the newest one; says which others are left out."""
    newest = max(plans, key=lambda folder: (folder / SOLUTION).stat().st_mtime_ns)
    wanted = hashes(plans[newest].motion)
    kept = {folder: plan for folder, plan in plans.items() if hashes(plan.motion) == wanted}
    for folder in plans.keys() - kept.keys():
        told = f"{folder}: is of another problem or anatomy than {newest}, and not shown with it."
        click.echo(printable(told), err=True)
    return kept


@click.command("convert")
@click.argument("run", metavar="PROBLEM|DIR", default="pick-fruit")
@click.option(
    "--to",
    "kinds",
    type=click.Choice(["glb", "vtk", "sto"]),
    multiple=True,
    help="Only this; may be repeated.  [default: all]",
)
@click.option("--anyway", is_flag=True, help="Even what is not solved and verified.")
def convert(run: str, kinds: tuple[str, ...], anyway: bool) -> None:
    """Write a finished run for other programs.

    motion.glb is an animation for Blender and other viewers, vtk/ has a file for each time step
    for ParaView, activations.sto is for OpenSim. They go beside the results of each plan.
    """
    from ..motion_files import write_glb, write_sto, write_vtk

    writers: dict[str, Callable[[Plan, Path], object]] = {
        "glb": lambda plan, folder: write_glb(plan, folder / "motion.glb"),
        "vtk": lambda plan, folder: write_vtk(plan, folder / "vtk"),
        "sto": lambda plan, folder: write_sto(plan, folder / "activations.sto"),
    }
    with clean_errors():
        _, plans = finished(run)
        for folder, plan in plans.items():
            if plan.status is not Status.SOLVED and not anyway:
                raise InputError(
                    f"{folder}: {plan.status.value}; expected a solved plan. See why with "
                    f"trunk-ocp explain {run}, or convert it --anyway."
                )
        for folder, plan in plans.items():
            for kind in kinds or writers:
                writers[kind](plan, folder)
            click.echo(printable(f"{folder}/: {', '.join(kinds or writers)}"))

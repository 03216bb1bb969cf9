"""Command line: `solve-motion` and `trunk-ocp`."""

from __future__ import annotations

import json
import logging
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import click
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from .anatomy import load_anatomy
from .checkpoint import FILE, Checkpoint
from .command import clean_errors, tell, verdict
from .comparison import compare
from .diagnosis import explain
from .errors import InputError
from .exporting import export_model
from .files import alone, write
from .interrupts import INTERRUPTED, Interrupts
from .motion import Motion, load_motion
from .output import standard_output
from .planner import Options, mode_of, plan_motion
from .problem_file import problem_schema
from .questions import compare_ways, many_starts, redundant, survey_limits
from .reporting import Reporter
from .results_folder import default_folder, set_aside, sign
from .runs import convert, explain_run, view
from .screen import (
    Screen,
    comparison_table,
    findings,
    rank_table,
    sign_table,
    step_table,
)
from .solution import Plan, Status
from .solver import check_linear_solver
from .storage import activations_table, save_diagnosis, save_plan, summary

# Where it may not keep its settings it makes a folder for them; nobody needs to know.
logging.getLogger("matplotlib").setLevel(logging.ERROR)


@click.command("solve")
@click.version_option(package_name="trunk_ocp")
@click.argument("problem", default="pick-fruit")
@click.option(
    "--mode",
    type=click.Choice(["horizon", "sequential", "both"]),
    default="horizon",
    show_default=True,
    help="Plan all time steps as one programme, one step after the other, or both ways.",
)
@click.option(
    "--lookahead",
    type=click.IntRange(min=1),
    metavar="H",
    help="Plan H time steps at a time (a receding horizon); instead of --mode.",
)
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    metavar="DIR",
    help="Where results go.  [default: results/PROBLEM]",
)
@click.option("--linear-solver", default="mumps", show_default=True, help="Linear solver of Ipopt.")
@click.option(
    "--max-iterations",
    type=click.IntRange(min=1),
    default=1000,
    show_default=True,
    help="Most iterations of one solve.",
)
@click.option(
    "--starts",
    type=click.IntRange(min=1),
    default=1,
    show_default=True,
    help="Solve a horizon from N starts and keep the best: the sequential plan, the passive "
    "trunk, random ones.",
    metavar="N",
)
@click.option("--resume", is_flag=True, help="Go on with an unfinished run, from its last window.")
@click.option("--no-figures", is_flag=True, help="Draw no figures and no page.")
@click.option("--film", is_flag=True, help="Make a film as well: half a minute or more.")
@click.option("--quiet", is_flag=True, help="Print nothing but what went wrong.")
@click.option("--json", "as_json", is_flag=True, help="Print the summary as JSON, and no more.")
def solve(
    problem: str,
    mode: str,
    lookahead: int | None,
    out: Path | None,
    linear_solver: str,
    max_iterations: int,
    starts: int,
    resume: bool,
    no_figures: bool,
    film: bool,
    quiet: bool,
    as_json: bool,
) -> None:
    """Plan a motion: which muscles contract when, and how the head turns.

    PROBLEM is pick-fruit (the default), lift-log, lift-log-asymmetric, or a problem file of
    your own.

    Exit codes: 0 solved and verified; 2 bad usage or problem file, or files that cannot be
    written; 3 not converged, not verified, unstable, or a target out of reach (what was reached
    is saved and marked); 4 interrupted (the best so far is saved).
    """
    context = click.get_current_context()
    source = context.get_parameter_source("mode")
    if lookahead is not None and source is not click.core.ParameterSource.DEFAULT:
        raise click.UsageError("give --mode or --lookahead, not both.")
    output = standard_output()
    console = Console(file=output, quiet=quiet or as_json, highlight=False)
    command = json.loads(json.dumps(context.params, default=str))
    with Interrupts() as interrupts, clean_errors():
        motion = load_motion(problem)
        for warning in motion.warnings:
            click.echo(f"warning: {warning}", err=True)
        folder = out or default_folder(problem, motion)
        check_linear_solver(linear_solver)
        options = Options(linear_solver=linear_solver, max_iterations=max_iterations, starts=starts)
        checkpoints = _checkpoints(motion, mode, lookahead, folder, resume)
        with alone(folder):
            with Screen(console, motion) as screen, interrupts.patience(screen):
                plans = _plans(motion, checkpoints, options, screen)
                finished = not screen.stop
                if not len(plans[0].x):
                    raise KeyboardInterrupt  # before the first step: what is saved stays
                plans = [
                    replace(plan, options=plan.options | {"command": command}) for plan in plans
                ]
                aside = set_aside(
                    folder, [(plan_folder(plan), plan, activations_table(plan)) for plan in plans]
                )
                figures = _save(plans, folder)
                if out is None:
                    sign(folder, problem, motion)
                if finished:
                    for checkpoint in checkpoints.values():
                        checkpoint.remove()
            for plan in plans:
                console.print(step_table(plan))
                verdict(console, plan)
                _tell(console, plan, folder / plan_folder(plan))
            if figures:
                console.print(comparison_table(figures))
            with _interrupted_drawing(console):
                if not no_figures and not interrupts.came:
                    _draw(plans, folder, console)
                if film and not interrupts.came:
                    for plan in plans:
                        _film(plan, folder / plan_folder(plan), console)
            earlier = aside.settle()
        if earlier is not None:
            tell(console, f"What was made from earlier plans is now in {earlier}/")
        if not finished:
            console.print("solve-motion --resume, with the same options, goes on from here.")
        tell(console, f"Results are in {folder}/")
        for plan in plans if quiet else []:
            if plan.status is not Status.SOLVED:
                click.echo(f"{motion.name}, {plan.mode}: {plan.status.value}", err=True)
        if as_json:
            reports = {plan_folder(plan): summary(plan) for plan in plans}
            click.echo(json.dumps(reports, indent=2), file=output)
        codes = [plan.status.exit_code for plan in plans]
        sys.exit(INTERRUPTED if interrupts.came else max(codes))


def _save(plans: list[Plan], folder: Path) -> dict[str, dict[str, Any]]:
    """Write plans to their folders; of two plans, their measures as well, which are returned."""
    for plan in plans:
        save_plan(plan, folder / plan_folder(plan))
    figures = compare(*plans) if len(plans) == 2 else {}
    if figures:
        write(folder / "comparison.json", json.dumps(figures, indent=2) + "\n")
    return figures


def plan_folder(plan: Plan) -> str:
    """Name of a plan's folder: its mode, with the lookahead of a receding horizon."""
    return _folder_name(plan.mode, plan.lookahead)


def _folder_name(mode: str, lookahead: int) -> str:
    return f"receding-{lookahead}" if mode == "receding" else mode


def _checkpoints(
    motion: Motion, mode: str, lookahead: int | None, folder: Path, resume: bool
) -> dict[int | None, Checkpoint]:
    """Checkpoints of the plans to make, one after the other, by their lookahead.

    Raises
    ------
    InputError
        If a run is to be resumed where there is none.
    """
    wanted: dict[str, list[int | None]] = {"sequential": [1], "horizon": [None], "both": [1, None]}
    lookaheads = wanted[mode] if lookahead is None else [lookahead]
    checkpoints = {
        h: Checkpoint(folder / _folder_name(*mode_of(motion, h)) / FILE) for h in lookaheads
    }
    if not resume:
        return checkpoints
    there = [checkpoint for checkpoint in checkpoints.values() if checkpoint.exists]
    if not there:
        raise InputError(
            f"{folder}: there is nothing to resume; expected an unfinished run of this problem and "
            "mode here. Name its folder with --out, or run without --resume to start anew."
        )
    for checkpoint in there:
        checkpoint.resume = True
    return checkpoints


def _plans(
    motion: Motion,
    checkpoints: dict[int | None, Checkpoint],
    options: Options,
    reporter: Reporter,
) -> list[Plan]:
    """Plans by their lookahead; a second one starts from the first."""
    plans: list[Plan] = []
    for lookahead, checkpoint in checkpoints.items():
        start = plans[-1] if plans else None
        plan = plan_motion(motion, lookahead, options, reporter, start, checkpoint, throw=False)
        plans.append(plan)
        if reporter.stop:
            break
    return plans


def _draw(plans: list[Plan], folder: Path, console: Console) -> None:
    """Figures of each plan, of two together, and the page to turn the trunk in."""
    from .drawing import draw_run  # matplotlib takes its time

    with console.status("drawing figures; Ctrl-C leaves them out"):
        page = draw_run(plans, [folder / plan_folder(plan) for plan in plans], folder)
    if page is not None:
        tell(console, f"Turn it in a browser: {page}")


def _film(plan: Plan, folder: Path, console: Console) -> None:
    """A film of one plan, with a bar that says how long it will take."""
    from .figures import write_film

    if not len(plan.x):
        return
    with Progress(
        TextColumn("film of the {task.description} plan"),
        BarColumn(),
        TextColumn("{task.completed} of {task.total} frames, still"),
        TimeRemainingColumn(),
        console=console,
    ) as bar:
        task = bar.add_task(plan.mode, total=None)
        paths = write_film(
            plan, folder, lambda done, total: bar.update(task, completed=done, total=total)
        )
    for path in paths:
        tell(console, f"Film: {path}")


@contextmanager
def _interrupted_drawing(console: Console) -> Iterator[None]:
    """Ctrl-C while drawing leaves the pictures out; the plans are saved already."""
    try:
        yield
    except KeyboardInterrupt:
        console.print("Stopped drawing; the plans are saved.")


def _tell(console: Console, plan: Plan, folder: Path) -> None:
    """What the plan leans on, or why it failed, on the screen and in its folder."""
    solved = plan.status is Status.SOLVED
    waiting = "solved; looking around" if solved else "looking for what stands in the way"
    with console.status(waiting):
        diagnosis = explain(plan, deep=not solved)
    save_diagnosis(diagnosis, folder)
    for line in findings(diagnosis, brief=True):
        console.print(line, soft_wrap=True)


@click.group()
@click.version_option(package_name="trunk_ocp")
def main() -> None:
    """Plan whole motions of a muscular trunk."""


@main.command("tables")
@click.option("--anatomy", default="asian-elephant", show_default=True, help="Name or file.")
def tables(anatomy: str) -> None:
    """Print what each muscle group does, and how strongly (the paper's Tables 2 and 3)."""
    console = Console(file=standard_output(), highlight=False)
    with clean_errors():
        trunk = load_anatomy(anatomy)
        if not trunk.muscles:
            click.echo(f"{trunk.name} has no muscles.")
            return
        console.print(sign_table(trunk))
        console.print(rank_table(trunk))


@main.command("schema")
def schema() -> None:
    """Print the JSON Schema of problem files, for editors."""
    click.echo(json.dumps(problem_schema(), indent=2))


main.add_command(solve)
for command in (explain_run, view, convert, export_model):
    main.add_command(command)
for command in (redundant, compare_ways, survey_limits, many_starts):
    main.add_command(command)

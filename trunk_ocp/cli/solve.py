"""What `solve-motion` and `trunk-ocp tables` do; their options are in commands."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from .._support.atomic_files import alone, write
from ..analysis.diagnosis import explain, save_diagnosis
from ..analysis.measures import compare
from ..errors import InputError
from ..model.anatomy import load_anatomy
from ..nlp.ipopt_options import check_linear_solver
from ..planning.checkpoint import FILE, Checkpoint
from ..planning.options import Options, mode_of
from ..planning.plan import Plan, Status
from ..planning.planner import plan_motion
from ..planning.results_folder import default_folder, modes, set_aside, set_unfinished_aside, sign
from ..planning.storage import activations_table, save_plan, summary
from ..problem.build import load_motion
from ..problem.motion import Motion
from ..reporting import Reporter
from .common import tell, verdict
from .ending import optional, warn
from .interrupts import INTERRUPTED, Interrupts
from .stdout import standard_output
from .tables import Screen, comparison_table, findings, rank_table, sign_table, step_table


def run_solve(
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
    resume_with: str,
) -> None:
    """Plan a motion, show and save what came of it, and end with its exit code."""
    context = click.get_current_context()
    source = context.get_parameter_source("mode")
    if lookahead is not None and source is not click.core.ParameterSource.DEFAULT:
        raise click.UsageError("give --mode or --lookahead, not both.")
    output = standard_output()
    console = Console(file=output, quiet=quiet or as_json, highlight=False)
    command = json.loads(json.dumps(context.params, default=str))
    with _interrupts(f"Resume with: {resume_with}") as interrupts:
        motion = load_motion(problem)
        for warning in motion.warnings:
            click.echo(f"warning: {warning}", err=True)
        folder = out or default_folder(problem, motion)
        check_linear_solver(linear_solver)
        options = Options(linear_solver=linear_solver, max_iterations=max_iterations, starts=starts)
        checkpoints = _checkpoints(motion, mode, lookahead, folder, resume)
        with alone(folder):
            if not resume:
                _keep_unfinished(folder, checkpoints.values(), console)
            with Screen(console, motion) as screen, interrupts.patience(screen):
                plans = _plans(motion, checkpoints, options, screen)
                finished = not screen.stop
                if not len(plans[0].x):
                    raise KeyboardInterrupt  # before the first step: what is saved stays
                plans = [
                    plan.with_record(options=plan.options | {"command": command}) for plan in plans
                ]
                tables = [(plan_folder(plan), plan, activations_table(plan)) for plan in plans]
                aside = set_aside(folder, tables, problem)
                sign(folder, problem, motion)
                figures = _save(plans, folder)
                for checkpoint in checkpoints.values() if finished else ():
                    checkpoint.remove()
            _show(plans, figures, folder, console)
            with _interrupted_drawing(console):
                if not no_figures and not interrupts.came:
                    _draw(plans, folder, console)
                if film and not interrupts.came:
                    _films(plans, folder, console)
            earlier = aside.settle()
        if earlier is not None:
            tell(console, f"What was made from earlier plans is now in {earlier}/")
        if not finished:
            tell(console, f"Resume with: {resume_with}")
        tell(console, f"Results are in {folder}/")
        for plan in plans if quiet else []:
            if plan.status is not Status.SOLVED:
                click.echo(f"{motion.name}, {plan.mode}: {plan.status.value}", err=True)
        if as_json:
            reports = {plan_folder(plan): summary(plan) for plan in plans}
            click.echo(json.dumps(reports, indent=2), file=output)
        codes = [plan.status.exit_code for plan in plans]
        sys.exit(INTERRUPTED if interrupts.came else max(codes))


@contextmanager
def _interrupts(hint: str) -> Iterator[Interrupts]:
    """Those of the command, with what to do after one that ends at once."""
    interrupts = Interrupts.current or Interrupts()
    interrupts.hint = hint
    yield interrupts


def _keep_unfinished(folder: Path, checkpoints: Iterable[Checkpoint], console: Console) -> None:
    """Move aside what unfinished runs left, as new ones begin in their place, and say so."""
    files = [path for checkpoint in checkpoints for path in checkpoint.files()]
    kept = set_unfinished_aside(folder, files)
    if kept is not None:
        tell(
            console,
            f"An unfinished run was here, which --resume goes on with; its file is now in {kept}/",
        )


def _save(plans: list[Plan], folder: Path) -> dict[str, dict[str, Any]]:
    """Write plans to their folders; of two plans, their measures as well, which are returned."""
    for plan in plans:
        save_plan(plan, folder / plan_folder(plan))
    figures: dict[str, dict[str, Any]] = {}
    if len(plans) == 2:
        with optional("the plans are saved, but could not be compared"):
            figures = compare(*plans)
    if figures:
        write(folder / "comparison.json", json.dumps(figures, indent=2) + "\n")
    return figures


def _show(
    plans: list[Plan], figures: dict[str, dict[str, Any]], folder: Path, console: Console
) -> None:
    """Print what came of each plan, and of two of them side by side."""
    for plan in plans:
        console.print(step_table(plan))
        verdict(console, plan)
        with optional(f"the {plan.mode} plan is saved, but not its diagnosis"):
            _tell(console, plan, folder / plan_folder(plan))
    if figures:
        console.print(comparison_table(figures))


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
            f"mode here. {_unfinished_modes(folder)}Name its folder with --out, or run without "
            "--resume to start anew."
        )
    for checkpoint in there:
        checkpoint.resume = True
    return checkpoints


def _unfinished_modes(folder: Path) -> str:
    """A sentence with the options that resume the unfinished runs of a folder; empty if none."""
    options = []
    for place in modes(folder):
        if Checkpoint(place / FILE).exists:
            ahead = place.name.removeprefix("receding-")
            options.append(f"--mode {ahead}" if ahead == place.name else f"--lookahead {ahead}")
    return f"Unfinished here: resume with {' or '.join(options)}. " if options else ""


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
    from .draw_run import draw_run  # matplotlib takes its time

    with console.status("drawing figures; Ctrl-C leaves them out"):
        drawn = draw_run(plans, [folder / plan_folder(plan) for plan in plans], folder)
    for sentence in drawn.failed:
        warn(f"{sentence} The plans are saved.")
    if drawn.page is not None:
        tell(console, f"Turn it in a browser: {drawn.page}")


def _films(plans: list[Plan], folder: Path, console: Console) -> None:
    for plan in plans:
        with optional(f"could not make the film of the {plan.mode} plan"):
            _film(plan, folder / plan_folder(plan), console)


def _film(plan: Plan, folder: Path, console: Console) -> None:
    """A film of one plan, with a bar that says how long it will take."""
    from ..figures import write_film

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


def print_tables(anatomy: str) -> None:
    """Print the paper's Tables 2 and 3 of an anatomy."""
    output = standard_output()
    console = Console(file=output, highlight=False)
    trunk = load_anatomy(anatomy)
    if trunk.muscles:
        console.print(sign_table(trunk))
        console.print(rank_table(trunk))
    else:
        click.echo(f"{trunk.name} has no muscles.")
    output.check()

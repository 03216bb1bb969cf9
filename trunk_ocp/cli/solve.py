"""The work of `solve-motion` and `trunk-ocp tables`; their options are in `commands`."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click
from rich.console import Console

from .._support.atomic_files import alone, write
from ..analysis.diagnosis import explain, save_diagnosis
from ..analysis.measures import compare
from ..errors import InputError
from ..model.anatomy import load_anatomy
from ..nlp.ipopt_options import check_linear_solver
from ..planning.checkpoint import FILE, Checkpoint
from ..planning.options import Options, mode_of
from ..planning.plan import Plan
from ..planning.planner import plan_motion
from ..planning.results_folder import (
    Aside,
    default_folder,
    modes,
    set_aside,
    set_unfinished_aside,
    sign,
)
from ..planning.status import Status
from ..planning.storage import save_plan, summary
from ..planning.tables import activations_table
from ..problem.motion import Motion
from ..reporting import Reporter
from .common import load_problem, print_outcome, print_plain
from .error_messages import warn, warn_on_failure
from .exit_codes import INTERRUPTED
from .interrupts import Interrupts
from .progress import ProgressDisplay, progress_bar
from .safe_streams import standard_output
from .tables import comparison_table, finding_lines, rank_table, sign_table, step_table


def run_solve(
    problem: str,
    mode: str,
    lookahead: int | None,
    contact: str | None,
    effort: float | None,
    rate: float | None,
    head_effort: float | None,
    out: Path | None,
    options: Options,
    resume: bool,
    figures: str,
    film: bool,
    quiet: bool,
    as_json: bool,
    resume_command: str,
) -> None:
    """Plan a motion, save and show the plans, and exit with the code of the worst one.

    `figures` is "none", "main" or "all".
    """
    console = Console(file=standard_output(), quiet=quiet or as_json, highlight=False)
    interrupts = Interrupts.current or Interrupts()
    interrupts.hint = f"Resume with: {resume_command}"
    motion = load_problem(problem, contact)
    if (effort, rate, head_effort) != (None, None, None):
        motion = motion.weighted(effort, rate, head_effort)
    for warning in motion.warnings:
        warn(warning)
    folder = out or default_folder(problem, motion)
    check_linear_solver(options.linear_solver)
    checkpoints = _checkpoints(motion, mode, lookahead, folder, resume)
    with alone(folder):
        if not resume:
            _set_unfinished_aside(folder, checkpoints.values(), console)
        with ProgressDisplay(console, motion) as display, interrupts.graceful_stop(display):
            plans = _plan(motion, checkpoints, options, display)
            finished = not display.stop
            aside, measures = save_plans(plans, folder, problem)
            for checkpoint in checkpoints.values() if finished else ():
                checkpoint.remove()
        _show(plans, measures, folder, console)
        with _stop_drawing_on_interrupt(console):
            if figures != "none" and not interrupts.received:
                with warn_on_failure("could not draw the figures; the plans are saved"):
                    _draw(plans, folder, figures == "all", console)
            if film and not interrupts.received:
                _films(plans, folder, console)
        earlier = aside.settle()
    if earlier is not None:
        print_plain(console, f"Files made from earlier plans are now in {earlier}/")
    if not finished:
        print_plain(console, interrupts.hint)
    print_plain(console, f"Results are in {folder}/")
    _report(plans, quiet, as_json)
    codes = [plan.status.exit_code for plan in plans]
    sys.exit(INTERRUPTED if interrupts.received else max(codes))


def _report(plans: list[Plan], quiet: bool, as_json: bool) -> None:
    """Print the summary as JSON; if quiet, name plans that are not solved on standard error."""
    for plan in plans if quiet else []:
        if plan.status is not Status.SOLVED:
            click.echo(f"{plan.motion.name}, {plan.mode}: {plan.status.value}", err=True)
    if as_json:
        reports = {plan_folder(plan): summary(plan) for plan in plans}
        click.echo(json.dumps(reports, indent=2), file=standard_output())


# --- planning ------------------------------------------------------------------------------


def _checkpoints(
    motion: Motion, mode: str, lookahead: int | None, folder: Path, resume: bool
) -> dict[int | None, Checkpoint]:
    """Checkpoints of the plans to make, by lookahead and in order.

    Raises
    ------
    InputError
        If there is no unfinished run to resume.
    """
    by_mode: dict[str, list[int | None]] = {"sequential": [1], "horizon": [None], "both": [1, None]}
    lookaheads = by_mode[mode] if lookahead is None else [lookahead]
    checkpoints = {
        h: Checkpoint(folder / _folder_name(*mode_of(motion, h)) / FILE) for h in lookaheads
    }
    if not resume:
        return checkpoints
    existing = [checkpoint for checkpoint in checkpoints.values() if checkpoint.exists]
    if not existing:
        raise InputError(
            f"{folder}: nothing to resume; expected an unfinished run of this problem and mode "
            f"here. {_unfinished_modes(folder)}Name its folder with --out, or start over without "
            "--resume."
        )
    for checkpoint in existing:
        checkpoint.resume = True
    return checkpoints


def _unfinished_modes(folder: Path) -> str:
    """A sentence with the options that resume the unfinished runs in a folder; empty if none."""
    options = []
    for place in modes(folder):
        if Checkpoint(place / FILE).exists:
            ahead = place.name.removeprefix("receding-")
            options.append(f"--mode {ahead}" if ahead == place.name else f"--lookahead {ahead}")
    return f"To resume the unfinished run here, add {' or '.join(options)}. " if options else ""


def _set_unfinished_aside(
    folder: Path, checkpoints: Iterable[Checkpoint], console: Console
) -> None:
    """Keep the checkpoints of unfinished runs that this run would overwrite, and say where."""
    files = [path for checkpoint in checkpoints for path in checkpoint.files()]
    aside = set_unfinished_aside(folder, files)
    if aside is not None:
        print_plain(
            console,
            f"This folder had an unfinished run, which --resume would have continued; its "
            f"checkpoint is now in {aside}/",
        )


def _plan(
    motion: Motion,
    checkpoints: dict[int | None, Checkpoint],
    options: Options,
    reporter: Reporter,
) -> list[Plan]:
    """Plans by lookahead, with the command recorded in each; a second starts from the first.

    Raises
    ------
    KeyboardInterrupt
        If stopped before the first time step was planned: results of earlier runs then stay.
    """
    plans: list[Plan] = []
    for lookahead, checkpoint in checkpoints.items():
        start = plans[-1] if plans else None
        plan = plan_motion(motion, lookahead, options, reporter, start, checkpoint, throw=False)
        plans.append(plan)
        if reporter.stop:
            break
    if not len(plans[0].x):
        raise KeyboardInterrupt
    parameters = click.get_current_context().params
    command = json.loads(json.dumps(parameters, default=str))
    return [plan.with_record(options=plan.options | {"command": command}) for plan in plans]


# --- results -------------------------------------------------------------------------------


def plan_folder(plan: Plan) -> str:
    """Name of a plan's folder: its mode, with the lookahead of a receding horizon."""
    return _folder_name(plan.mode, plan.lookahead)


def _folder_name(mode: str, lookahead: int) -> str:
    return f"receding-{lookahead}" if mode == "receding" else mode


def save_plans(
    plans: list[Plan], folder: Path, problem: str
) -> tuple[Aside, dict[str, dict[str, Any]]]:
    """Write plans, and the measures of two plans, to a folder.

    Returns what was moved aside because these plans make it out of date, and the measures.
    """
    tables = [(plan_folder(plan), plan, activations_table(plan)) for plan in plans]
    aside = set_aside(folder, tables, problem)
    sign(folder, problem, plans[0].motion)
    for plan in plans:
        save_plan(plan, folder / plan_folder(plan))
    measures: dict[str, dict[str, Any]] = {}
    if len(plans) == 2:
        with warn_on_failure("the plans are saved, but could not be compared"):
            measures = compare(*plans)
    if measures:
        write(folder / "comparison.json", json.dumps(measures, indent=2) + "\n")
    return aside, measures


def _show(
    plans: list[Plan], measures: dict[str, dict[str, Any]], folder: Path, console: Console
) -> None:
    """Print each plan with its diagnosis, and two plans side by side."""
    for plan in plans:
        console.print(step_table(plan))
        print_outcome(console, plan)
        with warn_on_failure(f"the {plan.mode} plan is saved, but not its diagnosis"):
            _diagnose(console, plan, folder / plan_folder(plan))
    if measures:
        console.print(comparison_table(measures))


def _diagnose(console: Console, plan: Plan, folder: Path) -> None:
    """Print and save why a plan failed, or what limits it."""
    solved = plan.status is Status.SOLVED
    with console.status("checking the plan" if solved else "looking for the cause of the failure"):
        diagnosis = explain(plan, deep=not solved)
    save_diagnosis(diagnosis, folder)
    for line in finding_lines(diagnosis, brief=True):
        console.print(line, soft_wrap=True)


# --- figures -------------------------------------------------------------------------------


@contextmanager
def _stop_drawing_on_interrupt(console: Console) -> Iterator[None]:
    """Block that Ctrl-C ends without ending the command, as the plans are already saved."""
    try:
        yield
    except KeyboardInterrupt:
        console.print("Stopped drawing; the plans are saved.")


def _draw(plans: list[Plan], folder: Path, everything: bool, console: Console) -> None:
    """Draw each plan and both together, write the interactive page, and list the files."""
    from .run_figures import draw_run, file_lines  # imports matplotlib, which is slow

    with console.status("drawing figures; Ctrl-C skips them"):
        folders = [folder / plan_folder(plan) for plan in plans]
        drawn = draw_run(plans, folders, folder, everything)
    for sentence in drawn.failures:
        warn(f"{sentence} The plans are saved.")
    for line in file_lines(drawn.files):
        print_plain(console, line)
    if drawn.files and not everything:
        print_plain(console, "--figures all also draws muscles and anatomy, and everything as PDF.")
    if drawn.page is not None:
        print_plain(console, f"Interactive page: {drawn.page}")


def _films(plans: list[Plan], folder: Path, console: Console) -> None:
    for plan in plans:
        with warn_on_failure(f"could not make the film of the {plan.mode} plan"):
            _film(plan, folder / plan_folder(plan), console)


def _film(plan: Plan, folder: Path, console: Console) -> None:
    """Write the film of one plan, with a progress bar."""
    from ..figures import write_film

    if not len(plan.x):
        return
    with progress_bar(console, "film of the {task.description} plan", "frames") as bar:
        task = bar.add_task(plan.mode, total=None)
        paths = write_film(
            plan, folder, lambda done, total: bar.update(task, completed=done, total=total)
        )
    for path in paths:
        print_plain(console, f"Film: {path}")


# --- trunk-ocp tables ----------------------------------------------------------------------


def print_tables(anatomy: str) -> None:
    """Print the paper's Tables 2 and 3 for an anatomy."""
    output = standard_output()
    console = Console(file=output, highlight=False)
    trunk = load_anatomy(anatomy)
    if trunk.muscles:
        console.print(sign_table(trunk))
        console.print(rank_table(trunk))
    else:
        click.echo(f"{trunk.name} has no muscles.")
    output.check()

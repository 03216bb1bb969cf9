"""Commands that study a motion: `trunk-ocp redundancy`, `compare`, `survey` and `optima`."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import click
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from .._support.atomic_files import write
from ..analysis.lookahead_study import compare_lookaheads, smoothness_tradeoff, survey_limits
from ..analysis.multistart import find_optima
from ..analysis.redundancy import AblationResult, ablate_muscles, analyze_redundancy
from ..planning.plan import Plan
from ..planning.results_folder import default_folder, set_figures_aside, sign
from ..planning.storage import finite
from ..problem.motion import Motion
from ..reporting import Reporter
from .common import load_problem, load_run, print_plain
from .error_messages import warn_on_failure
from .interrupts import Interrupts
from .option_types import Number, Numbers, contact_option, out_option
from .tables import foresight_table, optima_table, redundancy_table, survey_table, version_table

no_figures_option = click.option("--no-figures", is_flag=True, help="Skip the figures.")
lookaheads_option = click.option(
    "--lookaheads",
    type=Numbers("lookahead"),
    metavar="H,...",
    help="Only these lookaheads, such as 1,2,5.  [default: all]",
)


@click.command("redundancy")
@click.argument("run", metavar="PROBLEM|DIR", default="pick-fruit")
@click.option(
    "--needed", "ablate", is_flag=True, help="Also replan the motion without each muscle."
)
@out_option("Folder for results, with a subfolder per plan.  [default: beside the plans]")
@no_figures_option
def redundancy_command(run: str, ablate: bool, out: Path | None, no_figures: bool) -> None:
    """Show which muscles a finished run needs, and what others could replace.

    Computes the range of each muscle's activation that leaves the motion unchanged, and the same
    motion with least effort, least peak activation and fewest muscles; with --needed also how
    much worse the motion gets without each muscle. Writes redundancy.json and figures/redundancy.
    Takes a few seconds; with --needed, half a minute or more.
    """
    console = Console(highlight=False)
    folder, plans = load_run(run)
    for plan_folder, plan in plans.items():
        place = out / plan_folder.relative_to(folder) if out else plan_folder
        with console.status(f"{plan.mode}: ranges of {len(plan.motion.trunk.muscles)} muscles"):
            result = analyze_redundancy(plan)
        if ablate and plan.auxiliary:
            console.print(f"{plan.mode}: skipped --needed, which applies to horizon plans only.")
        elif ablate:
            result = replace(result, needs=_ablation(plan, console))
        write(place / "redundancy.json", json.dumps(result.as_dict(), indent=2) + "\n")
        console.print(redundancy_table(result))
        console.print(version_table(result))
        if not no_figures:
            with warn_on_failure("could not draw the ranges"):
                from ..figures import FORMATS
                from ..figures.redundancy import draw_redundancy

                draw_redundancy(result, place / "figures", FORMATS)
        else:
            set_figures_aside(place / "figures", "redundancy")
        print_plain(console, f"Results are in {place}/")


def _ablation(plan: Plan, console: Console) -> tuple[AblationResult, ...]:
    """The motion replanned without each muscle, with a line that shows progress."""
    reporter, interrupts = Reporter(), Interrupts.current or Interrupts()
    with (
        console.status("planning without each muscle") as line,
        interrupts.graceful_stop(reporter),
    ):

        def show(done: int, total: int, result: AblationResult) -> None:
            line.update(f"planning without each muscle: {done} of {total}")

        return ablate_muscles(plan, progress=show, reporter=reporter)


def _study_options(command: Callable[..., None]) -> Callable[..., None]:
    """Add the options that all studies have."""
    for option in (
        click.option("--json", "as_json", is_flag=True, help="Print only the results, as JSON."),
        click.option(
            "--processes",
            type=Number("processes"),
            metavar="N",
            help="Number of plans to solve in parallel.  [default: one per core]",
        ),
        out_option("Folder for results.  [default: results/PROBLEM/COMMAND]"),
        contact_option,
    ):
        command = option(command)
    return command


def _study_folder(problem: str, motion: Motion, out: Path | None, command: str) -> Path:
    return out or default_folder(problem, motion) / command


@contextmanager
def _plan_progress(
    console: Console, title: str
) -> Iterator[tuple[Reporter, Callable[[int, int], None]]]:
    """A progress bar for many plans; Ctrl-C stops them all."""
    bar = Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.completed} of {task.total} plans, time left"),
        TimeRemainingColumn(),
        console=console,
        transient=True,
        disable=console.quiet,
    )
    reporter = Reporter()
    interrupts = Interrupts.current or Interrupts()
    with interrupts.graceful_stop(reporter), bar:
        task = bar.add_task(title, total=None)
        yield reporter, lambda done, total: bar.update(task, completed=done, total=total)


@click.command("compare")
@click.argument("problem", default="pick-fruit")
@click.option(
    "--max-activation",
    type=Number("activation limit"),
    metavar="A",
    help="Limit every contraction to A.",
)
@click.option(
    "--max-rate",
    type=Number("rate limit"),
    metavar="R",
    help="Limit the rate of change of every activation to R per second.",
)
@lookaheads_option
@no_figures_option
@_study_options
def compare_command(
    problem: str,
    max_activation: float | None,
    max_rate: float | None,
    lookaheads: list[int] | None,
    no_figures: bool,
    contact: str | None,
    out: Path | None,
    processes: int | None,
    as_json: bool,
) -> None:
    """Compare planning step by step, as in the paper, with planning ahead.

    Plans the motion the paper's way (each time step on its own, tracking cost only, with the
    feasible sets of its appendix B), the same way with the cost used everywhere else, and then
    with every lookahead from one time step to all of them, under equal bounds. Limits on strength
    and speed make planning ahead matter more.

    Writes comparison.json, with units and definitions, and a figure. Takes 15 seconds for lift-log
    and about a minute for pick-fruit on one core.

    Exit codes: 0 if the horizon plan is solved and verified; otherwise as for solve-motion.
    """
    console = Console(quiet=as_json, highlight=False)
    motion = load_problem(problem, contact)
    folder = _study_folder(problem, motion, out, "compare")
    with _plan_progress(console, motion.name) as (reporter, done):
        result = compare_lookaheads(
            motion, max_activation, max_rate, lookaheads, None, processes, reporter, done
        )
    data = finite(result.as_dict())
    if out is None:
        sign(folder.parent, problem, motion)
    write(folder / "comparison.json", json.dumps(data, indent=2) + "\n")
    console.print(foresight_table(result))
    if no_figures:
        set_figures_aside(folder, "comparison")
    else:
        with warn_on_failure("could not draw the comparison"):
            from ..figures import draw_foresight

            draw_foresight(result, folder)
    print_plain(console, f"Results are in {folder}/")
    if as_json:
        click.echo(json.dumps(data, indent=2))
    sys.exit(result.curve.best.status.exit_code)


@click.command("survey")
@click.argument("problem", default="pick-fruit")
@click.option(
    "--max-activations",
    type=Numbers("activation limit", none="none"),
    default="none",
    metavar="A,...",
    help="Limits on every contraction, such as none,2.5,2.  [default: none]",
)
@click.option(
    "--max-rates",
    type=Numbers("rate limit", none="none"),
    default="none",
    metavar="R,...",
    help="Limits on the change of activations in 1/s, such as none,2,1.  [default: none]",
)
@lookaheads_option
@no_figures_option
@_study_options
def survey_command(
    problem: str,
    max_activations: list[float | None],
    max_rates: list[float | None],
    lookaheads: list[int] | None,
    no_figures: bool,
    contact: str | None,
    out: Path | None,
    processes: int | None,
    as_json: bool,
) -> None:
    """Find how many steps of lookahead suffice under limits on strength and speed.

    Repeats the lookaheads of trunk-ocp compare under every pair of limits. Also computes the
    trade-off between smoothness and accuracy, step by step and with the whole horizon, as the
    weight on activation rates grows. Writes survey.json, front.json and their figures.

    Takes half a minute for lift-log and two minutes for pick-fruit on one core, and about as long
    as trunk-ocp compare for each further pair of limits.
    """
    console = Console(quiet=as_json, highlight=False)
    motion = load_problem(problem, contact)
    folder = _study_folder(problem, motion, out, "survey")
    with _plan_progress(console, f"{motion.name}, limits") as (reporter, done):
        cells = survey_limits(
            motion, max_activations, max_rates, lookaheads, None, processes, reporter, done
        )
    with _plan_progress(console, f"{motion.name}, smoothness") as (reporter, done):
        curve = smoothness_tradeoff(motion, processes=processes, reporter=reporter, done=done)
    cells, curve = finite(cells), finite(curve)
    if out is None:
        sign(folder.parent, problem, motion)
    write(folder / "survey.json", json.dumps(cells, indent=2) + "\n")
    write(folder / "front.json", json.dumps(curve, indent=2) + "\n")
    console.print(survey_table(cells))
    if no_figures:
        set_figures_aside(folder, f"foresight-{motion.name}", f"front-{motion.name}")
    else:
        from ..figures import draw_front, draw_survey

        with warn_on_failure("could not draw the survey"):
            draw_survey(cells, folder, ("pdf", "png"))
        with warn_on_failure("could not draw the smoothness trade-off"):
            draw_front(curve, folder, ("pdf", "png"))
    print_plain(console, f"Results are in {folder}/")
    if as_json:
        click.echo(json.dumps({"survey": cells, "front": curve}, indent=2))


@click.command("optima")
@click.argument("problem", default="pick-fruit")
@click.option(
    "--lookahead",
    type=Number("lookahead"),
    metavar="H",
    help="Time steps planned at a time; 1 is sequential.  [default: all]",
)
@click.option(
    "--starts",
    type=Number("random starts"),
    default=20,
    show_default=True,
    metavar="N",
    help="Number of random starts.",
)
@click.option(
    "--seed",
    type=Number("seed"),
    default=0,
    show_default=True,
    metavar="S",
    help="Seed of the random starts.",
)
@_study_options
def optima_command(
    problem: str,
    lookahead: int | None,
    starts: int,
    seed: int,
    contact: str | None,
    out: Path | None,
    processes: int | None,
    as_json: bool,
) -> None:
    """Look for better local optima than the reported plan, from many starts.

    Plans the same motion from N random starts, from the mirror image of the reported plan and
    from the passive trunk. Writes optima.json. Takes about a minute for the shipped motions on
    one core.
    """
    console = Console(quiet=as_json, highlight=False)
    motion = load_problem(problem, contact)
    folder = _study_folder(problem, motion, out, "optima")
    with _plan_progress(console, motion.name) as (reporter, done):
        result = find_optima(motion, lookahead, starts, seed, None, processes, reporter, done)
    data = finite(result.as_dict())
    if out is None:
        sign(folder.parent, problem, motion)
    write(folder / "optima.json", json.dumps(data, indent=2) + "\n")
    console.print(optima_table(result))
    print_plain(console, f"Results are in {folder}/")
    if as_json:
        click.echo(json.dumps(data, indent=2))

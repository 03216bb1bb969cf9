"""Questions about a motion: `trunk-ocp redundancy`, `compare`, `survey` and `optima`."""

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
from ..problem.motion import load_motion
from ..reporting import Reporter
from .common import finished, tell
from .ending import Command, optional
from .interrupts import Interrupts
from .option_types import Number, Numbers
from .tables import foresight_table, optima_table, redundancy_table, survey_table, version_table


@click.command("redundancy", cls=Command)
@click.argument("run", metavar="PROBLEM|DIR", default="pick-fruit")
@click.option("--needed", "ask", is_flag=True, help="Also plan without each muscle: minutes.")
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    metavar="DIR",
    help="Where results go, in a folder for each plan.  [default: beside the plans]",
)
@click.option("--no-figures", is_flag=True, help="Draw no figure.")
def redundant(run: str, ask: bool, out: Path | None, no_figures: bool) -> None:
    """Tell which muscles a finished run determines, and what the others could do.

    The range of each muscle that leaves the motion as it is, the same motion with least effort,
    least peak and fewest muscles, and with --needed how much worse it gets without each muscle.
    Writes redundancy.json and figures/redundancy.
    """
    console = Console(highlight=False)
    folder, plans = finished(run)
    for own, plan in plans.items():
        place = out / own.relative_to(folder) if out else own
        with console.status(f"{plan.mode}: ranges of {len(plan.motion.trunk.muscles)} muscles"):
            found = analyze_redundancy(plan)
        if ask and plan.near:
            console.print(f"{plan.mode}: --needed is for horizon plans; left out here.")
        elif ask:
            found = replace(found, needs=_needs(plan, console))
        write(place / "redundancy.json", json.dumps(found.as_dict(), indent=2) + "\n")
        console.print(redundancy_table(found))
        console.print(version_table(found))
        if not no_figures:
            with optional("could not draw the ranges"):
                from ..figures import FORMATS
                from ..figures.redundancy import draw_redundancy

                draw_redundancy(found, place / "figures", FORMATS)
        else:
            set_figures_aside(place / "figures", "redundancy")
        tell(console, f"Results are in {place}/")


def _needs(plan: Plan, console: Console) -> tuple[AblationResult, ...]:
    """What a motion is like without each muscle, with a line that says how far this is."""
    reporter, interrupts = Reporter(), Interrupts.current or Interrupts()
    with console.status("planning without each muscle") as line, interrupts.patience(reporter):

        def show(done: int, total: int, need: AblationResult) -> None:
            line.update(f"planning without each muscle: {done} of {total}")

        return ablate_muscles(plan, progress=show, reporter=reporter)


def _shared(command: Callable[..., None]) -> Callable[..., None]:
    """Options that several commands have: where results go, and how many processes work."""
    for option in (
        click.option("--json", "as_json", is_flag=True, help="Print it as JSON, and no more."),
        click.option(
            "--processes",
            type=Number("processes"),
            metavar="N",
            help="Plan N at a time.  [default: one for each core]",
        ),
        click.option(
            "--out",
            type=click.Path(file_okay=False, path_type=Path),
            metavar="DIR",
            help="Where results go.  [default: results/PROBLEM/COMMAND]",
        ),
    ):
        command = option(command)
    return command


@contextmanager
def _counting(console: Console, what: str) -> Iterator[tuple[Reporter, Callable[[int, int], None]]]:
    """A bar for many plans, and a Ctrl-C that ends them all."""
    bar = Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.completed} of {task.total} plans, still"),
        TimeRemainingColumn(),
        console=console,
        transient=True,
        disable=console.quiet,
    )
    reporter = Reporter()
    interrupts = Interrupts.current or Interrupts()
    with interrupts.patience(reporter), bar:
        task = bar.add_task(what, total=None)
        yield reporter, lambda done, total: bar.update(task, completed=done, total=total)


@click.command("compare", cls=Command)
@click.argument("problem", default="pick-fruit")
@click.option(
    "--max-activation",
    type=Number("activation limit"),
    metavar="A",
    help="Contract no muscle by more than A.",
)
@click.option(
    "--max-rate",
    type=Number("rate limit"),
    metavar="R",
    help="Change no activation faster than R per second, over each time step.",
)
@click.option(
    "--lookaheads",
    type=Numbers("lookahead"),
    metavar="H,...",
    help="Some only, such as 1,2,5.  [default: all]",
)
@click.option("--no-figures", is_flag=True, help="Draw no figure.")
@_shared
def compare_ways(
    problem: str,
    max_activation: float | None,
    max_rate: float | None,
    lookaheads: list[int] | None,
    no_figures: bool,
    out: Path | None,
    processes: int | None,
    as_json: bool,
) -> None:
    """Ask what foresight is worth: a motion planned the paper's way and with every lookahead.

    The paper's way: each time step on its own, by tracking only, with the feasible sets of its
    appendix B; and the same with the running cost of all other ways. Then 1 to all time steps at
    a time, under equal bounds. Limits on strength and speed make foresight matter more.

    DIR has comparison.json, with units and definitions, and a figure. Exit codes: 0 if the horizon
    is solved and verified, else as solve-motion's.
    """
    console = Console(quiet=as_json, highlight=False)
    motion = load_motion(problem)
    folder = out or default_folder(problem, motion) / "compare"
    with _counting(console, motion.name) as (reporter, done):
        result = compare_lookaheads(
            motion, max_activation, max_rate, lookaheads, None, processes, reporter, done
        )
    report = finite(result.as_dict())
    if out is None:
        sign(folder.parent, problem, motion)
    write(folder / "comparison.json", json.dumps(report, indent=2) + "\n")
    console.print(foresight_table(result))
    if no_figures:
        set_figures_aside(folder, "comparison")
    else:
        with optional("could not draw the comparison"):
            from ..figures import draw_foresight

            draw_foresight(result, folder)
    tell(console, f"Results are in {folder}/")
    if as_json:
        click.echo(json.dumps(report, indent=2))
    sys.exit(result.curve.best.status.exit_code)


@click.command("survey", cls=Command)
@click.argument("problem", default="pick-fruit")
@click.option(
    "--max-activations",
    type=Numbers("activation limit", none="none"),
    default="none",
    metavar="A,...",
    help="Such as none,2.5,2: in turn.",
)
@click.option(
    "--max-rates",
    type=Numbers("rate limit", none="none"),
    default="none",
    metavar="R,...",
    help="In 1/s, such as none,2,1.",
)
@click.option(
    "--lookaheads",
    type=Numbers("lookahead"),
    metavar="H,...",
    help="Some only, such as 1,2,5.  [default: all]",
)
@click.option("--no-figures", is_flag=True, help="Draw no figure.")
@_shared
def survey(
    problem: str,
    max_activations: list[float | None],
    max_rates: list[float | None],
    lookaheads: list[int] | None,
    no_figures: bool,
    out: Path | None,
    processes: int | None,
    as_json: bool,
) -> None:
    """Ask how many steps ahead suffice, under every pair of limits on strength and speed.

    And what smoothness costs, blind and with a horizon, as the weight of rates grows. DIR has
    survey.json, front.json and their figures.
    """
    console = Console(quiet=as_json, highlight=False)
    motion = load_motion(problem)
    folder = out or default_folder(problem, motion) / "survey"
    with _counting(console, f"{motion.name}, limits") as (reporter, done):
        cells = survey_limits(
            motion, max_activations, max_rates, lookaheads, None, processes, reporter, done
        )
    with _counting(console, f"{motion.name}, smoothness") as (reporter, done):
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

        with optional("could not draw the survey"):
            draw_survey(cells, folder, ("pdf", "png"))
        with optional("could not draw the front"):
            draw_front(curve, folder, ("pdf", "png"))
    tell(console, f"Results are in {folder}/")
    if as_json:
        click.echo(json.dumps({"survey": cells, "front": curve}, indent=2))


@click.command("optima", cls=Command)
@click.argument("problem", default="pick-fruit")
@click.option(
    "--lookahead", type=Number("lookahead"), metavar="H", help="1: sequential; default: horizon."
)
@click.option("--starts", type=Number("random starts"), default=20, show_default=True, metavar="N")
@click.option(
    "--seed",
    type=Number("seed"),
    default=0,
    show_default=True,
    metavar="S",
    help="Of the random starts.",
)
@_shared
def many_starts(
    problem: str,
    lookahead: int | None,
    starts: int,
    seed: int,
    out: Path | None,
    processes: int | None,
    as_json: bool,
) -> None:
    """Ask whether the reported plan is the best: the same motion from N random starts.

    And from its mirror image and the passive trunk. DIR has optima.json.
    """
    console = Console(quiet=as_json, highlight=False)
    motion = load_motion(problem)
    folder = out or default_folder(problem, motion) / "optima"
    with _counting(console, motion.name) as (reporter, done):
        found = find_optima(motion, lookahead, starts, seed, None, processes, reporter, done)
    report = finite(found.as_dict())
    if out is None:
        sign(folder.parent, problem, motion)
    write(folder / "optima.json", json.dumps(report, indent=2) + "\n")
    console.print(optima_table(found))
    tell(console, f"Results are in {folder}/")
    if as_json:
        click.echo(json.dumps(report, indent=2))

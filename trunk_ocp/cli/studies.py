"""Commands that study a motion: `trunk-ocp redundancy`, `compare`, `survey` and `optima`."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import wraps
from pathlib import Path
from typing import Any

import click
from rich.console import Console, Group
from rich.table import Table

from .._support.atomic_files import write
from ..analysis.lookahead_study import compare_lookaheads, smoothness_tradeoff, survey_limits
from ..analysis.multistart import find_optima
from ..analysis.redundancy.ablation import AblationResult, ablate_muscles
from ..analysis.redundancy.report import analyze_redundancy
from ..planning.plan import Plan
from ..planning.results_folder import default_folder, set_figures_aside, sign
from ..planning.storage import finite
from ..problem.motion import Motion
from ..reporting import Reporter
from .common import load_problem, load_run, print_plain
from .error_messages import warn_on_failure
from .interrupts import Interrupts
from .option_types import Numbers, contact_option, number_option, out_option
from .progress import progress_bar
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
                from ..figures.redundancy import draw_redundancy

                draw_redundancy(result, place / "figures")
        else:
            set_figures_aside(place / "figures", "redundancy")
        print_plain(console, f"Results are in {place}/")


def _ablation(plan: Plan, console: Console) -> tuple[AblationResult, ...]:
    """The motion replanned without each muscle, with a line that shows progress."""
    reporter, interrupts = Reporter(), Interrupts.current or Interrupts()
    title = "planning without each muscle"
    with console.status(title) as line, interrupts.graceful_stop(reporter):

        def show(done: int, total: int, result: AblationResult) -> None:
            line.update(f"{title}: {done} of {total}")

        return ablate_muscles(plan, progress=show, reporter=reporter)


@dataclass(frozen=True)
class Study:
    """A study of one motion: where its results go, and how it is run and reported.

    `in_results` says whether its folder is in that of the motion's other results. The console is
    quiet if the results are to be printed as JSON.
    """

    problem: str
    motion: Motion
    folder: Path
    in_results: bool
    processes: int | None
    console: Console

    @contextmanager
    def run(self, title: str = "") -> Iterator[dict[str, Any]]:
        """A progress bar for many plans; gives the arguments with which to make them.

        Ctrl-C stops them all.
        """
        reporter, interrupts = Reporter(), Interrupts.current or Interrupts()
        bar = progress_bar(self.console, "{task.description}", "plans", transient=True)
        with interrupts.graceful_stop(reporter), bar:
            task = bar.add_task(self.motion.name + title, total=None)
            yield {
                "processes": self.processes,
                "reporter": reporter,
                "done": lambda done, total: bar.update(task, completed=done, total=total),
            }

    def save(self, table: Table | Group, **results: Any) -> None:
        """Write each result to its file, and print the table."""
        if self.in_results:
            sign(self.folder.parent, self.problem, self.motion)
        for name, result in results.items():
            write(self.folder / f"{name}.json", json.dumps(result, indent=2) + "\n")
        self.console.print(table)

    def finish(self, result: Any) -> None:
        """Print where the results are, or the result itself."""
        print_plain(self.console, f"Results are in {self.folder}/")
        if self.console.quiet:
            click.echo(json.dumps(result, indent=2))


def _with_study(function: Callable[..., None]) -> Callable[..., None]:
    """Add the options that all studies have; the command gets them as a `Study`."""

    @contact_option
    @out_option("Folder for results.  [default: results/PROBLEM/COMMAND]")
    @number_option(
        "--processes",
        "processes",
        "N",
        "Number of plans to solve in parallel.  [default: one per core]",
    )
    @click.option("--json", "as_json", is_flag=True, help="Print only the results, as JSON.")
    @wraps(function)
    def command(
        problem: str,
        contact: str | None,
        out: Path | None,
        processes: int | None,
        as_json: bool,
        **options: Any,
    ) -> None:
        console, motion = Console(quiet=as_json, highlight=False), load_problem(problem, contact)
        name = function.__name__.removesuffix("_command")
        folder = out or default_folder(problem, motion) / name
        function(Study(problem, motion, folder, out is None, processes, console), **options)

    return command


@click.command("compare")
@click.argument("problem", default="pick-fruit")
@number_option("--max-activation", "activation limit", "A", "Limit every contraction to A.")
@number_option(
    "--max-rate", "rate limit", "R", "Limit the rate of change of every activation to R per second."
)
@lookaheads_option
@no_figures_option
@_with_study
def compare_command(
    study: Study,
    max_activation: float | None,
    max_rate: float | None,
    lookaheads: list[int] | None,
    no_figures: bool,
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
    with study.run() as arguments:
        result = compare_lookaheads(study.motion, max_activation, max_rate, lookaheads, **arguments)
    data = finite(result.as_dict())
    study.save(foresight_table(result), comparison=data)
    if no_figures:
        set_figures_aside(study.folder, "comparison")
    else:
        with warn_on_failure("could not draw the comparison"):
            from ..figures import draw_foresight

            draw_foresight(result, study.folder)
    study.finish(data)
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
@_with_study
def survey_command(
    study: Study,
    max_activations: list[float | None],
    max_rates: list[float | None],
    lookaheads: list[int] | None,
    no_figures: bool,
) -> None:
    """Find how many steps of lookahead suffice under limits on strength and speed.

    Repeats the lookaheads of trunk-ocp compare under every pair of limits. Also computes the
    trade-off between smoothness and accuracy, step by step and with the whole horizon, as the
    weight on activation rates grows. Writes survey.json, front.json and their figures.

    Takes half a minute for lift-log and two minutes for pick-fruit on one core, and about as long
    as trunk-ocp compare for each further pair of limits.
    """
    motion, folder = study.motion, study.folder
    with study.run(", limits") as arguments:
        cells = survey_limits(motion, max_activations, max_rates, lookaheads, **arguments)
    with study.run(", smoothness") as arguments:
        curve = smoothness_tradeoff(motion, **arguments)
    cells, curve = finite(cells), finite(curve)
    study.save(survey_table(cells), survey=cells, front=curve)
    if no_figures:
        set_figures_aside(folder, f"foresight-{motion.name}", f"front-{motion.name}")
    else:
        from ..figures import draw_front, draw_survey

        with warn_on_failure("could not draw the survey"):
            draw_survey(cells, folder)
        with warn_on_failure("could not draw the smoothness trade-off"):
            draw_front(curve, folder)
    study.finish({"survey": cells, "front": curve})


@click.command("optima")
@click.argument("problem", default="pick-fruit")
@number_option(
    "--lookahead",
    "lookahead",
    "H",
    "Time steps planned at a time; 1 is sequential.  [default: all]",
)
@number_option("--starts", "random starts", "N", "Number of random starts.", default=20)
@number_option("--seed", "seed", "S", "Seed of the random starts.", default=0)
@_with_study
def optima_command(study: Study, lookahead: int | None, starts: int, seed: int) -> None:
    """Look for better local optima than the reported plan, from many starts.

    Plans the same motion from N random starts, from the mirror image of the reported plan and
    from the passive trunk. Writes optima.json. Takes about a minute for the shipped motions on
    one core.
    """
    with study.run() as arguments:
        result = find_optima(study.motion, lookahead, starts, seed, **arguments)
    data = finite(result.as_dict())
    study.save(optima_table(result), optima=data)
    study.finish(data)

"""Command line: `solve-motion` and `trunk-ocp`."""

from __future__ import annotations

import json
import os
import signal
import sys
import tempfile
import webbrowser
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

import click
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from .anatomy import load_anatomy
from .comparison import compare
from .diagnosis import effects, explain
from .errors import InputError, TrunkError
from .foresight import foresight, front, survey
from .motion import Motion, load_motion
from .optima import optima
from .planner import Options, plan_motion
from .problem_file import problem_schema
from .reporting import Reporter
from .screen import (
    Screen,
    comparison_table,
    findings,
    foresight_table,
    history_table,
    optima_table,
    rank_table,
    sign_table,
    step_table,
    survey_table,
)
from .solution import Plan, Status
from .solver import check_linear_solver
from .storage import finite, load_plan, save_diagnosis, save_plan, summary

BAD_INPUT = 2


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
    no_figures: bool,
    film: bool,
    quiet: bool,
    as_json: bool,
) -> None:
    """Plan a motion: which muscles contract when, and how the head turns.

    PROBLEM is pick-fruit (the default), lift-log, lift-log-asymmetric, or a problem file of
    your own.

    Exit codes: 0 solved and verified; 2 bad usage or problem file; 3 not converged, not
    verified, or a target out of reach (what was reached is saved and marked); 4 interrupted
    (the best so far is saved).
    """
    source = click.get_current_context().get_parameter_source("mode")
    if lookahead is not None and source is not click.core.ParameterSource.DEFAULT:
        raise click.UsageError("give --mode or --lookahead, not both.")
    console = Console(quiet=quiet or as_json, highlight=False)
    # CasADi's OpenBLAS, loaded with the solver, would only spin a second thread here.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    with _clean_errors():
        motion = load_motion(problem)
        folder = out or Path("results") / motion.name
        check_linear_solver(linear_solver)
        _check_writable(folder)
        options = Options(linear_solver=linear_solver, max_iterations=max_iterations, starts=starts)
        with Screen(console, motion) as screen, _interruptible(screen):
            plans = _plans(motion, mode, lookahead, options, screen)
            for plan in plans:
                save_plan(plan, folder / plan_folder(plan))
        for plan in plans:
            console.print(step_table(plan))
            _verdict(console, plan)
            _tell(console, plan, folder / plan_folder(plan))
        if len(plans) == 2:
            figures = compare(*plans)
            (folder / "comparison.json").write_text(json.dumps(figures, indent=2) + "\n")
            console.print(comparison_table(figures))
        with _interrupted_drawing(console):
            if not no_figures:
                _draw(plans, folder, console)
            if film:
                for plan in plans:
                    _film(plan, folder / plan_folder(plan), console)
        console.print(f"Results are in {folder}/")
    if quiet:
        for plan in plans:
            if plan.status is not Status.SOLVED:
                click.echo(f"{motion.name}, {plan.mode}: {plan.status.value}", err=True)
    if as_json:
        reports = {plan_folder(plan): summary(plan) for plan in plans}
        click.echo(json.dumps(reports, indent=2))
    sys.exit(max(plan.status.exit_code for plan in plans))


def plan_folder(plan: Plan) -> str:
    """Name of a plan's folder: its mode, with the lookahead of a receding horizon."""
    return f"receding-{plan.lookahead}" if plan.mode == "receding" else plan.mode


def _plans(
    motion: Motion, mode: str, lookahead: int | None, options: Options, reporter: Reporter
) -> list[Plan]:
    if lookahead is not None:
        return [plan_motion(motion, lookahead, options, reporter, throw=False)]
    if mode == "horizon":
        return [plan_motion(motion, None, options, reporter, throw=False)]
    sequential = plan_motion(motion, 1, options, reporter, throw=False)
    if mode == "sequential" or reporter.stop:
        return [sequential]
    horizon = plan_motion(motion, None, options, reporter, start=sequential, throw=False)
    return [sequential, horizon]


def _draw(plans: list[Plan], folder: Path, console: Console) -> None:
    """Figures of each plan, of two together, and the page to turn the trunk in."""
    from .drawing import draw_run  # matplotlib takes its time

    with console.status("drawing figures; Ctrl-C leaves them out"):
        page = draw_run(plans, [folder / plan_folder(plan) for plan in plans], folder)
    if page is not None:
        console.print(f"Turn it in a browser: {page}")


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
        console.print(f"Film: {path}")


@contextmanager
def _interrupted_drawing(console: Console) -> Iterator[None]:
    """Ctrl-C while drawing leaves the pictures out; the plans are saved already."""
    try:
        yield
    except KeyboardInterrupt:
        console.print("Stopped drawing; the plans are saved.")


def _verdict(console: Console, plan: Plan) -> None:
    colour = "green" if plan.status is Status.SOLVED else "yellow"
    planned, steps = len(plan.x), len(plan.motion.steps)
    part = "" if planned == steps else f" ({planned} of {steps} time steps)"
    console.print(f"[{colour}]{plan.mode}: {plan.status.value}{part}[/]", soft_wrap=True)
    for sentence in plan.notes:
        console.print(f"  {sentence}", soft_wrap=True)


def _tell(console: Console, plan: Plan, folder: Path) -> None:
    """What the plan leans on, or why it failed, on the screen and in its folder."""
    solved = plan.status is Status.SOLVED
    waiting = "solved; looking around" if solved else "looking for what stands in the way"
    with console.status(waiting):
        diagnosis = explain(plan, deep=not solved)
    save_diagnosis(diagnosis, folder)
    for line in findings(diagnosis, brief=True):
        console.print(line, soft_wrap=True)


@contextmanager
def _clean_errors() -> Iterator[None]:
    """Errors a user can mend become a message and exit code 2."""
    try:
        yield
    except (TrunkError, OSError) as error:
        click.echo(f"Error: {error}", err=True)
        sys.exit(BAD_INPUT)
    except KeyboardInterrupt:
        click.echo("Interrupted; nothing more was saved.", err=True)
        sys.exit(Status.INTERRUPTED.exit_code)


def _check_writable(folder: Path) -> None:
    """Make the output folder before hours are spent on what goes into it."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise InputError(
            f"{folder}: cannot be written to ({error.strerror}); name another folder with --out."
        ) from None


@contextmanager
def _interruptible(reporter: Reporter) -> Iterator[None]:
    """The first Ctrl-C ends the plan after the current iteration; a second one at once."""

    def stop(number: int, frame: FrameType | None) -> None:
        if reporter.stop:
            raise KeyboardInterrupt
        reporter.stop = True
        reporter.note("Stopping; the best so far will be saved.")

    before = signal.signal(signal.SIGINT, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


@click.group()
@click.version_option(package_name="trunk_ocp")
def main() -> None:
    """Plan whole motions of a muscular trunk."""


@main.command("tables")
@click.option("--anatomy", default="asian-elephant", show_default=True, help="Name or file.")
def tables(anatomy: str) -> None:
    """Print what each muscle group does, and how strongly (the paper's Tables 2 and 3)."""
    console = Console(highlight=False)
    with _clean_errors():
        trunk = load_anatomy(anatomy)
        if not trunk.muscles:
            click.echo(f"{trunk.name} has no muscles.")
            return
        console.print(sign_table(trunk))
        console.print(rank_table(trunk))


def _finished(run: str) -> tuple[Path, dict[Path, Plan]]:
    """Folder of a finished run, given it or a problem's name, and its plans by their folders."""
    folder = Path(run) if Path(run).is_dir() else Path("results") / run
    found = sorted(folder.glob("*/solution.nc")) or sorted(folder.glob("solution.nc"))
    if not found:
        raise InputError(
            f"{run}: no finished run here or in {folder}/; expected a folder that solve-motion "
            "wrote. Plan the motion first: solve-motion PROBLEM --out DIR."
        )
    return folder, {path.parent: load_plan(path.parent, throw=False) for path in found}


@main.command("explain")
@click.argument("run", metavar="PROBLEM|DIR", default="pick-fruit")
@click.option("--json", "as_json", is_flag=True, help="Print it as JSON, and no more.")
def explain_run(run: str, as_json: bool) -> None:
    """Say why a finished run is what it is.

    Of a plan that failed: which constraints do not hold, where and by how much, which bounds
    would have to give, how the solve went, what to try next. Of a solved one: what it leans on,
    and what a little more of each bound would bring. It is kept as diagnosis.json.
    """
    console = Console(quiet=as_json, highlight=False)
    with _clean_errors():
        _, plans = _finished(run)
        told = {}
        for folder, plan in plans.items():
            with console.status(f"{plan.mode}: asking each bound what it costs"):
                diagnosis = explain(plan)
            save_diagnosis(diagnosis, folder)
            told[folder.name] = diagnosis.as_json()
            _verdict(console, plan)
            for line in findings(diagnosis):
                console.print(line, soft_wrap=True)
            if diagnosis.history:
                console.print(history_table(diagnosis))
            if sentences := effects(diagnosis.responses):
                console.print("If a bound gave by 1 %, all else planned anew around it:")
                for sentence in sentences:
                    console.print(f"    {sentence}", soft_wrap=True)
        if as_json:
            click.echo(json.dumps(finite(told), indent=2))
        sys.exit(max(plan.status.exit_code for plan in plans.values()))


@main.command("view")
@click.argument("run", metavar="PROBLEM|DIR", default="pick-fruit")
@click.option("--no-browser", is_flag=True, help="Only write the page and say where it is.")
def view(run: str, no_browser: bool) -> None:
    """Open the page of a finished run in a browser: turn the trunk, play, pick muscles.

    It is one file, motion.html, that needs neither server nor network.
    """
    from .drawing import PAGE
    from .page import write_page

    with _clean_errors():
        folder, plans = _finished(run)
        pair = [plan for plan in plans.values() if plan.mode != "receding"] or [*plans.values()]
        order = sorted(pair, key=lambda plan: plan.mode == "horizon")  # as in solve-motion
        page = write_page(order[:2], folder / PAGE).resolve()
        click.echo(str(page))
        if not no_browser and not webbrowser.open(page.as_uri()):
            click.echo("No browser was found here; open this file in one.", err=True)


@main.command("convert")
@click.argument("run", metavar="PROBLEM|DIR", default="pick-fruit")
@click.option(
    "--to",
    "kinds",
    type=click.Choice(["glb", "vtk", "sto"]),
    multiple=True,
    help="Only this; may be repeated.  [default: all]",
)
def convert(run: str, kinds: tuple[str, ...]) -> None:
    """Write a finished run for other programs.

    motion.glb is an animation for Blender and other viewers, vtk/ has a file for each time step
    for ParaView, activations.sto is for OpenSim. They go beside the results of each plan.
    """
    from .exports import write_glb, write_sto, write_vtk

    writers: dict[str, Callable[[Plan, Path], object]] = {
        "glb": lambda plan, folder: write_glb(plan, folder / "motion.glb"),
        "vtk": lambda plan, folder: write_vtk(plan, folder / "vtk"),
        "sto": lambda plan, folder: write_sto(plan, folder / "activations.sto"),
    }
    with _clean_errors():
        _, plans = _finished(run)
        for folder, plan in plans.items():
            for kind in kinds or writers:
                writers[kind](plan, folder)
            click.echo(f"{folder}/: {', '.join(kinds or writers)}")


def _shared(command: Callable[..., None]) -> Callable[..., None]:
    """Options that several commands have: where results go, and how many processes work."""
    for option in (
        click.option("--json", "as_json", is_flag=True, help="Print it as JSON, and no more."),
        click.option(
            "--processes",
            type=click.IntRange(min=1),
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
    with bar, _interruptible(reporter):
        task = bar.add_task(what, total=None)
        yield reporter, lambda done, total: bar.update(task, completed=done, total=total)


def _positive(_: click.Context, __: click.Parameter, value: str | None) -> list[float | None]:
    """Values above 0 of an option; "none" is no limit."""
    try:
        return [None if part == "none" else float(part) for part in (value or "none").split(",")]
    except ValueError:
        raise click.BadParameter(f"{value!r}: expected numbers with commas, or none.") from None


def _steps(_: click.Context, __: click.Parameter, value: str | None) -> list[int] | None:
    """Whole numbers with commas."""
    try:
        return None if value is None else [int(part) for part in value.split(",")]
    except ValueError:
        raise click.BadParameter(f"{value!r}: expected whole numbers with commas.") from None


@main.command("compare")
@click.argument("problem", default="pick-fruit")
@click.option(
    "--max-activation",
    type=click.FloatRange(min=0, min_open=True),
    metavar="A",
    help="Contract no muscle by more than A.",
)
@click.option(
    "--max-rate",
    type=click.FloatRange(min=0, min_open=True),
    metavar="R",
    help="Change no activation faster than R per second, over each time step.",
)
@click.option(
    "--lookaheads",
    callback=_steps,
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
    with _clean_errors():
        motion = load_motion(problem)
        folder = out or Path("results") / motion.name / "compare"
        _check_writable(folder)
        with _counting(console, motion.name) as (reporter, done):
            result = foresight(
                motion, max_activation, max_rate, lookaheads, None, processes, reporter, done
            )
        report = finite(result.as_dict())
        (folder / "comparison.json").write_text(json.dumps(report, indent=2) + "\n")
        console.print(foresight_table(result))
        if not no_figures:
            from .figures import draw_foresight

            draw_foresight(result, folder)
        console.print(f"Results are in {folder}/")
        if as_json:
            click.echo(json.dumps(report, indent=2))
        sys.exit(result.curve.best.status.exit_code)


@main.command("survey")
@click.argument("problem", default="pick-fruit")
@click.option(
    "--max-activations", callback=_positive, metavar="A,...", help="Such as none,2.5,2: in turn."
)
@click.option("--max-rates", callback=_positive, metavar="R,...", help="In 1/s, such as none,2,1.")
@click.option(
    "--lookaheads",
    callback=_steps,
    metavar="H,...",
    help="Some only, such as 1,2,5.  [default: all]",
)
@click.option("--no-figures", is_flag=True, help="Draw no figure.")
@_shared
def survey_limits(
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
    with _clean_errors():
        motion = load_motion(problem)
        folder = out or Path("results") / motion.name / "survey"
        _check_writable(folder)
        with _counting(console, f"{motion.name}, limits") as (reporter, done):
            cells = survey(
                motion, max_activations, max_rates, lookaheads, None, processes, reporter, done
            )
        with _counting(console, f"{motion.name}, smoothness") as (reporter, done):
            curve = front(motion, processes=processes, reporter=reporter, done=done)
        cells, curve = finite(cells), finite(curve)
        (folder / "survey.json").write_text(json.dumps(cells, indent=2) + "\n")
        (folder / "front.json").write_text(json.dumps(curve, indent=2) + "\n")
        console.print(survey_table(cells))
        if not no_figures:
            from .figures import draw_front, draw_survey

            draw_survey(cells, folder, ("pdf", "png"))
            draw_front(curve, folder, ("pdf", "png"))
        console.print(f"Results are in {folder}/")
        if as_json:
            click.echo(json.dumps({"survey": cells, "front": curve}, indent=2))


@main.command("optima")
@click.argument("problem", default="pick-fruit")
@click.option("--lookahead", type=click.IntRange(min=1), metavar="H", help="1: sequential; "
              "default: horizon.")  # fmt: skip
@click.option("--starts", type=click.IntRange(min=0), default=20, show_default=True, metavar="N")
@click.option("--seed", type=int, default=0, show_default=True, help="Of the random starts.")
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
    with _clean_errors():
        motion = load_motion(problem)
        folder = out or Path("results") / motion.name / "optima"
        _check_writable(folder)
        with _counting(console, motion.name) as (reporter, done):
            found = optima(motion, lookahead, starts, seed, None, processes, reporter, done)
        report = finite(found.as_dict())
        (folder / "optima.json").write_text(json.dumps(report, indent=2) + "\n")
        console.print(optima_table(found))
        console.print(f"Results are in {folder}/")
        if as_json:
            click.echo(json.dumps(report, indent=2))


@main.command("schema")
def schema() -> None:
    """Print the JSON Schema of problem files, for editors."""
    click.echo(json.dumps(problem_schema(), indent=2))


main.add_command(solve)

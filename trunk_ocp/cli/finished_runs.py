"""Commands for a finished run: `trunk-ocp explain`, `simulate`, `slow`, `view` and `convert`."""

from __future__ import annotations

import json
import os
import sys
import webbrowser
from collections.abc import Callable
from pathlib import Path

import click
from rich.console import Console

from .._support.atomic_files import write
from .._support.toml_files import is_file, printable
from ..analysis.bound_sensitivity import effects
from ..analysis.diagnosis import explain, save_diagnosis
from ..codegen.subject import is_problem
from ..dynamics.simulation import DAMPING_TIME, TIME_STEP
from ..dynamics.slowing import ACCEPTED, phases_with_inertia
from ..errors import InputError
from ..model.anatomy import Trunk, anatomies_folder, load_anatomy
from ..planning.plan import Plan
from ..planning.results_folder import hashes, problem_file_of
from ..planning.simulated_plan import SimulatedPlan, simulate
from ..planning.status import Status
from ..planning.storage import SOLUTION, finite
from ..problem.problem_file import ProblemSpec
from ..problem.problem_text import problem_text
from ..problem.variants import slowed_spec
from .commands import resume_command
from .common import folder_name, load_run, print_outcome, print_plain
from .option_types import number_option
from .progress import progress_bar
from .safe_streams import standard_output
from .tables import finding_lines, history_table, slowing_table

ENERGY_TOL = 0.05  # of the work, that a simulation may lose without a warning
RESPONSES = "If a bound were relaxed by 1 % (or as stated, if it is 0) and the motion replanned:"


@click.command("explain")
@click.argument("run", metavar="PROBLEM|DIR", default="pick-fruit")
@click.option("--json", "as_json", is_flag=True, help="Print only the diagnosis, as JSON.")
def explain_command(run: str, as_json: bool) -> None:
    """Explain a finished run: why it failed, or what limits it.

    For a plan that failed: which constraints are violated, where and by how much; which bounds
    would have to change; how the solve went; what to try next. For a solved plan: which bounds
    are active, and what relaxing each would gain. Also saved as diagnosis.json beside the plan.
    Takes a few seconds.

    Exit codes are those of solve-motion for the same plan.
    """
    console = Console(quiet=as_json, highlight=False)
    _, plans = load_run(run)
    reports = {folder.name: _explain(plan, folder, console) for folder, plan in plans.items()}
    if as_json:
        click.echo(json.dumps(finite(reports), indent=2))
    sys.exit(max(plan.status.exit_code for plan in plans.values()))


def _explain(plan: Plan, folder: Path, console: Console) -> object:
    """Print and save the diagnosis of one plan; returns it ready for JSON."""
    with console.status(f"{plan.mode}: computing the effect of each bound"):
        diagnosis = explain(plan)
    save_diagnosis(diagnosis, folder)
    print_outcome(console, plan)
    for line in finding_lines(diagnosis):
        console.print(line, soft_wrap=True)
    command = plan.options.get("command")
    if plan.status is Status.INTERRUPTED and isinstance(command, dict):
        print_plain(console, f"Resume with: {resume_command(command)}")
    if diagnosis.history:
        console.print(history_table(diagnosis))
    if sentences := effects(diagnosis.responses, plan.motion.trunk.length):
        console.print(RESPONSES, soft_wrap=True)
        for sentence in sentences:
            print_plain(console, f"    {sentence}")
    return diagnosis.as_json()


@click.command("simulate")
@click.argument("run", metavar="PROBLEM|DIR", default="pick-fruit")
@number_option("--time-step", "time step", "S", "Longest step in time, s.", TIME_STEP)
@number_option("--damping-time", "damping time", "S", "Of the tissue, s; 0: none.", DAMPING_TIME)
def simulate_command(run: str, time_step: float, damping_time: float) -> None:
    """Play a finished run on the trunk with inertia and damping.

    Plans are quasi-static. This plays their activations, head angles and loads on a trunk that has
    mass, and says how far that is from the plan: simulation.nc, simulation.json and a figure are
    written beside each plan. Takes a few seconds.
    """
    from ..figures.simulation import draw_simulation

    console = Console(highlight=False)
    _, plans = load_run(run)
    for folder, plan in plans.items():
        result = _simulated(plan, time_step, damping_time, console)
        result.save(folder)
        draw_simulation(result, folder / "figures", ("png",))
        found = result.summary()
        share = found["energy_imbalance"] / found["work"] if found["work"] else 0.0
        print_plain(
            console,
            f"{plan.mode}: up to {1e3 * found['largest_distance']:.3g} mm from the plan, at Z = "
            f"{found['largest_distance_Z']:.2f} m and {found['largest_distance_time']:.3g} s; the "
            f"tip ends {1e3 * found['tip_distance_at_end']:.3g} mm from it",
        )
        print_plain(console, f"  energy balances to {share:.1g} of the work; results in {folder}/")
        if share > ENERGY_TOL:
            finer = f"Shorter ones tell how much that matters: --time-step {time_step / 2:.3g}."
            warning = f"steps of {1e3 * time_step:g} ms lose fast vibrations. {finer}"
            console.print(f"[yellow]warning[/]: {warning}", soft_wrap=True)


def _simulated(
    plan: Plan, time_step: float, damping_time: float, console: Console
) -> SimulatedPlan:
    """Simulate a plan, with a progress bar."""
    with progress_bar(console, f"simulating the {plan.mode} plan", "ms", transient=True) as bar:
        task = bar.add_task(plan.mode, total=round(1e3 * float(plan.times[-1])))

        def advance(t: float) -> None:
            bar.update(task, completed=round(1e3 * t))

        return simulate(plan, time_step, damping_time, advance)


@click.command("slow")
@click.argument("run", metavar="PROBLEM|DIR", default="pick-fruit")
@number_option(
    "--ratio", "inertia ratio", "R", "Largest moment of inertia over that of weight.", ACCEPTED
)
@click.option(
    "--out",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="FILE",
    help="Write the slower problem, a new file.",
)
def slow_command(run: str, ratio: float, out: Path | None) -> None:
    """Find how long a finished run's phases must be for inertia not to matter.

    Plans are quasi-static: the trunk is in equilibrium at all times, as if it moved infinitely
    slowly. This says how large the forces of inertia would be, and how long each phase has to take
    for them to be small. It assumes the same shapes; plan the slower problem to have them. Takes
    less than a second.
    """
    folder, plans = load_run(run)
    plan = next((p for p in plans.values() if p.mode == "horizon"), next(iter(plans.values())))
    phases = phases_with_inertia(plan.motion, plan.inertia, ratio)
    output = standard_output()
    Console(file=output, highlight=False).print(slowing_table(plan, phases, ratio))
    output.check()
    if out is not None:
        factors = {each.phase: each.factor for each in phases}
        text = problem_text(_moved(slowed_spec(plan.motion.spec, factors), folder, out))
        if out.exists():
            raise InputError(f"{out}: exists already; expected the name of a new file.")
        write(out, text)
        click.echo(printable(f"Plan it: solve-motion {out}"))


def _moved(spec: ProblemSpec, folder: Path, out: Path) -> ProblemSpec:
    """The problem of a run for the file `out`: its anatomy file as seen from the folder of that."""
    source = problem_file_of(folder)
    if source is None or not is_file(source.parent / spec.anatomy):
        return spec
    anatomy = os.path.relpath((source.parent / spec.anatomy).resolve(), out.parent.resolve())
    return spec.model_copy(update={"anatomy": Path(anatomy).as_posix()})


@click.command("view")
@click.argument("subject", metavar="PROBLEM|DIR|ANATOMY", default="pick-fruit")
@click.option("--no-browser", is_flag=True, help="Write the page and print its path only.")
def view_command(subject: str, no_browser: bool) -> None:
    """Open the interactive page of a finished run, or of a trunk, in a browser.

    Rotate the trunk, play the motion, select muscles; try muscles, head and loads yourself, and
    drag the trunk. A shipped anatomy (asian-elephant) or an anatomy file needs no run: its page
    shows the trunk at rest. The page is one file, motion.html or trunk.html, that works without a
    server or a network connection; it is written again first. Takes a few seconds.
    """
    trunk = _trunk(subject)
    page = (_page_of_run(subject) if trunk is None else _page_of_trunk(trunk)).resolve()
    click.echo(printable(str(page)))
    if not no_browser and not webbrowser.open(page.as_uri()):
        click.echo("No browser found; open this file in a browser yourself.", err=True)


def _trunk(subject: str) -> Trunk | None:
    """The trunk of a shipped anatomy or an anatomy file; None if that is not what is meant."""
    path = Path(subject)
    names = {file.stem for file in anatomies_folder().glob("*.toml")}
    is_name = subject in names and not path.is_dir()
    is_anatomy_file = path.suffix == ".toml" and is_file(path) and not is_problem(path)
    return load_anatomy(subject) if is_name or is_anatomy_file else None


def _page_of_trunk(trunk: Trunk) -> Path:
    from ..viewer import write_page

    return write_page(trunk, Path("results") / folder_name(trunk.name) / "trunk.html")


def _page_of_run(run: str) -> Path:
    from ..viewer import write_page
    from .run_figures import PAGE

    folder, plans = load_run(run)
    plans = _plans_of_newest_problem(plans)
    pair = [plan for plan in plans.values() if plan.mode != "receding"] or [*plans.values()]
    order = sorted(pair, key=lambda plan: plan.mode == "horizon")  # as in solve-motion
    return write_page(order[:2], folder / PAGE)


def _plans_of_newest_problem(plans: dict[Path, Plan]) -> dict[Path, Plan]:
    """Plans of the newest one's problem and anatomy; prints which others are left out."""
    newest = max(plans, key=lambda folder: (folder / SOLUTION).stat().st_mtime_ns)
    wanted = hashes(plans[newest].motion)
    kept = {folder: plan for folder, plan in plans.items() if hashes(plan.motion) == wanted}
    for folder in plans.keys() - kept.keys():
        message = f"{folder}: left out, as its problem or anatomy differs from that of {newest}."
        click.echo(printable(message), err=True)
    return kept


@click.command("convert")
@click.argument("run", metavar="PROBLEM|DIR", default="pick-fruit")
@click.option(
    "--to",
    "kinds",
    type=click.Choice(["glb", "vtk", "sto"]),
    multiple=True,
    help="Write this format only; may be repeated.  [default: all]",
)
@click.option("--anyway", is_flag=True, help="Convert plans that are not solved and verified, too.")
def convert_command(run: str, kinds: tuple[str, ...], anyway: bool) -> None:
    """Write a finished run as files for Blender, ParaView and OpenSim.

    motion.glb is an animation for Blender and other 3D viewers, vtk/ has a file per time step for
    ParaView, and activations.sto is for OpenSim. They are written beside each plan's results. To
    write the trunk model itself as code, use trunk-ocp export instead. Takes a few seconds.
    """
    from ..motion_files import write_glb, write_sto, write_vtk

    writers: dict[str, Callable[[Plan, Path], object]] = {
        "glb": lambda plan, folder: write_glb(plan, folder / "motion.glb"),
        "vtk": lambda plan, folder: write_vtk(plan, folder / "vtk"),
        "sto": lambda plan, folder: write_sto(plan, folder / "activations.sto"),
    }
    _, plans = load_run(run)
    for folder, plan in plans.items():
        if plan.status is not Status.SOLVED and not anyway:
            raise InputError(
                f"{folder}: {plan.status.value}; expected a solved plan. See why with "
                f"trunk-ocp explain {run}, or convert it with --anyway."
            )
    for folder, plan in plans.items():
        for kind in kinds or writers:
            writers[kind](plan, folder)
        click.echo(printable(f"{folder}/: {', '.join(kinds or writers)}"))

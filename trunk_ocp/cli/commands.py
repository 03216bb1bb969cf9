"""The commands `solve-motion` and `trunk-ocp`, and the options of those that start quickly.

Imports little, so that help appears at once; each command imports what it needs when it runs.
"""

from __future__ import annotations

import json
import shlex
from collections.abc import Mapping
from typing import Any

import click
from click.core import ParameterSource

from .command_base import Command, LazyGroup
from .option_types import contact_option, number_option, out_option
from .safe_streams import standard_output

LAZY_COMMANDS = {
    "studies": {
        "compare": "Compare planning step by step, as in the paper, with planning ahead.",
        "optima": "Look for better local optima than the reported plan, from many starts.",
        "redundancy": "Show which muscles a finished run needs, and what others could replace.",
        "survey": "Find how many steps of lookahead suffice under limits on strength and speed.",
    },
    "finished_runs": {
        "convert": "Write a finished run as files for Blender, ParaView and OpenSim.",
        "explain": "Explain a finished run: why it failed, or what limits it.",
        "simulate": "Play a finished run on the trunk with inertia and damping.",
        "slow": "Find how long a finished run's phases must be for inertia not to matter.",
        "view": "Open the interactive page of a finished run, or of a trunk, in a browser.",
    },
    "export_model": {
        "export": "Write the trunk model (activations, head, loads to shape) as code.",
    },
    "live": {
        "live": "Drag targets on a page and watch the motion being planned again.",
    },
}
"""Commands that are imported when they run, and their short help, by module."""


@click.command("solve", cls=Command)
@click.version_option(package_name="trunk_ocp")
@click.argument("problem", default="pick-fruit")
@click.option(
    "--mode",
    type=click.Choice(["horizon", "sequential", "both"]),
    default="horizon",
    show_default=True,
    help="Plan all time steps together as one NLP, one step at a time, or both ways.",
)
@number_option(
    "--lookahead",
    "lookahead",
    "H",
    "Plan H time steps at a time (receding horizon); replaces --mode.",
)
@contact_option
@number_option(
    "--effort", "weight", "W", "Weight of squared activations; replaces that of the problem file."
)
@number_option("--rate", "weight", "W", "Weight of squared rates of change; likewise.")
@number_option("--head-effort", "weight", "W", "Weight of squared head angles; likewise.")
@out_option("Folder for results.  [default: results/PROBLEM]")
@click.option(
    "--linear-solver", default="mumps", show_default=True, help="Linear solver used by Ipopt."
)
@number_option("--max-iterations", "max_iterations", "N", "Iteration limit of each solve.", 1000)
@number_option(
    "--starts",
    "starts",
    "N",
    "Solve the horizon from N initial guesses and keep the best plan: the sequential plan, "
    "then the passive trunk, then random ones.",
    default=1,
)
@click.option("--resume", is_flag=True, help="Continue an unfinished run where it stopped.")
@click.option(
    "--figures",
    type=click.Choice(["none", "main", "all"]),
    default="main",
    show_default=True,
    help="Draw shapes, activations and errors as PNG (main); also muscles and anatomy, and PDF "
    "files (all); or neither figures nor the interactive page (none).",
)
@click.option("--no-figures", is_flag=True, help="The same as --figures none.")
@click.option("--film", is_flag=True, help="Also make a film; takes half a minute or more.")
@click.option("--quiet", is_flag=True, help="Print warnings and errors only.")
@click.option("--json", "as_json", is_flag=True, help="Print only the summary, as JSON.")
def solve(
    lookahead: int | None,
    linear_solver: str,
    max_iterations: int,
    starts: int,
    figures: str,
    no_figures: bool,
    **options: Any,
) -> None:
    """Plan a motion: which muscles contract when, and how the head moves.

    PROBLEM is pick-fruit (the default), lift-log or lift-log-asymmetric, feed-fruit, lift-log-hung,
    fruit-behind-posts or tight-curl, which keep clear of bodies, or a problem file of your own
    (.toml). Planning takes a few seconds for the shipped motions, the figures about as long again.
    Results go to DIR/MODE: activations.csv, solution.nc, summary.json and figures, with an
    interactive page in DIR. Ctrl-C stops and saves the best plan so far; press it again to quit
    immediately.

    Exit codes: 0 solved and verified; 2 bad usage or problem file, or files that cannot be
    written; 3 not converged, not verified, colliding, unstable, or a target out of reach (the plan
    is saved and marked as such); 4 interrupted (the best plan so far is saved).
    """
    context = click.get_current_context()
    if lookahead is not None and context.get_parameter_source("mode") != ParameterSource.DEFAULT:
        raise click.UsageError("give --mode or --lookahead, not both.")
    if no_figures and context.get_parameter_source("figures") != ParameterSource.DEFAULT:
        raise click.UsageError("give --figures or --no-figures, not both.")
    from ..planning.options import Options
    from .solve import run_solve

    run_solve(
        lookahead=lookahead,
        options=Options(linear_solver=linear_solver, max_iterations=max_iterations, starts=starts),
        figures="none" if no_figures else figures,
        resume_command=resume_command(context.params),
        **options,
    )


def resume_command(parameters: Mapping[str, Any]) -> str:
    """The `solve-motion` command that resumes a run with these saved arguments and options."""
    words = ["solve-motion", str(parameters.get("problem", "PROBLEM"))]
    for option in solve.params:
        value, name = parameters.get(str(option.name)), option.opts[0]
        is_default = value is None or value is False or value == option.default
        if name.startswith("--") and name != "--resume" and not is_default:
            words += [name] if value is True else [name, str(value)]
    return shlex.join([*words, "--resume"])


@click.group(cls=LazyGroup, lazy_commands=LAZY_COMMANDS)
@click.version_option(package_name="trunk_ocp")
def main() -> None:
    """Plan whole motions of a muscular trunk.

    Start with trunk-ocp solve (or solve-motion, the same command). Commands that work on a
    finished run (explain, simulate, slow, view, convert, redundancy) take the problem or the
    folder of its results; the studies (compare, survey, optima) plan the motion many times
    themselves.
    """


@main.command("tables")
@click.option(
    "--anatomy",
    default="asian-elephant",
    show_default=True,
    metavar="NAME|FILE",
    help="Shipped anatomy, or an anatomy file.",
)
def tables(anatomy: str) -> None:
    """Print the effect of each muscle group, and its rank (the paper's Tables 2 and 3).

    Takes about a second.
    """
    from .solve import print_tables

    print_tables(anatomy)


@main.command("schema")
def schema() -> None:
    """Print the JSON Schema of problem files, for completion and checks in editors."""
    from ..problem.problem_file import problem_schema

    output = standard_output()
    click.echo(json.dumps(problem_schema(), indent=2), file=output)
    output.check()


main.add_command(solve)

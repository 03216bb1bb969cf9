"""The commands `solve-motion` and `trunk-ocp`: their options, and where the work is done.

Imports little, so that help is there at once; what a command does is imported when it runs.
"""

from __future__ import annotations

import json
import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

from .ending import Command, Group
from .option_types import Number
from .stdout import standard_output


@click.command("solve", cls=Command)
@click.version_option(package_name="trunk_ocp")
@click.argument("problem", default="pick-fruit")
@click.option(
    "--mode",
    type=click.Choice(["horizon", "sequential", "both"]),
    default="horizon",
    show_default=True,
    help="Plan all time steps as one NLP, one step after the other, or both ways.",
)
@click.option(
    "--lookahead",
    type=Number("lookahead"),
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
    type=Number("max_iterations"),
    metavar="N",
    default=1000,
    show_default=True,
    help="Most iterations of one solve.",
)
@click.option(
    "--starts",
    type=Number("starts"),
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
def solve(**options: Any) -> None:
    """Plan a motion: which muscles contract when, and how the head turns.

    PROBLEM is pick-fruit (the default), lift-log, lift-log-asymmetric, or a problem file of
    your own.

    Exit codes: 0 solved and verified; 2 bad usage or problem file, or files that cannot be
    written; 3 not converged, not verified, unstable, or a target out of reach (what was reached
    is saved and marked); 4 interrupted (the best so far is saved).
    """
    from .solve import run_solve

    run_solve(**options, resume_with=resume_command(click.get_current_context().params))


def resume_command(given: Mapping[str, Any]) -> str:
    """`solve-motion` with the arguments and options of an earlier run, as saved, and --resume."""
    words = ["solve-motion", str(given.get("problem", "PROBLEM"))]
    for option in solve.params:
        value, name = given.get(str(option.name)), option.opts[0]
        usual = value in (None, False, option.default)
        if name.startswith("--") and name != "--resume" and not usual:
            words += [name] if value is True else [name, str(value)]
    return shlex.join([*words, "--resume"])


@click.group(
    cls=Group,
    elsewhere={
        "compare": ("studies", "compare_ways", "Ask what foresight is worth."),
        "convert": ("finished_runs", "convert", "Write a finished run for other programs."),
        "explain": ("finished_runs", "explain_run", "Say why a finished run is what it is."),
        "export": (
            "export",
            "export_model",
            "Write the map from activations, head and loads to shape for another program.",
        ),
        "optima": ("studies", "many_starts", "Ask whether the reported plan is the best."),
        "redundancy": ("studies", "redundant", "Tell which muscles a finished run determines."),
        "survey": ("studies", "survey_limits", "Ask how many steps ahead suffice."),
        "view": ("finished_runs", "view", "Open the page of a finished run in a browser."),
    },
)
@click.version_option(package_name="trunk_ocp")
def main() -> None:
    """Plan whole motions of a muscular trunk."""


@main.command("tables", cls=Command)
@click.option("--anatomy", default="asian-elephant", show_default=True, help="Name or file.")
def tables(anatomy: str) -> None:
    """Print what each muscle group does, and how strongly (the paper's Tables 2 and 3)."""
    from .solve import print_tables

    print_tables(anatomy)


@main.command("schema", cls=Command)
def schema() -> None:
    """Print the JSON Schema of problem files, for editors."""
    from ..problem.problem_file import problem_schema

    output = standard_output()
    click.echo(json.dumps(problem_schema(), indent=2), file=output)
    output.check()


main.add_command(solve)

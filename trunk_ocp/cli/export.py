"""The command `trunk-ocp export`: the model for other programs."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import click
from rich.console import Console

from ..codegen.formats import FORMATS, check_export, export
from ..codegen.request import CheckError
from ..codegen.shape_model import MIN_ELEMENTS
from ..codegen.subject import load_subject
from .common import clean_errors
from .option_types import Number
from .stdout import standard_output

DISAGREES = 3


def _points(
    context: click.Context, parameter: click.Parameter, text: str | None
) -> tuple[float, ...]:
    """Points Z of a text, separated by commas."""
    try:
        return tuple(float(word) for word in text.split(",")) if text is not None else ()
    except ValueError:
        raise click.BadParameter(f"{text!r}: expected numbers in m, such as 0.9,1.75.") from None


@click.command("export")
@click.argument("subject", metavar="PROBLEM|ANATOMY")
@click.option(
    "--what",
    type=click.Choice(["shape", "jacobian", "constraints"]),
    default="jacobian",
    show_default=True,
    help="Shapes; shapes with first derivatives; the motion NLP's own functions.",
)
@click.option(
    "--at", metavar="Z,Z,...", callback=_points, help="Points along the trunk in m.  [the tip]"
)
@click.option("--to", type=click.Choice([*FORMATS]), required=True, help="Format.")
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    metavar="DIR",
    help="Where the files go.  [default: export/NAME-FORMAT]",
)
@click.option("--second", is_flag=True, help="Also second derivatives, along a direction.")
@click.option(
    "--contact-from", type=Number("Z"), metavar="Z", help="Where contact loads start, in m."
)
@click.option(
    "--elements",
    type=Number("elements"),
    default=MIN_ELEMENTS,
    metavar="N",
    help="At least N elements.",
)
@click.option("--muscle", metavar="NAME", help="The muscle that formulas are for.")
@click.option("--check", is_flag=True, help="Run the export in its own environment on test cases.")
def export_model(
    subject: str,
    what: str,
    at: tuple[float, ...],
    to: str,
    out: Path | None,
    second: bool,
    contact_from: float | None,
    elements: int,
    muscle: str | None,
    check: bool,
) -> None:
    """Write the map from activations, head and loads to shape for another program.

    Every export brings a check file of inputs and expected outputs; --check compiles or runs the
    export and compares.

    Exit codes: 0 written (and all agree); 2 bad usage, or a tool is missing; 3 it disagrees.
    """
    console = Console(file=standard_output(), highlight=False)
    with clean_errors():
        asked = load_subject(subject)
        folder = out or Path("export") / f"{_folder_name(asked.name)}-{to}"
        with console.status("writing"):
            files = export(
                asked,
                to,
                folder,
                what,
                at,
                second=second,
                muscle=muscle,
                contact_from=contact_from,
                elements=elements,
            )
        for path in files:
            console.print(str(path), markup=False, soft_wrap=True)
        if check:
            _check(console, folder, to, what)


def _folder_name(name: str) -> str:
    """A name that any file system takes, of the name of an anatomy or a problem."""
    return re.sub(r"[^\w.]+", "-", name)[:50].strip("-") or "trunk"


def _check(console: Console, folder: Path, to: str, what: str) -> None:
    try:
        with console.status(f"checking: {FORMATS[to].about}"):
            told = check_export(folder, to, what)
    except CheckError as error:
        click.echo(f"Error: {folder}: the export does not pass its check.\n{error}", err=True)
        sys.exit(DISAGREES)
    console.print(told.rstrip(), markup=False, soft_wrap=True)

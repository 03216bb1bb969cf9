"""The command `trunk-ocp export`: the trunk model as code for another program."""

from __future__ import annotations

import sys
from pathlib import Path

import click
from rich.console import Console

from ..codegen.formats import FORMATS, check_export, export
from ..codegen.request import CheckError
from ..codegen.shape_model import MIN_ELEMENTS
from ..codegen.subject import load_subject
from .common import folder_name
from .exit_codes import NOT_VERIFIED
from .option_types import number_option, out_option
from .safe_streams import standard_output


def _points(
    context: click.Context, parameter: click.Parameter, text: str | None
) -> tuple[float, ...]:
    """Parse points Z, separated by commas."""
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
    help="The shape; the shape and its first derivatives; the NLP of a motion (its objective, "
    "constraints and derivatives).",
)
@click.option(
    "--at",
    metavar="Z,Z,...",
    callback=_points,
    help="Points in m from the base.  [default: the tip]",
)
@click.option("--to", metavar=f"[{'|'.join(FORMATS)}]", required=True, help="Target format.")
@out_option("Folder for the files.  [default: export/NAME-FORMAT]")
@click.option("--second", is_flag=True, help="Add second derivatives along a direction.")
@number_option("--contact-from", "Z", "Z", "Where contact loads begin, in m.")
@number_option("--elements", "elements", "N", "Use at least N collocation elements.", MIN_ELEMENTS)
@click.option(
    "--muscle", metavar="NAME", help="Muscle for formulas (sympy and latex), such as R1-dl."
)
@click.option("--check", is_flag=True, help="Compile or run the export, and compare on test cases.")
def export_command(
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
    """Write the trunk model (activations, head, loads to shape) as code.

    The result is source code or a function file that computes shapes and derivatives without
    trunk_ocp: for a controller, an optimizer or a paper. To write a planned motion for Blender,
    ParaView or OpenSim, use trunk-ocp convert instead. Takes a few seconds; --check adds the
    time of the compiler or framework.

    Every export includes a check file of inputs and expected outputs.

    Exit codes: 0 written (and the check passes); 2 bad usage, or a tool is missing; 3 the check
    fails.
    """
    console = Console(file=standard_output(), highlight=False)
    model = load_subject(subject)
    folder = out or Path("export") / f"{folder_name(model.name)}-{to}"
    with console.status("writing"):
        files = export(
            model,
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


def _check(console: Console, folder: Path, to: str, what: str) -> None:
    try:
        with console.status(f"checking: {FORMATS[to].about}"):
            report = check_export(folder, to, what)
    except CheckError as error:
        click.echo(f"Error: {folder}: the export does not pass its check.\n{error}", err=True)
        sys.exit(NOT_VERIFIED)
    console.print(report.rstrip(), markup=False, soft_wrap=True)

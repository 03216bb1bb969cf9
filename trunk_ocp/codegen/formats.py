"""Formats of `trunk-ocp export`: what each supports, and the functions that write and check it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import Any

from .._support.arguments import check_arguments
from .._support.atomic_files import alone
from .._support.ranges import shown
from .._support.wording import suggestion
from ..errors import InputError
from ..model.anatomy import Trunk
from ..model.loads import Loads, check_contact
from ..problem.motion import Motion
from .check_cases import check_files, resolved
from .manifest import Files, write_files
from .request import Request
from .shape_model import MIN_ELEMENTS, build_model


@dataclass(frozen=True)
class Format:
    """An export format.

    Attributes
    ----------
    name : str
        As in `--to`; the format's functions are `write_NAME(request)` and `check_NAME(folder)`.
    about : str
        Description for help texts and messages.
    module : str
        Module of these functions, imported on first use because some need optional packages.
    supports : tuple of str
        Values of `--what` that the format supports.
    formulas : bool
        Whether the export is formulas of one muscle, for reading.
    """

    name: str
    about: str
    module: str
    supports: tuple[str, ...] = ("shape", "jacobian")
    formulas: bool = False

    def write(self, request: Request) -> Files:
        """Files of an export, without its check files."""
        files: Files = self._function("write", request.what)(request)
        return files

    def check(self, folder: Path, what: str) -> str:
        """Run the check of an export in its own environment; returns its output.

        Raises
        ------
        CheckError
            If a number disagrees.
        ToolMissingError
            If a tool is missing.
        """
        return str(self._function("check", what)(folder))

    def _function(self, verb: str, what: str) -> Callable[..., Any]:
        """Function that writes or checks; exports of constraints have their own."""
        module, name = self.module, f"{verb}_{self.name}"
        if what == "constraints":
            module, name = "nlp_export", f"{verb}_nlp_{self.name}"
        function: Callable[..., Any] = getattr(import_module(f".{module}", __package__), name)
        return function


ALL = ("shape", "jacobian", "constraints")
DERIVATIVES = ("jacobian",)
FORMATS = {
    form.name: form
    for form in (
        Format("c", "C99 source without dependencies", "c", ALL),
        Format("casadi", "CasADi function files", "casadi_files", ALL),
        Format("mex", "MATLAB or Octave MEX source", "mex", ALL),
        Format("numpy", "Python module that needs only NumPy", "numpy_module"),
        Format("jax", "JAX functions with derivatives", "jax_torch", DERIVATIVES),
        Format("torch", "PyTorch functions with derivatives", "jax_torch", DERIVATIVES),
        Format("sympy", "formulas of one muscle in SymPy", "formulas", DERIVATIVES, True),
        Format("latex", "formulas of one muscle in LaTeX", "formulas", DERIVATIVES, True),
    )
}
_SHAPES = tuple(name for name, form in FORMATS.items() if not form.formulas)


@check_arguments
def export(
    subject: Motion | Trunk,
    to: str,
    out: str | Path,
    what: str = "jacobian",
    at: Sequence[float] = (),
    *,
    second: bool = False,
    muscle: str | None = None,
    contact_from: float | None = None,
    elements: int = MIN_ELEMENTS,
) -> list[Path]:
    """Export the map from activations, head angles and loads to shape for another program.

    Parameters
    ----------
    subject : Motion or Trunk
        A motion supplies its trunk, gravity and contact region.
    to : str
        Format: a key of `FORMATS`.
    out : path
        Folder for the files; created if it does not exist.
    what : "shape", "jacobian" or "constraints"
        Shapes; shapes and first derivatives; the functions of the motion's NLP.
    at : sequence of float
        Points Z in m. Default: the tip.
    second : bool
        Whether to add the derivative of the Jacobian along a direction.
    muscle : str, optional
        Name of the muscle, for formulas.
    contact_from : float, optional
        Z in m where the contact region starts; contact force and couple become inputs. Default:
        the motion's.
    elements : int
        Minimum number of collocation elements; more are used if the check cases need them.

    Returns
    -------
    list of Path
        The files written, including the check files.

    Raises
    ------
    InputError
        If the format, points or options are invalid or do not fit together, or a file that no
        export wrote would be overwritten.
    ToolMissingError
        If a package that writes the format is not installed.
    """
    request = build_request(subject, to, what, at, second, muscle, contact_from, elements)
    files = FORMATS[to].write(request)
    if what != "constraints" and to in _SHAPES:
        files |= check_files(request)
    folder = Path(out)
    with alone(folder):
        return write_files(folder, files, {"format": to, "what": what})


@check_arguments
def check_export(folder: str | Path, to: str, what: str = "jacobian") -> str:
    """Run an export in its own environment on its check files; returns the output.

    Raises
    ------
    InputError
        If the format is unknown, or the folder has no such export.
    CheckError
        If a number disagrees, or the export does not run.
    ToolMissingError
        If a required program or package is not installed; the message says how to install it.
    """
    form = _format(to)
    try:
        return form.check(Path(folder), what)
    except FileNotFoundError as error:
        raise InputError(
            f"{error.filename}: no such file; expected the folder of an export to {to}."
        ) from None


def build_request(
    subject: Motion | Trunk,
    to: str,
    what: str,
    at: Sequence[float],
    second: bool,
    muscle: str | None,
    contact_from: float | None,
    elements: int = MIN_ELEMENTS,
) -> Request:
    """Request with the validated arguments of `export`."""
    form = _format(to)
    motion = subject if isinstance(subject, Motion) else None
    trunk = subject.trunk if isinstance(subject, Motion) else subject
    gravity = motion.gravity if motion else Loads().gravity
    contact = contact_from if contact_from is not None or not motion else motion.contact_from
    if contact is not None:
        check_contact(trunk, contact)
    model = build_model(trunk, at, Loads(gravity, contact_from=contact), elements)
    name = motion.name if motion else trunk.name
    request = Request(model, what, name, second, muscle, motion)
    _check_options(request, form, at)
    shapes = what != "constraints" and to in _SHAPES
    return replace(request, model=resolved(model)) if shapes else request


def _format(to: str) -> Format:
    """The format of a name; InputError if there is none."""
    if to not in FORMATS:
        hint = suggestion(to, FORMATS, similarity=0.5)  # of "C++" and "c"
        raise InputError(f"--to {shown(to)}: expected one of {', '.join(FORMATS)}.{hint}")
    return FORMATS[to]


def _check_options(request: Request, form: Format, at: Sequence[float]) -> None:
    """Raise InputError for options that do not fit together."""
    what, muscle, motion = request.what, request.muscle, request.motion
    if what not in form.supports:
        others = [name for name, other in FORMATS.items() if what in other.supports]
        raise InputError(
            f"--what {what}: {form.name} ({form.about}) does not support it; expected "
            f"--what {' or '.join(form.supports)}, or --to {', '.join(others) or 'another format'}."
        )
    constraints = what == "constraints"
    second_fits = what == "jacobian" and form.name in _SHAPES
    faults = {
        "--what constraints: expected a problem, not an anatomy": constraints and not motion,
        "--at: not for --what constraints, whose points are those of its targets": constraints
        and len(at) > 0,
        f"--second: expected with --what jacobian and --to {', '.join(_SHAPES)}": request.second
        and not second_fits,
        "--muscle: expected with --to sympy or latex": muscle is not None and not form.formulas,
    }
    for fault, applies in faults.items():
        if applies:
            raise InputError(f"{fault}.")

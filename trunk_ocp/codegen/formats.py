"""The formats of `trunk-ocp export`: what each carries, who writes it, who checks it."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

from .._support.arguments import check_arguments
from .._support.atomic_files import alone
from .._support.ranges import shown
from ..errors import InputError
from ..model.anatomy import Trunk
from ..model.loads import Loads, check_contact
from ..problem.motion import Motion
from .cases import check_files, resolved
from .model import FEWEST, build_model
from .own_files import Files, write_files
from .request import Request


@dataclass(frozen=True)
class Format:
    """One format.

    Attributes
    ----------
    about : str
        What it is, for help texts and messages.
    module, name : str
        Where `write_NAME(request)` and `check_NAME(folder)` are: imported when they are needed,
        as some need packages of their own.
    carries : tuple of str
        What it can be asked for.
    loaded : bool
        Whether it carries loaded shapes, which take an iteration.
    formulas : bool
        Whether it is about one muscle, to be read.
    """

    about: str
    module: str
    name: str
    carries: tuple[str, ...] = ("shape", "jacobian")
    loaded: bool = True
    formulas: bool = False

    def write(self, request: Request) -> Files:
        """The files of an export, without its check files."""
        part = "nlp_export" if request.what == "constraints" else self.module
        name = f"nlp_{self.name}" if request.what == "constraints" else self.name
        files: Files = getattr(import_module(f".{part}", __package__), f"write_{name}")(request)
        return files

    def check(self, folder: Path, what: str) -> str:
        """What the check of an export in its own environment prints.

        Raises
        ------
        CheckError, ToolMissingError
            If they disagree; if a tool is missing.
        """
        part = "nlp_export" if what == "constraints" else self.module
        name = f"nlp_{self.name}" if what == "constraints" else self.name
        check: Callable[[Path], str] = getattr(
            import_module(f".{part}", __package__), f"check_{name}"
        )
        return check(folder)


ALL = ("shape", "jacobian", "constraints")
FORMATS = {
    "c": Format("C99 source without dependencies", "c", "c", ALL),
    "casadi": Format("CasADi function files", "casadi_files", "casadi", ALL),
    "mex": Format("MATLAB or Octave MEX source", "mex", "mex", ALL),
    "numpy": Format("Python module that needs NumPy only", "numpy_module", "numpy"),
    "jax": Format("JAX functions with derivatives", "wrappers", "jax", ("jacobian",)),
    "torch": Format("PyTorch functions with derivatives", "wrappers", "torch", ("jacobian",)),
    "onnx": Format("ONNX model of unloaded shapes", "onnx_model", "onnx", loaded=False),
    "sympy": Format(
        "formulas of one muscle in SymPy", "formulas", "sympy", ("jacobian",), False, True
    ),
    "latex": Format(
        "formulas of one muscle in LaTeX", "formulas", "latex", ("jacobian",), False, True
    ),
}

_LOADED = tuple(name for name, form in FORMATS.items() if form.loaded)


@check_arguments
def export(
    subject: Motion | Trunk,
    to: str,
    out: str | Path,
    what: str = "jacobian",
    at: Sequence[float] = (),
    *,
    second: bool = False,
    single: bool = False,
    muscle: str | None = None,
    contact_from: float | None = None,
    elements: int = FEWEST,
) -> list[Path]:
    """Write the map from activations, head angles and loads to shape for another program.

    Parameters
    ----------
    subject : Motion or Trunk
        Of a motion its trunk, gravity and contact region are taken.
    to : str
        Format: a key of `FORMATS`.
    out : path
        Folder for the files; made if need be.
    what : "shape", "jacobian" or "constraints"
        Shapes; shapes and first derivatives; the motion NLP's own functions.
    at : sequence of float
        Points Z in m. Default: the tip.
    second : bool
        Whether to add the derivative of the Jacobian along a direction.
    single : bool
        Single precision; for ONNX.
    muscle : str, optional
        The muscle that formulas are for.
    contact_from : float, optional
        Z in m from which the trunk may touch something, so that contact force and couple are
        inputs. Default: the motion's.
    elements : int
        Least number of collocation elements; there are more if the check cases need them.

    Returns
    -------
    list of Path
        The files written, the check files among them.

    Raises
    ------
    InputError
        For a format, points or options that do not go together, or a file in the way.
    ToolMissingError
        If a package that writes the format is not installed.
    """
    request = build_request(subject, to, what, at, second, single, muscle, contact_from, elements)
    files = FORMATS[to].write(request)
    if what != "constraints" and not FORMATS[to].formulas:
        files |= check_files(request, FORMATS[to].loaded)
    folder = Path(out)
    with alone(folder):
        return write_files(folder, files, {"format": to, "what": what})


@check_arguments
def check_export(folder: str | Path, to: str, what: str = "jacobian") -> str:
    """Run an export in its own environment against its check files; what that prints.

    Raises
    ------
    InputError
        If the format is unknown, or the folder has no such export.
    CheckError
        If a number disagrees, or the export does not run.
    ToolMissingError
        If a program or package that this needs is not installed; says how to install it.
    """
    if to not in FORMATS:
        raise InputError(f"to = {shown(to)}: expected one of {', '.join(FORMATS)}.")
    try:
        return FORMATS[to].check(Path(folder), what)
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
    single: bool,
    muscle: str | None,
    contact_from: float | None,
    elements: int = FEWEST,
) -> Request:
    """Checked arguments of `export`."""
    if to not in FORMATS:
        close = difflib.get_close_matches(to, FORMATS, 1)
        hint = f" Did you mean {close[0]}?" if close else ""
        raise InputError(f"--to {to}: expected one of {', '.join(FORMATS)}.{hint}")
    motion = subject if isinstance(subject, Motion) else None
    _check_together(to, what, at, second, single, muscle, motion)
    trunk = subject.trunk if isinstance(subject, Motion) else subject
    gravity = motion.gravity if motion else Loads().gravity
    contact = contact_from if contact_from is not None or not motion else motion.contact_from
    if contact is not None:
        check_contact(trunk, contact)
    model = build_model(trunk, at, Loads(gravity, contact_from=contact), elements)
    if FORMATS[to].loaded and what != "constraints":
        model = resolved(model)
    name = motion.name if motion else trunk.name
    return Request(model, what, name, second, single, muscle, motion)


def _check_together(
    to: str,
    what: str,
    at: Sequence[float],
    second: bool,
    single: bool,
    muscle: str | None,
    motion: Motion | None,
) -> None:
    """Raise InputError for options that mean nothing together."""
    form = FORMATS[to]
    if what not in form.carries:
        able = [name for name, each in FORMATS.items() if what in each.carries]
        raise InputError(
            f"--what {what}: {to} ({form.about}) does not carry it; expected "
            f"--what {' or '.join(form.carries)}, or --to {', '.join(able) or 'another format'}."
        )
    constrained = what == "constraints"
    faults = [
        (constrained and motion is None, "--what constraints: expected a problem, not an anatomy"),
        (constrained and len(at) > 0, "--at: not for --what constraints, which has its own points"),
        (
            second and not (what == "jacobian" and form.loaded),
            f"--second: expected with --what jacobian and --to {', '.join(_LOADED)}",
        ),
        (
            single and to != "onnx",
            "--single: for --to onnx; the others follow their input",
        ),
        (muscle is not None and not form.formulas, "--muscle: expected with --to sympy or latex"),
    ]
    for there, fault in faults:
        if there:
            raise InputError(f"{fault}.")

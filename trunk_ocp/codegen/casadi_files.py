"""CasADi function files: the map for any program that has CasADi, in Python, C++ or MATLAB."""

from __future__ import annotations

import tempfile
from pathlib import Path

import casadi as ca

from . import casadi_function
from .headers import header, template
from .numpy_module import CHECK, check_text, run_check
from .request import Request


def functions(request: Request) -> dict[str, ca.Function]:
    """The functions of an export by their names, which are those of their files."""
    loaded = casadi_function.loaded(request.model)
    unloaded = casadi_function.unloaded(request.model)
    made = {"loaded": loaded, "unloaded": unloaded}
    if request.what == "jacobian":
        made |= {f"{name}_jacobian": casadi_function.jacobian(f) for name, f in made.items()}
        if request.second:
            made["loaded_second"] = casadi_function.second(loaded)
    return made


def write_casadi(request: Request) -> dict[str, str | bytes]:
    """A file for each function, a check that needs nothing but CasADi, and how to call them."""
    files: dict[str, str | bytes] = {
        f"{name}.casadi": _saved(function) for name, function in functions(request).items()
    }
    files[CHECK] = check_text("casadi")
    files["README.txt"] = header(request) + template("casadi/README.txt")
    return files


def check_casadi(folder: Path) -> str:
    """What the export's own check prints.

    Raises
    ------
    CheckError
        If the functions do not give the numbers of the check files.
    """
    return run_check(folder)


def _saved(function: ca.Function) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "function.casadi"
        function.save(str(path))
        return path.read_bytes()

"""CasADi function files, for programs with CasADi in Python, C++ or MATLAB."""

from __future__ import annotations

import tempfile
from pathlib import Path

import casadi as ca

from . import casadi_function
from .headers import header, template
from .numpy_module import CHECK, check_text
from .request import Request
from .run_checks import run_python

check_casadi = run_python


def functions(request: Request) -> dict[str, ca.Function]:
    """The functions of an export, by the names of their files."""
    loaded = casadi_function.loaded(request.model)
    unloaded = casadi_function.unloaded(request.model)
    exported = {"loaded": loaded, "unloaded": unloaded}
    if request.what == "jacobian":
        exported |= {
            f"{name}_jacobian": casadi_function.jacobian(f) for name, f in exported.items()
        }
        if request.second:
            exported["loaded_second"] = casadi_function.second(loaded)
    return exported


def write_casadi(request: Request) -> dict[str, str | bytes]:
    """Files of the export: one for each function, a self-check that needs only CasADi, README."""
    files: dict[str, str | bytes] = {
        f"{name}.casadi": saved(function) for name, function in functions(request).items()
    }
    files[CHECK] = check_text("casadi")
    files["README.txt"] = header(request) + template("casadi/README.txt")
    return files


def saved(function: ca.Function) -> bytes:
    """Content of a function's file."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "function.casadi"
        function.save(str(path))
        return path.read_bytes()

"""The shape and its derivatives for MATLAB and Octave: a MEX gateway to the C export."""

from __future__ import annotations

from pathlib import Path

from .c import write_c
from .headers import commented, header, template
from .request import Request
from .run_checks import build_mex, in_a_copy, run_octave


def write_mex(request: Request) -> dict[str, str | bytes]:
    """Files of the export: the C source, the gateway, help, an example and a self-check."""
    source = write_c(request)
    files: dict[str, str | bytes] = {name: source[name] for name in ("trunk.c", "trunk.h")}
    for name in ("trunk_shape.c", "trunk_shape.m", "trunk_example.m", "check.m"):
        files[name] = template(f"mex/{name}")
    about = template("mex/trunk_shape.m").replace("@HEADER@", commented(header(request), "%"))
    return files | {"trunk_shape.m": about}


def check_mex(folder: Path) -> str:
    """Compile an export with Octave's compiler and run its self-check; returns the output.

    Raises
    ------
    ToolMissingError
        If Octave or its compiler is not installed.
    CheckError
        If it does not compile, or does not reproduce the check files.
    """
    with in_a_copy(folder) as copy:
        build_mex(copy, "trunk_shape", ["trunk_shape.c", "trunk.c"])
        return run_octave(copy, "check")

"""The shape and its derivatives for MATLAB and Octave: a MEX gateway to the C export."""

from __future__ import annotations

from pathlib import Path

from .c import write_c
from .headers import commented, header, template
from .request import Request
from .run_checks import run_mex


def write_mex(request: Request) -> dict[str, str | bytes]:
    """Files of the export: the C source, the gateway, help, an example and a self-check."""
    source = write_c(request)
    files: dict[str, str | bytes] = {name: source[name] for name in ("trunk.c", "trunk.h")}
    for name in ("trunk_shape.c", "trunk_shape.m", "trunk_example.m", "check.m"):
        files[name] = template(f"mex/{name}").replace("@HEADER@", commented(header(request), "%"))
    return files


def check_mex(folder: Path) -> str:
    """Compile and run the self-check of an export; returns its output, and raises as `run_mex`."""
    return run_mex(folder, "trunk_shape", "trunk_shape.c", "trunk.c")

"""The model for PyTorch: a thin wrapper of the NumPy module with derivatives of its own."""

from __future__ import annotations

import importlib.util
from pathlib import Path

from .numpy_module import CHECK, check_text, module_text, run_check
from .numpy_module import NAME as NUMPY
from .request import Request, ToolMissingError
from .texts import template

NAME = "trunk_torch.py"


def write_torch(request: Request) -> dict[str, str | bytes]:
    """Files of the export: wrapper, the NumPy module it wraps, and a program that checks it."""
    return {
        NAME: template("python/torch_wrapper.py"),
        NUMPY: module_text(request),
        CHECK: check_text("torch"),
    }


def check_torch(folder: Path) -> str:
    """What the export's own check prints.

    Raises
    ------
    ToolMissingError
        If PyTorch is not installed.
    CheckError
        If the wrapper does not give the numbers of the check files.
    """
    if importlib.util.find_spec("torch") is None:
        raise ToolMissingError(
            "Checking this export needs the package torch: pip install 'trunk_ocp[torch]'"
        )
    return run_check(folder)

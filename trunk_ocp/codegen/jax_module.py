"""The model for JAX: a thin wrapper of the NumPy module with derivatives of its own."""

from __future__ import annotations

import importlib.util
from pathlib import Path

from .numpy_module import CHECK, check_text, module_text, run_check
from .numpy_module import NAME as NUMPY
from .request import Request, ToolMissingError
from .texts import template

NAME = "trunk_jax.py"


def write_jax(request: Request) -> dict[str, str | bytes]:
    """Files of the export: wrapper, the NumPy module it wraps, and a program that checks it."""
    return {
        NAME: template("python/jax_wrapper.py"),
        NUMPY: module_text(request),
        CHECK: check_text("jax"),
    }


def check_jax(folder: Path) -> str:
    """What the export's own check prints.

    Raises
    ------
    ToolMissingError
        If JAX is not installed.
    CheckError
        If the wrapper does not give the numbers of the check files.
    """
    if importlib.util.find_spec("jax") is None:
        raise ToolMissingError(
            "Checking this export needs the package jax: pip install 'trunk_ocp[jax]'"
        )
    return run_check(folder)

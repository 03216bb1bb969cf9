"""Exports for JAX and PyTorch: wrappers of the NumPy module, with derivatives."""

from __future__ import annotations

import importlib.util
from functools import partial
from pathlib import Path

from .headers import template
from .numpy_module import CHECK, NAME, check_text, module_text
from .request import Request, ToolMissingError
from .run_checks import run_python


def _files(package: str, request: Request) -> dict[str, str | bytes]:
    """Files of an export: wrapper, the NumPy module that it wraps, and a self-check."""
    return {
        f"trunk_{package}.py": template(f"python/{package}_wrapper.py"),
        NAME: module_text(request),
        CHECK: check_text(package),
    }


def _check(package: str, folder: Path) -> str:
    """Run the self-check of an export; returns its output.

    Raises
    ------
    ToolMissingError
        If the package is not installed.
    CheckError
        If the wrapper does not reproduce the check files.
    """
    if importlib.util.find_spec(package) is None:
        raise ToolMissingError(
            f"Checking this export needs the package {package}: pip install {package}"
        )
    return run_python(folder)


write_jax, check_jax = partial(_files, "jax"), partial(_check, "jax")
write_torch, check_torch = partial(_files, "torch"), partial(_check, "torch")

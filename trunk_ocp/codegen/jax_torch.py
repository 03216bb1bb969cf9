"""The model for JAX and PyTorch: wrappers of the NumPy module with derivatives of their own."""

from __future__ import annotations

import importlib.util
from pathlib import Path

from .headers import template
from .numpy_module import CHECK, NAME, check_text, module_text, run_check
from .request import Request, ToolMissingError


def write_jax(request: Request) -> dict[str, str | bytes]:
    """Files of the export: wrapper, the NumPy module it wraps, and a program that checks it."""
    return _written(request, "jax")


def write_torch(request: Request) -> dict[str, str | bytes]:
    """The same for PyTorch."""
    return _written(request, "torch")


def check_jax(folder: Path) -> str:
    """What the export's own check prints.

    Raises
    ------
    ToolMissingError
        If the package is not installed.
    CheckError
        If the wrapper does not give the numbers of the check files.
    """
    return _checked(folder, "jax")


def check_torch(folder: Path) -> str:
    """The same for PyTorch."""
    return _checked(folder, "torch")


def _written(request: Request, package: str) -> dict[str, str | bytes]:
    return {
        f"trunk_{package}.py": template(f"python/{package}_wrapper.py"),
        NAME: module_text(request),
        CHECK: check_text(package),
    }


def _checked(folder: Path, package: str) -> str:
    if importlib.util.find_spec(package) is None:
        raise ToolMissingError(
            f"Checking this export needs the package {package}: pip install 'trunk_ocp[{package}]'"
        )
    return run_check(folder)

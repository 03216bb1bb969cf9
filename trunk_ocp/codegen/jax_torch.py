"""Exports for JAX and PyTorch: wrappers of the NumPy module, with derivatives."""

from __future__ import annotations

import importlib.util
from pathlib import Path

from .headers import template
from .numpy_module import CHECK, NAME, check_text, module_text, run_check
from .request import Request, ToolMissingError


def write_jax(request: Request) -> dict[str, str | bytes]:
    """Files of a JAX export: wrapper, the NumPy module that it wraps, and a self-check."""
    return _files(request, "jax")


def write_torch(request: Request) -> dict[str, str | bytes]:
    """Files of a PyTorch export; as `write_jax`."""
    return _files(request, "torch")


def check_jax(folder: Path) -> str:
    """Run the self-check of a JAX export; returns its output.

    Raises
    ------
    ToolMissingError
        If the package is not installed.
    CheckError
        If the wrapper does not reproduce the check files.
    """
    return _check(folder, "jax")


def check_torch(folder: Path) -> str:
    """Run the self-check of a PyTorch export; as `check_jax`."""
    return _check(folder, "torch")


def _files(request: Request, package: str) -> dict[str, str | bytes]:
    return {
        f"trunk_{package}.py": template(f"python/{package}_wrapper.py"),
        NAME: module_text(request),
        CHECK: check_text(package),
    }


def _check(folder: Path, package: str) -> str:
    if importlib.util.find_spec(package) is None:
        raise ToolMissingError(
            f"Checking this export needs the package {package}: pip install {package}"
        )
    return run_check(folder)

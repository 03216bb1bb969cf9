"""Provenance of results: versions of the software, and fingerprints of the input."""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import io
import json
import platform
import re
from functools import cache
from importlib.metadata import version
from typing import Any

import casadi as ca
import numpy as np
from pydantic import BaseModel


@cache
def versions() -> dict[str, str]:
    """Versions of everything that may affect the last digits of a result."""
    return {
        "trunk_ocp": version("trunk_ocp"),
        "casadi": version("casadi"),
        "ipopt": _ipopt_version(),
        "numpy": version("numpy"),
        "scipy": version("scipy"),
        "python": platform.python_version(),
        "platform": platform.platform(),
    }


def fingerprint(value: Any) -> str:
    """SHA-256, in hexadecimal, of a value, independent of the formatting of its file.

    The value is first serialized to JSON without spaces, with sorted keys and all digits. It may
    consist of file sections, dataclasses, arrays, and JSON types.
    """
    text = json.dumps(value, sort_keys=True, separators=(",", ":"), default=plain)
    return hashlib.sha256(text.encode()).hexdigest()


def plain(value: Any) -> Any:
    """A file section, a dataclass or an array as JSON types.

    Raises
    ------
    TypeError
        If it is of another type.
    """
    if isinstance(value, BaseModel):
        return value.model_dump(mode="json")
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
    if isinstance(value, np.ndarray):
        return value.tolist()
    raise TypeError(f"{type(value).__name__}: cannot be serialized.")


def _ipopt_version() -> str:
    """Version of Ipopt, which reports it only in the banner of a solve."""
    x, banner = ca.SX.sym("x"), io.StringIO()
    with contextlib.redirect_stdout(banner):
        ca.nlpsol("probe", "ipopt", {"x": x, "f": x**2}, {"ipopt.print_level": 5})(x0=1.0)
    match = re.search(r"Ipopt version ([\w.]*\w)", banner.getvalue())
    return match[1] if match else "unknown"

"""Where a result comes from: versions of what made it, and fingerprints of what it was made of."""

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
    """Version of everything whose change may change a result's last digits."""
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
    """SHA-256, in hexadecimal, of what a value says, whatever its file looked like.

    The value is brought into one form first: JSON without spaces, keys sorted, every number with
    all of its digits. Takes file sections, dataclasses, arrays, and what JSON has.
    """
    text = json.dumps(value, sort_keys=True, separators=(",", ":"), default=plain)
    return hashlib.sha256(text.encode()).hexdigest()


def plain(value: Any) -> Any:
    """A file section, a dataclass or an array as JSON has it.

    Raises
    ------
    TypeError
        If it is none of these.
    """
    if isinstance(value, BaseModel):
        return value.model_dump(mode="json")
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
    if isinstance(value, np.ndarray):
        return value.tolist()
    raise TypeError(f"{type(value).__name__}: has no plain form.")


def _ipopt_version() -> str:
    """Ipopt tells its version only in the banner of a solve."""
    x, said = ca.SX.sym("x"), io.StringIO()
    with contextlib.redirect_stdout(said):
        ca.nlpsol("probe", "ipopt", {"x": x, "f": x**2}, {"ipopt.print_level": 5})(x0=1.0)
    found = re.search(r"Ipopt version ([\w.]*\w)", said.getvalue())
    return found[1] if found else "unknown"

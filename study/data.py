"""Storage of the study's data: small JSON files with six significant digits."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from trunk_ocp.planning.storage import finite

ROOT = Path(__file__).parent.parent
DATA = ROOT / "results" / "foresight"
PAGE = ROOT / "docs" / "foresight.md"
MOTIONS = ("pick-fruit", "lift-log", "lift-log-asymmetric")
DIGITS = 6


def rounded(value: Any) -> Any:
    """A value with every float rounded to `DIGITS` significant digits."""
    if isinstance(value, dict):
        return {key: rounded(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [rounded(entry) for entry in value]
    return float(f"{value:.{DIGITS}g}") if isinstance(value, float) else value


def write(name: str, value: Any, folder: Path = DATA) -> None:
    """Write the data of one part."""
    folder.mkdir(parents=True, exist_ok=True)
    text = json.dumps(rounded(finite(value)), indent=1, allow_nan=False)
    (folder / f"{name}.json").write_text(text + "\n")


def read(name: str, folder: Path = DATA) -> Any:
    """Read the data of one part."""
    return json.loads((folder / f"{name}.json").read_text())

"""Problem files written from their spec."""

from __future__ import annotations

from .._support.toml_text import toml_text
from .problem_file import ProblemSpec


def problem_text(spec: ProblemSpec) -> str:
    """A problem file with this spec; keys that have their default are left out."""
    return toml_text(spec.model_dump(mode="json", by_alias=True, exclude_defaults=True))

"""The command that resumes an unfinished run."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from typing import Any


def resume_command(given: Mapping[str, Any]) -> str:
    """`solve-motion` with the arguments and options of an earlier run, as saved, and --resume."""
    from .commands import solve  # the command line, which most users of plans never need

    words = ["solve-motion", str(given.get("problem", "PROBLEM"))]
    for option in solve.params:
        value, name = given.get(str(option.name)), option.opts[0]
        usual = value in (None, False, option.default)
        if name.startswith("--") and name != "--resume" and not usual:
            words += [name] if value is True else [name, str(value)]
    return shlex.join([*words, "--resume"])

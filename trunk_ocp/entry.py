"""Where the installed commands begin: Ctrl-C is answered before anything large is imported."""

from __future__ import annotations

import sys

from .interrupts import INTERRUPTED, Interrupts, ignore_at_exit


def solve_motion() -> None:
    """`solve-motion`."""
    _run("solve")


def trunk_ocp() -> None:
    """`trunk-ocp`."""
    _run("main")


def _run(name: str) -> None:
    interrupts = Interrupts().__enter__()  # until the process ends
    ignore_at_exit()
    try:
        from . import commands

        getattr(commands, name)()
    except KeyboardInterrupt:
        _interrupted()
    except Exception:
        if not interrupts.came:  # an import that was interrupted may fail in another way
            raise
        _interrupted()


def _interrupted() -> None:
    if sys.stderr is not None:
        sys.stderr.write("Interrupted; nothing was done.\n")
    sys.exit(INTERRUPTED)

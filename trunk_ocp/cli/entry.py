"""Where the installed commands begin: Ctrl-C is answered before anything large is imported."""

from __future__ import annotations

import atexit
import contextlib
import os
import sys

from .interrupts import INTERRUPTED, Interrupts


def solve_motion() -> None:
    """`solve-motion`."""
    _run("solve")


def trunk_ocp() -> None:
    """`trunk-ocp`."""
    _run("main")


def _run(name: str) -> None:
    interrupts = Interrupts().__enter__()  # until the process ends
    codes: list[int] = []
    atexit.register(_leave, codes)  # first in, last out
    try:
        from . import commands

        getattr(commands, name)()
    except SystemExit as ended:
        codes.append(ended.code if isinstance(ended.code, int) else 0)
    except KeyboardInterrupt:
        codes.append(_interrupted())
    except Exception:
        if not interrupts.came:  # an import that was interrupted may fail in another way
            raise
        codes.append(_interrupted())


def _interrupted() -> int:
    if sys.stderr is not None:
        sys.stderr.write("Interrupted; nothing was done.\n")
    return INTERRUPTED


def _leave(codes: list[int]) -> None:
    """End without taking the interpreter down, which takes a while and heeds no Ctrl-C."""
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, ValueError, AttributeError):
            stream.flush()
    os._exit(codes[0] if codes else 1)

"""Entry points of the installed commands: Ctrl-C works before anything large is imported."""

from __future__ import annotations

import atexit
import contextlib
import os
import sys

from .exit_codes import INTERNAL_ERROR, INTERRUPTED, SUCCESS
from .interrupts import Interrupts


def solve_motion() -> None:
    """Run `solve-motion`."""
    _run("solve")


def trunk_ocp() -> None:
    """Run `trunk-ocp`."""
    _run("main")


def _run(name: str) -> None:
    interrupts = Interrupts().__enter__()  # until the process ends
    codes: list[int] = []
    atexit.register(_exit_quickly, codes)  # registered first, so it runs last
    try:
        from . import commands

        getattr(commands, name)()
    except SystemExit as exit_request:
        codes.append(exit_request.code if isinstance(exit_request.code, int) else SUCCESS)
    except KeyboardInterrupt:
        codes.append(_report_interrupt())
    except Exception:
        if not interrupts.received:  # an interrupted import may raise any error
            raise
        codes.append(_report_interrupt())


def _report_interrupt() -> int:
    if sys.stderr is not None:
        sys.stderr.write("Interrupted; nothing was done.\n")
    return INTERRUPTED


def _exit_quickly(codes: list[int]) -> None:
    """End without the interpreter's own shutdown, which is slow and ignores Ctrl-C."""
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, ValueError, AttributeError):
            stream.flush()
    os._exit(codes[0] if codes else INTERNAL_ERROR)

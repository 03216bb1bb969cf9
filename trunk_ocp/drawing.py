"""All pictures of a run, drawn by two processes side by side."""

from __future__ import annotations

import logging
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Any

from .errors import TrunkError
from .figures import FORMATS, PARTS, draw_anatomy, draw_comparison
from .files import discard_unfinished
from .page import write_page
from .solution import Plan

PROCESSES = 2
PAGE = "motion.html"


def draw_run(plans: Sequence[Plan], folders: Sequence[Path], folder: Path) -> Path | None:
    """Draw the figures of plans into their folders, and what they share into `folder`.

    Figures of one plan go to its folder's `figures/`, those of the trunk and of two plans
    together to `folder / "figures"`, the page to `folder / PAGE`.

    Returns
    -------
    The page; None if no plan has a time step.

    Raises
    ------
    InputError
        If something cannot be written there.
    TrunkError
        If a process that draws was ended from outside.
    """
    drawn = [pair for pair in zip(plans, folders, strict=True) if len(pair[0].x)]
    if not drawn:
        return None
    work: list[tuple[Callable[..., Any], tuple[Any, ...]]] = [
        (part, (plan, place / "figures", FORMATS)) for part in PARTS for plan, place in drawn
    ]
    if len(drawn) == 2:
        work.append((draw_comparison, (drawn[0][0], drawn[1][0], folder / "figures")))
    work.append((draw_anatomy, (plans[0].motion.trunk, folder / "figures")))
    # New processes: what is forked from one with solver threads may hang.
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(PROCESSES, context, _serve)
    try:
        tasks = [pool.submit(function, *arguments) for function, arguments in work]
        page = write_page([plan for plan, _ in drawn], folder / PAGE)
        for task in tasks:
            task.result()
    except BrokenProcessPool:
        raise TrunkError(
            "The figures are not complete: a process that draws was ended from outside, perhaps "
            "for want of memory. The plans are saved; --no-figures draws none."
        ) from None
    except BaseException:
        for process in multiprocessing.active_children():
            process.terminate()
        raise
    finally:
        pool.shutdown(cancel_futures=True)
    return page


def _serve() -> None:
    """Begin a process that draws: it ends with the one that started it, and only with that.

    Ctrl-C reaches every process at once; the first one answers for all.
    """
    logging.getLogger("matplotlib").setLevel(logging.ERROR)  # as in the one that started it
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, lambda number, frame: _leave())
    threading.Thread(target=_follow, daemon=True).start()


def _follow() -> None:
    """Wait for the end of the process that started this one; killed, it cannot tell."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        _leave()


def _leave() -> None:
    discard_unfinished()
    os._exit(1)

"""All pictures of a run, drawn by two processes side by side."""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

from .figures import FORMATS, PARTS, draw_anatomy, draw_comparison
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
    pool = ProcessPoolExecutor(PROCESSES, context, _ignore_interrupts)
    try:
        tasks = [pool.submit(function, *arguments) for function, arguments in work]
        page = write_page([plan for plan, _ in drawn], folder / PAGE)
        for task in tasks:
            task.result()
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
    return page


def _ignore_interrupts() -> None:
    """Ctrl-C reaches every process at once; the first one answers for all."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)

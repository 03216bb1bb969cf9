"""All figures of a run and its page, drawn by two parallel processes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from .._support.process_pool import Job, cores, iter_finished
from ..errors import TrunkError
from ..figures import FORMATS, PARTS, draw_anatomy, draw_comparison
from ..planning.plan import Plan
from ..viewer import write_page
from .error_messages import error_summary

PROCESSES = 2
PAGE = "motion.html"


def draw_run(
    plans: Sequence[Plan], folders: Sequence[Path], folder: Path
) -> tuple[Path | None, list[str]]:
    """Draw the figures of plans into their folders, and shared figures into `folder`.

    Figures of one plan go to its folder's `figures/`; those of the trunk, and of two plans
    together, to `folder / "figures"`; the page to `folder / PAGE`. A figure that fails, with
    whatever error, does not stop the others: the plans matter more than their figures.

    Returns the page, None if it was not written, and a sentence for each figure that failed.
    """
    pairs = [pair for pair in zip(plans, folders, strict=True) if len(pair[0].x)]
    if not pairs:
        return None, []
    jobs: dict[str, Job[Any]] = {"the page": (write_page, ([p for p, _ in pairs], folder / PAGE))}
    for draw in PARTS:
        for plan, place in pairs:
            jobs[f"the {plan.mode} plan's {draw.__name__.removeprefix('draw_')}"] = (
                draw,
                (plan, place / "figures", FORMATS),
            )
    if len(pairs) == 2:
        both = (pairs[0][0], pairs[1][0], folder / "figures")
        jobs["the comparison of both plans"] = (draw_comparison, both)
    jobs["the anatomy"] = (draw_anatomy, (plans[0].motion.trunk, folder / "figures"))
    names, failures, page = [*jobs], [], None
    unfinished = set(names)
    try:
        for number, future in iter_finished([*jobs.values()], min(PROCESSES, cores())):
            unfinished.discard(names[number])
            error = future.exception()
            if error is not None:
                failures.append(_failure(names[number], error))
            elif names[number] == "the page":
                page = future.result()
    except TrunkError as error:
        failures.append(_failure(", ".join(name for name in names if name in unfinished), error))
    return page, failures


def _failure(subject: str, error: BaseException) -> str:
    return f"could not draw {subject}: {error_summary(error).rstrip('.')}."

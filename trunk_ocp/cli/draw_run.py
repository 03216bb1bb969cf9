"""All pictures of a run, drawn by two processes side by side."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .._support.process_pool import Job, cores, iter_finished
from ..errors import TrunkError
from ..figures import FORMATS, PARTS, draw_anatomy, draw_comparison
from ..planning.plan import Plan
from ..viewer import write_page
from .ending import described

PROCESSES = 2
PAGE = "motion.html"


@dataclass(frozen=True)
class Drawn:
    """What came of the pictures of a run.

    Attributes
    ----------
    page : Path or None
        The page to turn the trunk in; None if there is none.
    failed : tuple of str
        A sentence for each picture that could not be drawn.
    """

    page: Path | None
    failed: tuple[str, ...]


def draw_run(plans: Sequence[Plan], folders: Sequence[Path], folder: Path) -> Drawn:
    """Draw the figures of plans into their folders, and what they share into `folder`.

    Figures of one plan go to its folder's `figures/`, those of the trunk and of two plans
    together to `folder / "figures"`, the page to `folder / PAGE`. A picture that fails stops no
    other, whatever its error: the plans are worth more than pictures of them.
    """
    drawn = [pair for pair in zip(plans, folders, strict=True) if len(pair[0].x)]
    if not drawn:
        return Drawn(None, ())
    work: dict[str, Job[Any]] = {"the page": (write_page, ([p for p, _ in drawn], folder / PAGE))}
    for part in PARTS:
        for plan, place in drawn:
            work[f"the {plan.mode} plan's {_subject(part)}"] = (
                part,
                (plan, place / "figures", FORMATS),
            )
    if len(drawn) == 2:
        both = (drawn[0][0], drawn[1][0], folder / "figures")
        work["the comparison of both plans"] = (draw_comparison, both)
    work["the anatomy"] = (draw_anatomy, (plans[0].motion.trunk, folder / "figures"))
    names, failed, page = [*work], [], None
    left = set(names)
    try:
        for number, future in iter_finished([*work.values()], min(PROCESSES, cores())):
            left.discard(names[number])
            error = future.exception()
            if error is not None:
                failed.append(_sentence(names[number], error))
            elif names[number] == "the page":
                page = future.result()
    except TrunkError as error:
        failed.append(_sentence(", ".join(name for name in names if name in left), error))
    return Drawn(page, tuple(failed))


def _subject(part: Callable[..., Any]) -> str:
    """What a function that draws is about: `draw_shapes` draws shapes."""
    return part.__name__.removeprefix("draw_")


def _sentence(what: str, error: BaseException) -> str:
    return f"could not draw {what}: {described(error).rstrip('.')}."

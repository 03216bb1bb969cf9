"""The figures of a run and its page: the main ones at once, or all of them by two processes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .._support.process_pool import Job, cores, iter_finished
from ..errors import TrunkError
from ..figures import FORMATS, MAIN_FORMATS, MAIN_PARTS, PARTS, draw_anatomy, draw_comparison
from ..planning.plan import Plan
from ..viewer import write_page
from .error_messages import error_summary

PROCESSES = 2
PAGE = "motion.html"


@dataclass(frozen=True)
class Drawn:
    """The page, None if it was not written; other files; a sentence for each failure."""

    page: Path | None
    files: tuple[Path, ...]
    failures: tuple[str, ...]


def draw_run(
    plans: Sequence[Plan], folders: Sequence[Path], folder: Path, everything: bool = False
) -> Drawn:
    """Draw the figures of plans into their folders, and shared figures into `folder`.

    Figures of one plan go to its folder's `figures/`; those of the trunk, and of two plans
    together, to `folder / "figures"`; the page to `folder / PAGE`. Without `everything` only the
    main figures are drawn, as PNG. They take as long as it takes to start a process, so they are
    drawn in this one. A figure that fails, with whatever error, does not stop the others: the
    plans matter more than their figures.
    """
    pairs = [pair for pair in zip(plans, folders, strict=True) if len(pair[0].x)]
    if not pairs:
        return Drawn(None, (), ())
    jobs = _jobs(pairs, folder, everything)
    names, page = [*jobs], None
    files: list[Path] = []
    failures: list[str] = []
    unfinished = set(names)
    processes = min(PROCESSES, cores()) if everything else 1
    try:
        for number, future in iter_finished([*jobs.values()], processes):
            unfinished.discard(names[number])
            error = future.exception()
            if error is not None:
                failures.append(_failure(names[number], error))
            elif names[number] == "the page":
                page = future.result()
            else:
                files += future.result()
    except TrunkError as error:
        failures.append(_failure(", ".join(name for name in names if name in unfinished), error))
    return Drawn(page, tuple(sorted(files)), tuple(failures))


def _jobs(
    pairs: Sequence[tuple[Plan, Path]], folder: Path, everything: bool
) -> dict[str, Job[Any]]:
    """What to draw, by its name in messages."""
    parts: Sequence[Callable[..., Any]] = PARTS if everything else MAIN_PARTS
    formats = FORMATS if everything else MAIN_FORMATS
    jobs: dict[str, Job[Any]] = {"the page": (write_page, ([p for p, _ in pairs], folder / PAGE))}
    for draw in parts:
        for plan, place in pairs:
            name = draw.__name__.removeprefix("draw_")
            jobs[f"the {plan.mode} plan's {name}"] = draw, (plan, place / "figures", formats)
    if len(pairs) == 2:
        both = (pairs[0][0], pairs[1][0], folder / "figures", formats)
        jobs["the comparison of both plans"] = draw_comparison, both
    if everything:
        trunk = pairs[0][0].motion.trunk
        jobs["the anatomy"] = draw_anatomy, (trunk, folder / "figures", formats)
    return jobs


def file_lines(files: Sequence[Path]) -> list[str]:
    """A line for each folder of files: where it is, and which pictures are there."""
    folders: dict[Path, dict[str, list[str]]] = {}
    for file in files:
        suffixes = folders.setdefault(file.parent, {}).setdefault(file.stem, [])
        suffixes.append(file.suffix.removeprefix(".").upper())
    lines = []
    for folder, names in folders.items():
        kinds = sorted({suffix for suffixes in names.values() for suffix in suffixes})
        lines.append(f"Figures in {folder}/: {', '.join(names)} ({' and '.join(kinds)})")
    return lines


def _failure(subject: str, error: BaseException) -> str:
    return f"could not draw {subject}: {error_summary(error).rstrip('.')}."

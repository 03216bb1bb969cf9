"""What windows have in common whose NLPs differ in numbers only, and which can be condensed."""

from __future__ import annotations

from collections.abc import Hashable, Iterator

from ..problem.motion import Motion
from ..problem.targets import HeldDirection, Target
from ..rod.equations import is_hung
from .window import Window


def can_condense(window: Window) -> bool:
    """Whether all rows of a window but its equations are linear, and bounds of one control each.

    Gaps from bodies are not, nor are sides that contract alike.
    """
    return not window.gap_rows and not window.motion.spec.weights.symmetric


def layout_of(motion: Motion) -> Hashable:
    """Equal for motions whose windows have the same decision vector, and goals of the same kinds.

    They differ only in numbers: targets, loads, bounds, the start.
    """
    steps = []
    for step in motion.steps:
        targets = tuple(
            (target.Z, target.frame, target.position is None, *_kinds(target))
            for target in step.targets
        )
        pull = None if step.pull is None else step.pull[1]
        limited = step.change.limited.tobytes()
        steps.append((step.duration, targets, pull, is_hung(step.loads), limited))
    return motion.extension, motion.spec.weights.symmetric, tuple(steps)


def _kinds(target: Target) -> Iterator[tuple[int, HeldDirection | None]]:
    """Directors with a direction, and where it is held from if it is not fixed."""
    for j, direction, _ in target.pairs():
        yield j, direction if isinstance(direction, HeldDirection) else None

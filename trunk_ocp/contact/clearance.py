"""How far a planned trunk stays from every solid and from itself, in numbers and in sentences.

The check shares no code with the rows of the NLP: it works on sampled shapes, with distances from
`model.solids` and the bounds of `certificate`.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from .._support.wording import step_list
from .gaps import Bend, Gap

COLLISION_TOL = 5.7e-5
"""By how much a gap may be too small, as a share of the trunk's length; 0.1 mm for the elephant."""


@dataclass(frozen=True, eq=False, repr=False)
class Clearance:
    """Gaps between a planned trunk and every body.

    Attributes
    ----------
    at_steps, between : tuple of Gap
        The smallest gap to each body at each time step, and on the way to each.
    length : float
        Length of the trunk in m.
    bend : Bend or None
        The sharpest bend at a time step.
    """

    at_steps: tuple[Gap, ...]
    between: tuple[Gap, ...]
    length: float
    bend: Bend | None = None

    def __repr__(self) -> str:
        worst = self.min
        nearest = "" if worst is None else f", {worst.gap:.4g} m from {worst.body} at the least"
        return f"<Clearance of {len(self.at_steps)} gaps at steps{nearest}>"

    @property
    def min(self) -> Gap | None:
        """The smallest gap of all, with the lowest bound of all; None for a plan without steps."""
        return _smallest(self.all)

    @property
    def all(self) -> tuple[Gap, ...]:
        """Gaps at time steps and between them."""
        return (*self.at_steps, *self.between)

    def of_step(self, step: int) -> Gap | None:
        """The smallest gap at a time step (from 0) and on the way to it, as `min`."""
        return _smallest([gap for gap in self.all if gap.step == step])

    def sentences(self, groups: Collection[str]) -> list[str]:
        """Bodies of some groups that the trunk is too close to, a sentence each.

        A gap that is bounded from below only, because the trunk has no equilibrium somewhere or
        moves too fast, counts as too small.
        """
        tol, found = COLLISION_TOL * self.length, []
        for body in dict.fromkeys(gap.body for gap in self.all if gap.group in groups):
            small = [g for g in self.all if g.body == body and not g.bound >= g.least - tol]
            if small:
                found.append(_sentence(small, tol))
        return found

    @property
    def warnings(self) -> list[str]:
        """Bodies that the trunk certainly is in, or closer to than asked, and creases."""
        tol, found = COLLISION_TOL * self.length, []
        for body in dict.fromkeys(gap.body for gap in self.all):
            small = [gap for gap in self.all if gap.body == body and gap.depth > tol]
            if small:
                found.append(_sentence(small, tol))
        if self.bend is not None and self.bend.sharpness > 1:
            found.append(
                f"the trunk creases at step {self.bend.step + 1}, Z = {self.bend.Z:.2f} m: it "
                f"bends {self.bend.sharpness:.3g} times as sharply as its own radius"
            )
        return found


def _smallest(gaps: Sequence[Gap]) -> Gap | None:
    known = [gap for gap in gaps if not np.isnan(gap.gap)]
    if not known:
        return None
    return replace(min(known, key=lambda gap: gap.gap), bound=min(gap.bound for gap in gaps))


def _sentence(small: Sequence[Gap], tol: float) -> str:
    """What is wrong with gaps to one body that are too small."""
    body = "itself" if small[0].group == "self" else f"the {small[0].body}"
    unknown = sorted({gap.step + 1 for gap in small if np.isnan(gap.gap)})
    if unknown:
        return (
            f"the trunk has no equilibrium on the way to {step_list(unknown)}, or none that the "
            f"plan's mesh resolves, so its distance from {body} is unknown there"
        )
    steps = step_list(sorted({gap.step + 1 for gap in small}))
    worst = max(small, key=lambda gap: (gap.depth > tol, gap.depth, gap.least - gap.bound))
    if worst.depth <= tol:
        worst = max(small, key=lambda gap: gap.least - gap.bound)
    at = f"at Z = {worst.Z:.2f} m" + (f" and {worst.other:.2f} m" if worst.other > 0 else "")
    at_start = " at the start," if worst.time == 0 else ""
    when = f"worst{at_start} at {worst.time:.3g} s; at or before {steps}"
    if worst.depth <= tol:
        missing = 1e3 * (worst.least - worst.bound)
        return f"the trunk may be {missing:.2g} mm too close to {body} {at} ({when})"
    if worst.gap < 0:
        asked = f", {1e3 * worst.least:g} mm clear of it are asked for" if worst.least > 0 else ""
        return f"the trunk enters {body} by {-1e3 * worst.gap:.3g} mm {at} ({when}{asked})"
    return (
        f"the trunk is {1e3 * worst.gap:.3g} mm from {body} {at}, {1e3 * worst.least:g} mm are "
        f"asked for ({when})"
    )

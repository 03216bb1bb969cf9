"""How long phases have to be for quasi-statics to hold.

Stretched in time by a factor s, a phase goes through the same shapes and every acceleration is
1 / s^2 times as large, as "cosine" and "hermite" start and end each phase at rest: how long one
takes makes no difference to the others.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..problem.motion import Motion
from .inertia import Inertia

ACCEPTED = 0.05
"""Ratio of inertia to weight with which quasi-statics counts as accurate, unless one is asked."""
WORTH_A_WARNING = 0.1
GRAVITY = 9.8  # m/s^2, of which accelerations are multiples


@dataclass(frozen=True)
class PhaseInertia:
    """The largest inertia in a phase.

    Attributes
    ----------
    phase : int
        From 0.
    ratio, time, acceleration
        Of `Inertia`, at its worst: no unit, s, and m/s^2.
    factor : float
        By which the phase has to be slower, 1 or more.
    """

    phase: int
    ratio: float
    time: float
    acceleration: float
    factor: float


def phases_with_inertia(
    motion: Motion, inertia: Inertia, accepted: float = ACCEPTED
) -> list[PhaseInertia]:
    """The phases whose inertia is known, and how much slower they have to be.

    accepted : largest ratio of inertia to weight, more than 0
    """
    found = []
    for phase in range(len(motion.phases)):
        steps = [t for t in range(len(inertia.ratio)) if motion.steps[t].phase == phase]
        known = [t for t in steps if not np.isnan(inertia.ratio[t])]
        if known:
            worst = max(known, key=lambda t: inertia.ratio[t])
            ratio = float(inertia.ratio[worst])
            found.append(
                PhaseInertia(
                    phase,
                    ratio,
                    float(inertia.time[worst]),
                    float(inertia.acceleration[known].max()),
                    max(1.0, float(np.sqrt(ratio / accepted))),
                )
            )
    return found


def warnings(motion: Motion, inertia: Inertia) -> list[str]:
    """Phases in which inertia is not small, a sentence each."""
    return [
        f"{motion.phases[each.phase].name}: it would be {each.ratio:.2g} times the weight at "
        f"{each.time:.3g} s; slow the phase by {each.factor:.2g}"
        for each in phases_with_inertia(motion, inertia)
        if each.ratio > WORTH_A_WARNING
    ]

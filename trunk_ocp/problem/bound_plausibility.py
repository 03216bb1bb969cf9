"""Plausibility of a start and of bounds; see `plausibility`."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from ..model.activation import strain_matrix, strains
from .motion import Motion
from .variants import HEAD_ANGLES

BOUND_TOL = 1e-6


def of_start(motion: Motion) -> Iterator[tuple[str, object, str]]:
    """Findings on a start outside bounds: key, value and a text."""
    x0, box, count = motion.start, motion.box, len(motion.trunk.muscles)
    text = "outside the motion's bounds, {:g} to {:g}, which count from step 1 on"
    outside = np.flatnonzero((x0 < box.lower - BOUND_TOL) | (x0 > box.upper + BOUND_TOL))
    for i in outside[:1].tolist():
        key = f'activation."{motion.trunk.muscles[i]}"' if i < count else HEAD_ANGLES[i - count]
        unit = 1.0 if i < count else math.degrees(1.0)
        value, low, high = (float(unit * one[i]) for one in (x0, box.lower, box.upper))
        sign = "; negative contracts" if i < count and value > 0 else ""
        more = f"; so are {outside.size - 1} more" if outside.size > 1 else ""
        yield f"start.{key}", value, text.format(low, high) + sign + more
    extension = strains(motion.trunk, x0[:count])[:, 0]
    low, high = motion.extension
    outside = np.flatnonzero((extension < low - BOUND_TOL) | (extension > high + BOUND_TOL))
    for i in outside[:1].tolist():
        length = f"makes segment {i + 1} {extension[i]:.4g} times as long"
        active = f"{np.count_nonzero(x0[:count])} muscles"
        yield "start.activation", active, f"{length}, {text.format(low, high)}"


def of_changes(motion: Motion) -> Iterator[tuple[str, object, str]]:
    """A finding on bounds that contradict each other, so that no plan can keep them."""
    A = strain_matrix(motion.trunk)[:, 0]
    names = (*motion.trunk.muscles, *HEAD_ANGLES)
    low = high = motion.start  # range of each control, from the start on
    for number, step in enumerate(motion.steps, 1):
        low = np.maximum(low + step.change.lower, step.box.lower)
        high = np.minimum(high + step.change.upper, step.box.upper)
        where = f"phases[{step.phase + 1}]"
        for i in np.flatnonzero(low > high + BOUND_TOL).tolist():
            text = "its bounds cannot be reached by the changes allowed from the start on; no plan"
            yield f"{where}.change", names[i], f"at step {number}, {text} can keep both"
            return
        least = 1 + np.minimum(A * low[:-2], A * high[:-2]).sum(axis=1)
        most = 1 + np.maximum(A * low[:-2], A * high[:-2]).sum(axis=1)
        outside = (least > motion.extension[1] + BOUND_TOL) | (
            most < motion.extension[0] - BOUND_TOL
        )
        for i in np.flatnonzero(outside).tolist():
            yield (
                "bounds.extension",
                motion.extension,
                f"at step {number} the allowed activations make segment {i + 1} from "
                f"{least[i]:.4g} to {most[i]:.4g} times as long; no plan can keep both",
            )
            return

"""The moving trunk at one instant of a plan."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..model.loads import Loads
from ..problem.interpolation import interpolate, loads_at, planned_time
from ..problem.motion import Motion
from ..rod.shape import Shape
from ..rod.statics import refined, solve_statics

MAX_DEFECT = 1e-4
"""Largest `Shape.defect` of a sample, beyond which its mesh is refined."""


@dataclass(frozen=True, eq=False)
class Sample:
    """The moving trunk at one instant; `after` on the later side of a jump of the loads."""

    time: float
    activation: np.ndarray
    head: np.ndarray
    loads: Loads
    shape: Shape
    after: bool = False


def sample_at(
    motion: Motion, x: np.ndarray, loads: Sequence[Loads], shape: Shape, t: float, after: bool
) -> Sample:
    """The trunk at time t in s, from planned controls, loads and shapes (H,); see `Plan.sample`."""
    t = planned_time(motion, len(x), t)
    controls = interpolate(motion, np.concatenate([motion.start[None], x]), t)
    now = loads_at(motion, loads, t, after)
    activation, head = controls[:-2], controls[-2:]
    # Of several equilibria, the one close to the planned shape of the nearest time step.
    times = motion.times[: len(x)]
    near = shape[int(np.argmin(np.abs(times - t)))] if len(times) else None
    found = solve_statics(motion.trunk, activation, head, now, near=near)
    if found.defect > MAX_DEFECT:  # the plan's mesh was checked at its time steps only
        found = refined(found, activation, head, now)
    return Sample(t, activation, head, now, found, after)

"""A plan as a table with a row for each time step: for spreadsheets, and for pandas."""

from __future__ import annotations

import csv
import io
import math

import numpy as np
import pandas as pd

from ..errors import StaticsError
from .plan import Plan
from .status import Status

FORMULAS = tuple("=+-@\uff1d\uff0b\uff0d\uff20")  # full-width ones included


def activations_table(plan: Plan) -> str:
    """A CSV table with one row for each time step, the start included.

    For a plan that is not solved, every row ends with its status.
    """
    motion, text = plan.motion, io.StringIO(newline="")
    mark = [] if plan.check() is Status.SOLVED else [plan.check().name.lower()]
    writer = csv.writer(text)
    writer.writerow(["time_s", "phase", *_controls(plan), *(["status"] if mark else [])])
    first, *phases = _phases(plan)
    writer.writerow([0.0, first, *motion.start.tolist(), *mark])
    for phase, step, x in zip(phases, motion.steps, plan.x, strict=False):
        numbers = (f"{value:.9g}" for value in x)
        writer.writerow([f"{step.time:.9g}", as_text(phase), *numbers, *mark])
    return text.getvalue()


def plan_table(plan: Plan) -> pd.DataFrame:
    """The table that `plan.to_dataframe()` returns; row 0 is the start."""
    columns = {"time_s": plan.times, "phase": _phases(plan)}
    columns |= dict(zip(_controls(plan), plan.trajectory.T, strict=True))
    columns |= dict(zip(("tip_x_m", "tip_y_m", "tip_z_m"), _tips(plan).T, strict=True))
    columns |= {name: [math.nan, *values] for name, values in _qualities(plan).items()}
    if plan.check() is not Status.SOLVED:
        columns["status"] = plan.check().name.lower()
    return pd.DataFrame(columns, index=pd.RangeIndex(len(plan.x) + 1, name="step"))


def _controls(plan: Plan) -> list[str]:
    """Names of the columns of `trajectory`."""
    return [*plan.motion.trunk.muscles, "psi_z_rad", "psi_y_rad"]


def _phases(plan: Plan) -> list[str]:
    """Names of the phases of time steps 0 (the start), 1, ..., H."""
    motion = plan.motion
    steps = motion.steps[: len(plan.x)]
    start = "start" if np.any(motion.start) else "rest"
    return [start, *(motion.phases[step.phase].name for step in steps)]


def _tips(plan: Plan) -> np.ndarray:
    """Positions (H + 1, 3) of the tip in m; NaN for a start without an equilibrium."""
    tip = np.array([plan.motion.trunk.length])
    try:
        start = plan.sample(0.0).shape.position(tip)
    except StaticsError:
        start = np.full((1, 3), np.nan)
    return np.concatenate([start, plan.shape.position(tip)[:, 0]])


def _qualities(plan: Plan) -> dict[str, list[float]]:
    """Columns (H,) on how good each time step is."""
    gaps = [plan.clearance.of_step(t) for t in range(len(plan.x))]
    return {
        "position_error_m": [max(each.position, default=math.nan) for each in plan.errors],
        "direction_error": [max(each.direction, default=math.nan) for each in plan.errors],
        "objective": [each.paper for each in plan.errors],
        "stability_margin": plan.stability.margin.tolist(),
        "clearance_m": [math.nan if gap is None else gap.gap for gap in gaps],
    }


def as_text(cell: str) -> str:
    """A cell that spreadsheets show as text instead of running it as a formula.

    They take text that begins with = + - @, a tab or a return for a formula. A leading apostrophe
    is the only escape that all spreadsheets know.
    """
    return f"'{cell}" if cell.lstrip()[:1] in FORMULAS or cell[:1] in ("\t", "\r") else cell

"""Activations as an OpenSim storage file (.sto)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from .._support.atomic_files import write
from ..planning.plan import Plan
from ..problem.interpolation import interpolate
from ..scene.keyframes import check_steps

ROW_RATE = 100.0  # rows per second, besides those at the time steps
MAX_ROWS = 100_000  # besides those; motions of more than a quarter of an hour get a lower rate
TIME_TOL = 1e-6  # s; a regular row closer to a time step would duplicate it


def write_sto(plan: Plan, path: str | Path) -> Path:
    """Write -activation of every muscle over time; returns the path.

    Rows are 10 ms apart from the start to the end of the plan (farther apart if there would be more
    than 100,000), with another at each time step in between; values follow each phase's
    interpolation.

    Raises
    ------
    InputError
        If the plan has no time steps, or the file cannot be written.
    """
    check_steps(plan)
    steps = plan.motion.times[: len(plan.x)]
    times = sto_times(steps)
    known = plan.trajectory[:, :-2]
    values = [0.0 - interpolate(plan.motion, known, t) for t in times.tolist()]  # no "-0"
    rows = [
        "\t".join([f"{t:.9f}", *(f"{value:.9f}" for value in row)])
        for t, row in zip(times.tolist(), values, strict=True)
    ]
    muscles = plan.motion.trunk.muscles
    head = _header(plan, len(rows), 1 + len(muscles))
    text = "\n".join([*head, "\t".join(["time", *muscles]), *rows]) + "\n"
    return write(path, text.encode())


def sto_times(steps: np.ndarray) -> np.ndarray:
    """Times of the rows in s: every 10 ms from 0, or fewer, and the time steps (H,)."""
    rate = min(ROW_RATE, MAX_ROWS / float(steps[-1]))
    regular = np.arange(int(steps[-1] * rate) + 1) / rate
    after = np.searchsorted(steps, regular).clip(max=len(steps) - 1)
    nearest = np.minimum(np.abs(regular - steps[after]), np.abs(regular - steps[after - 1]))
    kept = regular[(nearest > TIME_TOL) & (regular < steps[-1])]
    return np.sort(np.concatenate([kept, steps]))


def _header(plan: Plan, rows: int, columns: int) -> list[str]:
    """Lines before the column names; OpenSim takes those without "=" as a comment."""
    largest = 0.0 - float(plan.trajectory[:, :-2].min(initial=0.0))
    return [
        plan.motion.name,
        "version=1",
        f"nRows={rows}",
        f"nColumns={columns}",
        "inDegrees=no",
        "",
        "Units are S.I. units (second). Each column is a muscle of the trunk and holds minus the",
        "activation gamma of the model, in which negative values contract. So here, as in OpenSim,",
        "0 is passive and positive values contract. Values are not clipped or scaled: gamma is a",
        f"strain of the fibers and may exceed OpenSim's 1 (largest here {largest:.4g}); divide by",
        "the strongest contraction you allow if your muscles need 0 to 1.",
        "",
        "endheader",
    ]

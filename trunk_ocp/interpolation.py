"""Continuous motion between time steps (section 5.2)."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicHermiteSpline, PchipInterpolator

from .errors import InputError
from .motion import Motion


def interpolate(motion: Motion, values: np.ndarray, t: float) -> np.ndarray:
    """Values at time t in s from those at time steps 0, 1, ...: (steps + 1, n) to (n,).

    "cosine" blends neighbours with zero rate at both; "none" holds the earlier one.
    "hermite" is a cubic Hermite spline over the phase. The paper leaves its slopes open;
    here they are the monotone ones of Fritsch & Butland, so that no value leaves the interval
    of its neighbours, and zero at the ends of the phase, so that it joins what comes before and
    after smoothly and the motion ends at rest. The extension of a segment, a sum over muscles
    that each move at their own pace, may leave its bounds a little between steps (by 0.0035 at
    most in the shipped motions); with "cosine" it cannot.

    Raises
    ------
    InputError
        If t is outside the planned time.
    """
    times = np.append(0.0, motion.times[: len(values) - 1])
    if not 0 <= t <= times[-1]:
        raise InputError(f"t = {t:g}: expected a time from 0 to {times[-1]:g} s.")
    i = max(int(np.searchsorted(times, t, side="left")), 1)  # t in (t_(i-1), t_i]
    if t == times[i]:
        return values[i].copy()
    phase = motion.steps[i - 1].phase
    kind = motion.phases[phase].interpolation
    if kind == "none":
        return values[i - 1].copy()
    if kind == "cosine":
        share = (1 - np.cos(np.pi * (t - times[i - 1]) / (times[i] - times[i - 1]))) / 2
        return (1 - share) * values[i - 1] + share * values[i]
    inside = [n for n in range(1, len(values)) if motion.steps[n - 1].phase == phase]
    knots = np.arange(inside[0] - 1, inside[-1] + 1)
    slopes = np.zeros_like(values[knots])
    if len(knots) > 2:
        slopes[1:-1] = PchipInterpolator(times[knots], values[knots])(times[knots[1:-1]], 1)
    return CubicHermiteSpline(times[knots], values[knots], slopes)(t)

"""The moments of a plan that are drawn: the passive start, the time steps, and some between."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import InputError, StaticsError
from ..planning.plan import Plan, Sample
from ..rod.shape import Shape

NEAR = 0.03 / 1.75  # of the trunk's length, between it and the mean of its neighbors' positions
HALVINGS = 5  # at most, between two time steps
HOLD = 1e-3  # s; how long a jump takes, since moments of a file cannot coincide


@dataclass(frozen=True, eq=False)
class Keyframes:
    """The moving trunk at n times, all different.

    times (n,) in s; activation (n, muscles); shape with batch axis (n,); held (n,), whether the
    trunk stays as it was until this time, and then jumps. Where loads jump, the time step is
    followed within `HOLD` by the trunk under its new loads.
    """

    times: np.ndarray
    activation: np.ndarray
    shape: Shape
    held: np.ndarray


def check_steps(plan: Plan) -> None:
    """Refuse a plan without time steps.

    Raises
    ------
    InputError
        If there is nothing to write.
    """
    if not len(plan.x):
        raise InputError(
            f"{plan.motion.name}: the plan has no time steps, so there is no motion to write; "
            "plan it again and let at least one step finish."
        )


def at_steps(plan: Plan) -> Keyframes:
    """The passive start and every planned step, with what follows at once where loads jump."""
    return _keyframes(plan, _jumped(plan), [[] for _ in plan.x])


def with_between(plan: Plan) -> Keyframes:
    """Every step, and in between as many moments as straight lines need to come near the motion.

    Halfway from the passive trunk to the fruit, the mean of the two shapes would have lost a
    quarter of its volume.
    """
    check_steps(plan)
    Z, jumped = np.linspace(0.0, plan.motion.trunk.length, 9), _jumped(plan)
    times = plan.times.tolist()
    ends = [plan.sample(0.0).shape.position(Z), *plan.shape.position(Z)]
    starts = [
        jumped[time].shape.position(Z) if time in jumped else end
        for time, end in zip(times, ends, strict=True)
    ]
    spans = zip(times, starts, times[1:], ends[1:], _held(plan), strict=False)
    between = [
        [] if held else _between(plan, Z, (t, a), (u, b), HALVINGS) for t, a, u, b, held in spans
    ]
    return _keyframes(plan, jumped, between)


def _between(
    plan: Plan,
    Z: np.ndarray,
    a: tuple[float, np.ndarray],
    b: tuple[float, np.ndarray],
    halvings: int,
) -> list[tuple[float, np.ndarray, Shape]]:
    """Moments (time, activation, shape) between two with positions at Z, by halving."""
    time = (a[0] + b[0]) / 2
    try:
        sample = plan.sample(time)
    except StaticsError:  # no equilibrium in between: a straight line is all there is
        return []
    here = sample.shape.position(Z)
    near = NEAR * plan.motion.trunk.length
    if not halvings or np.linalg.norm((a[1] + b[1]) / 2 - here, axis=-1).max() < near:
        return []
    middle = (time, here)
    return [
        *_between(plan, Z, a, middle, halvings - 1),
        (time, sample.activation, sample.shape),
        *_between(plan, Z, middle, b, halvings - 1),
    ]


def _held(plan: Plan) -> list[bool]:
    phases = plan.motion.phases
    steps = plan.motion.steps[: len(plan.x)]
    return [phases[step.phase].interpolation == "none" for step in steps]


def _jumped(plan: Plan) -> dict[float, Sample]:
    """The trunk right after each jump of the loads, by its time in s, where it has a shape."""
    found = {}
    for time in plan.jumps:
        with contextlib.suppress(StaticsError):
            found[time] = plan.sample(time, after=True)
    return found


def _keyframes(
    plan: Plan,
    jumped: Mapping[float, Sample],
    between: Sequence[Sequence[tuple[float, np.ndarray, Shape]]],
) -> Keyframes:
    """Join the start, the steps, what comes before each of them and what follows a jump."""
    check_steps(plan)
    steps = plan.times.tolist()
    rest = plan.sample(0.0)
    times, activation, held = [0.0], [rest.activation], [False]
    shapes = [rest.shape]
    for i, (moments, hold) in enumerate(zip(between, _held(plan), strict=True)):
        after = jumped.get(steps[i])
        if after is not None:
            following = moments[0][0] if moments else steps[i + 1]
            soon = steps[i] + min(HOLD, (following - steps[i]) / 2)
            moments = [(soon, after.activation, after.shape), *moments]
        for time, gamma, shape in moments:
            times.append(time)
            activation.append(gamma)
            shapes.append(shape)
            held.append(False)
        times.append(steps[i + 1])
        activation.append(plan.activations[i])
        shapes.append(plan.shape[i])
        held.append(hold)
    stacked = Shape.stack(shapes, plan.mesh)
    return Keyframes(np.array(times), np.array(activation), stacked, np.array(held))

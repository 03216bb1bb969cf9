"""The moments of a plan that are drawn: the passive start, the time steps, and some between."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..errors import InputError, StaticsError
from ..solution import Plan
from ..statics import Shape

NEAR = 0.03  # m between the trunk and the mean of its neighbours' positions
HALVINGS = 5  # at most, between two time steps


@dataclass(frozen=True)
class Keyframes:
    """The moving trunk at n times.

    times (n,) in s; activation (n, muscles); shape with batch axis (n,); held (n,), whether the
    trunk stays as it was until this time, and then jumps.
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
    """The passive start and every planned step."""
    return _keyframes(plan, [[] for _ in plan.x])


def with_between(plan: Plan) -> Keyframes:
    """Every step, and in between as many moments as straight lines need to come near the motion.

    Halfway from the passive trunk to the fruit, the mean of the two shapes would have lost a
    quarter of its volume.
    """
    steps = at_steps(plan)
    Z = np.linspace(0.0, plan.motion.trunk.length, 9)
    ends = list(zip(steps.times.tolist(), steps.shape.position(Z), strict=True))
    return _keyframes(
        plan,
        [
            [] if held else _between(plan, Z, a, b, HALVINGS)
            for a, b, held in zip(ends[:-1], ends[1:], _held(plan), strict=True)
        ],
    )


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
    if not halvings or np.linalg.norm((a[1] + b[1]) / 2 - here, axis=-1).max() < NEAR:
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


def _keyframes(
    plan: Plan, between: Sequence[Sequence[tuple[float, np.ndarray, Shape]]]
) -> Keyframes:
    """Join the start, the steps and what comes before each of them."""
    check_steps(plan)
    rest = plan.sample(0.0)
    times, activation, held = [0.0], [rest.activation], [False]
    shapes = [_batch_of_one(rest.shape)]
    for i, (moments, hold) in enumerate(zip(between, _held(plan), strict=True)):
        for time, gamma, shape in moments:
            times.append(time)
            activation.append(gamma)
            shapes.append(_batch_of_one(shape))
            held.append(False)
        times.append(float(plan.motion.times[i]))
        activation.append(plan.activations[i])
        shapes.append(plan.part(i, i + 1))
        held.append(hold)
    joined = replace(
        plan.shape,
        states=np.concatenate([shape.states for shape in shapes]),
        edges=np.concatenate([shape.edges for shape in shapes]),
        slopes=np.concatenate([shape.slopes for shape in shapes]),
    )
    return Keyframes(np.array(times), np.array(activation), joined, np.array(held))


def _batch_of_one(shape: Shape) -> Shape:
    return replace(
        shape, states=shape.states[None], edges=shape.edges[None], slopes=shape.slopes[None]
    )

"""Key frames for files that blend between them: the start, the time steps, and some in between."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import InputError, StaticsError
from ..planning.plan import Plan
from ..planning.sampling import Sample
from ..rod.shape import Shape

BLEND_TOL = 0.03 / 1.75  # of the trunk's length; larger errors of a blend get a key frame between
MAX_HALVINGS = 5  # between two time steps
JUMP_DURATION = 1e-3  # s, because key frames of a file cannot coincide


@dataclass(frozen=True, eq=False)
class Keyframes:
    """The moving trunk at n times, all different.

    times (n,) in s; activation (n, muscles); shape with batch axis (n,); held (n,), whether the
    trunk keeps its shape until this time, and then jumps. Where loads jump, the time step is
    followed within `JUMP_DURATION` by the trunk under its new loads.
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
    """The start and every planned step; where loads jump, also the trunk just after the jump."""
    return _keyframes(plan, _jumped(plan), [[] for _ in plan.x])


def for_blending(plan: Plan) -> Keyframes:
    """Every step, and as many key frames between as blending needs to stay near the motion.

    Blending moves points along straight lines: halfway from rest to the fruit, the mean of the
    two shapes would have lost a quarter of its volume.
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
        [] if held else _between(plan, Z, (t, a), (u, b), MAX_HALVINGS)
        for t, a, u, b, held in spans
    ]
    return _keyframes(plan, jumped, between)


def _between(
    plan: Plan,
    Z: np.ndarray,
    a: tuple[float, np.ndarray],
    b: tuple[float, np.ndarray],
    halvings: int,
) -> list[tuple[float, np.ndarray, Shape]]:
    """Key frames (time, activation, shape) between a and b (time, positions at Z), by halving."""
    time = (a[0] + b[0]) / 2
    try:
        sample = plan.sample(time)
    except StaticsError:  # no equilibrium in between: a straight line must do
        return []
    here = sample.shape.position(Z)
    tolerance = BLEND_TOL * plan.motion.trunk.length
    if not halvings or np.linalg.norm((a[1] + b[1]) / 2 - here, axis=-1).max() < tolerance:
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
    """The trunk just after each jump of the loads, by time in s, if it has an equilibrium."""
    samples = {}
    for time in plan.jumps:
        with contextlib.suppress(StaticsError):
            samples[time] = plan.sample(time, after=True)
    return samples


def _keyframes(
    plan: Plan,
    jumped: Mapping[float, Sample],
    between: Sequence[Sequence[tuple[float, np.ndarray, Shape]]],
) -> Keyframes:
    """Join the start, the steps, the key frames before each of them and those after jumps."""
    check_steps(plan)
    steps = plan.times.tolist()
    start = plan.sample(0.0)
    times, activation, held = [0.0], [start.activation], [False]
    shapes = [start.shape]
    for i, (frames, hold) in enumerate(zip(between, _held(plan), strict=True)):
        after = jumped.get(steps[i])
        if after is not None:
            following = frames[0][0] if frames else steps[i + 1]
            soon = steps[i] + min(JUMP_DURATION, (following - steps[i]) / 2)
            frames = [(soon, after.activation, after.shape), *frames]
        for time, gamma, shape in frames:
            times.append(time)
            activation.append(gamma)
            shapes.append(shape)
            held.append(False)
        times.append(steps[i + 1])
        activation.append(plan.activations[i])
        shapes.append(plan.shape[i])
        held.append(hold)
    shape = Shape.stack(shapes, plan.mesh)
    return Keyframes(np.array(times), np.array(activation), shape, np.array(held))

"""What the live page gets of each new plan: only what changed, and as few shapes as will do."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ..planning.plan import Plan
from ..planning.status import Status
from ..scene.moments import TIME_TOL, Moment, moments_at
from ..scene.surroundings import Places
from .live_edits import Handle
from .payload import moving, sample_times, shown_solids

Update = dict[str, Any]
"""Parts of the page's state, ready for JSON."""


def quick_plan(plan: Plan, start: Moment, handles: Sequence[Handle]) -> Update:
    """A plan by the shapes of its time steps, which are there already; `start` is that of rest."""
    moments = [start, *_after(plan, 0.0)]
    for t, time in enumerate(plan.motion.times[: len(plan.x)].tolist()):
        moments.append(Moment(time, plan.activations[t], plan.head[t], plan.part(t, t + 1)))
        moments += _after(plan, time)
    return _update(moving(plan, moments, _planned_places(plan)), plan, moments, handles)


def smooth_plan(plan: Plan, handles: Sequence[Handle], hurry: Callable[[], bool]) -> Update | None:
    """A plan by as many shapes as a page from disk has; None if there is a `hurry` before."""
    moments: list[Moment] = []
    for time in sample_times(plan).tolist():
        if hurry():
            return None
        moments += moments_at(plan, np.array([time]))
    return _update(moving(plan, moments), plan, moments, handles)


def _update(
    content: Update, plan: Plan, moments: Sequence[Moment], handles: Sequence[Handle]
) -> Update:
    return {**content, "shown": shown_solids(plan, moments), "handles": handle_entries(handles)}


def handle_entries(handles: Sequence[Handle]) -> list[Update]:
    """Handles as the page takes them."""
    return [
        {
            "name": handle.name,
            "position": handle.position.tolist(),
            "radius": handle.radius,
            "from": handle.first,
            "to": handle.last,
        }
        for handle in handles
    ]


def _planned_places(plan: Plan) -> Places:
    """Where points with targets are, by the plan's own shapes: the check takes 1 ms a step."""
    Z = np.unique([target.Z for step in plan.motion.steps for target in step.targets])
    position, directors = plan.shape.position(Z), plan.shape.directors(Z)
    number = {z: i for i, z in enumerate(Z.tolist())}
    return lambda step, z: (position[step, number[z]], directors[step, number[z]])


def _after(plan: Plan, time: float) -> list[Moment]:
    """The other side of a jump of the loads at a time in s, if there is one."""
    if not any(abs(jump - time) < TIME_TOL for jump in plan.jumps):
        return []
    return [moment for moment in moments_at(plan, np.array([time])) if moment.after]


def outcome(plan: Plan) -> Update:
    """How a plan ended, once it is checked: in words, with its objective."""
    status = plan.check()
    J = plan.objective.paper
    return {
        "text": _words(plan, status),
        "state": "good" if status is Status.SOLVED else "bad",
        "objective": J if math.isfinite(J) else None,
    }


def _words(plan: Plan, status: Status) -> str:
    """How close a plan comes to its targets, or what is wrong with it."""
    worst = max((float(e.position.max()) for e in plan.errors if e.position.size), default=0.0)
    distance = f"{1e3 * worst:.2g}" if worst < 0.1 else f"{1e3 * worst:.0f}"
    if status is Status.SOLVED:
        return f"verified, {distance} mm"
    if status is not Status.MISSED:
        return status.value
    if worst > plan.motion.tolerance[0]:
        return f"cannot be reached: {distance} mm away"
    return f"cannot be reached: {plan.missed[0]}"

"""What the trunk acts on, as far as a motion's file says: log, fruit and targets."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..planning.plan import Plan, Sample
from ..problem.interpolation import interpolate
from ..problem.motion import Motion
from ..problem.problem_file import LogSpec, PhaseSpec, WrapSpec
from ..problem.targets import HeldDirection, Target
from ..rod.shape import Shape
from .colors import MASS

FRUIT_DENSITY = 1000.0  # kg/m^3; a tip mass is drawn as a ball of water
NEAR = 1e-9  # s
SLENDERNESS = 12.0  # length by radius of a log of which only the radius is given


@dataclass(frozen=True, eq=False)
class Thing:
    """Something that is moved: its description for the page and its center (n, 3) in m.

    The description of one that comes and goes has `shown`, n times whether it is there.
    """

    description: dict[str, Any]
    center: np.ndarray


def carried(plan: Plan, samples: Sequence[Sample], shape: Shape) -> list[Thing]:
    """Log and fruit of a plan at n samples, in which the trunk has shapes (n,)."""
    times = np.array([sample.time for sample in samples])
    return [*_log(plan, times), *_fruit(plan, samples, shape)]


def _log(plan: Plan, times: np.ndarray) -> Iterator[Thing]:
    """The cylinder that the trunk wraps around, its axis along e_Y, if there is one."""
    phases = plan.motion.spec.phases
    wraps = [phase.wrap for phase in phases if phase.wrap is not None]
    if not wraps:
        return
    spec = next((phase.loads.log for phase in phases if phase.loads.log is not None), None)
    radius = spec.radius if spec else wraps[0].log_radius
    length = spec.length if spec else SLENDERNESS * radius
    grips = _grips(plan.motion)[: len(plan.x)]
    known = np.array([grip for grip in grips if grip is not None])
    if not len(known):
        return
    steps = _filled(grips, known[0])
    # In step with the trunk: both follow each phase's interpolation from step to step.
    path = np.array([interpolate(plan.motion, np.vstack([steps[:1], steps]), t) for t in times])
    kind = {"kind": "log", "radius": radius, "length": length}
    yield Thing(kind, path + np.array([0.0, _middle(spec), 0.0]))


def _middle(log: LogSpec | None) -> float:
    """How far along e_Y the log's middle is from the grip, in m.

    As the couple in `motion` has it: a weight W at y turns by y W about e_X, and that is
    -offset W there.
    """
    return -log.offset if log else 0.0


def _grips(motion: Motion) -> list[np.ndarray | None]:
    """Center of the log's grip at every time step; None where nothing is wrapped."""
    return [
        _grip(motion.spec.phases[step.phase].wrap, step.targets, motion) for step in motion.steps
    ]


def _grip(wrap: WrapSpec | None, goals: tuple[Target, ...], motion: Motion) -> np.ndarray | None:
    """Center of the arc that a step's last targets are on (eqs. 46-48)."""
    if wrap is None:
        return None
    first = goals[-wrap.points]  # a phase's wrap follows its other targets
    angle = math.radians(wrap.angles_deg[0])
    distance = wrap.log_radius + float(motion.trunk.radius(first.Z))
    return np.asarray(first.position) - distance * np.array([math.sin(angle), 0, math.cos(angle)])


def _filled(grips: list[np.ndarray | None], first: np.ndarray) -> np.ndarray:
    """Centers at every step: where nothing is wrapped, the log stays where it was."""
    rows, last = [], first
    for grip in grips:
        last = last if grip is None else grip
        rows.append(last)
    return np.array(rows)


def _fruit(plan: Plan, samples: Sequence[Sample], shape: Shape) -> Iterator[Thing]:
    """The mass that a phase hangs on the tip: it waits where it is taken.

    Once let go it is gone: where it falls nobody knows.
    """
    phases = plan.motion.spec.phases
    mass = max(phase.loads.tip_mass for phase in phases)
    if mass <= 0:
        return
    radius = (3 * mass / (4 * math.pi * FRUIT_DENSITY)) ** (1 / 3)
    end = np.array([plan.motion.trunk.length])
    at_tip = (shape.position(end) + radius * shape.directors(end)[..., 2, :])[:, 0]
    held = _holding(phases, plan.motion, samples)
    if not held.any():  # a plan that was cut short before
        return
    # It comes off where the tip was last before it hung there.
    center, place = at_tip.copy(), at_tip[max(int(np.argmax(held)) - 1, 0)]
    for i, holds in enumerate(held):
        place = at_tip[i] if holds else place
        center[i] = place
    shown = (held | (np.arange(len(held)) < np.argmax(held))).tolist()
    fruit = {"kind": "fruit", "radius": radius, "mass": mass, "color": MASS, "shown": shown}
    yield Thing(fruit, center)


def _holding(
    phases: tuple[PhaseSpec, ...], motion: Motion, samples: Sequence[Sample]
) -> np.ndarray:
    """Whether the tip carries a mass in each sample: from the end of the phase before on."""
    ends = np.array([phase.end for phase in motion.phases[:-1]])
    number = [int(np.searchsorted(ends, s.time + (NEAR if s.after else -NEAR))) for s in samples]
    return np.array([phase.loads.tip_mass > 0 for phase in phases])[number]


def arrows(plan: Plan) -> list[dict[str, Any]]:
    """Directions that points of the trunk should have: where, which way, from when to when in s."""
    found: list[dict[str, Any]] = []
    for number, step in enumerate(plan.motion.steps[: len(plan.x)]):
        for goal in step.targets:
            at, _ = plan.verification.at(number, goal.Z)
            placed = goal.position is not None and goal.position_weight > 0
            for _, wanted, _ in goal.pairs():
                if isinstance(wanted, HeldDirection):
                    way = plan.verification.at(wanted.step, wanted.Z)[1][wanted.director]
                else:
                    way = np.asarray(wanted)
                found.append(
                    {
                        "position": list(goal.position or ()) if placed else at.tolist(),
                        "direction": way.tolist(),
                        "from": step.time - step.duration,
                        "to": step.time,
                    }
                )
    return found


def targets(plan: Plan) -> list[dict[str, Any]]:
    """Places that points of the trunk should be at, and from when to when, in s."""
    places: dict[tuple[float, ...], dict[str, Any]] = {}
    for step in plan.motion.steps[: len(plan.x)]:
        for goal in step.targets:
            if goal.position is None or goal.position_weight <= 0:
                continue
            start = step.time - step.duration
            here = places.setdefault(
                (goal.Z, *goal.position),
                {"Z": goal.Z, "position": list(goal.position), "from": start, "to": step.time},
            )
            here["to"] = step.time
    return list(places.values())

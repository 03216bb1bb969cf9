"""How many local optima a motion has: the same nlp solved from many starts.

A start is a whole motion of activations and head angles: the plan as it is reported, its mirror
image, the passive trunk, and random ones, which move straight from one random posture to another.
Which random ones is decided by a seed and nothing else.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any

import numpy as np

from .._support.arguments import check_arguments
from .._support.process_pool import Done, run_tasks
from .._support.ranges import check
from ..errors import InputError
from ..model.activation import strains
from ..planning.plan import Plan
from ..planning.planner import plan_from
from ..planning.state import Options
from ..problem.mirror import mirrored_unknowns
from ..problem.motion import Motion
from ..reporting import Reporter
from .lookahead_study import plan_of, sound
from .measures import plan_measures

SAME = 0.05
"""Largest difference of any activation, or angle in rad, between two plans that count as one."""
BETTER = 1e-4
"""Share by which an objective must be smaller to be better: ten times what Ipopt leaves."""


@dataclass(frozen=True)
class Optimum:
    """A local optimum: the best plan that found it, and from which starts it was found."""

    plan: Plan
    starts: tuple[str, ...]


@dataclass(frozen=True)
class Optima:
    """What many starts of one motion found.

    Attributes
    ----------
    reported : Plan
        What `plan_motion` gives.
    plans : dict
        By the name of the start; not all of them need be sound.
    """

    reported: Plan
    plans: dict[str, Plan]

    @cached_property
    def distinct(self) -> tuple[Optimum, ...]:
        """Distinct optima, the best first."""
        named = {"reported": self.reported} | self.plans
        good = [(name, plan) for name, plan in named.items() if sound(plan)]
        return distinct(sorted(good, key=lambda pair: pair[1].objective.total))

    @property
    def failed(self) -> list[str]:
        """Starts from which no optimum was found."""
        return [name for name, plan in self.plans.items() if not sound(plan)]

    @property
    def reported_is_best(self) -> bool:
        """Whether no start found anything better than what is reported."""
        if not self.distinct:
            return False
        least = self.distinct[0].plan.objective.total
        return sound(self.reported) and self.reported.objective.total <= least * (1 + BETTER)

    def as_dict(self) -> dict[str, Any]:
        """Everything in numbers, ready for JSON."""
        best = self.distinct[0].plan if self.distinct else None
        return {
            "problem": self.reported.motion.name,
            "mode": self.reported.mode,
            "lookahead": self.reported.lookahead,
            "starts": len(self.plans),
            "failed": self.failed,
            "same_within": SAME,
            "reported_is_best": self.reported_is_best,
            "reported": asdict(plan_measures(self.reported)),
            "optima": [
                {
                    "found_from": list(optimum.starts),
                    "distance": distance(optimum.plan.x, best.x),
                    "rms_distance": float(np.sqrt(np.mean((optimum.plan.x - best.x) ** 2))),
                    "head_deg": np.degrees(optimum.plan.head).tolist(),
                    **asdict(plan_measures(optimum.plan)),
                }
                for optimum in self.distinct
                if best is not None
            ],
            "definitions": {
                "same_within": "largest difference of an activation, or angle in rad, of two "
                "plans that count as one optimum",
                "distance": "largest difference of an activation, or angle in rad, from the best",
                "rms_distance": "root mean square of all these differences",
                "failed": "starts from which nothing converged, or nothing that passed the check",
                "head_deg": "psi_Z and psi_Y at each time step, degrees",
            },
        }


def distance(a: np.ndarray, b: np.ndarray) -> float:
    """Largest difference of any unknown of two plans (H, muscles + 2)."""
    return float(np.abs(a - b).max(initial=0.0))


def distinct(plans: Sequence[tuple[str, Plan]]) -> tuple[Optimum, ...]:
    """Plans (name, plan), the best first, put together where they are within `SAME` of a better."""
    found: list[tuple[Plan, list[str]]] = []
    for name, plan in plans:
        for known, starts in found:
            if distance(plan.x, known.x) <= SAME:
                starts.append(name)
                break
        else:
            found.append((plan, [name]))
    return tuple(Optimum(plan, tuple(starts)) for plan, starts in found)


@check_arguments
def find_optima(
    motion: Motion,
    lookahead: int | None = None,
    starts: int = 20,
    seed: int = 0,
    options: Options | None = None,
    processes: int | None = None,
    reporter: Reporter | None = None,
    done: Done | None = None,
) -> Optima:
    """Solve a motion from many starts.

    Parameters
    ----------
    lookahead : as in `plan_motion`: None for the horizon, 1 for the sequential solve
        Of the latter each step's solve starts where the whole motion of a start has that step.
    starts : number of random starts, beside the reported plan, its mirror image and rest
    seed : of the random starts
    processes, reporter, done : see `process_pool.run_tasks`
    """
    check(starts, "random starts", "starts")
    check(seed, "seed")
    options = options or Options()
    (reported,) = run_tasks(plan_of, [(motion, lookahead, options, None)], 1, reporter)
    guesses = {"reported plan": reported.x, "rest": np.zeros_like(reported.x)}
    with suppress(InputError):  # of a trunk that has no other side
        guesses["mirror image"] = mirrored_unknowns(motion.trunk, reported.x)
    rng = np.random.default_rng(seed)
    guesses |= {f"random {n}": random_motion(motion, rng) for n in range(1, starts + 1)}
    tasks = [(motion, x, lookahead, options) for x in guesses.values()]
    plans = run_tasks(_from, tasks, processes, reporter, done)
    return Optima(reported, dict(zip(guesses, plans, strict=True)))


def random_motion(motion: Motion, rng: np.random.Generator) -> np.ndarray:
    """Unknowns (H, muscles + 2) that move straight from one random posture to another."""
    ends = np.stack([_posture(motion, rng), _posture(motion, rng)])
    share = np.linspace(0.0, 1.0, len(motion.steps))[:, None]
    x: np.ndarray = (1 - share) * ends[0] + share * ends[1]
    return x


def _posture(motion: Motion, rng: np.random.Generator) -> np.ndarray:
    """Random unknowns within the motion's bounds, extension's included."""
    x = rng.uniform(motion.box.lower, motion.box.upper)
    first = motion.steps[0].box  # the head's own bounds are often those of phases
    x[-2:] = rng.uniform(first.lower[-2:], first.upper[-2:])
    change = strains(motion.trunk, x[:-2])[:, 0] - 1
    low, high = motion.extension
    room = np.where(change < 0, low - 1, high - 1) / np.where(change == 0, np.inf, change)
    x[:-2] *= min(1.0, float(room[change != 0].min(initial=1.0))) * rng.uniform()
    return x


def _from(
    motion: Motion, x: np.ndarray, lookahead: int | None, options: Options, reporter: Reporter
) -> Plan:
    """`plan_from`, for a process of its own; the plan has been checked there as well."""
    plan = plan_from(motion, x, lookahead, options, reporter)
    _ = plan.status  # kept in the plan
    return plan

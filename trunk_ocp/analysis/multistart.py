"""Local optima of a motion: the same NLP solved from many starts.

A start is a whole motion of activations and head angles: the reported plan, its mirror image, the
passive trunk, and random ones, which move linearly from one random posture to another. A seed
alone determines the random ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any

import numpy as np

from .._support.arguments import check_arguments
from .._support.process_pool import DoneCallback, run_tasks
from .._support.ranges import check
from ..errors import InputError
from ..model.activation import strains
from ..planning.options import Options
from ..planning.plan import Plan
from ..problem.mirror import mirrored_controls
from ..problem.motion import Motion
from ..reporting import Reporter
from .measures import plan_measures
from .study_tasks import plan_from_start, plan_of, sound

SAME_PLAN_TOL = 0.05
"""Largest difference of an activation, or angle in rad, between plans that count as one."""
BETTER_RTOL = 1e-4
"""Relative decrease of an objective that counts as better: ten times the error of Ipopt."""


@dataclass(frozen=True)
class Optimum:
    """A local optimum: its best plan, and the starts that led to it."""

    plan: Plan
    starts: tuple[str, ...]


@dataclass(frozen=True)
class Optima:
    """The optima of one motion that many starts led to.

    Attributes
    ----------
    reported : Plan
        The result of `plan_motion`.
    plans : dict
        By the name of the start; some may not be sound.
    """

    reported: Plan
    plans: dict[str, Plan]

    @cached_property
    def distinct(self) -> tuple[Optimum, ...]:
        """Distinct optima, the best first."""
        candidates = {"reported": self.reported} | self.plans
        sound_plans = [(name, plan) for name, plan in candidates.items() if sound(plan)]
        return distinct(sorted(sound_plans, key=lambda pair: pair[1].objective.total))

    @property
    def failed(self) -> list[str]:
        """Starts that led to no optimum."""
        return [name for name, plan in self.plans.items() if not sound(plan)]

    @property
    def reported_is_best(self) -> bool:
        """Whether no start led to a better plan than the reported one."""
        if not self.distinct:
            return False
        least = self.distinct[0].plan.objective.total
        return sound(self.reported) and self.reported.objective.total <= least * (1 + BETTER_RTOL)

    def as_dict(self) -> dict[str, Any]:
        """All numbers, ready for JSON."""
        best = self.distinct[0].plan if self.distinct else None
        return {
            "problem": self.reported.motion.name,
            "mode": self.reported.mode,
            "lookahead": self.reported.lookahead,
            "starts": len(self.plans),
            "failed": self.failed,
            "same_within": SAME_PLAN_TOL,
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
                "same_within": "largest difference of an activation, or angle in rad, between "
                "plans that count as one optimum",
                "distance": "largest difference of an activation, or angle in rad, from the best",
                "rms_distance": "root mean square of all these differences",
                "failed": "starts from which no plan converged and passed the check",
                "head_deg": "psi_Z and psi_Y at each time step, degrees",
            },
        }


def distance(a: np.ndarray, b: np.ndarray) -> float:
    """Largest difference between the controls (H, muscles + 2) of two plans."""
    return float(np.abs(a - b).max(initial=0.0))


def distinct(plans: Sequence[tuple[str, Plan]]) -> tuple[Optimum, ...]:
    """Optima of plans (name, plan), the best first, merged within `SAME_PLAN_TOL`."""
    optima: list[tuple[Plan, list[str]]] = []
    for name, plan in plans:
        for known, starts in optima:
            if distance(plan.x, known.x) <= SAME_PLAN_TOL:
                starts.append(name)
                break
        else:
            optima.append((plan, [name]))
    return tuple(Optimum(plan, tuple(starts)) for plan, starts in optima)


@check_arguments
def find_optima(
    motion: Motion,
    lookahead: int | None = None,
    starts: int = 20,
    seed: int = 0,
    options: Options | None = None,
    processes: int | None = None,
    reporter: Reporter | None = None,
    done: DoneCallback | None = None,
) -> Optima:
    """Find local optima of a motion by solving it from many starts.

    Parameters
    ----------
    motion : Motion
    lookahead : int, optional
        As in `plan_motion`: None for the horizon, 1 for the sequential solve, in which each step
        starts from that step of the whole start.
    starts : int
        Number of random starts, in addition to the reported plan, its mirror image and rest.
    seed : int
        Of the random starts.
    options : Options, optional
    processes : int, optional
        By default one for each core that this process may use.
    reporter : Reporter, optional
        Its `stop` ends all plans with KeyboardInterrupt.
    done : callable, optional
        Called with the number of finished plans and of all plans.

    Returns
    -------
    Optima

    Raises
    ------
    InputError
        If an argument is of the wrong type or out of range.
    """
    check(starts, "random starts", "starts")
    check(seed, "seed")
    options = options or Options()
    (reported,) = run_tasks(plan_of, [(motion, lookahead, options, None)], 1, reporter)
    guesses = {"reported plan": reported.x, "rest": np.zeros_like(reported.x)}
    with suppress(InputError):  # the trunk is not symmetric
        guesses["mirror image"] = mirrored_controls(motion.trunk, reported.x)
    rng = np.random.default_rng(seed)
    guesses |= {f"random {n}": random_motion(motion, rng) for n in range(1, starts + 1)}
    tasks = [(motion, x, lookahead, options) for x in guesses.values()]
    plans = run_tasks(plan_from_start, tasks, processes, reporter, done)
    return Optima(reported, dict(zip(guesses, plans, strict=True)))


def random_motion(motion: Motion, rng: np.random.Generator) -> np.ndarray:
    """Controls (H, muscles + 2) that move linearly from one random posture to another."""
    ends = np.stack([_posture(motion, rng), _posture(motion, rng)])
    share = np.linspace(0.0, 1.0, len(motion.steps))[:, None]
    x: np.ndarray = (1 - share) * ends[0] + share * ends[1]
    return x


def _posture(motion: Motion, rng: np.random.Generator) -> np.ndarray:
    """Random controls within the motion's bounds, including those on extension."""
    x = rng.uniform(motion.box.lower, motion.box.upper)
    first = motion.steps[0].box  # phases often set the bounds of the head
    x[-2:] = rng.uniform(first.lower[-2:], first.upper[-2:])
    change = strains(motion.trunk, x[:-2])[:, 0] - 1
    low, high = motion.extension
    room = np.where(change < 0, low - 1, high - 1) / np.where(change == 0, np.inf, change)
    x[:-2] *= min(1.0, float(room[change != 0].min(initial=1.0))) * rng.uniform()
    return x

"""Which muscles a task needs: take one away, plan again, and see how much worse it gets."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ..._support.process_pool import run
from ...errors import InputError
from ...planning.options import Options
from ...planning.plan import Plan
from ...planning.planner import plan_motion
from ...problem.motion import Motion
from ...problem.variants import silenced_spec
from ...reporting import Reporter
from ..measures import measure
from .variants import can_be_off, least_cost

CHEAP = 1.01
"""Ratio of costs up to which the planned shapes will do, without planning others."""


@dataclass(frozen=True)
class AblationResult:
    """What a motion is like without some muscles.

    Attributes
    ----------
    muscles : tuple of str
        Those taken away.
    spare : bool
        Whether the others can keep every shape of the plan.
    status : str
        Name of the plan's `Status`, in lower case.
    planner_objective, paper_objective : float
        As in `Measures`.
    ratio : float
        Of the planner's objective to that of the plan with all muscles.
    worst_position_error, mean_position_error : float
        In m.
    worst_direction_error : float
    """

    muscles: tuple[str, ...]
    spare: bool
    status: str
    planner_objective: float
    paper_objective: float
    ratio: float
    worst_position_error: float
    mean_position_error: float
    worst_direction_error: float


Progress = Callable[[int, int, AblationResult], None]


def needed(
    plan: Plan,
    without: Sequence[tuple[str, ...]] | None = None,
    workers: int | None = None,
    progress: Progress | None = None,
    reporter: Reporter | None = None,
) -> tuple[AblationResult, ...]:
    """How much worse a motion gets without a muscle.

    A muscle that can be off at the planned shapes costs no target anything, and no more than
    the effort of its substitutes. If that is more than `CHEAP`, or if there are none, the motion
    is planned again as a horizon that starts from there: a local optimum, so an upper bound on
    the loss.

    Parameters
    ----------
    plan : Plan
        A verified plan of all time steps within the horizon's bounds.
    without : sequence of tuples of muscle names, optional
        What to take away at a time; by default each muscle by itself.
    workers : int, optional
        Processes; by default one for each core that this process may use. 1: in this process.
    progress : callable, optional
        Called with (done, total, result) after each.
    reporter : Reporter, optional
        Its `stop` ends all, with KeyboardInterrupt.

    Raises
    ------
    InputError
        If the plan is not verified, follows auxiliary solutions, or a name is unknown.
    """
    if plan.auxiliary:
        raise InputError(
            f"{plan.motion.name}, {plan.mode}: follows auxiliary solutions, which other muscles "
            "would change; expected a horizon plan."
        )
    tasks = list(without or ((name,) for name in plan.motion.trunk.muscles))
    reference = plan.objective.total
    found: dict[int, AblationResult] = {}

    def note(number: int, need: AblationResult) -> None:
        found[number] = need
        if progress is not None:
            progress(len(found), len(tasks), need)

    hard: dict[int, Plan] = {}  # and where to start from
    for number, muscles in enumerate(tasks):
        if reporter is not None and reporter.stop:
            raise KeyboardInterrupt
        spare = can_be_off(plan, muscles)
        start = least_cost(plan, off=muscles) if spare else plan
        if spare and start.objective.total <= CHEAP * plan.objective.total:
            note(number, _need(muscles, True, start, reference))
        else:
            hard[number] = start
    numbers = [*hard]
    run(
        _replanned,
        [(start, tasks[n], start is not plan, reference) for n, start in hard.items()],
        workers,
        reporter,
        found=lambda place, need: note(numbers[place], need),
    )
    return tuple(found[number] for number in range(len(tasks)))


def _replanned(
    start: Plan, muscles: tuple[str, ...], spare: bool, reference: float, reporter: Reporter
) -> AblationResult:
    """Plan again without some muscles, from a plan that may still use them."""
    motion = motion_without(start.motion, muscles)
    options = Options(weights=start.weights)
    again = plan_motion(motion, None, options, reporter, start, throw=False)
    return _need(muscles, spare, again, reference)


def motion_without(motion: Motion, muscles: tuple[str, ...]) -> Motion:
    """The same motion with some muscles at rest all the time."""
    return motion.with_spec(silenced_spec(motion.spec, muscles))


def pairs(motion: Motion) -> tuple[tuple[str, ...], ...]:
    """Muscles with their mirror images: names that differ in the side only, together."""
    found: dict[str, list[str]] = {}
    for muscle in motion.trunk.subdomains:
        found.setdefault(f"{muscle.segment} {muscle.group}", []).append(muscle.name)
    return tuple(tuple(names) for names in found.values())


def _need(muscles: tuple[str, ...], spare: bool, plan: Plan, reference: float) -> AblationResult:
    figures = measure(plan)
    return AblationResult(
        muscles=muscles,
        spare=spare,
        status=plan.status.name.lower(),
        planner_objective=figures.planner_objective,
        paper_objective=figures.paper_objective,
        ratio=figures.planner_objective / reference if reference else np.inf,
        worst_position_error=figures.worst_position_error,
        mean_position_error=figures.mean_position_error,
        worst_direction_error=figures.worst_direction_error,
    )

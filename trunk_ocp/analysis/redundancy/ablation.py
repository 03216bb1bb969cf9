"""Ablation: plan a motion again without one muscle, and compare the costs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ..._support.process_pool import run_tasks
from ...errors import InputError
from ...planning.options import Options
from ...planning.plan import Plan
from ...planning.planner import plan_motion
from ...problem.motion import Motion
from ...problem.variants import silenced_spec
from ...reporting import Reporter
from ..measures import plan_measures
from .alternatives import can_be_off, least_cost

CHEAP_RATIO = 1.01
"""Ratio of costs up to which the planned shapes are kept and no new plan is made."""


@dataclass(frozen=True)
class AblationResult:
    """One motion without some muscles.

    Attributes
    ----------
    muscles : tuple of str
        The muscles removed.
    spare : bool
        Whether the other muscles can keep every shape of the plan.
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


OnResult = Callable[[int, int, AblationResult], None]


def ablate_muscles(
    plan: Plan,
    without: Sequence[tuple[str, ...]] | None = None,
    processes: int | None = None,
    progress: OnResult | None = None,
    reporter: Reporter | None = None,
) -> tuple[AblationResult, ...]:
    """How much worse a motion gets without each muscle.

    Where other muscles can keep the planned shapes, removing a muscle costs only the effort of its
    substitutes. If the cost then exceeds `CHEAP_RATIO`, or the shapes cannot be kept, the motion is
    planned again as a horizon from that start: a local optimum, so an upper bound on the loss.

    Parameters
    ----------
    plan : Plan
        A verified plan of all time steps within the horizon's bounds.
    without : sequence of tuples of muscle names, optional
        The muscles to remove in each run; by default one muscle at a time.
    processes : int, optional
        By default one for each core that this process may use; 1 computes in this process.
    progress : callable, optional
        Called with (done, total, result) after each run.
    reporter : Reporter, optional
        Its `stop` ends all runs with KeyboardInterrupt.

    Raises
    ------
    InputError
        If the plan is not verified or follows auxiliary solutions, or a name is unknown.
    """
    if plan.auxiliary:
        raise InputError(
            f"{plan.motion.name}, {plan.mode}: follows auxiliary solutions, which depend on all "
            "muscles; expected a horizon plan."
        )
    tasks = list(without or ((name,) for name in plan.motion.trunk.muscles))
    reference = plan.objective.total
    results: dict[int, AblationResult] = {}

    def note(number: int, result: AblationResult) -> None:
        results[number] = result
        if progress is not None:
            progress(len(results), len(tasks), result)

    starts: dict[int, Plan] = {}  # of the runs that need a new plan
    for number, muscles in enumerate(tasks):
        if reporter is not None and reporter.stop:
            raise KeyboardInterrupt
        spare = can_be_off(plan, muscles)
        start = least_cost(plan, off=muscles) if spare else plan
        if spare and start.objective.total <= CHEAP_RATIO * plan.objective.total:
            note(number, _result(muscles, True, start, reference))
        else:
            starts[number] = start
    numbers = [*starts]
    run_tasks(
        _replanned,
        [(start, tasks[n], start is not plan, reference) for n, start in starts.items()],
        processes,
        reporter,
        on_result=lambda place, result: note(numbers[place], result),
    )
    return tuple(results[number] for number in range(len(tasks)))


def _replanned(
    start: Plan, muscles: tuple[str, ...], spare: bool, reference: float, reporter: Reporter
) -> AblationResult:
    """Plan again without some muscles, starting from a plan that may still use them."""
    motion = motion_without(start.motion, muscles)
    options = Options(weights=start.weights)
    again = plan_motion(motion, None, options, reporter, start, throw=False)
    return _result(muscles, spare, again, reference)


def motion_without(motion: Motion, muscles: tuple[str, ...]) -> Motion:
    """The same motion with some muscles at rest all the time."""
    return motion.with_spec(silenced_spec(motion.spec, muscles))


def _result(muscles: tuple[str, ...], spare: bool, plan: Plan, reference: float) -> AblationResult:
    figures = plan_measures(plan)
    return AblationResult(
        muscles=muscles,
        spare=spare,
        status=plan.check().name.lower(),
        planner_objective=figures.planner_objective,
        paper_objective=figures.paper_objective,
        ratio=figures.planner_objective / reference if reference else np.inf,
        worst_position_error=figures.worst_position_error,
        mean_position_error=figures.mean_position_error,
        worst_direction_error=figures.worst_direction_error,
    )

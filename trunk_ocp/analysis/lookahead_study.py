"""What foresight is worth: one motion planned with every lookahead, under equal bounds.

The paper doubts its own result: activations reorganize abruptly in mid-motion, and that may only
come from solving each time step blind to the next. Three things set its way of planning apart
from a horizon, and each is undone on its own here: nothing but tracking counts (so the activations
are whatever the solver ends at), steps stay near solutions without loads (appendix B), and no
step knows the next. The same is asked under limits on strength and speed, where foresight matters
more.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from .._support.arguments import check_arguments
from .._support.process_pool import Done, run_tasks
from ..errors import InputError
from ..nlp.window import Weights
from ..planning.plan import Plan, Status
from ..planning.planner import plan_from, plan_motion
from ..planning.state import Options
from ..problem.motion import Motion
from ..problem.variants import unaided_spec
from ..reporting import Reporter
from .measures import DEFINITIONS, REVERSAL, Measures, plan_measures

TRACKING_ONLY = Weights(effort=1e-7, rate=0.0)
"""The paper's cost, made well-posed.

By tracking alone 16 of the elephant's 28 directions of activation count for nothing, and a plan is
wherever the optimizer happens to stop. This is about the least effort that Ipopt still sees: its
slope at gamma = -3 is 6e-7, and Ipopt stops where slopes are below 1e-8.
"""
SHARE = 0.01
"""A lookahead suffices if its objective is within this share of the best one's."""
ALIKE = 1e-6
"""Relative difference of two objectives that is no difference."""


def equal_bounds(motion: Motion) -> Motion:
    """The motion without auxiliary problems: every lookahead then has the horizon's bounds."""
    steps = tuple(replace(s, auxiliary=None) for s in motion.steps)
    return replace(motion, spec=unaided_spec(motion.spec), steps=steps)


@dataclass(frozen=True)
class Curve:
    """One motion planned with several lookaheads under equal bounds.

    Attributes
    ----------
    plans : dict
        By lookahead; 1 is blind, the number of time steps the horizon.
    best : Plan
        The best horizon known: that of `plans`, or another one that starts from a receding plan
        that beats it. All are local optima.
    shown : Plan
        Blind once more, each step's solve started where the best horizon has that step. What is
        still missing then is for want of foresight; what is not was for want of a good start.
    """

    motion: Motion
    plans: Mapping[int, Plan]
    best: Plan
    shown: Plan

    @property
    def blind(self) -> Plan:
        """The plan that solves each step blind to the next."""
        return self.plans[1]

    @property
    def horizon(self) -> Plan:
        """The plan of all time steps together, as it starts from the blind one."""
        return self.plans[len(self.motion.steps)]

    @cached_property
    def excess(self) -> dict[int, float]:
        """Objective of each lookahead over the best one's, minus 1; only of sound plans."""
        least = self.best.objective.total
        return {
            H: plan.objective.total / least - 1 for H, plan in self.plans.items() if sound(plan)
        }

    @property
    def sufficient(self) -> int | None:
        """The smallest lookahead whose objective is within `SHARE` of the best one's.

        None that misses a target suffices where the best does not.
        """
        reaches = self.best.status is Status.SOLVED
        enough = (
            H
            for H, excess in self.excess.items()
            if excess <= SHARE and (not reaches or self.plans[H].status is Status.SOLVED)
        )
        return min(enough, default=None)

    @property
    def worse_than_blind(self) -> list[int]:
        """Lookaheads that do worse than none."""
        none = self.excess.get(1, np.inf)
        return [H for H, excess in self.excess.items() if excess > none * (1 + ALIKE) + ALIKE]

    def as_dict(self) -> dict[str, Any]:
        """Measures of all plans, ready for JSON."""
        return {
            "lookaheads": {str(H): asdict(plan_measures(plan)) for H, plan in self.plans.items()},
            "best": asdict(plan_measures(self.best)),
            "blind_from_best": asdict(plan_measures(self.shown)),
            "sufficient_lookahead": self.sufficient,
            "worse_than_blind": self.worse_than_blind,
        }


def sound(plan: Plan) -> bool:
    """Whether a plan is an optimum that the independent check confirms, targets met or not."""
    return plan.converged and plan.verified


@dataclass(frozen=True)
class Foresight:
    """The paper's way of planning a motion, and every lookahead.

    Attributes
    ----------
    paper : Plan
        Sequential, with appendix B's auxiliary problems and feasible sets, by tracking only.
    paper_costed : Plan
        The same with the running cost of all other plans.
    curve : Curve
        All lookaheads under equal bounds.
    limits : dict
        Largest |gamma| "activation" and "rate" in 1/s; None where there is no limit.
    """

    paper: Plan
    paper_costed: Plan
    curve: Curve
    limits: Mapping[str, float | None]

    @property
    def motion(self) -> Motion:
        """The motion, as it was limited."""
        return self.paper.motion

    @cached_property
    def measures(self) -> dict[str, Measures]:
        """Measures of every plan by its name; the objective is by the same weights for all."""
        curve = self.curve
        weights = curve.best.weights
        plans = {"paper": self.paper, "paper, same cost": self.paper_costed}
        plans |= {f"lookahead {H}": plan for H, plan in curve.plans.items()}
        if curve.best is not curve.horizon:
            plans["best horizon"] = curve.best
        plans["blind from best"] = curve.shown
        return {name: plan_measures(plan, weights) for name, plan in plans.items()}

    def as_dict(self) -> dict[str, Any]:
        """Everything in numbers, with units and definitions; ready for JSON."""
        weights = self.curve.best.weights
        return {
            "problem": self.motion.name,
            "limits": dict(self.limits),
            "weights": asdict(weights),
            "ways": {
                "paper": "one step after the other, tracking only (effort weighs "
                f"{TRACKING_ONLY.effort:g}), auxiliary problems and feasible sets of appendix B",
                "paper, same cost": "the same with effort and rate weighed as in all other ways",
                "lookahead H": "H steps at a time under the horizon's bounds, without auxiliary "
                "problems: 1 is blind to the next step, "
                f"{len(self.motion.steps)} is the horizon",
                "best horizon": "the horizon once more from the best receding plan; only if that "
                "is better than from the blind one",
                "blind from best": "lookahead 1 once more, each step's solve started from the best "
                "horizon's step: tells a want of foresight from a poor start",
            },
            "measures": {name: asdict(measures) for name, measures in self.measures.items()},
            "sufficient_lookahead": self.curve.sufficient,
            "worse_than_blind": self.curve.worse_than_blind,
            "definitions": definitions(),
        }


def definitions() -> dict[str, dict[str, str]]:
    """Unit and meaning of every number of this module."""
    limits = {
        "limits.activation": ("", "largest |gamma| that any muscle may have; null: the motion's"),
        "limits.rate": ("1/s", "largest change of any activation per second, over each time step"),
        "sufficient_lookahead": (
            "time steps",
            f"smallest lookahead with a planner_objective within {SHARE:.0%} of the best "
            "horizon's that misses no target, unless that horizon does; null if none is",
        ),
        "worse_than_blind": ("time steps", "lookaheads with a larger objective than lookahead 1"),
        "blind_from_best": ("", "lookahead 1 with each step's solve started from the best's"),
        "reversal threshold": ("", f"{REVERSAL:g}"),
    }
    return {
        name: {"unit": unit, "meaning": meaning}
        for name, (unit, meaning) in (DEFINITIONS | limits).items()
    }


@check_arguments
def compare_lookaheads(
    motion: Motion,
    activation: float | None = None,
    rate: float | None = None,
    lookaheads: Iterable[int] | None = None,
    options: Options | None = None,
    processes: int | None = None,
    reporter: Reporter | None = None,
    done: Done | None = None,
) -> Foresight:
    """Plan a motion the paper's way and with every lookahead.

    Parameters
    ----------
    activation, rate : float, optional
        Limits on every muscle, see `Motion.limited`.
    lookaheads : whole numbers, optional
        By default all; blindness and horizon are always among them.
    processes, reporter, done : see `process_pool.run_tasks`
    """
    options = options or Options()
    limited = motion.limited(activation, rate)
    bare = replace(options, weights=TRACKING_ONLY)
    first = [(limited, 1, bare, None), (limited, 1, options, None)]
    (paper, costed), (curve,) = _curves(
        [equal_bounds(limited)], lookaheads, options, processes, reporter, done, first
    )
    return Foresight(paper, costed, curve, {"activation": activation, "rate": rate})


@check_arguments
def survey_limits(
    motion: Motion,
    activations: Sequence[float | None] = (None,),
    rates: Sequence[float | None] = (None,),
    lookaheads: Iterable[int] | None = None,
    options: Options | None = None,
    processes: int | None = None,
    reporter: Reporter | None = None,
    done: Done | None = None,
) -> dict[str, Any]:
    """The curve of cost against lookahead under every pair of limits, ready for JSON.

    Arguments as those of `foresight`. "cells" has an entry for each pair of limits.
    """
    pairs = [(activation, rate) for activation in activations for rate in rates]
    if not pairs:
        raise InputError("activations and rates: expected one limit of each at least, or None.")
    motions = [equal_bounds(motion.limited(*pair)) for pair in pairs]
    _, curves = _curves(motions, lookaheads, options or Options(), processes, reporter, done)
    cells = [
        {"limits": {"activation": activation, "rate": rate}, **curve.as_dict()}
        for (activation, rate), curve in zip(pairs, curves, strict=True)
    ]
    return {"problem": motion.name, "cells": cells, "definitions": definitions()}


@check_arguments
def smoothness_tradeoff(
    motion: Motion,
    weights: Sequence[float] = tuple(10.0 ** np.arange(-7, -0.9, 0.5)),
    options: Options | None = None,
    processes: int | None = None,
    reporter: Reporter | None = None,
    done: Done | None = None,
) -> dict[str, Any]:
    """Tracking against smoothness, blind and with a horizon: the weight of rates swept.

    Under equal bounds; the weight of effort stays. Ready for JSON: measures by the names "blind"
    and "horizon", one entry for each weight.
    """
    options, equal = options or Options(), equal_bounds(motion)
    choices = [replace(options, weights=replace(options.weights, rate=w)) for w in weights]
    tasks = [(equal, None, choice, None) for choice in choices]
    pairs = run_tasks(_blind_and_horizon, tasks, processes, reporter, done)
    return {
        "problem": motion.name,
        "rate_weight": list(weights),
        "effort_weight": options.weights.effort,
        "blind": [asdict(plan_measures(blind)) for blind, _ in pairs],
        "horizon": [asdict(plan_measures(horizon)) for _, horizon in pairs],
        "definitions": definitions(),
    }


def _curves(
    motions: Sequence[Motion],
    lookaheads: Iterable[int] | None,
    options: Options,
    processes: int | None,
    reporter: Reporter | None,
    done: Done | None,
    first: Sequence[tuple[Any, ...]] = (),
) -> tuple[list[Plan], list[Curve]]:
    """Plans of the tasks `first`, and the curve of each motion.

    All lookaheads start from the blind plan; a window's first start is what it knows of the window
    before.
    """
    count = len(motions[0].steps)
    chosen = sorted({1, count, *(range(1, count + 1) if lookaheads is None else lookaheads)})
    if chosen[0] < 1 or chosen[-1] > count:
        raise InputError(
            f"lookaheads = {chosen}: expected whole numbers from 1 to {count}, the number of "
            "time steps."
        )
    longer = [H for H in reversed(chosen) if H > 1]  # what takes longest first
    total = len(first) + len(motions) * (len(longer) + 1)
    counts = _Counts(done, total)
    tasks = [*first, *((motion, 1, options, None) for motion in motions)]
    plans = run_tasks(plan_of, tasks, processes, reporter, counts)
    blind = plans[len(first) :]
    counts.begin(len(tasks))
    tasks = [
        (motion, H, options, start)
        for motion, start in zip(motions, blind, strict=True)
        for H in longer
    ]
    others = iter(run_tasks(plan_of, tasks, processes, reporter, counts))
    found = [{1: start} | {H: next(others) for H in longer} for start in blind]
    horizons = [_best(motion, some) for motion, some in zip(motions, found, strict=True)]
    tasks = [
        (motion, None, options, start)
        for motion, some, start in zip(motions, found, horizons, strict=True)
        if start is not some[count]
    ]
    again = iter(run_tasks(plan_of, tasks, processes, reporter))
    best = [
        start if start is some[count] else next(again)
        for some, start in zip(found, horizons, strict=True)
    ]
    tasks = [(motion, plan, options) for motion, plan in zip(motions, best, strict=True)]
    shown = run_tasks(_blind_from, tasks, processes, reporter)
    curves = [
        Curve(motion, {H: some[H] for H in chosen}, *pair)
        for motion, some, *pair in zip(motions, found, best, shown, strict=True)
    ]
    return plans[: len(first)], curves


def _best(motion: Motion, plans: Mapping[int, Plan]) -> Plan:
    """The plan with the least objective; the horizon unless another one clearly beats it."""
    horizon = plans[len(motion.steps)]
    good = [plan for plan in plans.values() if sound(plan)]
    best = min(good, key=lambda plan: plan.objective.total, default=horizon)
    clearly = best.objective.total < horizon.objective.total * (1 - ALIKE)
    return best if clearly or not sound(horizon) else horizon


class _Counts:
    """Counts the tasks of several runs as one."""

    def __init__(self, done: Done | None, total: int) -> None:
        self.done, self.total, self.before = done, total, 0

    def begin(self, before: int) -> None:
        """A run begins after so many tasks."""
        self.before = before

    def __call__(self, done: int, _: int) -> None:
        if self.done is not None:
            self.done(self.before + done, self.total)


def plan_of(
    motion: Motion, lookahead: int | None, options: Options, start: Plan | None, reporter: Reporter
) -> Plan:
    """`plan_motion`, for a process of its own; the plan has been checked there as well."""
    plan = plan_motion(motion, lookahead, options, reporter, start, throw=False)
    _ = plan.status  # kept in the plan
    return plan


def _blind_from(motion: Motion, start: Plan, options: Options, reporter: Reporter) -> Plan:
    plan = plan_from(motion, start.x, 1, options, reporter)
    _ = plan.status  # kept in the plan
    return plan


def _blind_and_horizon(
    motion: Motion, _: None, options: Options, start: None, reporter: Reporter
) -> tuple[Plan, Plan]:
    blind = plan_of(motion, 1, options, start, reporter)
    return blind, plan_of(motion, None, options, blind, reporter)

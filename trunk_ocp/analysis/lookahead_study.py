"""What foresight is worth: one motion planned with every lookahead, under equal bounds.

The paper questions its own result: activations reorganize abruptly in mid-motion, which may only
come from solving each time step blind to the next. Three things distinguish its method from a
horizon, and each is changed on its own here: only tracking counts (so the activations are
wherever the solver stops), steps stay near solutions without loads (appendix B), and no step
knows the next. The comparison is repeated under limits on strength and speed, where foresight
matters more.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from .._support.arguments import check_arguments
from .._support.process_pool import DoneCallback, run_tasks
from ..errors import InputError
from ..planning.options import Options
from ..planning.plan import Plan
from ..planning.status import Status
from ..problem.motion import Motion
from ..problem.variants import unaided_spec
from ..problem.weights import Weights
from ..reporting import Reporter
from .measures import DEFINITIONS, REVERSAL, Measures, plan_measures
from .study_tasks import blind_and_horizon, plan_from_start, plan_of, sound

TRACKING_ONLY = Weights(effort=1e-7, rate=0.0)
"""The paper's cost, made well-posed.

With tracking alone, 16 of the 28 directions of activation of the elephant's trunk do not affect the
cost, and a plan is wherever the optimizer happens to stop. This is about the smallest effort weight
that Ipopt still sees: its slope at gamma = -3 is 6e-7, and Ipopt stops at slopes below 1e-8.
"""
SUFFICIENT_EXCESS = 0.01
"""Relative excess over the best objective up to which a lookahead is sufficient."""
OBJECTIVE_RTOL = 1e-6
"""Relative difference up to which two objectives count as equal."""


def equal_bounds(motion: Motion) -> Motion:
    """The motion without auxiliary problems: every lookahead then has the horizon's bounds."""
    return motion.with_spec(unaided_spec(motion.spec))


@dataclass(frozen=True)
class Curve:
    """One motion planned with several lookaheads under equal bounds.

    Attributes
    ----------
    plans : dict
        By lookahead; 1 is blind, the number of time steps the horizon.
    best : Plan
        The best horizon known: that of `plans`, or one that starts from a receding plan with a
        lower objective. All are local optima.
    shown : Plan
        Blind again, with each step started at that step of the best horizon. The remaining loss
        comes from missing foresight; the rest came from a poor start.
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
        """The plan of all time steps together, started from the blind one."""
        return self.plans[len(self.motion.steps)]

    @cached_property
    def excess(self) -> dict[int, float]:
        """Relative excess of the objective over the best one, by lookahead; only of sound plans."""
        least = self.best.objective.total
        return {
            H: plan.objective.total / least - 1 for H, plan in self.plans.items() if sound(plan)
        }

    @property
    def sufficient(self) -> int | None:
        """The smallest lookahead within `SUFFICIENT_EXCESS` of the best objective.

        A plan that misses a target is not sufficient if the best one misses none.
        """
        best_solved = self.best.status is Status.SOLVED
        sufficient = (
            H
            for H, excess in self.excess.items()
            if excess <= SUFFICIENT_EXCESS
            and (not best_solved or self.plans[H].status is Status.SOLVED)
        )
        return min(sufficient, default=None)

    @property
    def worse_than_blind(self) -> list[int]:
        """Lookaheads with a higher objective than the blind plan."""
        blind = self.excess.get(1, np.inf)
        return [
            H
            for H, excess in self.excess.items()
            if excess > blind * (1 + OBJECTIVE_RTOL) + OBJECTIVE_RTOL
        ]

    def as_dict(self) -> dict[str, Any]:
        """Measures of all plans, ready for JSON."""
        return {
            "lookaheads": {str(H): asdict(plan_measures(plan)) for H, plan in self.plans.items()},
            "best": asdict(plan_measures(self.best)),
            "blind_from_best": asdict(plan_measures(self.shown)),
            "sufficient_lookahead": self.sufficient,
            "worse_than_blind": self.worse_than_blind,
        }


@dataclass(frozen=True)
class Foresight:
    """One motion planned with the paper's method, and with every lookahead.

    Attributes
    ----------
    paper : Plan
        Sequential, tracking only, with appendix B's auxiliary problems and feasible sets.
    paper_costed : Plan
        The same with the cost of all other plans.
    curve : Curve
        All lookaheads under equal bounds.
    limits : dict
        Largest |gamma| "activation" and "rate" in 1/s; None for no limit.
    """

    paper: Plan
    paper_costed: Plan
    curve: Curve
    limits: Mapping[str, float | None]

    @property
    def motion(self) -> Motion:
        """The motion with its limits."""
        return self.paper.motion

    @cached_property
    def measures(self) -> dict[str, Measures]:
        """Measures of every plan by its name; objectives use the same weights for all."""
        curve = self.curve
        weights = curve.best.weights
        plans = {"paper": self.paper, "paper, same cost": self.paper_costed}
        plans |= {f"lookahead {H}": plan for H, plan in curve.plans.items()}
        if curve.best is not curve.horizon:
            plans["best horizon"] = curve.best
        plans["blind from best"] = curve.shown
        return {name: plan_measures(plan, weights) for name, plan in plans.items()}

    def as_dict(self) -> dict[str, Any]:
        """All numbers, with units and definitions, ready for JSON."""
        weights = self.curve.best.weights
        return {
            "problem": self.motion.name,
            "limits": dict(self.limits),
            "weights": asdict(weights),
            "ways": {
                "paper": "one step at a time, tracking only (effort weight "
                f"{TRACKING_ONLY.effort:g}), auxiliary problems and feasible sets of appendix B",
                "paper, same cost": "the same with the weights of all other plans",
                "lookahead H": "H steps at a time under the horizon's bounds, without auxiliary "
                "problems: 1 is blind to the next step, "
                f"{len(self.motion.steps)} is the horizon",
                "best horizon": "the horizon started from the best receding plan, if better than "
                "from the blind one",
                "blind from best": "lookahead 1, each step started from that of the best horizon: "
                "separates missing foresight from a poor start",
            },
            "measures": {name: asdict(measures) for name, measures in self.measures.items()},
            "sufficient_lookahead": self.curve.sufficient,
            "worse_than_blind": self.curve.worse_than_blind,
            "definitions": definitions(),
        }


def definitions() -> dict[str, dict[str, str]]:
    """Unit and meaning of every number of this module."""
    limits = {
        "limits.activation": ("", "largest |gamma| of any muscle; null: the motion's own limit"),
        "limits.rate": ("1/s", "largest change of any activation per second, over each time step"),
        "sufficient_lookahead": (
            "time steps",
            f"smallest lookahead with planner_objective within {SUFFICIENT_EXCESS:.0%} of the best "
            "horizon that misses no target, unless that horizon does; null if there is none",
        ),
        "worse_than_blind": ("time steps", "lookaheads with a larger objective than lookahead 1"),
        "blind_from_best": ("", "lookahead 1 with each step started from that of the best horizon"),
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
    done: DoneCallback | None = None,
) -> Foresight:
    """Plan a motion with the paper's method and with every lookahead.

    Parameters
    ----------
    motion : Motion
    activation, rate : float, optional
        Limits on every muscle: largest |gamma|, and largest rate in 1/s; see `Motion.limited`.
    lookaheads : iterable of int, optional
        Time steps; by default all. 1 and the number of time steps are always included.
    options : Options, optional
    processes : int, optional
        By default one for each core that this process may use.
    reporter : Reporter, optional
        Its `stop` ends all plans with KeyboardInterrupt.
    done : callable, optional
        Called with the number of finished plans and of all plans.

    Returns
    -------
    Foresight

    Raises
    ------
    InputError
        If an argument is of the wrong type or out of range, or the limits leave no motion.
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
    done: DoneCallback | None = None,
) -> dict[str, Any]:
    """Cost against lookahead under every pair of limits on strength and speed, ready for JSON.

    Parameters
    ----------
    motion : Motion
    activations, rates : sequences of float or None
        Limits on every muscle, see `Motion.limited`; None for no limit.
    lookaheads, options, processes, reporter, done
        As in `compare_lookaheads`.

    Returns
    -------
    dict
        "cells" has an entry for each pair of limits, "definitions" all units and meanings.

    Raises
    ------
    InputError
        As `compare_lookaheads`, or if there is no pair of limits.
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
    done: DoneCallback | None = None,
) -> dict[str, Any]:
    """Tracking against smoothness, blind and with a horizon: a sweep of the weight of rates.

    Parameters
    ----------
    motion : Motion
        Planned under equal bounds.
    weights : sequence of float
        Weights of rates; the weight of effort stays that of `options`.
    options, processes, reporter, done
        As in `compare_lookaheads`.

    Returns
    -------
    dict
        Ready for JSON: "blind" and "horizon" have the measures for each weight.

    Raises
    ------
    InputError
        If an argument is of the wrong type or out of range.
    """
    options, equal = options or Options(), equal_bounds(motion)
    base = options.weights_for(motion)
    choices = [replace(options, weights=replace(base, rate=w)) for w in weights]
    tasks = [(equal, choice) for choice in choices]
    pairs = run_tasks(blind_and_horizon, tasks, processes, reporter, done)
    return {
        "problem": motion.name,
        "rate_weight": list(weights),
        "effort_weight": base.effort,
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
    done: DoneCallback | None,
    first: Sequence[tuple[Any, ...]] = (),
) -> tuple[list[Plan], list[Curve]]:
    """Plans of the tasks `first`, and the curve of each motion.

    All lookaheads start from the blind plan; later windows start from the window before.
    """
    count = len(motions[0].steps)
    chosen = sorted({1, count, *(range(1, count + 1) if lookaheads is None else lookaheads)})
    if chosen[0] < 1 or chosen[-1] > count:
        raise InputError(
            f"lookaheads = {chosen}: expected whole numbers from 1 to {count}, the number of "
            "time steps."
        )
    longer = [H for H in reversed(chosen) if H > 1]  # slowest first
    total, report = len(first) + len(motions) * (len(longer) + 1), done or (lambda _, __: None)
    tasks = [*first, *((motion, 1, options, None) for motion in motions)]
    plans = run_tasks(plan_of, tasks, processes, reporter, lambda n, _: report(n, total))
    blind, before = plans[len(first) :], len(plans)
    tasks = [
        (motion, H, options, start)
        for motion, start in zip(motions, blind, strict=True)
        for H in longer
    ]
    others = iter(
        run_tasks(plan_of, tasks, processes, reporter, lambda n, _: report(before + n, total))
    )
    plans_by_H = [{1: start} | {H: next(others) for H in longer} for start in blind]
    horizons = [_best(motion, by_H) for motion, by_H in zip(motions, plans_by_H, strict=True)]
    tasks = [
        (motion, None, options, start)
        for motion, by_H, start in zip(motions, plans_by_H, horizons, strict=True)
        if start is not by_H[count]
    ]
    again = iter(run_tasks(plan_of, tasks, processes, reporter))
    best = [
        start if start is by_H[count] else next(again)
        for by_H, start in zip(plans_by_H, horizons, strict=True)
    ]
    tasks = [(motion, plan.x, 1, options) for motion, plan in zip(motions, best, strict=True)]
    shown = run_tasks(plan_from_start, tasks, processes, reporter)
    curves = [
        Curve(motion, {H: by_H[H] for H in chosen}, *pair)
        for motion, by_H, *pair in zip(motions, plans_by_H, best, shown, strict=True)
    ]
    return plans[: len(first)], curves


def _best(motion: Motion, plans: Mapping[int, Plan]) -> Plan:
    """The plan with the lowest objective; the horizon unless another one is clearly better."""
    horizon = plans[len(motion.steps)]
    candidates = [plan for plan in plans.values() if sound(plan)]
    best = min(candidates, key=lambda plan: plan.objective.total, default=horizon)
    clearly_better = best.objective.total < horizon.objective.total * (1 - OBJECTIVE_RTOL)
    return best if clearly_better or not sound(horizon) else horizon

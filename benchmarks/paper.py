"""The paper's method with our forward solve: J_T of eq. (42), derivative-free, step by step.

With appendix B's feasible sets and initial guesses, the extension penalty of 1e3, and Sbplx (NLopt)
or NOMAD for the main problems. The auxiliary problems, which need no boundary value problem, are
solved by differential evolution (the paper's choice for the logs, appendix C) on whole populations,
then by Sbplx, which did better here than the paper's other choice. An optimizer that ends early is
restarted, as in B.3, from the best point plus a random change of up to 0.01.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.optimize import differential_evolution

import trunk_ocp as to
from trunk_ocp.problem.motion import allowed

from .common import run_part
from .objective import Objective

AUXILIARY_SHARE = 0.25


@dataclass
class Search:
    """A problem with bounds; records the best point and when it was found."""

    J: Callable[[np.ndarray], np.ndarray]
    lower: np.ndarray
    upper: np.ndarray
    x: np.ndarray
    until: float
    best: float = np.inf
    found: list[tuple[float, float]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.upper = np.maximum(self.lower, self.upper)
        self.x = np.clip(self.x, self.lower, self.upper)
        self.free = self.upper - self.lower > 1e-12
        self(self.x[None][:, self.free])

    @property
    def left(self) -> float:
        return self.until - time.perf_counter()

    def __call__(self, free: np.ndarray) -> np.ndarray:
        x = np.tile(self.x, (len(free), 1))
        x[:, self.free] = np.clip(free, self.lower[self.free], self.upper[self.free])
        J = self.J(x)
        i = int(np.argmin(J))
        if J[i] < self.best:
            self.best, self.x = float(J[i]), x[i].copy()
            self.found.append((time.perf_counter(), self.best))
        return J

    def restart(self, rng: np.random.Generator) -> np.ndarray:
        """The best point with a random change of appendix B.3, contractions only."""
        start = self.x[self.free] + rng.uniform(0, 0.01, size=self.free.sum())
        return np.clip(start, self.lower[self.free], self.upper[self.free])


def sbplx_search(search: Search, start: np.ndarray, seed: int) -> None:
    import nlopt

    lower, upper = search.lower[search.free], search.upper[search.free]
    optimizer = nlopt.opt(nlopt.LN_SBPLX, lower.size)
    optimizer.set_lower_bounds(lower)
    optimizer.set_upper_bounds(upper)
    optimizer.set_min_objective(lambda x, _: float(search(x[None])[0]))
    optimizer.set_xtol_rel(1e-6)
    optimizer.set_maxtime(max(search.left, 1e-3))
    with contextlib.suppress(nlopt.RoundoffLimited, RuntimeError):
        optimizer.optimize(start)


def nomad_search(search: Search, start: np.ndarray, seed: int) -> None:
    """NOMAD with blocks of points, which our forward solve evaluates as one batch."""
    import PyNomad

    lower, upper = search.lower[search.free], search.upper[search.free]

    def block(points: Any) -> list[bool]:
        block_points = [points.get_x(k) for k in range(points.size())]
        x = np.array([[p.get_coord(i) for i in range(p.size())] for p in block_points])
        for point, J in zip(block_points, search(x), strict=True):
            point.setBBO(repr(float(J)).encode())
        return [True] * len(block_points)

    PyNomad.optimize(
        block,
        start.tolist(),
        lower.tolist(),
        upper.tolist(),
        [
            "BB_OUTPUT_TYPE OBJ",
            f"BB_MAX_BLOCK_SIZE {2 * lower.size}",
            f"MAX_TIME {max(1, round(search.left))}",  # whole seconds
            "QUAD_MODEL_SEARCH no",  # both this and sorting are slow, and did worse in equal time
            "EVAL_QUEUE_SORT DIR_LAST_SUCCESS",
            "DIRECTION_TYPE ORTHO 2N",
            "DISPLAY_DEGREE 0",
            "DISPLAY_ALL_EVAL false",
            f"SEED {seed}",
        ],
    )


def evolution(search: Search) -> Search:
    """Differential evolution for half of the time."""
    stop = time.perf_counter() + search.left / 2
    lower, upper = search.lower[search.free], search.upper[search.free]
    share = np.clip((search.x[search.free] - lower) / (upper - lower), 1e-6, 1 - 1e-6)
    differential_evolution(
        lambda x: search(x.T),
        list(zip(lower, upper, strict=True)),
        strategy="rand1bin",
        x0=lower
        + share * (upper - lower),  # scipy rejects a start on a bound, because of round-off
        maxiter=10**6,
        popsize=3,
        tol=0,
        polish=False,
        vectorized=True,
        updating="deferred",
        callback=lambda *_, **__: time.perf_counter() > stop,
        rng=0,
    )
    return search


METHODS = {"sbplx": sbplx_search, "nomad": nomad_search}


def minimize(search: Search, method: str) -> Search:
    """Run an optimizer until the time is up, restarting it when it ends early."""
    rng, start, seed = np.random.default_rng(0), search.x[search.free], 0
    shortest = 0.5 if method == "nomad" else 0.02  # NOMAD counts whole seconds
    while search.left > shortest and start.size:
        METHODS[method](search, start, seed)
        start, seed = search.restart(rng), seed + 1
    return search


def sequential(motion: str, method: str, budget: float = 60.0) -> dict[str, Any]:
    """Plan step by step within a budget of seconds; best J against seconds."""
    loaded = to.load_motion(motion)
    objective, count = Objective(loaded), len(loaded.steps)
    passive = np.zeros(len(loaded.trunk.muscles) + 2)
    for evaluate in (Objective(loaded).loaded, Objective(loaded).unloaded):
        evaluate(0, passive[None])  # compiled before the clock starts
    began = time.perf_counter()
    x, auxiliary, curves, waiting = [], None, [], []
    for t, step in enumerate(loaded.steps):
        end = began + budget * (t + 1) / count
        before = x[-1] if x else passive
        near = None
        lower, upper = step.box.lower, step.box.upper
        if step.auxiliary is None:
            auxiliary, start = None, before
            lower = np.maximum(lower, before + step.change.lower)
            upper = np.minimum(upper, before + step.change.upper)
        else:
            chained = bool(np.any(np.isfinite(step.change.upper))) and auxiliary is not None
            own = (lower, upper)
            if chained:
                own = (
                    np.maximum(lower, auxiliary + step.change.lower),
                    np.minimum(upper, auxiliary + step.change.upper),
                )
            until = time.perf_counter() + AUXILIARY_SHARE * (end - time.perf_counter())
            first = auxiliary if chained else before
            J_unloaded = lambda x, t=t: objective.unloaded(t, x)
            auxiliary = start = minimize(
                evolution(Search(J_unloaded, *own, first, until)), "sbplx"
            ).x
            near = start if step.auxiliary.binds else None
            box = allowed(loaded, step, near)
            lower, upper = box.lower, box.upper
        J = lambda x, t=t: objective.loaded(t, x)
        search = minimize(Search(J, lower, upper, start, end), method)
        x.append(search.x)
        objective.decide(t, search.x)
        curves.append([(when - began, J) for when, J in search.found])
        waiting.append(float(objective.loaded(t, passive[None])[0]))
    return {
        "J": sum(curve[-1][1] for curve in curves),
        "J_steps": [curve[-1][1] for curve in curves],
        "evaluations": objective.evaluations,
        "total_seconds": time.perf_counter() - began,
        "curve": summed(curves, waiting),
    }


def summed(curves: list[list[tuple[float, float]]], waiting: list[float]) -> list[list[float]]:
    """Best J so far summed over the steps, thinned; steps not yet started count as passive."""
    best = list(waiting)
    events = sorted((when, t, J) for t, curve in enumerate(curves) for when, J in curve)
    result: list[list[float]] = []
    for when, t, J in events:
        best[t] = J
        if not result or when > result[-1][0] * 1.02 + 1e-3:
            result.append([when, sum(best)])
    if events:
        result.append([events[-1][0], sum(best)])
    return result


if __name__ == "__main__":
    run_part({"sequential": sequential})

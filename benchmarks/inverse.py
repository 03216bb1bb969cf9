"""Whole motions: our planner, re-plans, and the horizon's NLP in standard CasADi."""

from __future__ import annotations

import time
from typing import Any

import casadi as ca
import numpy as np

import trunk_ocp as to
from trunk_ocp.nlp.ipopt import Optimizer, derivative_seconds
from trunk_ocp.nlp.ipopt_options import DEFAULT_OPTIONS
from trunk_ocp.nlp.window import Window
from trunk_ocp.planning.decided_steps import DecidedSteps
from trunk_ocp.planning.options import Options, first_mesh
from trunk_ocp.planning.planning_run import PlanningRun

from .common import median, run_part
from .objective import Objective

SHIFT = 0.01  # m


def figures_of(plan: to.Plan) -> dict[str, Any]:
    return {
        "status": plan.status.value,
        "setup_seconds": plan.setup_seconds,
        "solve_seconds": plan.solve_seconds,
        "derivative_seconds": plan.derivative_seconds,
        "total_seconds": plan.total_seconds,
        "iterations": plan.iterations,
        "objective": plan.objective.total,
        "J": plan.objective.paper,
        "verification_error_m": float(plan.verification.position_difference.max()),
        "J_steps": [errors.paper for errors in plan.errors],
    }


def ours(motion: str, mode: str, repeats: int = 3) -> dict[str, Any]:
    """Plan a motion a few times; medians of the times, which include initial guesses."""
    loaded = to.load_motion(motion)
    lookahead = 1 if mode == "sequential" else None
    plans = [to.plan_motion(loaded, lookahead) for _ in range(repeats)]
    totals = [plan.total_seconds for plan in plans]
    figures = figures_of(plans[-1])
    for name in ("setup_seconds", "solve_seconds", "derivative_seconds", "total_seconds"):
        figures[name] = median(getattr(plan, name) for plan in plans)
    figures["linear_algebra_seconds"] = figures["solve_seconds"] - figures["derivative_seconds"]
    return figures | {"first_seconds": totals[0], "duration": loaded.steps[-1].time}


def replan(motion: str) -> dict[str, Any]:
    """Re-plan with all targets moved by 1 cm along each axis, and moved back."""
    loaded = to.load_motion(motion)
    plan = to.plan_motion(loaded)
    planner = to.Replanner(plan)
    plans: list[to.Plan] = []
    planner(loaded)
    for axis in range(3):
        for sign in (1, -1):
            offset = sign * SHIFT * np.eye(3)[axis]
            plans += [planner(loaded.shifted(tuple(offset))), planner(loaded)]
    moved = plans[0::2]
    return {
        "iterations": median(p.iterations for p in moved),
        "worst_iterations": max(p.iterations for p in moved),
        "seconds": median(p.total_seconds for p in moved),
        "worst_seconds": max(p.total_seconds for p in moved),
        "solve_seconds": median(p.solve_seconds for p in moved),
        "converged": sum(p.converged for p in plans),
        "of": len(plans),
        "verified": sum(not p.verification.faults for p in moved),
    }


def horizon_window(motion: to.Motion) -> tuple[Window, np.ndarray, float]:
    """The horizon's NLP, its start (the sequential plan), and the time the start took in s."""
    options = Options()
    began = time.perf_counter()
    plan = to.plan_motion(motion, lookahead=1)
    start_seconds = time.perf_counter() - began
    mesh = first_mesh(motion, options)
    run = PlanningRun(motion, mesh, "horizon", len(motion.steps), options, Optimizer())
    window = run.window(0, motion.steps, DecidedSteps())
    return window, window.pack(plan.x, plan.shape), start_seconds


def horizon_nlp(motion: str, way: str, budget: float = 60.0) -> dict[str, Any]:
    """The same NLP, start and Ipopt options in three ways.

    "ours" gives Ipopt our derivatives; "plain" and "expand" leave them to `nlpsol`, with a graph
    of matrix operations or expanded to scalars. The budget limits Ipopt; building the graph is
    limited only by the time limit of the job.
    """
    loaded = to.load_motion(motion)
    horizon_window(loaded)  # warm-up, as for our planner
    window, start, start_seconds = horizon_window(loaded)
    began = time.perf_counter()
    options: dict[str, Any] = {f"ipopt.{name}": v for name, v in DEFAULT_OPTIONS.items()} | {
        "ipopt.max_wall_time": budget,
        "print_time": False,
        "record_time": True,
        "error_on_fail": False,
        "expand": way == "expand",
    }
    if way == "ours":
        options |= window.nlp.derivatives()
    solver = ca.nlpsol("horizon", "ipopt", window.nlp.as_casadi(), options)
    setup = time.perf_counter() - began
    result = solver(x0=start, p=window.parameters, **window.bounds)
    return solver_figures(solver.stats(), start_seconds, setup) | {
        "objective": float(result["f"]),
        "J": paper_objective(loaded, window.controls_of(np.asarray(result["x"]).ravel())),
        "unknowns": window.nlp.size[0],
        "constraints": window.nlp.size[1],
    }


def solver_figures(stats: dict[str, Any], start: float, setup: float) -> dict[str, Any]:
    """Status, iterations and seconds from the statistics of Ipopt in CasADi."""
    derivatives = derivative_seconds(stats)
    solve, iterations = stats["t_wall_total"], stats["iter_count"]
    return {
        "status": stats["return_status"],
        "setup_seconds": setup,
        "solve_seconds": solve,
        "derivative_seconds": derivatives,
        "linear_algebra_seconds": solve - derivatives,
        "iterations": iterations,
        "seconds_per_iteration": solve / max(iterations, 1),
        "start_seconds": start,
        "total_seconds": start + setup + solve,
    }


def paper_objective(motion: to.Motion, x: np.ndarray) -> float:
    """J of the forward solutions for the unknowns (H, muscles + 2), summed over the steps."""
    total, objective = 0.0, Objective(motion)
    for t, values in enumerate(x):
        total += objective.loaded(t, values[None])[0]
        objective.decide(t, values)
    return float(total)


if __name__ == "__main__":
    run_part({"ours": ours, "replan": replan, "horizon_nlp": horizon_nlp})

"""Whole-motion planning for a muscular trunk, modeled as an active Kirchhoff rod in CasADi.

import trunk_ocp as to
plan = to.plan_motion(to.load_motion("pick-fruit"))
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .analysis.diagnosis import Diagnosis, Finding, explain
    from .analysis.lookahead_study import compare_lookaheads, smoothness_tradeoff, survey_limits
    from .analysis.lookahead_study import compare_lookaheads as foresight
    from .analysis.lookahead_study import smoothness_tradeoff as front
    from .analysis.lookahead_study import survey_limits as survey
    from .analysis.measures import compare, plan_measures
    from .analysis.measures import plan_measures as measure
    from .analysis.multistart import find_optima
    from .analysis.multistart import find_optima as optima
    from .codegen.formats import check_export, export
    from .contact.clearance import Clearance
    from .contact.gaps import Gap
    from .errors import InputError, SolverMissingError, StaticsError, TrunkError
    from .model.anatomy import Trunk, load_anatomy
    from .model.loads import Loads
    from .planning.checkpoint import Checkpoint
    from .planning.options import Options
    from .planning.plan import Plan, PlanError
    from .planning.planner import plan_from, plan_motion
    from .planning.replanning import Replanner
    from .planning.simulated_plan import SimulatedPlan, simulate
    from .planning.status import Status
    from .planning.storage import load_plan, save_plan
    from .problem.build import load_motion
    from .problem.motion import Motion
    from .problem.problem_file import problem_schema
    from .problem.weights import Weights
    from .reporting import Progress, Reporter
    from .rod.buckling import Stability, buckling_margin
    from .rod.buckling import buckling_margin as stability
    from .rod.flutter import Flutter, flutter, natural_frequencies
    from .rod.point_shapes import PointShapes
    from .rod.shape import Shape
    from .rod.shape_map import ShapeMap
    from .rod.statics import solve_statics
    from .rod.tip_jacobian import tip_jacobian

# The module that defines each public name. Names are imported on first use: all of them together
# take over a second, during which the command line could neither show its help nor answer Ctrl-C.
_HOMES = {
    "model.anatomy": ("Trunk", "load_anatomy"),
    "planning.checkpoint": ("Checkpoint",),
    "codegen.formats": ("check_export", "export"),
    "contact.clearance": ("Clearance",),
    "contact.gaps": ("Gap",),
    "analysis.measures": ("compare", "plan_measures"),
    "analysis.diagnosis": ("Diagnosis", "Finding", "explain"),
    "errors": ("InputError", "SolverMissingError", "StaticsError", "TrunkError"),
    "analysis.lookahead_study": ("compare_lookaheads", "smoothness_tradeoff", "survey_limits"),
    "model.loads": ("Loads",),
    "problem.build": ("Motion", "load_motion"),
    "analysis.multistart": ("find_optima",),
    "planning.planner": ("plan_from", "plan_motion"),
    "rod.point_shapes": ("PointShapes",),
    "problem.problem_file": ("problem_schema",),
    "planning.replanning": ("Replanner",),
    "reporting": ("Progress", "Reporter"),
    "rod.tip_jacobian": ("tip_jacobian",),
    "rod.shape_map": ("ShapeMap",),
    "planning.plan": ("Plan", "PlanError"),
    "planning.simulated_plan": ("SimulatedPlan", "simulate"),
    "planning.status": ("Status",),
    "rod.buckling": ("Stability", "buckling_margin"),
    "rod.flutter": ("Flutter", "flutter", "natural_frequencies"),
    "rod.shape": ("Shape",),
    "rod.statics": ("solve_statics",),
    "planning.options": ("Options",),
    "planning.storage": ("load_plan", "save_plan"),
    "problem.weights": ("Weights",),
}
_HOME = {name: home for home, names in _HOMES.items() for name in names}

# Names of version 0.1, which still work, and what they are called now.
_OLD_NAMES = {
    "foresight": "compare_lookaheads",
    "front": "smoothness_tradeoff",
    "measure": "plan_measures",
    "optima": "find_optima",
    "stability": "buckling_margin",
    "survey": "survey_limits",
}

__all__ = [
    "Checkpoint",
    "Clearance",
    "Diagnosis",
    "Finding",
    "Flutter",
    "Gap",
    "InputError",
    "Loads",
    "Motion",
    "Options",
    "Plan",
    "PlanError",
    "PointShapes",
    "Progress",
    "Replanner",
    "Reporter",
    "Shape",
    "ShapeMap",
    "SimulatedPlan",
    "SolverMissingError",
    "Stability",
    "StaticsError",
    "Status",
    "Trunk",
    "TrunkError",
    "Weights",
    "buckling_margin",
    "check_export",
    "compare",
    "compare_lookaheads",
    "explain",
    "export",
    "find_optima",
    "flutter",
    "foresight",
    "front",
    "load_anatomy",
    "load_motion",
    "load_plan",
    "measure",
    "natural_frequencies",
    "optima",
    "plan_from",
    "plan_measures",
    "plan_motion",
    "problem_schema",
    "save_plan",
    "simulate",
    "smoothness_tradeoff",
    "solve_statics",
    "stability",
    "survey",
    "survey_limits",
    "tip_jacobian",
]


def __getattr__(name: str) -> Any:
    current = _OLD_NAMES.get(name, name)
    if current not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from ._support.deferred_signals import deferred_interrupts

    # Ctrl-C waits: an import that it cuts short may leave NumPy or CasADi unusable, and Python
    # ends with SIGINT if it came during an `exec`, as in dataclasses, although it was caught.
    with deferred_interrupts():
        value = getattr(import_module(f".{_HOME[current]}", __name__), current)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})

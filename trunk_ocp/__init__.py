"""Whole-motion planning for a muscular trunk: an active Kirchhoff rod in CasADi.

import trunk_ocp as to
plan = to.plan_motion(to.load_motion("pick-fruit"))
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .analysis.diagnosis import Diagnosis, Finding, explain
    from .analysis.lookahead_study import foresight, front, survey
    from .analysis.measures import compare, measure
    from .analysis.multistart import optima
    from .codegen.formats import check_export, export
    from .errors import InputError, SolverMissingError, StaticsError, TrunkError
    from .model.anatomy import Trunk, load_anatomy
    from .model.loads import Loads
    from .nlp.window import Weights
    from .planning.checkpoint import Checkpoint
    from .planning.options import Options
    from .planning.plan import Plan, PlanError, Status
    from .planning.planner import plan_from, plan_motion
    from .planning.replanning import Replanner
    from .planning.storage import load_plan, save_plan
    from .problem.build import load_motion
    from .problem.motion import Motion
    from .problem.problem_file import problem_schema
    from .reporting import Progress, Reporter
    from .rod.buckling import Stability, stability
    from .rod.point_shapes import PointShapes
    from .rod.shape import Shape
    from .rod.shape_map import ShapeMap
    from .rod.statics import solve_statics
    from .rod.tip_jacobian import tip_jacobian

# Where each public name is. They are imported when they are first asked for: all together take
# over a second, in which the command line could neither show its help nor answer Ctrl-C.
_HOMES = {
    "model.anatomy": ("Trunk", "load_anatomy"),
    "planning.checkpoint": ("Checkpoint",),
    "codegen.formats": ("check_export", "export"),
    "analysis.measures": ("compare", "measure"),
    "analysis.diagnosis": ("Diagnosis", "Finding", "explain"),
    "errors": ("InputError", "SolverMissingError", "StaticsError", "TrunkError"),
    "analysis.lookahead_study": ("foresight", "front", "survey"),
    "model.loads": ("Loads",),
    "problem.build": ("load_motion",),
    "problem.motion": ("Motion",),
    "analysis.multistart": ("optima",),
    "planning.planner": ("plan_from", "plan_motion"),
    "rod.point_shapes": ("PointShapes",),
    "problem.problem_file": ("problem_schema",),
    "planning.replanning": ("Replanner",),
    "reporting": ("Progress", "Reporter"),
    "rod.tip_jacobian": ("tip_jacobian",),
    "rod.shape_map": ("ShapeMap",),
    "planning.plan": ("Plan", "PlanError", "Status"),
    "rod.buckling": ("Stability", "stability"),
    "rod.shape": ("Shape",),
    "rod.statics": ("solve_statics",),
    "planning.options": ("Options",),
    "planning.storage": ("load_plan", "save_plan"),
    "nlp.window": ("Weights",),
}
_HOME = {name: home for home, names in _HOMES.items() for name in names}

__all__ = [
    "Checkpoint",
    "Diagnosis",
    "Finding",
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
    "SolverMissingError",
    "Stability",
    "StaticsError",
    "Status",
    "Trunk",
    "TrunkError",
    "Weights",
    "check_export",
    "compare",
    "explain",
    "export",
    "foresight",
    "front",
    "load_anatomy",
    "load_motion",
    "load_plan",
    "measure",
    "optima",
    "plan_from",
    "plan_motion",
    "problem_schema",
    "save_plan",
    "solve_statics",
    "stability",
    "survey",
    "tip_jacobian",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f".{_HOME[name]}", __name__), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})

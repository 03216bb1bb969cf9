"""Whole-motion planning for a muscular trunk: an active Kirchhoff rod in CasADi.

import trunk_ocp as to
plan = to.plan_motion(to.load_motion("pick-fruit"))
"""

from __future__ import annotations

import sys
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .anatomy import Trunk, load_anatomy
    from .checkpoint import Checkpoint
    from .codegen.formats import check_export, export
    from .comparison import compare, measure
    from .diagnosis import Diagnosis, Finding, explain
    from .errors import InputError, PlanError, SolverMissingError, StaticsError, TrunkError
    from .foresight import foresight, front, survey
    from .loads import Loads
    from .motion import Motion, load_motion
    from .optima import optima
    from .planner import Options, plan_from, plan_motion
    from .point_shapes import PointShapes
    from .problem_file import problem_schema
    from .replanning import Replanner
    from .reporting import Progress, Reporter
    from .sensitivity import tip_jacobian
    from .shape_map import ShapeMap
    from .solution import Plan, Status
    from .stability import Stability, stability
    from .statics import Shape, solve_statics
    from .storage import load_plan, save_plan
    from .transcription import Weights

# Where each public name is. They are imported when they are first asked for: all together take
# over a second, in which the command line could neither show its help nor answer Ctrl-C.
_HOMES = {
    "anatomy": ("Trunk", "load_anatomy"),
    "checkpoint": ("Checkpoint",),
    "codegen.formats": ("check_export", "export"),
    "comparison": ("compare", "measure"),
    "diagnosis": ("Diagnosis", "Finding", "explain"),
    "errors": ("InputError", "PlanError", "SolverMissingError", "StaticsError", "TrunkError"),
    "foresight": ("foresight", "front", "survey"),
    "loads": ("Loads",),
    "motion": ("Motion", "load_motion"),
    "optima": ("optima",),
    "planner": ("Options", "plan_from", "plan_motion"),
    "point_shapes": ("PointShapes",),
    "problem_file": ("problem_schema",),
    "replanning": ("Replanner",),
    "reporting": ("Progress", "Reporter"),
    "sensitivity": ("tip_jacobian",),
    "shape_map": ("ShapeMap",),
    "solution": ("Plan", "Status"),
    "stability": ("Stability", "stability"),
    "statics": ("Shape", "solve_statics"),
    "storage": ("load_plan", "save_plan"),
    "transcription": ("Weights",),
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


class _Package(ModuleType):
    """A package some of whose functions have the names of their modules."""

    def __setattr__(self, name: str, value: Any) -> None:
        # Importing `trunk_ocp.foresight` sets an attribute of that name to the module, which
        # would hide the function.
        if not (name in _HOME and isinstance(value, ModuleType)):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package

"""Whole-motion planning for a muscular trunk: an active Kirchhoff rod in CasADi.

import trunk_ocp as to
plan = to.plan_motion(to.load_motion("pick-fruit"))
"""

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

"""Whole-motion planning for a muscular trunk: an active Kirchhoff rod in CasADi.

    import trunk_ocp as to
    plan = to.plan_motion(to.load_motion("pick-fruit"))
"""

from .anatomy import Trunk, load_anatomy
from .errors import InputError, SolverMissingError, StaticsError, TrunkError
from .loads import Loads
from .motion import Motion, load_motion
from .planner import Options, plan_motion
from .solution import Plan, Status
from .statics import Shape, solve_statics
from .transcription import Weights

__all__ = [
    "InputError",
    "Loads",
    "Motion",
    "Options",
    "Plan",
    "Shape",
    "SolverMissingError",
    "StaticsError",
    "Status",
    "Trunk",
    "TrunkError",
    "Weights",
    "load_anatomy",
    "load_motion",
    "plan_motion",
    "solve_statics",
]

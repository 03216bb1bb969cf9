"""Which part of the muscles' work a motion determines, and which part is a choice.

Activation enters the shape of a segment through four numbers, made by 8 or 10 muscles. The freedom
that remains is computed exactly: ranges by linear programs, the best choices by convex programs.
"""

from .ablation import AblationResult, ablate_muscles, left_right_pairs, motion_without
from .activation_ranges import NARROW_RANGE, Freedom, feasible_ranges, muscle_freedom
from .alternatives import can_be_off, fewest_muscles, least_cost, least_effort, least_peak
from .report import Redundancy, analyze_redundancy

__all__ = [
    "NARROW_RANGE",
    "AblationResult",
    "Freedom",
    "Redundancy",
    "ablate_muscles",
    "analyze_redundancy",
    "can_be_off",
    "feasible_ranges",
    "fewest_muscles",
    "least_cost",
    "least_effort",
    "least_peak",
    "left_right_pairs",
    "motion_without",
    "muscle_freedom",
]

"""Which of the muscles' work a motion determines, and which is a choice.

Activation enters a segment's shape through four numbers, by 8 or 10 muscles. What is left is
found exactly: ranges by linear programs, the best of all choices by convex ones.
"""

from .needed import AblationResult, motion_without, needed, pairs
from .ranges import NARROW, Freedom, freedom, ranges
from .report import Redundancy, redundancy, report
from .variants import can_be_off, fewest_muscles, least_cost, least_effort, least_peak

__all__ = [
    "NARROW",
    "AblationResult",
    "Freedom",
    "Redundancy",
    "can_be_off",
    "fewest_muscles",
    "freedom",
    "least_cost",
    "least_effort",
    "least_peak",
    "motion_without",
    "needed",
    "pairs",
    "ranges",
    "redundancy",
    "report",
]

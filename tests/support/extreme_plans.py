"""Plans at the edges of what is drawn, cheap to make: tiny, of many phases, of many segments."""

from functools import cache
from itertools import pairwise

import numpy as np

from trunk_ocp.model.anatomy import AnatomySpec, SegmentSpec
from trunk_ocp.planning.planner import plan_motion
from trunk_ocp.problem.build import build_motion
from trunk_ocp.problem.problem_file import ProblemSpec

CASES = ("20 phases", "one phase", "no head", "99 segments")

UPPER = {
    "group": "upper",
    "architecture": "longitudinal",
    "radii_over_length": (0.03, 0.06),
    "sector": (0.0, 1.5),
}
LOWER = UPPER | {"group": "lower", "sector": (1.6, 3.1)}
OBLIQUE = LOWER | {"group": "oblique", "architecture": "helical", "helix_deg": 25.0}
HEAD = {
    "pivot_radius": 0.04,
    "xi_y_deg": 80.0,
    "body": (
        {"name": "skull", "shape": "sphere", "center": (-0.05, 0.0, -0.02), "radius": 0.05},
        {"name": "snout", "shape": "capsule", "from": (-0.04, 0.0, -0.01),
         "to": (0.0, 0.0, -0.01), "radius": 0.03},
    ),
}  # fmt: skip


def arm_spec(length, segments, muscles, head=None):
    """An anatomy of equal segments with these muscles."""
    edges = np.linspace(0.0, 1.0, segments + 1).tolist()
    parts = tuple(
        SegmentSpec.model_validate({"Z_over_length": pair, "muscles": muscles})
        for pair in pairwise(edges)
    )
    spec = {
        "name": "arm",
        "length": length,
        "base_radius_over_length": 0.06,
        "taper_deg": 1.5,
        "material": {"youngs_modulus": 2e5, "poisson_ratio": 0.5, "density": 1000.0},
        "segments": ({"Z_over_length": (0.0, 1.0), "muscles": muscles},),
    }
    spec = AnatomySpec.model_validate(spec if head is None else spec | {"head": head})
    return spec.model_copy(update={"segments": parts})  # unchecked: more than a file may have


def plan_of(anatomy, phases, title, head_deg=0.0, strongest=-2.0):
    """A plan of phases, each a target of the tip, step by step."""
    head = (-head_deg, head_deg)
    problem = {
        "name": "extreme",
        "title": title,
        "anatomy": "arm",
        "bounds": {
            "activation": (strongest, 0.0),
            "extension": (0.6, 1.3),
            "head_z_deg": head,
            "head_y_deg": head,
        },
        "tolerance": {"position": 0.02},
        "phases": tuple(phases),
    }
    motion = build_motion(ProblemSpec.model_validate(problem), anatomy)
    return plan_motion(motion, lookahead=1, throw=False)


def phase(name, length, duration=0.3, **target):
    """A phase of one step with a target of the tip."""
    return {"name": name, "duration": duration, "targets": ({"Z": length, **target},)}


def circle(count, length):
    """Phases of different durations whose targets are on a circle around the hanging tip."""
    names = ("reach", "grasp the small apple", "lift", "turn", "lower it to the table")
    for n, angle in enumerate(np.linspace(0, 2 * np.pi, count, endpoint=False).tolist()):
        place = (0.3 * np.cos(angle), 0.3 * np.sin(angle), 0.8)
        wanted = tuple((length * np.array(place)).tolist())
        yield phase(names[n % len(names)], length, 0.1 + 0.05 * (n % 4), position=wanted)


@cache
def extreme(case):
    """One of `CASES`."""
    muscles = (UPPER, OBLIQUE)
    if case == "20 phases":
        return plan_of(arm_spec(0.2, 2, muscles, HEAD), circle(20, 0.2), "A small arm", 20.0)
    if case == "one phase":
        wanted = {"d3": (0.5, 0.3, 0.8)}
        phases = [phase("point at it", 1.0, 1.0, **wanted)]
        arm = arm_spec(1.0, 3, muscles, None)
        return plan_of(arm, phases, "Directions only", 20.0, strongest=-1.0)  # ticks of 0.25
    if case == "no head":
        return plan_of(arm_spec(1.0, 1, (UPPER, LOWER)), circle(3, 1.0), "No head")
    return plan_of(arm_spec(2.0, 99, muscles), circle(2, 2.0), "99 segments")

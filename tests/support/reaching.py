"""One phase of the small arm of `scenes`, and bodies for it to avoid."""

from scenes import ARM

from trunk_ocp.problem.build import build_motion
from trunk_ocp.problem.problem_file import ProblemSpec

BALL = {"name": "ball", "shape": "sphere", "center": (0.25, 0.02, 0.55), "radius": 0.1}
BEYOND = {"Z": 1.0, "position": (0.55, 0.05, 0.45)}
"""A place that the arm's tip reaches through the ball, or around it."""


def reaching(targets, contact, obstacles=(), problem=None, **phase):
    """The motion; the trunk jumps to its time steps unless `phase` has another interpolation."""
    whole = {
        "name": "reach",
        "anatomy": "arm",
        "bounds": {
            "activation": (-3.0, 0.0),
            "extension": (0.5, 1.4),
            "head_z_deg": (-20.0, 20.0),
            "head_y_deg": (-20.0, 20.0),
        },
        "tolerance": {"position": 0.002},
        "obstacles": tuple(obstacles),
        "contact": contact,
        "phases": (
            {"name": "reach", "duration": 1.0, "interpolation": "none", "targets": tuple(targets)}
            | phase,
        ),
    }
    return build_motion(ProblemSpec.model_validate(whole | (problem or {})), ARM)

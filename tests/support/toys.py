"""The smallest trunk with a choice of when: a straight rod that only shortens, all by hand.

A straight, weightless rod without taper, clamped along +Z, has one longitudinal muscle on either
side. Contracted alike they shorten it: its tip is at (1 + C gamma) L e_Z. Targets ask for lengths,
so that planning a motion is a small quadratic program in one number gamma a step.
"""

import numpy as np

from trunk_ocp.model.activation import strain_matrix
from trunk_ocp.model.anatomy import AnatomySpec, build_trunk
from trunk_ocp.problem.build import build_motion
from trunk_ocp.problem.problem_file import ProblemSpec

SPEC = AnatomySpec.model_validate(
    {
        "name": "shortener",
        "length": 1.0,
        "base_radius_over_length": 0.05,
        "material": {"youngs_modulus": 1e6, "poisson_ratio": 0.5, "density": 0.0},
        "segments": (
            {
                "Z_over_length": (0.0, 1.0),
                "muscles": (
                    {
                        "group": "long",
                        "architecture": "longitudinal",
                        "radii_over_length": (0.02, 0.05),
                        "sector": (0.0, np.pi),
                    },
                ),
            },
        ),
    }
)
TRUNK = build_trunk(SPEC)
C = float(strain_matrix(TRUNK)[0, 0].sum())
"""Change of extension per unit of gamma, both muscles alike."""


def shortening(wanted, duration=1.0, most=None):
    """A motion whose targets ask for contractions `wanted`; `most` bounds a change of gamma.

    `duration` of a step in s, or one for each.
    """
    durations = np.broadcast_to(duration, len(wanted)).tolist()
    tips = [(0.0, 0.0, 1.0 + C * gamma) for gamma in wanted]
    bounds = {"activation": (-1.0, 0.0), "head_z_deg": (0.0, 0.0), "head_y_deg": (0.0, 0.0)}
    change = () if most is None else ({"activation": most},)
    return motion(tips, durations, bounds, change)


def pointing(tip, duration=1.0):
    """One step that takes the tip to a place, by the head alone: psi_Z within 4 rad, psi_Y pi/2."""
    turn = float(np.degrees(4.0))
    return motion([tip], [duration], {"activation": (0.0, 0.0), "head_z_deg": (-turn, turn)})


def motion(tips, durations, bounds, change=()):
    """A motion with a target for the tip at each step."""
    phases = [
        {
            "name": f"step {number}",
            "duration": duration,
            "targets": ({"Z": 1.0, "position": tip},),
            "change": change,
        }
        for number, (tip, duration) in enumerate(zip(tips, durations, strict=True), 1)
    ]
    problem = {
        "name": "shorten",
        "anatomy": "shortener",
        "gravity": 0.0,
        "bounds": {"extension": (0.1, 1.5), **bounds},
        "phases": tuple(phases),
    }
    return build_motion(ProblemSpec.model_validate(problem), SPEC)

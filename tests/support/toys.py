"""The smallest trunk with a choice of when: a straight rod that only shortens, all by hand.

A straight, weightless rod without taper, clamped along +Z, has one longitudinal muscle on either
side. Contracted alike they shorten it: its tip is at (1 + C gamma) L e_Z. Targets ask for lengths,
so that planning a motion is a small quadratic program in one number gamma a step.
"""

import numpy as np

from trunk_ocp.model.activation import strain_matrix
from trunk_ocp.model.anatomy import AnatomySpec, build_trunk
from trunk_ocp.model.loads import Loads
from trunk_ocp.problem.motion import Bounds, Motion, Phase, Step
from trunk_ocp.problem.problem_file import ProblemSpec
from trunk_ocp.problem.targets import Target

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
PROBLEM = ProblemSpec.model_validate(
    {
        "name": "shorten",
        "anatomy": "shortener",
        "gravity": 0.0,
        "bounds": {"activation": (-1.0, 0.0), "extension": (0.1, 1.5)},
        "phases": ({"name": "all", "duration": 1.0, "targets": ({"Z": 1.0, "d3": (0, 0, 1)},)},),
    }
)


def shortening(wanted, duration=1.0, most=np.inf):
    """A motion whose targets ask for contractions `wanted`; `most` bounds a change of gamma.

    `duration` of a step in s, or one for each.
    """
    durations = np.broadcast_to(duration, len(wanted))
    box = Bounds(np.array([-1.0, -1.0, 0.0, 0.0]), np.zeros(4))
    change = Bounds(
        np.array([-most, -most, -np.inf, -np.inf]), np.array([most, most, np.inf, np.inf])
    )
    steps = [
        step(float(time), float(span), (0.0, 0.0, 1.0 + C * gamma), box, change)
        for time, span, gamma in zip(np.cumsum(durations), durations, wanted, strict=True)
    ]
    return motion(steps)


def pointing(tip, duration=1.0):
    """One step that takes the tip to a place, by the head alone: psi_Z within 4 rad, psi_Y pi/2."""
    most = np.array([0.0, 0.0, 4.0, np.pi / 2])
    free = Bounds(np.full(4, -np.inf), np.full(4, np.inf))
    return motion([step(duration, duration, tip, Bounds(-most, most), free)])


def step(time, duration, tip, box, change):
    target = Target(1.0, tip, 1.0, (None, None, None), (0.0, 0.0, 0.0))
    return Step(time, duration, 0, (target,), Loads(0.0), None, box, change, None)


def motion(steps):
    phases = (Phase("all", steps[-1].time, "cosine"),)
    return Motion(PROBLEM, SPEC, TRUNK, phases, tuple(steps), (0.1, 1.5), steps[0].box)

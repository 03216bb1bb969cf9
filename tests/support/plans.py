"""Motions, plans and problem files that several test files share; plans are made once a worker."""

import math
from dataclasses import replace
from functools import cache

import numpy as np

from trunk_ocp.model.anatomy import AnatomySpec, build_trunk
from trunk_ocp.planning.planner import plan_motion
from trunk_ocp.problem.build import load_motion
from trunk_ocp.rod.statics import solve_statics

MOTIONS = ("pick-fruit", "lift-log", "lift-log-asymmetric")

# The smallest problem file: one phase, one target, well within reach.
TOUCH = """
name = "touch"

[bounds]
activation = [-3.0, 0.0]
extension = [0.67, 1.35]

[[phases]]
name = "reach"
duration = 1.0

[[phases.targets]]
Z = 1.75
position = [0.6, 0.1, 1.2]
"""

# Two phases of two steps each, without a gram of load that TOUCH does not have.
POINT = """
name = "point"

[bounds]
activation = [-3.0, 0.0]
extension = [0.67, 1.35]

[[phases]]
name = "reach"
duration = 1.0
steps = 2

[[phases.targets]]
Z = 1.75
position = [0.6, 0.1, 1.2]

[[phases]]
name = "rise"
duration = 0.5
steps = 2
interpolation = "hermite"

[[phases.targets]]
Z = 1.75
path = [[0.6, 0.1, 1.2], [0.7, 0.0, 1.1]]
"""


@cache
def shipped(name):
    """A shipped motion."""
    return load_motion(name)


@cache
def planned(name, mode):
    """A plan of a shipped motion; the horizon is started as by default, from the sequential."""
    if mode == "sequential":
        return plan_motion(shipped(name), lookahead=1)
    return plan_motion(shipped(name), start=planned(name, "sequential"))


@cache
def first_steps(name, count):
    """A shipped motion cut short, for speed."""
    spec, phases = shipped(name).spec, []
    for phase in spec.phases:
        if count > 0:
            phases.append(first_part(phase, min(count, phase.steps)))
        count -= phase.steps
    return shipped(name).with_spec(spec.model_copy(update={"phases": tuple(phases)}))


def first_part(phase, steps):
    """A phase with its first steps only; a path and a pull that grows end where they are then."""
    share = steps / phase.steps
    change = (entry for entry in phase.change if entry.steps is None or entry.steps[0] <= steps)
    change = tuple(
        entry
        if entry.steps is None
        else entry.model_copy(update={"steps": (entry.steps[0], min(entry.steps[1], steps))})
        for entry in change
    )
    update = {"steps": steps, "duration": phase.duration * share, "change": change}
    if phase.wrap is not None and phase.wrap.path is not None:
        path = np.array(phase.wrap.path)
        start = [path[0]]
        while len(path) > 1:  # de Casteljau: the first points of all layers
            path = (1 - share) * path[:-1] + share * path[1:]
            start.append(path[0])
        points = tuple(tuple(point.tolist()) for point in start)
        update["wrap"] = phase.wrap.model_copy(update={"path": points})
    if phase.loads.pull is not None and phase.loads.pull.ramp:
        pull = phase.loads.pull.model_copy(update={"force": phase.loads.pull.force * share})
        update["loads"] = phase.loads.model_copy(update={"pull": pull})
    return phase.model_copy(update=update)


def with_phases(motion, **update):
    """The motion with these sections in every phase."""
    phases = tuple(phase.model_copy(update=update) for phase in motion.spec.phases)
    return motion.with_spec(motion.spec.model_copy(update={"phases": phases}))


def written(folder, text, name="problem.toml"):
    """A problem file with this text; its path."""
    path = folder / name
    path.write_text(text)
    return path


def in_equilibrium(window, x):
    """Shapes of a window's steps under their loads, pulls included, on the window's mesh."""
    loads = [step.loads for step in window.steps]
    trunk = window.motion.trunk
    shapes = solve_statics(trunk, x[:, :-2], x[:, -2:], loads, window.mesh)
    loads = [
        replace(load, tip_force=tuple(np.add(load.tip_force, pull)))
        for load, pull in zip(loads, window.pulls(shapes), strict=True)
    ]
    return solve_statics(trunk, x[:, :-2], x[:, -2:], loads, window.mesh), loads


def soft_rod(name, segments=("[0.0, 1.0]",), radius="0.05"):
    """An anatomy file of 1 m and 1 MPa; muscles of the last segment may follow."""
    parts = "".join(f"\n[[segments]]\nZ_over_length = {edges}\n" for edges in segments)
    return f"""
name = "{name}"
length = 1.0
base_radius_over_length = {radius}

[material]
youngs_modulus = 1.0e6
poisson_ratio = 0.5
density = 1000.0
{parts}"""


def thin_tipped_spec(taper=0.038, length=0.5, density=1050.0):
    """A soft arm from 0.04 L to 0.002 L: from its base, errors grow 1e8 times under 5 g."""
    dorsal = {
        "group": "d",
        "architecture": "longitudinal",
        "radii_over_length": (0.02, 0.04),
        "sector": (0.0, 1.2),
    }
    return AnatomySpec.model_validate(
        {
            "name": "arm",
            "length": length,
            "base_radius_over_length": 0.04,
            "taper_deg": math.degrees(math.atan(taper)),
            "material": {"youngs_modulus": 1e5, "poisson_ratio": 0.5, "density": density},
            "segments": ({"Z_over_length": (0.0, 1.0), "muscles": (dorsal,)},),
        }
    )


def thin_tipped(taper=0.038, length=0.5, density=1050.0):
    """The trunk of `thin_tipped_spec`."""
    return build_trunk(thin_tipped_spec(taper, length, density))


ROD = (
    soft_rod("soft-arm")
    + """
muscles = [
  { group = "top", architecture = "longitudinal", radii_over_length = [0.02, 0.05], sector = [0.0, 1.5] },
  { group = "low", architecture = "longitudinal", radii_over_length = [0.02, 0.05], sector = [1.6, 3.1] },
]
"""  # noqa: E501  # TOML inline tables stand on one line
)

REACH = """
name = "reach"
anatomy = "arm.toml"

[bounds]
activation = [-2.0, 0.0]
extension = [0.5, 1.5]

[[phases]]
name = "bend"
duration = 1.0

[[phases.targets]]
Z = 1.0
"""


def arm_file(folder, target="position = [0.2, 0.1, 0.9]", anatomy=ROD):
    """A problem file beside its anatomy, of one step of a trunk with few muscles; its path."""
    written(folder, anatomy, "arm.toml")
    return written(folder, REACH + target)


def arm(folder, target="position = [0.2, 0.1, 0.9]", anatomy=ROD):
    """The motion of `arm_file`."""
    return load_motion(arm_file(folder, target, anatomy))

"""Random scenes: a small arm, a few bodies in its way, and places that it has to reach."""

import numpy as np
from dense_contact import distance

from trunk_ocp.model.anatomy import AnatomySpec, build_trunk
from trunk_ocp.model.loads import Loads
from trunk_ocp.model.solid_specs import ObstacleSpec
from trunk_ocp.model.solids import built_solid
from trunk_ocp.problem.build import build_motion
from trunk_ocp.problem.problem_file import ProblemSpec
from trunk_ocp.rod.statics import solve_statics

RING = {"architecture": "longitudinal", "radii_over_length": (0.03, 0.05)}
MUSCLES = (
    RING | {"group": "dorsal", "sector": (0.0, np.pi / 2)},
    RING | {"group": "ventral", "sector": (np.pi / 2, np.pi)},
)
ARM = AnatomySpec.model_validate(
    {
        "name": "arm",
        "length": 1.0,
        "base_radius_over_length": 0.06,
        "taper_deg": 1.5,
        "material": {"youngs_modulus": 2e5, "poisson_ratio": 0.5, "density": 1000.0},
        "head": {"pivot_radius": 0.25, "xi_y_deg": 80.0},
        "segments": (
            {"Z_over_length": (0.0, 0.5), "muscles": MUSCLES},
            {"Z_over_length": (0.5, 1.0), "muscles": MUSCLES},
        ),
    }
)
TRUNK = build_trunk(ARM)
SHAPES = ("sphere", "capsule", "half-space", "box", "ellipsoid")


def vector(x):
    return tuple(np.asarray(x, dtype=float).tolist())


def direction(rng):
    n = rng.normal(size=3)
    return n / np.linalg.norm(n)


def body(shape, near, rng):
    """A body of a shape whose surface is not far from a point."""
    size = rng.uniform(0.03, 0.2)
    center = near + direction(rng) * (size + rng.uniform(-0.05, 0.08))
    match shape:
        case "sphere":
            keys = {"center": vector(center), "radius": size}
        case "capsule":
            half = direction(rng) * rng.uniform(0.05, 0.5)
            keys = {"from": vector(center - half), "to": vector(center + half), "radius": size}
        case "half-space":
            normal = direction(rng)
            point = near - normal * rng.uniform(0.0, 0.1)
            keys = {"point": vector(point), "normal": vector(normal)}
        case _:
            name = "half_sizes" if shape == "box" else "half_axes"
            sizes = size * rng.uniform(0.4, 1.6, 3)
            keys = {"center": vector(center), name: vector(sizes)}
            keys["rotation_deg"] = vector(rng.uniform(-90, 90, 3))
    return {"shape": shape} | keys


def shapes_of(count, rng):
    """Random shapes (count,) of the arm, and the activations and head angles that make them."""
    x = rng.uniform(-0.6, 0.0, (count, len(TRUNK.muscles)))
    head = rng.uniform(-0.3, 0.3, (count, 2))
    return solve_statics(TRUNK, x, head, Loads(9.8))


def scene(number):
    """A motion of 1 to 4 steps with 1 to 3 bodies in space or moving with the head, seeded."""
    rng = np.random.default_rng(1000 + number)
    phases = int(rng.integers(1, 3))
    steps = rng.integers(1, 3, phases).tolist()
    Z = np.linspace(0, 1, 11)
    rest = solve_statics(TRUNK, np.zeros((1, 8)), np.zeros((1, 2)), Loads(9.8))
    places = np.concatenate([rest.position(Z), shapes_of(phases, rng).position(Z)])
    obstacles = []
    tries = 0
    while len(obstacles) < 1 + number % 3:
        point, share = rng.integers(4, 11), rng.uniform(0, 1)
        before, after = places[(n := rng.integers(phases)) : n + 2, point]
        near = (1 - share) * before + share * after
        one = body(SHAPES[(number + len(obstacles)) % len(SHAPES)], near, rng)
        one["name"] = f"body {len(obstacles) + 1}"
        one["frame"] = "head" if rng.random() < 0.25 else "space"
        one["clearance"] = float(rng.choice([0.0, 0.01]))
        solid = built_solid(ObstacleSpec.model_validate(one), "obstacles", one["frame"])
        tries += 1
        if distance(solid, places[0]).min() < 0.075 and rng.random() < 0.995 and tries < 300:
            continue  # few scenes start in a body
        if distance(solid, places[1:, -1]).min() < 0.06 and rng.random() < 0.9 and tries < 300:
            continue  # and not too many have a target in one
        obstacles.append(one)
    problem = {
        "name": f"scene-{number}",
        "anatomy": "arm",
        "bounds": {
            "activation": (-2.0, 0.0),
            "extension": (0.6, 1.3),
            "head_z_deg": (-30.0, 30.0),
            "head_y_deg": (-30.0, 30.0),
        },
        "tolerance": {"position": 0.002},
        "obstacles": tuple(obstacles),
        "contact": {"obstacles": True, "self": True},
        "phases": tuple(
            {
                "name": f"phase {n + 1}",
                "duration": 1.0,
                "steps": steps[n],
                "interpolation": str(rng.choice(["cosine", "hermite"])),
                "targets": ({"Z": 1.0, "position": vector(places[n + 1, -1])},),
            }
            for n in range(phases)
        ),
    }
    return build_motion(ProblemSpec.model_validate(problem), ARM)

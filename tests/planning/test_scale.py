"""A scale model of a trunk, with gravity to match, makes the same motion with the same muscles."""

import numpy as np
import pytest

from trunk_ocp.model.anatomy import AnatomySpec
from trunk_ocp.planning.planner import plan_motion
from trunk_ocp.problem.build import build_motion, load_motion
from trunk_ocp.problem.motion import Motion
from trunk_ocp.problem.problem_file import ProblemSpec

pytestmark = pytest.mark.slow

# Powers of the length with which quantities scale: Young's modulus and density stay, so gravity
# is 1 / length, forces are length^2 (E times an area), couples and masses length^3.
POWERS = {
    "gravity": -1, "Z": 1, "position": 1, "path": 1, "center": 1, "log_radius": 1, "radius": 1,
    "length": 1, "offset": 1, "contact_from": 1, "tip_force": 2, "contact_force": 2, "force": 2,
    "contact_couple": 3, "tip_mass": 3, "pivot_radius": 1, "half_axes": 1, "half_sizes": 1,
    "from": 1, "to": 1, "point": 1, "clearance": 1,
}  # fmt: skip


def scaled(value, size, key=None):
    """A file's content for a trunk `size` times as long."""
    if isinstance(value, dict):
        return {name: scaled(entry, size, name) for name, entry in value.items()}
    if isinstance(value, list):
        return [scaled(entry, size, key) for entry in value]
    number = isinstance(value, int | float) and not isinstance(value, bool)
    return value * size ** POWERS[key] if number and key in POWERS else value


def model(name: str, size: float) -> Motion:
    """A shipped motion of a trunk `size` times as long, with default tolerances."""
    motion = load_motion(name)
    problem = scaled(motion.spec.model_dump(mode="json"), size)
    problem["tolerance"]["position"] = None
    anatomy = scaled(motion.anatomy.model_dump(mode="json"), size)
    return build_motion(
        ProblemSpec.model_validate(problem, strict=False),
        AnatomySpec.model_validate(anatomy, strict=False),
    )


@pytest.mark.parametrize("size", [0.01, 30.0])
@pytest.mark.parametrize("name", ["lift-log-asymmetric", "pick-fruit"])
def test_same_plan_at_every_scale(name, size):
    full, small = (plan_motion(model(name, s)) for s in (1.0, size))
    assert small.objective.total == pytest.approx(full.objective.total, rel=1e-6)
    Z = np.linspace(0, full.motion.trunk.length, 8)
    moved = small.shape.position(size * Z) / size - full.shape.position(Z)
    assert np.abs(moved).max() <= 1e-4 * full.motion.trunk.length  # points that no target holds
    # Activations that only effort tells apart: Ipopt stops where its slope, 2e-5 gamma, is 1e-8.
    np.testing.assert_allclose(small.x, full.x, rtol=0, atol=1e-3)


def test_default_tolerance_is_that_of_the_elephant_in_proportion():
    assert model("pick-fruit", 1.0).tolerance[0] == pytest.approx(0.02, rel=1e-12)
    assert model("pick-fruit", 0.01).tolerance[0] == pytest.approx(0.0002, rel=1e-12)

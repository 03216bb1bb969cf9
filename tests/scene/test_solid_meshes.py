"""Surfaces of solids that pictures show: on the solid, closed, outward, and as large as it is."""

import numpy as np
import pytest
from plans import TOUCH, written
from scipy.spatial.transform import Rotation

from trunk_ocp.model.solids import Solid, from_head_frame, signed_distance
from trunk_ocp.planning.planner import plan_motion
from trunk_ocp.problem.build import load_motion
from trunk_ocp.scene.solid_meshes import head_and_obstacles, placed, solid_surface

VOLUMES = {
    "sphere": ((0.3,), 4 / 3 * np.pi * 0.3**3),
    "capsule": ((0.1, 0.5), np.pi * 0.1**2 * 1.0 + 4 / 3 * np.pi * 0.1**3),
    "cylinder": ((0.1, 0.5), np.pi * 0.1**2 * 1.0),
    "box": ((0.1, 0.2, 0.3), 8 * 0.1 * 0.2 * 0.3),
    "ellipsoid": ((0.1, 0.2, 0.3), 4 / 3 * np.pi * 0.1 * 0.2 * 0.3),
}
AXES = tuple(map(tuple, Rotation.random(random_state=5).as_matrix()))


def solid(shape, sizes, frame="space"):
    return Solid("it", "obstacles", shape, (0.5, -0.2, 0.8), AXES, sizes, frame)


@pytest.mark.parametrize("shape", VOLUMES)
def test_a_surface_is_that_of_its_solid(shape):
    sizes, volume = VOLUMES[shape]
    surface = solid_surface(solid(shape, sizes), 1.75)
    distance, _ = signed_distance(solid(shape, sizes), surface.points)
    np.testing.assert_allclose(distance, 0, rtol=0, atol=1e-12)
    assert surface.body.volume[0] == pytest.approx(volume, rel=0.03)
    a, b, c, d = np.moveaxis(surface.points[surface.facets], 1, 0)
    middle = (a + b + c + d) / 4
    outward = signed_distance(solid(shape, sizes), middle)[1]
    assert np.all((np.cross(c - a, d - b) * outward).sum(-1) > 0)


def test_a_half_space_is_a_square_below_the_base():
    ground = solid("half-space", ())
    points = solid_surface(ground, 1.75).points
    np.testing.assert_allclose(signed_distance(ground, points)[0], 0, rtol=0, atol=1e-12)
    depth = signed_distance(ground, np.zeros(3))[0]
    np.testing.assert_allclose(points.mean(0), -depth * np.array(AXES[2]), atol=1e-12)
    assert np.ptp(points @ np.array(AXES[0])) == pytest.approx(1.6 * 1.75)


def test_what_is_fixed_to_the_head_turns_with_it(trunk):
    head = np.array([0.2, -0.3])
    sizes, _ = VOLUMES["box"]
    still = solid_surface(solid("box", sizes), trunk.length).points
    space, turned = (placed(trunk, solid("box", sizes, f), head).points for f in ("space", "head"))
    np.testing.assert_array_equal(space, still)
    np.testing.assert_array_equal(turned, from_head_frame(trunk, still, head))


def test_obstacles_are_there_in_their_phases(tmp_path):
    text = (
        TOUCH
        + """
[[phases]]
name = "again"
duration = 1.0
[[phases.targets]]
Z = 1.75
position = [0.6, 0.1, 1.2]
[[obstacles]]
name = "ball"
shape = "sphere"
center = [2.0, 0.0, 0.0]
radius = 0.1
phases = ["again"]
"""
    )
    plan = plan_motion(load_motion(written(tmp_path, text)))

    def names(time, after=False):
        return {solid.name for solid, _ in head_and_obstacles(plan, time, np.zeros(2), after)}

    parts = {part.name for part in plan.motion.trunk.head.body}
    assert names(0.0) == names(1.0) == parts
    assert names(1.0, after=True) == names(1.5) == {*parts, "ball"}

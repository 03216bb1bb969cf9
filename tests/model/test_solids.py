"""The distance from a solid against its surface, point by point, and against what defines it."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from trunk_ocp.errors import InputError
from trunk_ocp.model.anatomy import load_anatomy
from trunk_ocp.model.head import base_pose
from trunk_ocp.model.solid_specs import SolidSpec
from trunk_ocp.model.solids import (
    Solid,
    built_solid,
    from_head_frame,
    in_head_frame,
    signed_distance,
)
from trunk_ocp.problem.mirror import mirror_order
from trunk_ocp.problem.step_solids import head_solids
from trunk_ocp.rod.statics import solve_statics

SIZES = {"sphere": 1, "capsule": 2, "cylinder": 2, "half-space": 0, "box": 3, "ellipsoid": 3}
SHAPES = list(SIZES)


def random_solids(shape, count=6):
    """Solids of a shape, some of them a hundred times as long as thin, anywhere in space."""
    rng = np.random.default_rng(SHAPES.index(shape))
    for number in range(count):
        sizes = rng.uniform(0.05, 0.5, SIZES[shape])
        if number % 2 and sizes.size:
            sizes[rng.integers(sizes.size)] *= 0.02
        axes = Rotation.random(random_state=number).as_matrix()
        yield Solid(
            "it", "obstacles", shape, tuple(rng.uniform(-1, 1, 3)),
            tuple(map(tuple, axes)), tuple(sizes),
        )  # fmt: skip


def points_around(solid, count=30):
    """Points within and around a solid, some of them deep inside, some far away."""
    rng = np.random.default_rng(7)
    reach = max(solid.sizes, default=1.0)
    spread = np.array([0.05, 0.5, 3.0])[rng.integers(0, 3, count)] * reach
    return np.array(solid.center) + spread[:, None] * rng.normal(size=(count, 3))


def contains(solid, points):
    """The table of the module, word by word, in coordinates along the solid's own axes."""
    x, y, z = np.moveaxis((points - np.array(solid.center)) @ np.array(solid.axes).T, -1, 0)
    a, h = (*solid.sizes, 0, 0)[:2]
    return {
        "sphere": lambda: x**2 + y**2 + z**2 <= a**2,
        "capsule": lambda: x**2 + y**2 + (z - np.clip(z, -h, h)) ** 2 <= a**2,
        "cylinder": lambda: (x**2 + y**2 <= a**2) & (np.abs(z) <= h),
        "half-space": lambda: z <= 0,
        "box": lambda: np.all(np.abs([x, y, z]).T <= solid.sizes, axis=-1),
        "ellipsoid": lambda: sum((np.array([x, y, z]).T / solid.sizes).T ** 2) <= 1,
    }[solid.shape]()


# --- surfaces by two parameters each -----------------------------------------------------------


# None has a pole, at which all values of one parameter mean the same point.


def face(sizes, axis, sign, u, v):
    point = np.empty((*u.shape, 3))
    point[..., axis] = sign * sizes[axis]
    point[..., (axis + 1) % 3] = u * sizes[(axis + 1) % 3]
    point[..., (axis + 2) % 3] = v * sizes[(axis + 2) % 3]
    return point


def bulge(sizes, axis, sign, u, v):
    """A sixth of an ellipsoid."""
    part = face((1, 1, 1), axis, sign, u, v)
    return part / np.linalg.norm(part, axis=-1, keepdims=True) * sizes


def wall(radius, half, u, v):
    return np.stack([radius * np.cos(np.pi * v), radius * np.sin(np.pi * v), half * u], -1)


def lid(radius, z, u, v):
    return np.stack(
        [radius * u * np.sqrt(1 - v**2 / 2), radius * v * np.sqrt(1 - u**2 / 2), z + 0 * u], -1
    )


def cap(radius, z, u, v):
    points = lid(radius, z, u, v)
    height = np.sqrt(np.maximum(radius**2 - (points[..., :2] ** 2).sum(-1), 0))
    return points + np.sign(z) * height[..., None] * [0, 0, 1]


def patches(solid):
    """Maps of [-1, 1]^2 onto parts of the surface, in the solid's own axes."""
    sides = [(axis, sign) for axis in range(3) for sign in (-1, 1)]
    if solid.shape == "half-space":
        return [partial(face, (20, 20, 0), 2, 1)]
    if solid.shape == "box":
        return [partial(face, solid.sizes, *side) for side in sides]
    if solid.shape in ("sphere", "ellipsoid"):
        return [partial(bulge, solid.sizes, *side) for side in sides]
    radius, half = solid.sizes
    end = {"cylinder": lid, "capsule": cap}[solid.shape]
    return [partial(wall, radius, half), *(partial(end, radius, z) for z in (-half, half))]


def brute_force(solid, point):
    """Distance of a point from the nearest point of the surface, on ever finer grids."""
    local = np.array(solid.axes) @ (point - np.array(solid.center))
    nearest = []
    for patch in patches(solid):
        middle, half, count = np.zeros(2), 1.0, 161
        while half > 1e-10:
            axes = (np.clip(m + np.linspace(-half, half, count), -1, 1) for m in middle)
            u, v = np.meshgrid(*axes, indexing="ij")
            away = np.linalg.norm(patch(u, v) - local, axis=-1)
            best = np.unravel_index(np.argmin(away), away.shape)
            middle, half, count = np.array([u[best], v[best]]), half / 2, 25
        nearest.append(away.min())
    return min(nearest)


@pytest.mark.parametrize("shape", SHAPES)
def test_the_distance_is_that_of_the_nearest_point_of_the_surface(shape):
    for solid in random_solids(shape, 4):
        points = points_around(solid, 12)
        distance, _ = signed_distance(solid, points)
        np.testing.assert_array_equal(distance <= 0, contains(solid, points))
        nearest = [brute_force(solid, point) for point in points]
        np.testing.assert_allclose(np.abs(distance), nearest, rtol=0, atol=1e-9)


@pytest.mark.parametrize("shape", SHAPES)
def test_the_gradient_is_the_slope_of_the_distance_and_a_unit_vector(shape):
    step = 1e-7
    for solid in random_solids(shape):
        points = points_around(solid)
        distance, normal = signed_distance(solid, points)
        np.testing.assert_allclose(np.linalg.norm(normal, axis=-1), 1, rtol=0, atol=1e-12)
        ahead, behind = (
            np.stack([signed_distance(solid, points + s * step * e)[0] for e in np.eye(3)], -1)
            for s in (1, -1)
        )
        # Where the nearest point of the surface jumps, the distance has a kink and no slope.
        smooth = np.abs(ahead + behind - 2 * distance[:, None]).max(-1) < 1e-11
        assert smooth.mean() > 0.5
        slope = (ahead - behind) / (2 * step)
        np.testing.assert_allclose(normal[smooth], slope[smooth], rtol=0, atol=1e-7)


@pytest.mark.parametrize("shape", SHAPES)
def test_the_surface_is_where_the_gradient_leads(shape):
    for solid in random_solids(shape):
        points = points_around(solid)
        distance, normal = signed_distance(solid, points)
        on_surface = signed_distance(solid, points - distance[:, None] * normal)[0]
        np.testing.assert_allclose(on_surface, 0, rtol=0, atol=1e-12)


@pytest.mark.parametrize("shape", SHAPES)
def test_the_distance_is_convex(shape):
    for solid in random_solids(shape):
        points = points_around(solid, 40)
        distance, normal = signed_distance(solid, points)
        there, here = np.meshgrid(np.arange(40), np.arange(40))
        moved = points[there] - points[here]
        bound = distance[here] + (normal[here] * moved).sum(-1)
        assert np.all(distance[there] >= bound - 1e-12)


@pytest.mark.parametrize("shape", SHAPES)
def test_the_center_and_points_on_axes_have_a_distance_and_a_normal(shape):
    for solid in random_solids(shape):
        points = np.array([solid.center, *(np.array(solid.center) + np.array(solid.axes))])
        distance, normal = signed_distance(solid, points)
        deepest = {"half-space": 0.0, "capsule": solid.sizes[:1]}.get(shape, solid.sizes)
        np.testing.assert_allclose(distance[0], -np.min(deepest), rtol=0, atol=1e-9)
        np.testing.assert_allclose(np.linalg.norm(normal, axis=-1), 1, rtol=0, atol=1e-12)


# --- solids of files ---------------------------------------------------------------------------


def solid_of(**keys):
    return built_solid(SolidSpec.model_validate({"name": "it", **keys}), "obstacles", "space")


def test_a_capsule_ends_where_the_file_says():
    ends = np.array([[0.6, 0.2, 1.7], [0.4, -0.3, -0.5]])
    keys = {"from": tuple(ends[0]), "to": tuple(ends[1])}
    capsule = solid_of(shape="capsule", radius=0.06, **keys)
    axis = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
    beyond = np.array([ends[0] - 0.1 * axis, ends[1] + 0.1 * axis, ends.mean(0)])
    np.testing.assert_allclose(signed_distance(capsule, beyond)[0], [0.04, 0.04, -0.06], atol=1e-12)


def test_a_half_space_is_behind_its_normal():
    ground = solid_of(shape="half-space", point=(0.0, 0.0, 2.0), normal=(0.0, 0.0, -5.0))
    distance, normal = signed_distance(ground, np.array([[3.0, 4.0, 1.5], [0.0, 0.0, 2.5]]))
    np.testing.assert_allclose(distance, [0.5, -0.5], atol=1e-15)
    np.testing.assert_allclose(normal, [[0, 0, -1]] * 2, atol=1e-15)


@pytest.mark.parametrize("shape", ["box", "ellipsoid"])
def test_rotations_are_about_x_then_y_then_z_of_space(shape):
    angles = (20.0, -35.0, 50.0)
    sizes = {"box": "half_sizes", "ellipsoid": "half_axes"}[shape]
    keys = {sizes: (0.1, 0.2, 0.3), "center": (1.0, 2.0, 3.0), "rotation_deg": angles}
    solid = solid_of(shape=shape, **keys)
    turn = Rotation.from_euler("xyz", angles, degrees=True)  # lower case: about fixed axes
    tips = np.array(keys["center"]) + turn.apply(np.diag((0.1, 0.2, 0.3)))
    np.testing.assert_allclose(signed_distance(solid, tips)[0], 0, atol=1e-12)
    np.testing.assert_allclose(solid.axes, turn.as_matrix().T, atol=1e-15)


@pytest.mark.parametrize("normal", np.random.default_rng(1).normal(size=(5, 3)).tolist())
def test_axes_of_solids_are_right_handed(normal):
    axes = np.array(solid_of(shape="half-space", point=(0.0,) * 3, normal=tuple(normal)).axes)
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(axes) == pytest.approx(1, abs=1e-14)


# --- the head's frame --------------------------------------------------------------------------


def test_the_base_of_the_trunk_moves_with_the_head():
    trunk = load_anatomy("asian-elephant")
    for angles in np.random.default_rng(0).uniform(-1, 1, (5, 2)):
        base, _ = base_pose(trunk.head, *angles)
        moved = from_head_frame(trunk, np.zeros((1, 3)), angles)[0]
        np.testing.assert_allclose(moved, base, atol=1e-15)
        points = np.random.default_rng(1).normal(size=(7, 3))
        back = in_head_frame(trunk, from_head_frame(trunk, points, angles), angles)
        np.testing.assert_allclose(back, points, atol=1e-14)


# --- the elephant's head -----------------------------------------------------------------------


def gap(trunk, solid, shape, head):
    """Smallest distance of the surface of a trunk from a solid that it must keep clear of."""
    Z = np.linspace(0, trunk.length, 200)
    Z = Z[(Z >= solid.Z[0]) & (Z <= solid.Z[1])]
    points = in_head_frame(trunk, shape.position(Z), np.array(head))
    radius = trunk.radius(Z) * 1.1  # contracted, it is thicker
    return (signed_distance(solid, points)[0] - radius).min()


def test_the_passive_trunk_hangs_clear_of_the_head():
    trunk = load_anatomy("asian-elephant")
    shape = solve_statics(trunk, np.zeros(len(trunk.muscles)))
    solids = head_solids(trunk)
    assert len(solids) >= 5
    assert min(gap(trunk, solid, shape, (0, 0)) for solid in solids) > 0.05


def test_the_mouth_is_on_the_surface_of_the_head_and_opens_outward():
    trunk = load_anatomy("asian-elephant")
    mouth = np.array(trunk.head.mouth[0])
    direction = np.array(trunk.head.mouth[1])
    distances = [signed_distance(solid, mouth) for solid in head_solids(trunk)]
    nearest, normal = min(distances, key=lambda pair: pair[0])
    assert nearest == pytest.approx(0, abs=1e-9)
    np.testing.assert_allclose(normal, direction, atol=1e-9)


def test_the_tip_reaches_the_mouth_between_the_jaws():
    trunk = load_anatomy("asian-elephant")
    mouth, outward = (np.array(v) for v in trunk.head.mouth)
    axis = mouth + np.linspace(0, 0.3, 50)[:, None] * outward / np.linalg.norm(outward)
    for solid in head_solids(trunk):
        distance, _ = signed_distance(solid, axis)
        if solid.name == "upper jaw":  # the mouth is on its surface
            assert solid.Z[1] < trunk.length - 1.1 * trunk.radius(trunk.length)
        else:
            assert distance.min() > 1.1 * trunk.radius(trunk.length)


def test_the_head_is_its_own_mirror_image():
    trunk = load_anatomy("asian-elephant")
    assert sorted(mirror_order(trunk)) == list(range(len(trunk.muscles)))
    one_eared = replace(trunk.head, body=trunk.head.body[:-1])
    with pytest.raises(InputError, match="not its own mirror image"):
        mirror_order(replace(trunk, head=one_eared))

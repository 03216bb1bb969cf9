"""Gaps of discs against the distances of their surface points, found by brute force."""

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from trunk_ocp.contact.tube import Tube, apart, creases, pair_gaps, seen_by, solid_gaps, tube
from trunk_ocp.model.anatomy import load_anatomy
from trunk_ocp.model.loads import Loads
from trunk_ocp.model.solids import Solid, pivot, signed_distance
from trunk_ocp.rod.statics import solve_statics
from trust.validation.rods import contractions

SIZES = {"sphere": 1, "capsule": 2, "cylinder": 2, "half-space": 0, "box": 3, "ellipsoid": 3}


def random_solid(shape, rng):
    axes = tuple(map(tuple, Rotation.random(random_state=rng.integers(10**6)).as_matrix()))
    sizes = tuple(rng.uniform(0.05, 0.4, SIZES[shape]))
    return Solid("it", "obstacles", shape, tuple(rng.uniform(-0.3, 0.3, 3)), axes, sizes)


def random_discs(count, rng, spread=0.8):
    tangent = rng.normal(size=(1, count, 3))
    tangent /= np.linalg.norm(tangent, axis=-1, keepdims=True)
    center = spread * rng.uniform(-1, 1, (1, count, 3))
    return Tube(np.arange(count) * 1.0, center, tangent, rng.uniform(0.01, 0.2, (1, count)))


def in_disc(discs, i, u):
    """Points (..., 3) of disc i for u (..., 2), of which those within the unit circle fill it."""
    frame = np.linalg.svd(discs.tangent[0, i][None])[2][1:]  # two directions across the tangent
    length = np.linalg.norm(u, axis=-1, keepdims=True)
    return discs.center[0, i] + discs.radius[0, i] * (u / np.maximum(length, 1)) @ frame


GRID = np.stack(np.meshgrid(*2 * [np.linspace(-1, 1, 21)]), axis=-1).reshape(-1, 2)


def distance_of_disc(discs, i, solid):
    """Least signed distance of the points of a disc: the best of a grid, then a descent.

    A disc and the signed distance are convex, so that a descent leads to the least of all.
    """
    values = signed_distance(solid, in_disc(discs, i, GRID))[0]
    start = GRID[np.argmin(values)]
    start = start / max(1.0, np.linalg.norm(start))
    best = float(values.min())
    for size in (0.1, 1e-3):
        simplex = start + size * np.array([[0, 0], [1, 0], [0, 1]])
        found = minimize(
            lambda u: float(signed_distance(solid, in_disc(discs, i, u))[0]), start,
            method="Nelder-Mead",
            options={"initial_simplex": simplex, "xatol": 1e-11, "fatol": 1e-13, "maxiter": 400},
        )  # fmt: skip
        start, best = found.x, min(best, float(found.fun))
    angles = np.linspace(0, 2 * np.pi, 2000)
    rim = in_disc(discs, i, np.stack([np.cos(angles), np.sin(angles)], axis=-1))
    return min(best, float(signed_distance(solid, rim)[0].min()))


@pytest.mark.parametrize("shape", list(SIZES))
def test_a_gap_is_at_most_the_distance_of_the_disc(shape):
    rng = np.random.default_rng(list(SIZES).index(shape))
    close = 0
    for _ in range(4):
        solid, discs = random_solid(shape, rng), random_discs(6, rng)
        gaps = solid_gaps(discs, solid)[0]
        for i, gap in enumerate(gaps):
            least = distance_of_disc(discs, i, solid)
            assert gap <= least + 1e-9
            if shape == "half-space":
                assert gap == pytest.approx(least, abs=1e-9)
            close += gap > least - 0.02
    assert close > 3  # and it is no trifle below


@pytest.mark.parametrize("shape", list(SIZES))
def test_a_gap_is_the_distance_where_the_nearest_normal_is_across_the_trunk(shape):
    rng = np.random.default_rng(40 + list(SIZES).index(shape))
    for _ in range(6):
        solid, discs = random_solid(shape, rng), random_discs(1, rng)
        while (found := signed_distance(solid, discs.center))[0].item() < discs.radius.item():
            discs = random_discs(1, rng)
        normal = found[1][0, 0]
        tangent = np.cross(normal, rng.normal(size=3))
        discs = Tube(
            discs.Z, discs.center, tangent[None, None] / np.linalg.norm(tangent), discs.radius
        )
        least = distance_of_disc(discs, 0, solid)
        assert solid_gaps(discs, solid).item() == pytest.approx(least, abs=1e-9)


def distance_of_discs(discs, i, j):
    """Least distance between the points of two discs that do not meet (convex)."""
    rims = [in_disc(discs, k, GRID) for k in (i, j)]
    between = np.linalg.norm(rims[0][:, None] - rims[1][None], axis=-1)
    a, b = np.unravel_index(np.argmin(between), between.shape)

    def squared(u):
        return np.sum((in_disc(discs, i, u[:2]) - in_disc(discs, j, u[2:])) ** 2)

    start = np.concatenate([GRID[a], GRID[b]])
    found = minimize(squared, start, method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 1e-14})
    return min(float(between.min()), float(np.sqrt(found.fun)))


def test_a_gap_between_discs_is_at_most_their_distance():
    rng = np.random.default_rng(11)
    discs = random_discs(8, rng)
    discs = Tube(10 * discs.Z, discs.center, discs.tangent, discs.radius)
    pairs = np.stack(np.triu_indices(8, 1), axis=-1)
    gaps = pair_gaps(discs, pairs)[0]
    assert np.all(np.isfinite(gaps[apart(discs, pairs)[0]]))
    checked = 0
    for (i, j), gap in zip(pairs, gaps, strict=True):
        if np.isfinite(gap):
            assert gap <= distance_of_discs(discs, i, j) + 1e-9
            checked += gap > 0
    assert checked > 10


def test_a_gap_between_parallel_discs_side_by_side_is_their_distance():
    rng = np.random.default_rng(12)
    for _ in range(5):
        axis, across = np.linalg.qr(rng.normal(size=(3, 2)))[0].T
        center = np.stack([np.zeros(3), rng.uniform(0.6, 1.0) * across])[None]
        discs = Tube(
            np.arange(2.0), center, np.tile(axis, (1, 2, 1)), rng.uniform(0.05, 0.15, (1, 2))
        )
        gap = pair_gaps(discs, np.array([[0, 1]])).item()
        assert gap == pytest.approx(distance_of_discs(discs, 0, 1), abs=1e-7)
        assert gap == pytest.approx(np.linalg.norm(center[0, 1]) - discs.radius.sum(), abs=1e-12)


def bent(radius, bend, angle=1.5 * np.pi, count=400):
    """A tube along an arc of a circle of radius `bend`."""
    phi = np.linspace(0, angle, count)
    center = bend * np.stack([np.cos(phi), np.sin(phi), 0 * phi], axis=-1)[None]
    tangent = np.stack([-np.sin(phi), np.cos(phi), 0 * phi], axis=-1)[None]
    return Tube(phi * bend, center, tangent, np.full((1, count), radius))


def test_a_bend_that_is_wider_than_the_trunk_does_not_touch_itself():
    discs = bent(0.1, 0.101, angle=0.8 * np.pi)
    pairs = np.stack(np.triu_indices(400, 1), axis=-1)
    assert pair_gaps(discs, pairs).min() >= 0
    assert creases(discs).max() < 1


@pytest.mark.parametrize("radius", [0.3, 0.05])
def test_creases_are_bends_sharper_than_the_radius(radius):
    np.testing.assert_allclose(creases(bent(radius, 0.2)), radius / 0.2, rtol=1e-4)


def test_the_tube_of_a_shape_has_the_volume_of_the_trunk_and_turns_with_the_head():
    trunk = load_anatomy("asian-elephant")
    head = np.array([[0.3, -0.2], [0.0, 0.4]])
    shape = solve_statics(trunk, contractions(trunk, 2, seed=1), head, Loads())
    Z = np.linspace(0, trunk.length, 4001)
    discs = tube(trunk, shape, Z)
    arc = np.linalg.norm(np.diff(discs.center, axis=1), axis=-1)
    area = np.pi * (discs.radius[:, 1:] + discs.radius[:, :-1]) ** 2 / 4
    volume = np.pi * trunk.radius((Z[1:] + Z[:-1]) / 2) ** 2 @ np.diff(Z)
    np.testing.assert_allclose((area * arc).sum(axis=1), volume, rtol=1e-6)
    chords = np.diff(discs.center, axis=1)
    chords /= np.linalg.norm(chords, axis=-1, keepdims=True)
    aligned = np.sum(chords * (discs.tangent[:, 1:] + discs.tangent[:, :-1]) / 2, axis=-1)
    np.testing.assert_allclose(aligned, 1, atol=1e-5)
    solid = Solid("it", "head", "sphere", (0.4, 0.0, -0.3), sizes=(0.1,), frame="head")
    gaps = solid_gaps(seen_by(trunk, discs, solid, head), solid)
    turned = [
        pivot(trunk)
        + Rotation.from_euler("ZY", angles).apply(np.array(solid.center) - pivot(trunk))
        for angles in head
    ]
    for k, center in enumerate(turned):
        there = Solid("it", "head", "sphere", tuple(center), sizes=(0.1,))
        np.testing.assert_allclose(gaps[k], solid_gaps(discs[k : k + 1], there)[0], atol=1e-12)

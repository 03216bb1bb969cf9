"""Lower bounds of gaps against densely sampled surfaces of tubes that bend and move smoothly."""

import numpy as np
import pytest
from plans import shipped
from scipy.spatial.transform import Rotation

from trunk_ocp.contact.certificate import (
    Curving,
    Error,
    curving_along,
    curving_in_time,
    pair_bounds,
    solid_bounds,
)
from trunk_ocp.contact.tube import Tube, pair_gaps, solid_gaps, tube
from trunk_ocp.model.solids import Solid, signed_distance
from trunk_ocp.rod.statics import solve_statics
from trust.validation.rods import contractions

SIZES = {"sphere": 1, "capsule": 2, "cylinder": 2, "half-space": 0, "box": 3, "ellipsoid": 3}
FINER = 6  # dense samples of a piece
ANGLES = np.linspace(0, 2 * np.pi, 48, endpoint=False)


def error_along(discs):
    """The error at instants."""
    return Error(curving_along([discs]), Curving.none(len(discs.center), len(discs.Z) - 1))


def cell_error(instants, quarter):
    """The error on a quarter of a cell."""
    return Error(curving_along(instants[quarter : quarter + 2]), curving_in_time(instants))


def bounds_along(discs, solid):
    return solid_bounds([discs], error_along(discs), np.arange(len(discs.Z) - 1), solid)


def bounds_between(first, last, error, solid):
    return solid_bounds([first, last], error, np.arange(len(first.Z) - 1), solid)


def below(curving, normal):
    """How far all pieces may lie below their chords along a unit vector (3,), (C, P)."""
    pieces = np.arange(curving.turning.shape[1])
    normals = np.broadcast_to(normal, (*curving.turning.shape, 3))
    return curving.below(pieces, normals)


def random_motion(seed):
    """(Z, times) -> discs of a tube of length about 1 whose centerline is a moving Fourier sum."""
    rng = np.random.default_rng(seed)
    waves, phases = rng.uniform(1, 7, (4, 3)), rng.uniform(0, 6, (4, 3))
    speeds, sizes = (
        rng.uniform(-2, 2, (4, 3)),
        rng.uniform(0, 0.12, (4, 3)) / np.arange(1, 5)[:, None],
    )

    def discs(Z, times):
        angle = waves * Z[None, :, None, None] + phases + speeds * times[:, None, None, None]
        center = np.sum(sizes * np.sin(angle), axis=2)
        center[..., 0] += Z
        slope = np.sum(sizes * waves * np.cos(angle), axis=2)
        slope[..., 0] += 1
        radius = (0.12 - 0.08 * Z) * (1 + 0.1 * np.sin(3 * times))[:, None]
        return Tube(Z, center, slope / np.linalg.norm(slope, axis=-1, keepdims=True), radius)

    return discs


def rims(discs):
    """Points (H, n, angles, 3) of the rims of discs; with them, linear bounds hold inside too."""
    other = np.cross(discs.tangent, [0.36, 0.48, 0.8])
    other /= np.linalg.norm(other, axis=-1, keepdims=True)
    third = np.cross(discs.tangent, other)
    around = (
        np.cos(ANGLES)[:, None] * other[..., None, :]
        + np.sin(ANGLES)[:, None] * third[..., None, :]
    )
    return discs.center[..., None, :] + discs.radius[..., None, None] * around


def random_solid(shape, rng):
    axes = tuple(map(tuple, Rotation.random(random_state=rng.integers(10**6)).as_matrix()))
    sizes = tuple(rng.uniform(0.02, 0.3, SIZES[shape]))
    center = np.array([rng.uniform(0, 1), 0, 0]) + 0.4 * rng.normal(size=3)
    return Solid("it", "obstacles", shape, tuple(center), axes, sizes)


def dense(motion, n, times):
    """Rims at `FINER` places in each of n pieces, ends included: (H, n, FINER + 1, angles, 3)."""
    Z = np.linspace(0, 1, n * FINER + 1)
    points = rims(motion(Z, times))
    starts = FINER * np.arange(n)[:, None] + np.arange(FINER + 1)
    return points[:, starts]


@pytest.mark.parametrize("shape", list(SIZES))
def test_bounds_along_the_trunk_hold_and_converge(shape):
    rng, times = np.random.default_rng(list(SIZES).index(shape)), np.zeros(1)
    slack = {16: [], 32: [], 64: []}
    for seed in range(6):
        motion, solid = random_motion(seed), random_solid(shape, rng)
        for n, lost in slack.items():
            bounds = bounds_along(motion(np.linspace(0, 1, n + 1), times), solid)
            least = signed_distance(solid, dense(motion, n, times))[0].min(axis=(2, 3))
            assert np.all(bounds <= least)
            gaps = solid_gaps(motion(np.linspace(0, 1, 1001), times), solid)
            lost.append(max(gaps.min() - bounds.min(), 0.0))  # some bounds are sharper than gaps
    assert np.mean(slack[64]) < np.mean(slack[16]) / 6
    assert max(slack[64]) < 0.01


@pytest.mark.parametrize("shape", list(SIZES))
def test_bounds_between_instants_hold_and_converge(shape):
    rng, n = np.random.default_rng(20 + list(SIZES).index(shape)), 64
    slack = {1.6: [], 0.4: []}
    for seed in range(4):
        motion, solid = random_motion(seed), random_solid(shape, rng)
        Z, start = np.linspace(0, 1, n + 1), rng.uniform(0, 3)
        for duration, lost in slack.items():
            edges = start + duration * np.arange(5) / 4
            instants = [motion(Z, edges[i : i + 1]) for i in range(5)]
            for k in range(4):
                first, last, ends = instants[k], instants[k + 1], edges[k : k + 2]
                bounds = bounds_between(first, last, cell_error(instants, k), solid)[0]
                points = dense(motion, n, np.linspace(*ends, 7))
                least = signed_distance(solid, points)[0].min(axis=(0, 2, 3))
                assert np.all(bounds <= least)
                moving = motion(np.linspace(0, 1, 401), np.linspace(*ends, 7))
                lost.append(max(solid_gaps(moving, solid).min() - bounds.min(), 0.0))
    assert np.mean(slack[0.4]) < np.mean(slack[1.6]) / 3
    assert max(slack[0.4]) < 0.01


def test_bounds_of_pairs_hold_and_converge():
    slack = {16: [], 64: []}
    for seed in range(4):
        motion, times = random_motion(seed), np.array([0.3])
        for n, lost in slack.items():
            discs = motion(np.linspace(0, 1, n + 1), times)
            pairs = np.random.default_rng(seed).integers(0, n, (12, 2))
            pairs = pairs[np.abs(pairs[:, 0] - pairs[:, 1]) > n // 3]
            bounds = pair_bounds([discs], error_along(discs), pairs)[0]
            points = dense(motion, n, times)[0].reshape(n, -1, 3)
            for (i, j), bound in zip(pairs, bounds, strict=True):
                least = np.linalg.norm(points[i][:, None] - points[j][None], axis=-1).min()
                assert bound <= least
                corners = np.array([(i + a, j + b) for a in (0, 1) for b in (0, 1)])
                lost.append(pair_gaps(discs, corners).min() - bound)
    assert np.mean(slack[64]) < np.mean(slack[16]) / 2


def test_bounds_of_moving_pairs_hold():
    n, Z = 48, np.linspace(0, 1, 49)
    for seed in range(4):
        motion, edges = random_motion(seed), np.linspace(0.5, 0.7, 5)
        instants = [motion(Z, edges[i : i + 1]) for i in range(5)]
        pairs = np.random.default_rng(seed).integers(0, n, (10, 2))
        pairs = pairs[np.abs(pairs[:, 0] - pairs[:, 1]) > n // 3]
        bounds = pair_bounds(instants[:2], cell_error(instants, 0), pairs)[0]
        points = dense(motion, n, np.linspace(*edges[:2], 5)).reshape(5, n, -1, 3)
        for (i, j), bound in zip(pairs, bounds, strict=True):
            for now in points:
                assert bound <= np.linalg.norm(now[i][:, None] - now[j][None], axis=-1).min()


@pytest.mark.parametrize("name", ["pick-fruit", "lift-log"])
def test_bounds_along_loaded_trunks_hold(name):
    trunk, n = shipped(name).trunk, 64
    activation = contractions(trunk, 6, seed=2)
    loads = [step.loads for step in shipped(name).steps[-6:]]
    shape = solve_statics(trunk, activation, np.zeros((6, 2)), (loads * 6)[:6])
    solid = Solid("it", "obstacles", "sphere", (0.5, 0.0, 0.2), sizes=(0.3,))
    coarse, fine = (tube(trunk, shape, np.linspace(0, trunk.length, k + 1)) for k in (n, n * FINER))
    bounds = bounds_along(coarse, solid)
    starts = FINER * np.arange(n)[:, None] + np.arange(FINER + 1)
    least = signed_distance(solid, rims(fine))[0].min(axis=-1)[:, starts].min(axis=-1)
    assert np.all(bounds <= least)
    assert np.max(least.min(axis=1) - bounds.min(axis=1)) < 0.02


def straight(offsets, radius=0.05):
    """Straight tubes along X, moved by offsets (H, 3)."""
    Z = np.linspace(0, 1, 33)
    center = offsets[:, None] + Z[:, None] * np.array([1.0, 0, 0])
    tangent = np.broadcast_to([1.0, 0, 0], center.shape)
    return Tube(Z, center, tangent, np.full(center.shape[:2], radius))


def test_a_tilted_disc_is_bounded_by_its_rim_not_by_the_direction_of_its_center():
    discs = straight(np.zeros((1, 3)))
    ball = Solid("it", "obstacles", "sphere", (1.1, 0.0, 0.2), sizes=(0.05,))
    rim = np.hypot(0.1, 0.15) - 0.05
    bound = bounds_along(discs, ball).min()
    assert solid_gaps(discs, ball).min() < rim - 1e-3 < bound <= rim


def test_a_motion_with_an_inflection_in_the_middle_is_not_taken_for_a_straight_one():
    t = np.linspace(-1, 1, 5)
    path = np.stack([0 * t, 0 * t, 0.1 * t**3], axis=-1)
    curving = curving_in_time([straight(path[i : i + 1]) for i in range(5)])
    fine = np.linspace(-1, 1, 401)
    above = 0.1 * fine**3 - np.interp(fine, t, path[:, 2])
    for side in (-1, 1):
        assert below(curving, [0, 0, side]).min() >= -(side * above).min()


PATHS = {  # of time since the middle, over the time that a turn takes
    "a turn at constant speed": lambda t: [np.cos(t), np.sin(t)],
    "a swerve": lambda t: [np.tanh(t), 1 / np.cosh(t)],
    "a start and a stop": lambda t: [np.tanh(t), 0 * t],
    "a motion that gets faster": lambda t: [np.exp(t), 0.5 * np.exp(t)],
}


@pytest.mark.parametrize("takes", [0.3, 0.5, 1.0])
@pytest.mark.parametrize("path", PATHS.values(), ids=list(PATHS))
def test_accelerations_that_turn_or_change_sign_within_a_cell_are_bounded(path, takes):
    fine = 16  # samples of a quarter of the cell, [0, 1]
    share = np.linspace(0, 1, fine + 1)[:, None]
    normals = np.stack([0 * ANGLES, np.cos(ANGLES), np.sin(ANGLES)], axis=-1)[::4]
    for middle in np.linspace(-0.5, 1.5, 21):
        t = (np.linspace(0, 1, 4 * fine + 1) - middle) / takes
        offsets = np.stack([0 * t, *path(t)], axis=-1)
        curving = curving_in_time([straight(offsets[i : i + 1]) for i in range(0, t.size, fine)])
        error = np.array([below(curving, normal).min() for normal in normals])
        for i in range(0, t.size - 1, fine):
            x = offsets[i : i + fine + 1] @ normals.T
            chord = (1 - share) * x[0] + share * x[-1]
            assert np.all(error >= (chord - x).max(axis=0) - 1e-12)


def test_curvature_that_jumps_at_a_break_is_bounded_on_both_sides():
    bend, n = 8.0, 32  # 1/m, from the middle on; straight before
    s = np.linspace(0, 1, n + 1)

    def discs(at):
        turn = bend * np.maximum(at - 0.5, 0)
        x = np.minimum(at, 0.5) + np.where(at > 0.5, np.sin(turn) / bend, 0)
        z = np.where(at > 0.5, (1 - np.cos(turn)) / bend, 0)
        center = np.stack([x, 0 * x, z], axis=-1)[None]
        tangent = np.stack([np.cos(turn), 0 * x, np.sin(turn)], axis=-1)[None]
        return Tube(at, center, tangent, np.full((1, at.size), 0.06), np.isclose(at, 0.5))

    curving, fine = curving_along([discs(s)]), discs(np.linspace(0, 1, 16 * n + 1)).center[0]
    for angle in ANGLES[::6]:
        normal = np.array([np.cos(angle), 0, np.sin(angle)])
        error = below(curving, normal)[0]
        for i in range(n):
            chord = np.linspace(fine[16 * i], fine[16 * i + 16], 17)
            assert error[i] >= ((chord - fine[16 * i : 16 * i + 17]) @ normal).max()
        assert error[: n // 2].max() < 1e-12
    assert below(curving, [0, 0, 1.0])[0, n // 2] > 1e-4


def test_a_curl_is_nowhere_closer_to_what_it_is_curled_around_than_its_chords():
    s = np.linspace(0, 2, 129)
    turn = s / 0.3
    out = np.stack([np.cos(turn), 0 * s, np.sin(turn)], axis=-1)
    tangent = np.stack([-np.sin(turn), 0 * s, np.cos(turn)], axis=-1)
    discs = Tube(s, 0.3 * out[None], tangent[None], np.full((1, 129), 0.2))
    outward = (out[1:] + out[:-1]) / np.linalg.norm(out[1:] + out[:-1], axis=1, keepdims=True)
    curving, pieces = curving_along([discs]), np.arange(128)
    assert np.all(curving.below(pieces, outward[None]) == 0)
    sagitta = (0.3 + 0.2) * (1 - np.cos(turn[1] / 2))
    assert np.all(curving.below(pieces, -outward[None]) > sagitta)


def test_a_piece_without_neighbors_has_no_bound():
    curving = curving_along([straight(np.zeros((1, 3))).part(slice(0, 2))])
    assert np.all(np.isinf(below(curving, [0, 0, 1.0])))

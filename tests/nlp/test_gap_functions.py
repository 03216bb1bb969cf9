"""Gap functions of the NLP against distances in numpy, complex steps, and shapes of the rod.

Nothing here that is compared with a gap function calls it: distances are written again, with their
normals, in arithmetic that complex numbers pass through.
"""

from dataclasses import replace
from functools import cache

import casadi as ca
import numpy as np
import pytest
from plans import first_steps, in_equilibrium
from scipy.spatial.transform import Rotation

from trunk_ocp.model.activation import segment_at, strains
from trunk_ocp.model.solids import Solid, in_head_frame, signed_distance
from trunk_ocp.nlp.gap_functions import TILT, scaled_stretch, section_gap, solid_gap
from trunk_ocp.nlp.gap_rows import GapRow
from trunk_ocp.nlp.quantities import units_of
from trunk_ocp.nlp.window import Window
from trunk_ocp.problem.weights import Weights
from trunk_ocp.rod.collocation import mesh_for
from trunk_ocp.rod.equations import point_parameters
from trunk_ocp.rod.volume import section_scale
from trust.validation.rods import contractions

SIZES = {
    "sphere": (0.3,),
    "capsule": (0.1, 0.4),
    "cylinder": (0.2, 0.3),
    "half-space": (),
    "box": (0.1, 0.3, 0.2),
    "ellipsoid": (0.15, 0.4, 0.25),
}
SHAPES = list(SIZES)
PIVOT = np.array([-0.25, 0.03, 0.04])
RADIUS, STEP, COMPLEX_STEP = 0.07, 2e-5, 1e-30


# --- the same functions in numpy -------------------------------------------------------------


def length(x):
    return np.sqrt(np.sum(x * x))


def larger(a, b):
    return a if np.real(a) >= np.real(b) else b


def magnitude(a):
    return a if np.real(a) >= 0 else -a


def sphere(x, sizes):
    return length(x) - sizes[0], x / length(x)


def capsule(x, sizes):
    z = x[2] if abs(np.real(x[2])) <= sizes[1] else np.sign(np.real(x[2])) * sizes[1]
    return sphere(x - np.array([0, 0, 1]) * z, sizes)


def half_space(x, sizes):
    return x[2], np.array([0, 0, 1])


def box(x, sizes):
    """Of any number of dimensions."""
    sign = np.where(np.real(x) < 0, -1, 1)
    beyond = sign * x - sizes
    if np.all(np.real(beyond) <= 0):
        face = np.argmax(np.real(beyond))
        return beyond[face], sign * (np.arange(len(x)) == face)
    outside = np.where(np.real(beyond) > 0, beyond, 0)
    return length(outside), sign * outside / length(outside)


def cylinder(x, sizes):
    radius = length(x[:2])
    distance, (out, up) = box(np.array([radius, x[2]]), np.array(sizes))
    return distance, np.array([out * x[0] / radius, out * x[1] / radius, up])


def ellipsoid(x, sizes):
    """By the root t of sum (a x / (a^2 + t))^2 = 1: bisection first, then Newton's method."""
    a2 = np.array(sizes) ** 2

    def excess(t):
        return np.sum(a2 * x * x / (a2 + t) ** 2) - 1

    low, high = -a2.min(), 10.0
    for _ in range(60):
        t = (low + high) / 2
        low, high = (t, high) if excess(t).real > 0 else (low, t)
    t = high
    for _ in range(4):
        t = t + excess(t) / (2 * np.sum(a2 * x * x / (a2 + t) ** 3))
    normal = x / (a2 + t)
    return t * length(normal), normal / length(normal)


DISTANCES = {
    "sphere": sphere,
    "capsule": capsule,
    "cylinder": cylinder,
    "half-space": half_space,
    "box": lambda x, sizes: box(x, np.array(sizes)),
    "ellipsoid": ellipsoid,
}


def tangent(q):
    """d_3 of a quaternion of any length (eq. 22)."""
    s, x, y, z = q
    d3 = np.array([2 * (x * z + s * y), 2 * (y * z - s * x), s * s - x * x - y * y + z * z])
    return d3 / np.sum(q * q)


def reach(radius, volume, along):
    return radius / np.sqrt(volume) * np.sqrt(1 - along**2 + TILT**2)


def about(axis, angle, v):
    """A vector turned by an angle about e_Y or e_Z."""
    c, s = np.cos(angle), np.sin(angle)
    turns = {"Y": [[c, 0, s], [0, 1, 0], [-s, 0, c]], "Z": [[c, -s, 0], [s, c, 0], [0, 0, 1]]}
    return np.array(turns[axis]) @ v


def from_solid(shape, axes, center, w):
    """Gap of a section from a solid: w = r, q, volume ratio and, if in the head, its angles."""
    r, d3, volume = w[:3], tangent(w[3:7]), w[7]
    if len(w) == 10:  # turned back about Z first, as the head turns about Y first
        r, d3 = (about("Y", -w[9], about("Z", -w[8], v)) for v in (r - PIVOT, d3))
        r = r + PIVOT
    distance, normal = DISTANCES[shape](axes @ (r - center), SIZES[shape])
    return distance - reach(RADIUS, volume, np.sum(normal * (axes @ d3)))


def between_sections(radii, w):
    between = w[:3] - w[7:10]
    gap = length(between)
    for radius, q in zip(radii, (w[3:7], w[10:14]), strict=True):
        gap = gap - reach(radius, w[14], np.sum(between * tangent(q)) / length(between))
    return gap


def slope(function, w):
    """Gradient by complex steps."""
    return (
        np.array([function(w + COMPLEX_STEP * 1j * e).imag for e in np.eye(w.size)]) / COMPLEX_STEP
    )


def curvature(function, w):
    """Hessian by differences of complex steps, exact to the fourth order."""
    columns = []
    for e in STEP * np.eye(w.size):
        ahead, far = (slope(function, w + k * e) - slope(function, w - k * e) for k in (1, 2))
        columns.append((8 * ahead - far) / (12 * STEP))
    return np.stack(columns, axis=-1)


@cache
def derivatives(function):
    """Value, gradient and Hessian of a gap function."""
    w = ca.SX.sym("w", function.size1_in(0))
    p = ca.SX.sym("p", function.size1_in(1))
    value = function(w, p)
    hessian, gradient = ca.hessian(value, w)
    return ca.Function("all", [w, p], [value, gradient, hessian])


def evaluated(function, w, p):
    value, gradient, hessian = (part.full() for part in derivatives(function)(w, p))
    return value.item(), gradient[:, 0], hessian


# --- scenes ----------------------------------------------------------------------------------


def near_a_seam(shape, x):
    """Whether a point is beside a surface across which second derivatives jump."""
    sizes, radial = np.array(SIZES[shape]), np.hypot(x[0], x[1])
    match shape:
        case "capsule":
            beyond = np.array([abs(x[2]) - sizes[1]])
        case "cylinder":
            beyond = np.array([radial, abs(x[2])]) - sizes
        case "box":
            beyond = np.abs(x) - sizes
        case "ellipsoid":  # deep inside, the distance bends sharply near its planes of symmetry
            beyond = np.array([length(x / sizes) - 0.6]).clip(0)
        case _:
            beyond = np.ones(1)
    seams = np.append(beyond, np.diff(np.sort(beyond)))
    return min(np.abs(seams).min(), length(x), radial) < 0.02


def scenes(shape, in_head, count=12):
    """Placements of a solid, with unknowns of a section inside it, beside it and far away."""
    rng = np.random.default_rng(SHAPES.index(shape))
    while count:
        axes = Rotation.random(random_state=rng.integers(10**6)).as_matrix()
        center, x = rng.uniform(-0.5, 0.5, 3), rng.normal(size=3) * rng.choice([0.2, 0.6])
        if near_a_seam(shape, x):
            continue
        q = rng.normal(size=4)
        q *= rng.uniform(0.99, 1.01) / length(q)
        r, head = center + axes.T @ x, rng.uniform(-0.7, 0.7, 2)
        if in_head:
            r = PIVOT + Rotation.from_euler("ZY", head).apply(r - PIVOT)
        w = np.concatenate([r, q, [rng.uniform(0.7, 1.3)], head if in_head else []])
        p = np.concatenate([center, axes.ravel(), PIVOT, [RADIUS], SIZES[shape]])
        count -= 1
        yield axes, center, w, p


BOTH = pytest.mark.parametrize("in_head", [False, True], ids=["space", "head"])
ALL = pytest.mark.parametrize("shape", SHAPES)


@ALL
@BOTH
def test_a_gap_is_the_distance_less_the_reach_of_the_section(shape, in_head):
    inside = 0
    for axes, center, w, p in scenes(shape, in_head):
        frame = tuple(map(tuple, axes))
        solid = Solid("it", "obstacles", shape, tuple(center), frame, SIZES[shape])
        at, d3 = w[:3], Rotation.from_quat(np.roll(w[3:7], -1)).apply([0, 0, 1])
        if in_head:
            back = Rotation.from_euler("ZY", w[8:]).inv()
            at, d3 = PIVOT + back.apply(at - PIVOT), back.apply(d3)
        distance, normal = signed_distance(solid, at)
        gap = distance - RADIUS / np.sqrt(w[7]) * np.sqrt(1 - (normal @ d3) ** 2 + TILT**2)
        assert evaluated(solid_gap(shape, in_head), w, p)[0] == pytest.approx(gap, abs=1e-11)
        inside += distance < 0
    assert 0 < inside < 12


@ALL
@BOTH
def test_derivatives_of_a_gap_from_a_solid_agree_with_complex_steps(shape, in_head):
    for axes, center, w, p in scenes(shape, in_head, count=6):

        def gap(w, shape=shape, axes=axes, center=center):
            return from_solid(shape, axes, center, w)

        value, gradient, hessian = evaluated(solid_gap(shape, in_head), w, p)
        assert value == pytest.approx(gap(w), abs=1e-11)
        np.testing.assert_allclose(gradient, slope(gap, w), rtol=1e-8, atol=1e-8)
        wanted = curvature(gap, w)
        np.testing.assert_allclose(hessian, wanted, rtol=1e-8, atol=1e-8 * np.abs(wanted).max())


def test_derivatives_of_a_gap_between_sections_agree_with_complex_steps():
    rng = np.random.default_rng(5)
    for _ in range(20):
        w, radii = rng.normal(size=15), rng.uniform(0.02, 0.1, 2)
        w[14] = rng.uniform(0.7, 1.3)

        def gap(w, radii=radii):
            return between_sections(radii, w)

        value, gradient, hessian = evaluated(section_gap(), w, radii)
        assert value == pytest.approx(gap(w), abs=1e-12)
        np.testing.assert_allclose(gradient, slope(gap, w), rtol=1e-8, atol=1e-8)
        wanted = curvature(gap, w)
        np.testing.assert_allclose(hessian, wanted, rtol=1e-8, atol=1e-8 * np.abs(wanted).max())


def special_points(shape):
    """Where distances are not smooth: the center, axes, planes of symmetry, edges, corners."""
    sizes = SIZES[shape] or (0.2,)
    a = np.resize(sizes, 3)
    signs = np.array(np.meshgrid(*3 * [[-1, 0, 1]])).reshape(3, -1).T
    if shape in ("capsule", "cylinder"):
        a = np.array([sizes[0], sizes[0], sizes[1]])
    return np.concatenate([signs * a * share for share in (0.5, 1.0, 2.0)])


@ALL
@BOTH
def test_derivatives_are_finite_everywhere(shape, in_head):
    function = solid_gap(shape, in_head)
    for x in special_points(shape):
        for q in np.concatenate([np.eye(4), np.ones((1, 4)) / 2]):  # d_3 along axes, normals too
            w = np.concatenate([x, q, [1.0], [0.0, 0.0] if in_head else []])
            p = np.concatenate([np.zeros(3), np.eye(3).ravel(), PIVOT, [RADIUS], SIZES[shape]])
            assert all(np.all(np.isfinite(part)) for part in evaluated(function, w, p)), (x, q)


def test_derivatives_are_finite_where_sections_have_one_center():
    w = np.array([0.1, 0.2, 0.3, 1, 0, 0, 0, 0.1, 0.2, 0.3, 1, 0, 0, 0, 1.0])
    assert all(np.all(np.isfinite(part)) for part in evaluated(section_gap(), w, np.full(2, 0.1)))


# --- what the gaps need of the rod -----------------------------------------------------------


@cache
def contracted(name, step):
    """A step of a shipped motion with random contractions: window, decision vector, shape."""
    motion, t = first_steps(name, step + 1), step
    trunk, mesh = motion.trunk, mesh_for(motion.trunk, motion.contact_from, 8)
    solids = [replace(solid, Z=(0.0, trunk.length)) for solid in motion.steps[t].solids]
    rows = [GapRow(Z, solid, None, 0.0) for solid in solids for Z in (0.9, 1.31, 1.75)]
    rows += [GapRow(0.4, None, 1.2, 0.0), GapRow(0.9, None, 1.75, 0.0)]
    weights = Weights()
    still = np.zeros(len(trunk.muscles) + 2)
    held = {reference: np.array([0.6, 0.0, 0.8]) for reference in motion.held}
    window = Window(
        motion, mesh, motion.steps[t : t + 1], still, held, t, weights, {t: tuple(rows)}
    )
    x = np.append(contractions(trunk, 1, seed=3, strongest=0.4)[0], [0.2, -0.3])[None]
    shape, (loads,) = in_equilibrium(window, x)
    return window, window.pack(x, shape), x, shape, loads


STEPS = pytest.mark.parametrize(("name", "step"), [("pick-fruit", 0), ("lift-log", 6)])


@STEPS
def test_the_stretch_is_the_extension_of_the_shape(name, step):
    window, _, x, shape, loads = contracted(name, step)
    trunk, mesh = window.motion.trunk, shape.mesh
    units = units_of(trunk)
    made = strains(trunk, x[:, :-2])[0]  # (segments, 4), at rest (1, 0, 0, 0)
    segment = segment_at(trunk, mesh.points.ravel())
    count = segment.size
    force = np.asarray(loads.tip_force) / units.force
    w = np.vstack(
        [
            shape.states[0, :, 1:].reshape(count, 7).T / np.array([[1]] * 4 + [[units.moment]] * 3),
            made[segment].T * np.array([[1], *3 * [[units.length]]]),
            np.full((1, count), made[:, 0] @ np.diff(trunk.edges) / trunk.length),
            np.tile(force[:, None], count),
        ]
    )
    p = point_parameters(trunk, loads, mesh.points.ravel())
    got = scaled_stretch(units.length, units.moment).map(count)(w, p).full()[0]
    np.testing.assert_allclose(got, shape.extension.ravel(), rtol=0, atol=1e-10)
    along = np.linalg.norm(shape.slopes[0], axis=-1).ravel()
    np.testing.assert_allclose(got, along, rtol=0, atol=1e-7)  # |q| is 1 as collocation has it


@STEPS
def test_rows_are_the_gaps_of_a_trunk_that_keeps_its_volume(name, step):
    window, full, x, shape, _ = contracted(name, step)
    trunk = window.motion.trunk
    problem = window.nlp.as_casadi()
    function = ca.Function("g", [problem["x"], problem["p"]], [problem["g"]])
    g = np.append(0.0, function(full, window.parameters).full()[:, 0])  # rows are numbered from 1
    (volume,) = [b for b in window.blocks if b.meaning.name == "volume ratio"]
    assert np.abs(g[np.ravel(volume.rows)]).max() < 1e-9
    scale = section_scale(trunk, shape)[0]
    assert abs(scale - 1) > 1e-3
    for row, _, number in window.gap_rows:
        Z = np.array(row.points)
        centers, d3 = shape.position(Z)[0], shape.directors(Z)[0, :, 2]
        radii = scale * trunk.radius(Z)
        if row.solid is None:
            distance = length(centers[0] - centers[1])
            normal = (centers[0] - centers[1]) / distance
        else:
            if row.solid.frame == "head":
                centers = in_head_frame(trunk, centers, x[0, -2:])
                back = Rotation.from_euler("ZY", x[0, -2:]).inv()
                d3 = back.apply(d3)
            distance, normal = (part[0] for part in signed_distance(row.solid, centers))
        gap = distance - radii @ np.sqrt(1 - (d3 @ normal) ** 2 + TILT**2)
        assert g[number] * trunk.length == pytest.approx(gap, abs=1e-8 * trunk.length)

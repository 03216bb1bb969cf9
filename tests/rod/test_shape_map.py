"""Compiled shapes against statics, an independent integrator, finer steps and differences."""

import copy
import math
import multiprocessing
import pickle
import sys
from concurrent.futures import ProcessPoolExecutor
from functools import partial

import casadi as ca
import numpy as np
import pytest
import scipy.integrate
from plans import thin_tipped

import trunk_ocp
from trunk_ocp._support.casadi_to_python import python_source
from trunk_ocp.errors import InputError, StaticsError, TrunkError
from trunk_ocp.model.loads import Loads
from trunk_ocp.rod import dormand_prince, shape_map
from trunk_ocp.rod import shooting_kernels as shooting
from trunk_ocp.rod.arguments import Controls
from trunk_ocp.rod.collocation import mesh_for
from trunk_ocp.rod.equations import rates
from trunk_ocp.rod.shape_map import PointShapes, ShapeMap
from trunk_ocp.rod.statics import solve_statics
from trunk_ocp.rod.tip_jacobian import tip_jacobian
from trunk_ocp.rod.unloaded import unloaded_states
from trust import reference

pytestmark = pytest.mark.slow

REST = np.zeros(28)
LOADS = {
    "weight": Loads(),
    "sideways": Loads(tip_force=(30.0, -60.0, 10.0)),
    "heavy tip": Loads(tip_force=(0.0, 0.0, 400.0)),
    # Z_w = 1.3 m is no segment end.
    "contact": Loads(9.8, (20.0, -30.0, 40.0), 1.3, (10.0, 20.0, 100.0), (-60.0, 20.0, 10.0)),
}
every_load = pytest.mark.parametrize("load", LOADS.values(), ids=LOADS)


def heads(count, seed):
    return np.random.default_rng(seed).uniform(-0.6, 0.6, (count, 2))


def distance(one, other):
    return np.linalg.norm(one - other, axis=-1).max()


def at_points(shapes, Z):
    """The same shapes at some of their points."""
    index = np.searchsorted(shapes.Z, Z)
    np.testing.assert_array_equal(shapes.Z[index], Z)
    return PointShapes(np.asarray(Z), shapes.path[..., index, :])


def polished(solve, *arguments):
    """Shapes with one more call of Newton's method: to round-off."""
    return solve(*arguments, start=solve(*arguments))


def point_with(q):
    return PointShapes(np.zeros(1), np.append(q, np.zeros(6))[None])


# --- loaded shapes ------------------------------------------------------------------


@every_load
def test_shapes_are_those_of_statics(trunk, draw, load):
    activation, psi = draw(trunk, 60, seed=100), heads(60, 101)
    shapes = ShapeMap(trunk, load)(activation, psi)
    mesh = mesh_for(trunk, load.contact_from, 12, 8)
    expected = solve_statics(trunk, activation, psi, load, mesh)
    assert distance(shapes.position, expected.position(shapes.Z)) < 1e-6 * trunk.length
    assert np.abs(shapes.directors - expected.directors(shapes.Z)).max() < 1e-5
    moment = expected.moment(shapes.Z)
    assert np.abs(shapes.moment - moment).max() < 1e-5 * np.abs(moment).max()


@every_load
def test_a_runge_kutta_code_started_from_the_base_moment_finds_the_same_shape(trunk, draw, load):
    activation, psi = draw(trunk, 12, seed=102), heads(12, 103)
    shapes = polished(ShapeMap(trunk, load, steps=24), activation, psi)
    r, d, m = reference.march(
        trunk, activation, psi, [load] * 12, shapes.moment[:, 0], shapes.Z, rtol=1e-12, atol=1e-12
    )
    # The way back from the tip's free end is unstable: errors of the base grow along the trunk.
    assert distance(shapes.position, r) < 1e-7
    assert np.abs(shapes.directors - d).max() < 1e-6
    assert np.abs(shapes.moment - m).max() < 1e-6 * np.abs(m).max()


def test_shapes_start_at_the_clamp_and_end_free(trunk, draw):
    activation, psi = draw(trunk, 5, seed=104), heads(5, 105)
    shapes = polished(ShapeMap(trunk, LOADS["contact"]), activation, psi)
    for i in range(5):
        r0, d0 = reference.base(trunk, psi[i])
        np.testing.assert_allclose(shapes.position[i, 0], r0, atol=1e-14)
        np.testing.assert_allclose(shapes.directors[i, 0], d0, atol=1e-14)
    assert np.abs(shapes.moment[:, -1]).max() < 1e-8  # of some 300 N m at the base


@pytest.mark.parametrize("push", [-500.0, -2000.0])
def test_a_push_from_below_that_buckles_the_trunk_has_the_shape_of_statics(trunk, push):
    """Newton's method diverges from the unloaded shape here: the load has to be raised."""
    load = Loads(tip_force=(0.0, 0.0, push))
    shapes = polished(ShapeMap(trunk, load), REST)
    expected = solve_statics(trunk, REST, loads=load).position(shapes.Z)
    assert distance(shapes.position, expected) < 1e-5
    r, _, m = reference.march(trunk, REST, (0, 0), [load], shapes.moment[0], shapes.Z)
    assert distance(shapes.position, r[0]) < 1e-5
    assert np.abs(m[0, -1]).max() < 1e-4 * np.abs(m).max()


def test_wherever_statics_finds_a_shape_there_is_one(trunk, draw):
    rng = np.random.default_rng(106)
    for activation in draw(trunk, 20, seed=107):
        load = Loads(9.8, tuple(rng.uniform(-600, 600, 3)), 1.3, tuple(rng.uniform(-300, 300, 3)))
        solve_statics(trunk, activation, loads=load)
        shapes = polished(ShapeMap(trunk, load, steps=10), activation)
        # Perhaps another equilibrium, but one: statics' own starts are not the only ones.
        _, _, m = reference.march(trunk, activation, (0, 0), [load], shapes.moment[0], shapes.Z)
        assert np.abs(m[0, -1]).max() < 1e-4 * np.abs(m).max()


def test_by_weight_alone_newton_converges_from_the_unloaded_shape(trunk, draw):
    solve, activation, psi = ShapeMap(trunk), draw(trunk, 300, seed=108), heads(300, 109)
    controls = Controls.of(trunk, activation, psi, strict=True)
    paths, reached = solve._unloaded(controls), np.empty(300)
    nowhere = np.full_like(paths, np.nan)  # from which no load can be raised
    shooting.loaded_paths(
        paths, nowhere, controls.mean, solve._points, solve._widths, controls.strain,
        solve._segment, solve._floor, reached,
    )  # fmt: skip
    assert np.all(reached == 1)
    assert np.isfinite(paths).all()


@pytest.mark.parametrize("spoilt", ["start", "load"])
def test_a_newton_iteration_that_ends_in_nan_has_not_converged(trunk, spoilt):
    solve = ShapeMap(trunk)
    controls = Controls.of(trunk, REST, (0.0, 0.0), strict=True)
    unloaded, points, reached = solve._unloaded(controls), solve._points.copy(), np.empty(1)
    paths = unloaded.copy()
    if spoilt == "start":
        paths[:, 1:] = np.nan
    else:
        points[..., 5:8] = np.nan
    shooting.loaded_paths(
        paths, unloaded, controls.mean, points, solve._widths, controls.strain, solve._segment,
        solve._floor, reached,
    )  # fmt: skip
    assert reached == (1 if spoilt == "start" else 0)  # by raising the load; not at all
    assert np.isfinite(paths).all()


# --- resolution ---------------------------------------------------------------------


@pytest.mark.parametrize("steps", [3, 4, 5, 6])
def test_the_defect_estimates_the_error(trunk, draw, monkeypatch, steps):
    monkeypatch.setattr(shape_map, "MAX_DEFECT", np.inf)  # as the steps give it, never refined
    ratios = []
    for load in LOADS.values():
        activation, psi = draw(trunk, 100, seed=110), heads(100, 111)
        coarse = ShapeMap(trunk, load, steps=steps)
        shapes = polished(coarse, activation, psi)
        fine = ShapeMap(trunk, load, at=coarse.Z, steps=24)
        exact = at_points(polished(fine, activation, psi), coarse.Z)
        error = np.linalg.norm(shapes.position - exact.position, axis=-1).max(axis=-1)
        ratios += list((error / trunk.length / shapes.defect)[shapes.defect > 1e-8])
    assert len(ratios) > 50
    # Now and then |q| keeps its length by chance, and the defect says less than the error.
    low, middle, high = np.percentile(ratios, [1, 50, 99])
    assert low > 0.1
    assert 0.2 < middle < 5
    assert high < 50


@pytest.mark.parametrize("steps", [1, 3])
@pytest.mark.parametrize("load", ["heavy tip", "contact"])
def test_shapes_that_the_steps_do_not_resolve_are_solved_with_more(
    trunk, draw, monkeypatch, load, steps
):
    activation, psi, load = draw(trunk, 30, seed=112, strongest=3.0), heads(30, 113), LOADS[load]
    coarse = ShapeMap(trunk, load, steps=steps)
    shapes = coarse(activation, psi)
    assert shapes.defect.max() < 1e-7
    fine = ShapeMap(trunk, load, at=coarse.Z, steps=24)(activation, psi)
    # Of few steps, those that pass are the least accurate ones: see PointShapes.defect.
    assert distance(shapes.position, at_points(fine, coarse.Z).position) < 1e-5
    monkeypatch.setattr(shape_map, "MAX_HALVINGS", 0)
    with pytest.raises(StaticsError, match=r"bends too sharply") as caught:
        ShapeMap(trunk, load, steps=steps)(activation, psi)
    assert caught.value.load_fraction == 1


def test_the_defect_is_the_excess_of_the_squared_norm():
    assert point_with(np.array([0.6, 0.8, 0.0, 0.0])).defect == pytest.approx(0, abs=1e-15)
    assert point_with(np.array([1.1, 0.0, 0.0, 0.0])).defect == pytest.approx(0.21)
    assert np.isnan(point_with(np.full(4, np.nan)).defect)


# --- points, batches, starts --------------------------------------------------------


def test_points_asked_for_are_reported_and_change_nothing(trunk, draw):
    activation, psi, load = draw(trunk, 5, seed=114), heads(5, 115), LOADS["contact"]
    plain = ShapeMap(trunk, load)
    asked = ShapeMap(trunk, load, at=[1.6, 0.1, 0.1, 1.75, 0.0])
    assert {0.0, 0.1, 1.3, 1.6, 1.75, *trunk.edges} <= {*asked.Z}
    assert np.all(np.diff(asked.Z) > 0)
    assert (asked.Z[0], asked.Z[-1]) == (0.0, trunk.length)
    more = asked(activation, psi)
    assert more.path.shape == (5, asked.Z.size, 10)
    fewer = at_points(more, plain.Z)
    assert distance(fewer.position, plain(activation, psi).position) < 1e-6


@pytest.mark.parametrize("threads", [2, 3, 50])
def test_results_do_not_depend_on_threads(trunk, draw, threads):
    activation, psi = draw(trunk, 20, seed=116), heads(20, 117)
    one, many = (ShapeMap(trunk, LOADS["contact"], threads=n) for n in (1, threads))
    np.testing.assert_array_equal(one.unloaded(activation).path, many.unloaded(activation).path)
    shapes = one(activation, psi)
    np.testing.assert_array_equal(shapes.path, many(activation, psi).path)
    for a, b in zip(*(f.jacobian(shapes, activation, psi) for f in (one, many)), strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("steps", [1, 6])
def test_a_batch_is_its_members(trunk, draw, steps):
    activation, psi = draw(trunk, 6, seed=118).reshape(2, 3, 28), heads(3, 119)
    solve = ShapeMap(trunk, LOADS["contact"], steps=steps)
    shapes = solve(activation, psi)
    slopes = solve.jacobian(shapes, activation, psi)
    n = solve.Z.size
    assert shapes.path.shape == (2, 3, n, 10)
    assert shapes.directors.shape == (2, 3, n, 3, 3)
    assert shapes.defect.shape == (2, 3)
    assert [slope.shape for slope in slopes] == [(2, 3, n, 3, 30)] * 2
    for i, j in np.ndindex(2, 3):
        one = solve(activation[i, j], psi[j])
        np.testing.assert_allclose(shapes.path[i, j], one.path, rtol=0, atol=1e-10)
        for whole, part in zip(slopes, solve.jacobian(one, activation[i, j], psi[j]), strict=True):
            np.testing.assert_allclose(whole[i, j], part, rtol=0, atol=1e-9)


def test_heads_alone_may_make_a_batch_and_a_batch_may_be_empty(trunk):
    solve = ShapeMap(trunk)
    assert solve(REST, heads(4, 120)).path.shape == (4, solve.Z.size, 10)
    nothing = solve(np.zeros((0, 28)))
    assert nothing.path.shape == (0, solve.Z.size, 10)
    assert solve.jacobian(nothing, np.zeros((0, 28)))[0].shape == (0, solve.Z.size, 3, 30)


def test_a_rod_without_muscles_has_a_shape_too(build):
    rod = build(taper_deg=1.0)
    shapes = ShapeMap(rod)(np.zeros(0), (0.0, 0.9))
    expected = solve_statics(rod, np.zeros(0), (0.0, 0.9))
    assert distance(shapes.position, expected.position(shapes.Z)) < 1e-6


@pytest.mark.parametrize("steps", [1, 6])
@pytest.mark.parametrize("start", ["itself", "near", "another", "one for all"])
def test_from_any_start_the_shape_is_the_same(trunk, draw, start, steps):
    activation, psi = draw(trunk, 20, seed=121), heads(20, 122)
    solve = ShapeMap(trunk, steps=steps)
    cold = polished(solve, activation, psi)
    given = {
        "itself": lambda: cold,
        "near": lambda: solve(0.95 * activation, psi + 0.02),
        "another": lambda: solve(draw(trunk, 20, seed=123), heads(20, 124)),
        "one for all": lambda: solve(REST),
    }[start]()
    before = given.path.copy()
    warm = solve(activation, psi, start=given)
    warm = solve(activation, psi, start=warm)
    np.testing.assert_allclose(warm.path, cold.path, rtol=0, atol=1e-8)
    np.testing.assert_array_equal(given.path, before)  # the caller's own
    assert not np.shares_memory(warm.path, given.path)


def test_a_start_keeps_its_branch_though_the_steps_are_refined(trunk):
    """A trunk pushed up and back has several equilibria; coarse steps resolve none of them."""
    coarse = ShapeMap(trunk, Loads(tip_force=(-100.0, 0.0, -500.0)), steps=3)
    known = None
    for side in np.linspace(200, 0, 11):  # another branch, by a side force that vanishes
        fine = ShapeMap(trunk, Loads(tip_force=(-100.0, side, -500.0)), at=coarse.Z, steps=48)
        known = fine(REST, start=known)
    there = at_points(known, coarse.Z)
    assert distance(coarse(REST).position, there.position) > 0.5
    assert distance(coarse(REST, start=there).position, there.position) < 1e-5
    found, expected = coarse.jacobian(there, REST), fine.jacobian(known, REST)
    index = np.searchsorted(fine.Z, coarse.Z)
    for slope, value in zip(found, expected, strict=True):
        assert np.abs(slope - value[index]).max() < 1e-3 * np.abs(value).max()


# --- unloaded shapes ----------------------------------------------------------------


MUSCLE = {"radii_over_length": (0.01, 0.05), "sides": ("R",), "sector": (0.0, 1.0)}
TWO_MUSCLES = (
    MUSCLE | {"group": "dl", "architecture": "longitudinal"},
    MUSCLE | {"group": "he", "architecture": "helical", "helix_deg": 40.0},
)


@pytest.mark.parametrize("taper_deg", [0.0, 1e-9, 1e-4, 1.0, 2.8])
@pytest.mark.parametrize("strength", [0.0, 1e-14, 1e-9, 1e-4, 0.02, 1.0])
def test_unloaded_shapes_are_the_closed_form_in_every_limit(build, taper_deg, strength):
    parts = [{"Z_over_length": Z, "muscles": TWO_MUSCLES} for Z in ((0.0, 0.4), (0.4, 1.0))]
    rod = build(tuple(parts), taper_deg=taper_deg)
    activation, psi = strength * np.array([-0.5, -0.3, -0.1, -0.6]), (0.3, -0.2)
    shapes = ShapeMap(rod, at=[1e-9, 0.17]).unloaded(activation, psi)
    r, q = unloaded_states(rod, activation, np.array(psi), shapes.Z)
    np.testing.assert_allclose(shapes.position, r, rtol=0, atol=1e-13)
    np.testing.assert_allclose(shapes.orientation, q, rtol=0, atol=1e-13)
    assert not shapes.moment.any()


def test_unloaded_shapes_of_the_elephant_are_the_closed_form(trunk, draw):
    activation, psi = draw(trunk, 40, seed=125, strongest=3.0).reshape(8, 5, 28), heads(5, 126)
    shapes = ShapeMap(trunk, LOADS["contact"]).unloaded(activation, psi)
    r, q = unloaded_states(trunk, activation, psi, shapes.Z)
    np.testing.assert_allclose(shapes.position, r, rtol=0, atol=1e-13)
    np.testing.assert_allclose(shapes.orientation, q, rtol=0, atol=1e-13)


# --- Jacobian -----------------------------------------------------------------------


@every_load
def test_at_the_tip_the_jacobian_is_that_of_the_collocated_trunk(trunk, draw, load):
    solve, mesh = ShapeMap(trunk, load, steps=12), mesh_for(trunk, load.contact_from, 12, 8)
    for activation, psi in zip(draw(trunk, 4, seed=127), heads(4, 128), strict=True):
        shapes = polished(solve, activation, psi)
        found = solve.jacobian(shapes, activation, psi)
        known = solve_statics(trunk, activation, psi, load, mesh)
        expected = tip_jacobian(known, activation, psi, load)
        for slope, value in zip(found, expected, strict=True):
            np.testing.assert_allclose(slope[-1], value, rtol=0, atol=1e-6)


@pytest.mark.parametrize(("load", "steps"), [("weight", 6), ("weight", 12), ("contact", 12)])
def test_at_every_point_the_jacobian_agrees_with_differences_of_shapes(trunk, draw, load, steps):
    """It is the derivative of the integrated trunk, not of the exact one."""
    solve = ShapeMap(trunk, LOADS[load], at=[0.3, 1.5], steps=steps)
    x, h = np.hstack([draw(trunk, 3, seed=129), heads(3, 130)]), 1e-3
    shapes = polished(solve, x[:, :-2], x[:, -2:])
    found = np.concatenate(solve.jacobian(shapes, x[:, :-2], x[:, -2:]), axis=-2)
    varied = x + h * np.array([-2, -1, 1, 2])[:, None, None, None] * np.eye(30)[:, None]
    near = polished(solve, varied[..., :-2], varied[..., -2:])  # (4, 30, 3)
    values = np.concatenate([near.position, near.directors[..., 2, :]], axis=-1)
    expected = (values[0] - 8 * values[1] + 8 * values[2] - values[3]) / (12 * h)
    # h^4 = 1e-12 times fifth derivatives, and 1e-13 / h of rounding.
    np.testing.assert_allclose(found, np.moveaxis(expected, 0, -1), rtol=0, atol=1e-8)


@pytest.mark.parametrize("steps", [1, 3])
@pytest.mark.parametrize("load", ["heavy tip", "contact"])
def test_the_jacobian_of_a_refined_shape_is_that_of_fine_steps(trunk, draw, load, steps):
    activation, psi, load = draw(trunk, 10, seed=131, strongest=3.0), heads(10, 132), LOADS[load]
    coarse = ShapeMap(trunk, load, steps=steps)
    fine = ShapeMap(trunk, load, at=coarse.Z, steps=24)
    index = np.searchsorted(fine.Z, coarse.Z)
    found = coarse.jacobian(coarse(activation, psi), activation, psi)
    expected = fine.jacobian(fine(activation, psi), activation, psi)
    for slope, value in zip(found, expected, strict=True):
        assert np.abs(slope - value[:, index]).max() < 1e-4 * np.abs(value).max()


def test_shapes_may_be_shared_by_a_batch_of_jacobians(trunk):
    solve = ShapeMap(trunk)
    shapes = solve(REST)
    position, _ = solve.jacobian(shapes, np.zeros((2, 28)))
    np.testing.assert_array_equal(position[0], position[1])
    np.testing.assert_array_equal(position[0], solve.jacobian(shapes, REST)[0])


# --- errors -------------------------------------------------------------------------


BAD = {
    "too few muscles": ({"activation": np.zeros(27)}, "activation.*28"),
    "activation is nan": ({"activation": np.full(28, np.nan)}, "activation.*finite"),
    "activation collapses": ({"activation": np.full(28, -5.0)}, "extension must stay above 0"),
    "three head angles": ({"head": (0.0, 0.0, 0.0)}, "head.*psi_Z, psi_Y"),
    "head is nan": ({"head": (np.nan, 0.0)}, "head.*finite"),
    "axes differ": ({"activation": np.zeros((2, 28)), "head": np.zeros((3, 2))}, "leading axes"),
}


@pytest.mark.parametrize("case", BAD)
@pytest.mark.parametrize("what", ["__call__", "unloaded", "jacobian"])
def test_a_bad_argument_is_named(trunk, case, what):
    changes, message = BAD[case]
    solve = ShapeMap(trunk)
    first = {"shapes": solve.unloaded(REST)} if what == "jacobian" else {}
    with pytest.raises(InputError, match=message):
        getattr(solve, what)(**(first | {"activation": REST} | changes))


@pytest.mark.parametrize("Z", [-1e-6, 1.7501, np.nan, np.inf])
def test_a_point_off_the_trunk_is_refused(trunk, Z):
    with pytest.raises(InputError, match=r"expected (0 <= Z <= L = 1\.75 m|a sequence of numbers)"):
        ShapeMap(trunk, at=[0.5, Z])


@pytest.mark.parametrize("Z_w", [-0.1, 1.75, 5.0])
def test_contact_off_the_trunk_is_refused(trunk, Z_w):
    with pytest.raises(InputError, match="contact_from"):
        ShapeMap(trunk, Loads(contact_from=Z_w))


def test_shapes_of_other_points_or_batches_are_refused(trunk):
    solve, two = ShapeMap(trunk), np.zeros((2, 28))
    other = ShapeMap(trunk, at=[0.123])(REST)
    for given in (other, solve_statics(trunk, REST)):
        with pytest.raises(InputError, match="shapes: expected"):
            solve(REST, start=given)
        with pytest.raises(InputError, match="shapes: expected"):
            solve.jacobian(given, REST)
    for activation in (REST, np.zeros((3, 28))):
        with pytest.raises(InputError, match="start: expected shapes with leading axes"):
            solve(activation, start=solve(two))
    with pytest.raises(InputError, match="leading axes that match"):
        solve.jacobian(solve(two), np.zeros((3, 28)))


def test_the_jacobian_of_many_shapes_of_one_activation_is_theirs(trunk):
    solve = ShapeMap(trunk)
    two = solve(np.zeros((2, 28)))
    for many, one in zip(solve.jacobian(two, REST), solve.jacobian(solve(REST), REST), strict=True):
        np.testing.assert_allclose(many, np.stack([one, one]), atol=1e-12)


MAP_ARGUMENTS = {
    "a name": ({"trunk": "asian-elephant"}, "trunk = .*: expected a Trunk"),
    "several loads": ({"loads": [Loads()]}, "loads = .*: expected Loads or None; Loads"),
    "no steps": ({"steps": 0}, "steps = 0: expected a whole number from 1"),
    "half a step": ({"steps": 2.5}, r"steps = 2\.5: expected a whole number"),
    "no threads": ({"threads": 0}, "threads = 0: expected a whole number"),
    "one point": ({"at": 0.9}, r"at = 0\.9: expected a sequence"),
}


@pytest.mark.parametrize("case", MAP_ARGUMENTS)
def test_a_bad_argument_of_the_map_is_named(trunk, case):
    changes, message = MAP_ARGUMENTS[case]
    with pytest.raises(InputError, match=message):
        ShapeMap(**({"trunk": trunk} | changes))


def test_shapes_are_indexed_by_the_axes_of_the_batch(trunk, draw):
    shapes = ShapeMap(trunk)(draw(trunk, 6, seed=136).reshape(2, 3, 28))
    np.testing.assert_array_equal(shapes[1].path, shapes.path[1])
    np.testing.assert_array_equal(shapes[1, 2].path, shapes.path[1, 2])
    np.testing.assert_array_equal(shapes[:, shapes[0].found].path, shapes.path)
    with pytest.raises(IndexError):
        shapes[1, 2, 0]


def test_an_activation_that_collapses_is_named_or_left_out(trunk):
    activation = np.zeros((2, 3, 28))
    activation[1, 2] = -5.0
    with pytest.raises(InputError, match=r"activation\[1, 2\]: contracts a segment"):
        ShapeMap(trunk)(activation)
    shapes = ShapeMap(trunk, strict=False)(activation)
    assert shapes.found.tolist() == [[True] * 3, [True, True, False]]
    np.testing.assert_allclose(shapes.path[0], ShapeMap(trunk)(activation[0]).path, atol=1e-12)


def test_where_no_equilibrium_is_found_the_error_says_how_far_it_got(trunk):
    # 29 kN m on a trunk of 1.5 kN m^2 at the base and 50 N m^2 at Z_w: some thirty turns.
    load = Loads(contact_from=1.4, contact_couple=(2e4, 2e4, 7e3))
    for solve in (ShapeMap(trunk, load), partial(solve_statics, trunk, loads=load)):
        with pytest.raises(StaticsError, match=r"no equilibrium found beyond") as caught:
            solve(REST)
        assert 0 < caught.value.load_fraction < 1
        assert f"{100 * caught.value.load_fraction:.1f} %" in str(caught.value)


def test_the_error_names_the_shape_of_the_batch_that_fails(trunk, draw, monkeypatch):
    # Without loads the trunk at rest is straight, which any steps resolve; the other is not.
    monkeypatch.setattr(shape_map, "MAX_HALVINGS", 1)
    monkeypatch.setattr(shape_map, "MAX_DEFECT", 1e-14)
    activation = np.stack([REST, REST, draw(trunk, 1, seed=133)[0], REST])
    with pytest.raises(StaticsError, match=r"shape 3 of 4"):
        ShapeMap(trunk, Loads(0.0), steps=3)(activation)


def test_a_map_that_is_not_strict_leaves_out_what_it_does_not_find(trunk):
    load = Loads(contact_from=1.4, contact_couple=(3e3, 3e3, 1e3))  # many turns
    activation = -0.5 * np.random.default_rng(135).random((8, 28))
    shapes = ShapeMap(trunk, load, strict=False)(activation)
    alone = []
    for values in activation:
        try:
            alone.append(ShapeMap(trunk, load)(values).path)
        except StaticsError:
            alone.append(np.full_like(shapes.path[0], np.nan))
    missing = np.isnan(shapes.path).all(axis=(1, 2))
    assert 0 < missing.sum() < 8
    np.testing.assert_allclose(shapes.path, alone, atol=1e-12)
    # As starts, those left out count as none.
    again = ShapeMap(trunk, load, strict=False)(activation, start=shapes)
    np.testing.assert_array_equal(np.isnan(again.path).all(axis=(1, 2)), missing)
    assert distance(again.position[~missing], shapes.position[~missing]) <= 1e-6


def test_without_numba_the_error_says_what_to_install(trunk, monkeypatch):
    monkeypatch.setitem(sys.modules, "numba", None)
    monkeypatch.delitem(sys.modules, "trunk_ocp.rod.shooting_kernels")
    monkeypatch.delattr(trunk_ocp.rod, "shooting_kernels")
    with pytest.raises(TrunkError, match=r"needs numba.*pip install numba"):
        ShapeMap(trunk)


# --- translation --------------------------------------------------------------------


def translated(function):
    namespace = {}
    exec(python_source(function, "python"), namespace)
    return namespace["python"]


def test_the_integrator_is_that_of_scipy():
    known = scipy.integrate.DOP853
    np.testing.assert_array_equal(dormand_prince.A, known.A[:12, :12])
    np.testing.assert_array_equal(dormand_prince.B, known.B)
    np.testing.assert_array_equal(dormand_prince.C, known.C[:12])


def test_translated_rates_are_those_of_casadi():
    rng = np.random.default_rng(134)
    for _ in range(10):
        w, p, out = rng.uniform(0.5, 2, 15), rng.uniform(0.5, 2, 11), np.empty(10)
        translated(rates())(w, p, out)
        np.testing.assert_allclose(out, rates()(w, p).full().ravel(), rtol=1e-13)


def test_every_operation_that_is_translated_means_what_casadi_means():
    x, y = ca.SX.sym("x", 3), ca.SX.sym("y", 2, 2)
    a, b, c = ca.vertsplit(x)
    first = ca.vertcat(a + b, a - b * c, c / a, -b, a**2, 2 * c, 1 / b, 3.5, a, c - (a - b))
    function = ca.Function("f", [x, y], [first, ca.densify(ca.mtimes(y, y.T)) - a])
    values, matrix = np.array([0.7, -1.3, 2.1]), np.array([[1.0, 2.0], [3.0, -4.0]])
    one, two = np.empty(10), np.empty(4)
    translated(function)(values, matrix.ravel(order="F"), one, two)
    expected = function(values, matrix)
    np.testing.assert_allclose(one, expected[0].full().ravel(), rtol=1e-15)
    np.testing.assert_allclose(two, expected[1].full().ravel(order="F"), rtol=1e-15)


def test_an_operation_that_is_not_translated_is_refused():
    x = ca.SX.sym("x")
    with pytest.raises(TrunkError, match=r"wave: operation \d+ is not translated"):
        python_source(ca.Function("wave", [x], [ca.sin(x)]), "wave")
    y = ca.MX.sym("y")
    graph = ca.Function("graph", [y], [y + y])
    with pytest.raises(TrunkError, match="graph: expected an SX function"):
        python_source(graph, "graph")


# --- processes ----------------------------------------------------------------------


def shapes_elsewhere(solve, activation):
    """Shapes and slopes of a pickled map, and how many kernels this process compiled."""
    shapes = solve(activation)
    slopes = solve.jacobian(shapes, activation)
    kernels = (shooting.unloaded_paths, shooting.loaded_paths, shooting.tangent_paths)
    compiled = sum(sum(kernel.compiled.stats.cache_misses.values()) for kernel in kernels)
    return shapes.path, slopes, compiled


@pytest.mark.parametrize("start", ["spawn", "fork"])
def test_another_process_loads_what_is_compiled_and_finds_the_same_shapes(trunk, start):
    solve = ShapeMap(trunk, LOADS["contact"], steps=3)
    activation = np.zeros((2, 28))
    activation[1, 0] = -1.5  # bends sharply enough to need more steps
    path, slopes, _ = shapes_elsewhere(solve, activation)
    assert "_finer" in vars(solve)
    with ProcessPoolExecutor(1, multiprocessing.get_context(start)) as pool:
        elsewhere = pool.submit(shapes_elsewhere, solve, activation).result()
    np.testing.assert_array_equal(elsewhere[0], path)
    for there, here in zip(elsewhere[1], slopes, strict=True):
        np.testing.assert_array_equal(there, here)
    assert start == "fork" or elsewhere[2] == 0


def test_after_warm_up_no_call_compiles_anything(trunk):
    solve, two = ShapeMap(trunk, LOADS["contact"], steps=3, threads=2), np.zeros((2, 28))
    assert solve.warm_up() is None
    kernels = [shooting.unloaded_paths, shooting.loaded_paths, shooting.tangent_paths]
    before = [kernel.compiled.signatures for kernel in kernels]
    for shapes in (solve(two), solve(REST), solve(two, start=solve(REST)), solve.unloaded(REST)):
        solve.jacobian(shapes, REST)
        solve.jacobian(shapes, two)
    solve(np.asfortranarray(two), np.zeros((2, 2), dtype=int))
    assert [kernel.compiled.signatures for kernel in kernels] == before
    assert [len(signatures) for signatures in before] == [1, 1, 1]


@pytest.mark.parametrize("again", [copy.deepcopy, lambda map_: pickle.loads(pickle.dumps(map_))])
def test_a_copy_and_a_pickle_give_the_same_shapes(trunk, again):
    one = ShapeMap(trunk, LOADS["contact"], at=[0.3], steps=3)
    activation = np.zeros((2, 28))
    activation[1, 0] = -1.5  # bends sharply enough to need more steps
    wanted = one(activation, heads(2, 1))
    got = again(one)(activation, heads(2, 1))
    np.testing.assert_array_equal(got.path, wanted.path)
    np.testing.assert_array_equal(got.Z, wanted.Z)


# --- what no rod can be --------------------------------------------------------------


def test_a_compressed_shape_is_refused():
    trunk = thin_tipped(0.0, 0.1, 0.0)
    area, passive = math.pi * trunk.base_radius**2 * trunk.youngs_modulus, np.zeros(2)
    load = Loads(0.0, (0.0, 0.0, -1.6 * area))  # would leave -0.6 of the length
    with pytest.raises(StaticsError, match="compressed to nothing") as caught:
        ShapeMap(trunk, load)(passive)
    assert caught.value.load_fraction == pytest.approx(1 / 1.6, abs=1e-3)
    assert not ShapeMap(trunk, load, strict=False)(passive).found
    half = ShapeMap(trunk, load.scaled(0.5 / 1.6))(passive)
    np.testing.assert_allclose(half.position[-1], (0, 0, 0.05), atol=1e-9)


@pytest.mark.parametrize("Z", [0.1 * (1 + 2e-16), np.nextafter(0.1, 1), -1e-17])
def test_a_point_one_rounding_error_beyond_an_end_is_the_end(Z):
    trunk = thin_tipped(length=0.1)
    shapes = ShapeMap(trunk, Loads(0.0), at=[Z])
    np.testing.assert_array_equal(shapes.Z, ShapeMap(trunk, Loads(0.0)).Z)

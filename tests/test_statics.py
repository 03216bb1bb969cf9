"""Loaded shapes of the trunk: ends, limits, batches, hard loads, errors."""

import contextlib
import dataclasses
import math

import numpy as np
import pytest

from trunk_ocp import statics
from trunk_ocp.collocation import Mesh, mesh_for
from trunk_ocp.errors import InputError, StaticsError
from trunk_ocp.loads import Loads
from trunk_ocp.statics import solve_statics
from trunk_ocp.unloaded import unloaded_states
from trunk_ocp.verification import integrate
from trust import reference
from trust.validation.rods import EVERYTHING, heads

REST = np.zeros(28)


def test_the_free_tip_carries_no_moment(trunk, draw):
    shape = solve_statics(trunk, draw(trunk, 5, seed=42), heads(5, 43), EVERYTHING)
    assert np.abs(shape.moment([trunk.length])).max() < 1e-7  # of some 300 N m at the base


def test_without_loads_the_shape_is_the_closed_form(trunk, draw):
    activation, psi, Z = draw(trunk, 5, seed=46), heads(5, 47), np.linspace(0, 1.75, 20)
    mesh = mesh_for(trunk, elements=12, degree=8)
    shape = solve_statics(trunk, activation, psi, Loads(0.0), mesh)
    expected, _ = unloaded_states(trunk, activation, psi, Z)
    np.testing.assert_allclose(shape.position(Z), expected, rtol=0, atol=1e-9)
    assert np.abs(shape.moment(Z)).max() < 1e-9


def test_the_shape_starts_at_the_clamp(trunk, draw):
    psi = (0.3, -0.2)
    shape = solve_statics(trunk, draw(trunk, 1, seed=48)[0], psi, EVERYTHING)
    r0, d0 = reference.base(trunk, psi)
    np.testing.assert_allclose(shape.position([0.0])[0], r0, atol=1e-14)
    np.testing.assert_allclose(shape.directors([0.0])[0], d0, atol=1e-14)


def test_directions_that_change_no_strain_change_no_loaded_shape(trunk, draw):
    activation, Z = draw(trunk, 1, seed=50)[0], np.linspace(0, 1.75, 9)
    _, _, rows = np.linalg.svd(reference.strain_matrix(trunk).reshape(12, 28))
    other = activation + np.random.default_rng(51).normal(size=16) @ rows[12:]
    one, two = (solve_statics(trunk, gamma, loads=EVERYTHING) for gamma in (activation, other))
    np.testing.assert_allclose(one.position(Z), two.position(Z), atol=1e-10)


def test_a_batch_is_its_members(trunk, draw):
    activation, psi, Z = draw(trunk, 6, seed=52).reshape(2, 3, 28), heads(3, 53), [0.5, 1.75]
    loads = [dataclasses.replace(EVERYTHING, gravity=g) for g in (9.8, 5.0, 0.0)]
    for given in (EVERYTHING, loads):
        batch = solve_statics(trunk, activation, psi, given)
        assert batch.position(Z).shape == (2, 3, 2, 3)
        assert batch.directors(Z).shape == (2, 3, 2, 3, 3)
        assert batch.moment(Z).shape == (2, 3, 2, 3)
        for i, j in np.ndindex(2, 3):
            load = given if given is EVERYTHING else given[j]
            one = solve_statics(trunk, activation[i, j], psi[j], load)
            np.testing.assert_allclose(batch.position(Z)[i, j], one.position(Z), atol=1e-11)
            np.testing.assert_allclose(batch.moment(Z)[i, j], one.moment(Z), atol=1e-7)


def test_contact_regions_may_differ_on_a_mesh_that_serves_all(trunk):
    edges = sorted({*mesh_for(trunk, 1.0).edges, *mesh_for(trunk, 1.4).edges})
    loads = [Loads(contact_from=at, contact_force=(0, 0, 100.0)) for at in (1.0, 1.4)]
    batch = solve_statics(trunk, REST, loads=loads, mesh=Mesh(tuple(edges), 6))
    for tip, load in zip(batch.position([1.75])[:, 0], loads, strict=True):
        one = solve_statics(trunk, REST, loads=load)
        np.testing.assert_allclose(tip, one.position([1.75])[0], atol=1e-6)  # two meshes


def test_a_load_too_far_for_plain_newton_is_reached_in_steps(trunk, monkeypatch):
    load, Z = Loads(tip_force=(0.0, 0.0, -2000.0)), np.linspace(0, 1.75, 9)  # pushed up
    steps = []
    honest = statics._Problem.continuation  # the only seam between Newton and continuation
    monkeypatch.setattr(
        statics._Problem, "continuation", lambda self: steps.append(1) or honest(self)
    )
    shape = solve_statics(trunk, np.stack([REST, REST]), loads=[Loads(), load])
    assert len(steps) == 1  # plain Newton failed for the second rod only
    r, _, m = reference.march(trunk, REST, (0, 0), [load], shape.moment([0.0])[1, 0], Z)
    np.testing.assert_allclose(shape.position(Z)[1], r[0], atol=1e-5)
    assert np.abs(m[0, -1]).max() < 0.1  # of 3 kN m
    np.testing.assert_allclose(
        shape.position([1.75])[0, 0], (0.6720968, 0, 1.6202937), atol=1e-6
    )  # its neighbour is undisturbed


def test_where_no_equilibrium_is_found_the_error_says_how_far_it_got(trunk):
    # 29 kN m on a trunk of 1.5 kN m^2 at the base and 50 N m^2 at Z_w: some thirty turns.
    load = Loads(contact_from=1.4, contact_couple=(2e4, 2e4, 7e3))
    with pytest.raises(StaticsError, match=r"no equilibrium found beyond") as caught:
        solve_statics(trunk, REST, loads=load)
    reached = caught.value.load_fraction
    assert 0 < reached < 1
    assert f"{100 * reached:.1f} %" in str(caught.value)


def test_without_any_convergence_the_load_fraction_is_zero(trunk, monkeypatch):
    monkeypatch.setattr(statics, "MAX_ITERATIONS", 1)
    with pytest.raises(StaticsError) as caught:
        solve_statics(trunk, REST)
    assert caught.value.load_fraction == 0.0


def test_a_singular_newton_step_is_not_a_crash(trunk):
    # Heavy weight and a push from below on a trunk of 10 kPa: a Newton matrix is singular.
    soft = dataclasses.replace(trunk, youngs_modulus=1e4)
    load = Loads(tip_force=(0.0, 0.0, -1000.0))
    with contextlib.suppress(StaticsError):  # an honest refusal is as good as a shape
        shape = solve_statics(soft, REST, loads=load, mesh=mesh_for(soft))
        assert np.isfinite(shape.position([1.75])).all()


# Argument, its bad value, and words the message must have.
BAD = {
    "too few muscles": ({"activation": np.zeros(27)}, "activation.*28"),
    "activation is nan": ({"activation": np.full(28, math.nan)}, "activation.*finite"),
    "activation collapses": ({"activation": np.full(28, -5.0)}, "extension must stay above 0"),
    "three head angles": ({"head": (0.0, 0.0, 0.0)}, "head.*psi_Z, psi_Y"),
    "head is nan": ({"head": (math.nan, 0.0)}, "head.*finite"),
    "contact beyond the tip": ({"loads": Loads(contact_from=1.75)}, "contact_from"),
    "contact far beyond the tip": ({"loads": Loads(contact_from=5.0)}, "contact_from"),
    "contact before the base": ({"loads": Loads(contact_from=-0.1)}, "contact_from"),
    "no loads": ({"loads": []}, "loads"),
    "two contact regions": ({"loads": [Loads(), Loads(contact_from=1.0)]}, "one contact_from"),
    "3 loads, 2 shapes": ({"activation": np.zeros((2, 28)), "loads": [Loads()] * 3}, "loads"),
    "3 heads, 2 shapes": ({"activation": np.zeros((2, 28)), "head": np.zeros((3, 2))}, "head"),
    "mesh of another rod": ({"mesh": Mesh((0.0, 1.0), 4)}, "mesh"),
    "mesh without the jumps": ({"mesh": Mesh((0.0, 1.75), 4)}, "mesh"),
}


@pytest.mark.parametrize("case", BAD)
def test_a_bad_argument_is_named(trunk, case):
    arguments, message = BAD[case]
    with pytest.raises(InputError, match=message):
        solve_statics(trunk, **({"activation": REST} | arguments))


@pytest.mark.parametrize("Z", [-1e-6, 1.7501, math.nan, math.inf])
@pytest.mark.parametrize("what", ["position", "directors", "moment"])
def test_a_point_off_the_trunk_is_refused(trunk, Z, what):
    shape = solve_statics(trunk, REST)
    with pytest.raises(InputError, match=r"expected 0 <= Z <= L = 1\.75 m"):
        getattr(shape, what)([0.5, Z])


@pytest.mark.parametrize("push", [-1e3, -5e3])
def test_the_default_mesh_is_fine_enough_for_the_load(trunk, push):
    """A trunk pushed up buckles into a curl that a fixed mesh would get wrong unnoticed."""
    load = Loads(tip_force=(0.0, 0.0, push))
    shape = solve_statics(trunk, np.zeros(28), loads=load)
    Z = np.linspace(0.0, trunk.length, 50)
    path = integrate(trunk, np.zeros((1, 30)), [load], shape.moment([0.0]), Z)
    assert np.linalg.norm(shape.position(Z) - path.position[0], axis=1).max() < 1e-5

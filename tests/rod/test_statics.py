"""Loaded shapes of the trunk: ends, limits, batches, hard loads, errors."""

import contextlib
import dataclasses
import math

import numpy as np
import pytest
from plans import thin_tipped
from scipy.integrate import trapezoid

from trunk_ocp.codegen.shape_model import build_model
from trunk_ocp.errors import InputError, StaticsError
from trunk_ocp.model.loads import Loads
from trunk_ocp.planning.verification import integrate
from trunk_ocp.problem.build import build_motion, load_motion
from trunk_ocp.rod import continuation, newton, statics
from trunk_ocp.rod.collocation import Mesh, mesh_for
from trunk_ocp.rod.statics import solve_statics
from trunk_ocp.rod.unloaded import unloaded_states
from trust import reference
from trust.judge import Judge
from trust.validation.rods import EVERYTHING, heads

REST = np.zeros(28)


def test_a_search_that_hits_its_work_limit_says_there_may_be_an_equilibrium(monkeypatch):
    arm = thin_tipped(0.03928)  # from 20 mm to 0.36 mm
    activation, load = np.full(2, -0.1), Loads(0.0, (0.005, 0.0, 0.0))
    monkeypatch.setattr(continuation, "MAX_WORK", 20)
    with pytest.raises(
        StaticsError, match="the search reached its limit of work, so there may be one"
    ) as caught:
        solve_statics(arm, activation, loads=load)
    assert 0 <= caught.value.load_fraction < 1
    solve_statics(arm, activation, loads=load.scaled(0.25))


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


def test_contact_regions_may_differ_on_a_mesh_with_edges_for_all(trunk):
    edges = sorted({*mesh_for(trunk, 1.0).edges, *mesh_for(trunk, 1.4).edges})
    loads = [Loads(contact_from=at, contact_force=(0, 0, 100.0)) for at in (1.0, 1.4)]
    batch = solve_statics(trunk, REST, loads=loads, mesh=Mesh(tuple(edges), 6))
    for tip, load in zip(batch.position([1.75])[:, 0], loads, strict=True):
        one = solve_statics(trunk, REST, loads=load)
        np.testing.assert_allclose(tip, one.position([1.75])[0], atol=1e-6)  # two meshes


def test_a_load_too_far_for_plain_newton_is_reached_in_steps(trunk, monkeypatch):
    load, Z = Loads(tip_force=(0.0, 0.0, -2000.0)), np.linspace(0, 1.75, 9)  # pushed up
    steps = []
    raise_load = statics.raise_load
    monkeypatch.setattr(statics, "raise_load", lambda *a: steps.append(1) or raise_load(*a))
    shape = solve_statics(trunk, np.stack([REST, REST]), loads=[Loads(), load])
    assert len(steps) == 1  # for the second rod only, and not again on each finer mesh
    r, _, m = reference.march(trunk, REST, (0, 0), [load], shape.moment([0.0])[1, 0], Z)
    np.testing.assert_allclose(shape.position(Z)[1], r[0], atol=1e-5)
    assert np.abs(m[0, -1]).max() < 0.1  # of 3 kN m
    np.testing.assert_allclose(
        shape.position([1.75])[0, 0], (0.6720968, 0, 1.6202937), atol=1e-6
    )  # its neighbor is undisturbed


def test_where_no_equilibrium_is_found_the_error_says_how_far_it_got(trunk):
    # 29 kN m on a trunk of 1.5 kN m^2 at the base and 50 N m^2 at Z_w: some thirty turns.
    load = Loads(contact_from=1.4, contact_couple=(2e4, 2e4, 7e3))
    with pytest.raises(StaticsError, match=r"no equilibrium found beyond") as caught:
        solve_statics(trunk, REST, loads=load)
    reached = caught.value.load_fraction
    assert 0 < reached < 1
    assert f"{100 * reached:.1f} %" in str(caught.value)


def test_without_any_convergence_the_load_fraction_is_zero(trunk, monkeypatch):
    monkeypatch.setattr(newton, "MAX_ITERATIONS", 1)
    with pytest.raises(StaticsError) as caught:
        solve_statics(trunk, REST)
    assert caught.value.load_fraction == 0.0


def test_a_singular_newton_step_is_not_a_crash(trunk):
    # Heavy weight and a push from below on a trunk of 10 kPa: a Newton matrix is singular.
    soft = dataclasses.replace(trunk, youngs_modulus=1e4)
    load = Loads(tip_force=(0.0, 0.0, -1000.0))
    with contextlib.suppress(StaticsError):  # to refuse it is fine as well
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


@pytest.mark.parametrize("Z", ["a", ["a"], [[1.0]], [1.0, [2.0]], 1j])
def test_a_point_that_is_not_a_number_is_refused(trunk, Z):
    expected = "(points of the trunk in m|an array of real numbers)"
    with pytest.raises(InputError, match=f"Z = .*: expected {expected}"):
        solve_statics(trunk, REST).position(Z)


@pytest.mark.parametrize("push", [-1e3, -5e3])
def test_the_default_mesh_is_fine_enough_for_the_load(trunk, push):
    """A trunk pushed up buckles into a curl that a fixed mesh would get wrong unnoticed."""
    load = Loads(tip_force=(0.0, 0.0, push))
    shape = solve_statics(trunk, np.zeros(28), loads=load)
    Z = np.linspace(0.0, trunk.length, 50)
    path = integrate(trunk, np.zeros((1, 30)), [load], shape.moment([0.0]), Z)
    assert np.linalg.norm(shape.position(Z) - path.position[0], axis=1).max() < 1e-5


# --- strong taper, thrusts and pulls ------------------------------------------------------


@pytest.mark.parametrize("elements", [6, 24, 96])
def test_a_thin_tip_under_load_has_its_shape_on_any_mesh(elements):
    arm = thin_tipped()
    load, activation = Loads(tip_force=(0.0, 0.0, 0.049)), np.array([-0.1, -0.03])
    shape = solve_statics(arm, activation, loads=load, mesh=mesh_for(arm, None, elements))
    off = Judge(arm, activation, np.zeros(2), load).error(shape)
    assert off is not None
    assert off < (1e-5 if elements == 6 else 1e-7)


@pytest.mark.parametrize("force", [(1e5, 0.0, 0.0), (0.0, 0.0, 1e5), (3e4, 5e4, -8e4)])
def test_a_strong_pull_is_resolved_where_it_bends_the_trunk(trunk, force):
    load = Loads(tip_force=force)
    shape = solve_statics(trunk, REST, loads=load)
    assert shape.defect < 1e-5
    way = np.array(force) / np.linalg.norm(force)
    np.testing.assert_allclose(shape.directors([1.75])[0, 2], way, atol=0.02)  # a string, nearly
    assert shape.extension.max() > 5
    # d(r)/dZ of a string of E A(Z): 1 + F / (E A).
    grown = force @ (shape.position([1.75])[0] - shape.position([0.0])[0]) / np.linalg.norm(force)
    Z = np.linspace(0, 1.75, 2001)
    string = 1 + np.linalg.norm(force) / (trunk.youngs_modulus * np.pi * trunk.radius(Z) ** 2)
    assert grown == pytest.approx(trapezoid(string, Z), rel=0.05)


def test_a_thrust_that_leaves_nothing_of_the_length_is_refused():
    """A soft 10 cm arm under 50 N: 1 + n_3 / (E A) would be -0.6 all along."""
    soft = thin_tipped(0.0, 0.1, 0.0)
    push = 1.6 * soft.youngs_modulus * np.pi * soft.base_radius**2
    for mesh in (None, mesh_for(soft)):
        with pytest.raises(
            StaticsError, match="compress part of the trunk to nothing beyond"
        ) as it:
            solve_statics(soft, np.zeros(2), loads=Loads(0.0, (0.0, 0.0, -push)), mesh=mesh)
        assert it.value.load_fraction == pytest.approx(1 / 1.6, abs=1e-3)
    half = solve_statics(soft, np.zeros(2), loads=Loads(0.0, (0.0, 0.0, -push / 3.2)))
    np.testing.assert_allclose(half.extension, 0.5, atol=1e-9)


@pytest.mark.parametrize("size", [3e7, 1e8, 1e9])
@pytest.mark.parametrize("way", [(1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, -1.0)])
def test_an_enormous_tip_force_gives_no_trunk_of_zero_length(trunk, size, way):
    load = Loads(tip_force=tuple(size * np.array(way)))
    with contextlib.suppress(StaticsError):  # or else a string of the length that E A says
        shape = solve_statics(trunk, REST, loads=load, mesh=mesh_for(trunk, None, 24))
        assert shape.defect <= 0.95
        assert np.linalg.norm(shape.position([1.75])) > size / 1e6


def test_a_rod_that_needs_a_fine_mesh_does_not_change_the_others_of_its_batch(trunk):
    loads = [Loads(), Loads(tip_force=(1e5, 0.0, 0.0))]
    both = solve_statics(trunk, np.stack([REST, REST]), loads=loads)
    for own, load in zip(both.position([0.9, 1.75]), loads, strict=True):
        np.testing.assert_allclose(
            own, solve_statics(trunk, REST, loads=load).position([0.9, 1.75]), atol=1e-5
        )


@pytest.mark.parametrize("Z", [1.75 * (1 + 2e-16), np.nextafter(1.75, 2), -1e-17, -1e-13])
def test_a_point_one_rounding_error_beyond_an_end_is_the_end(trunk, Z):
    shape = solve_statics(trunk, REST)
    end = 0.0 if Z < 1 else 1.75
    for what in ("position", "directors", "moment", "state"):
        np.testing.assert_array_equal(getattr(shape, what)([Z]), getattr(shape, what)([end]))
    assert build_model(trunk, [Z]).Z == (end,)
    spec = load_motion("pick-fruit").spec
    phase = spec.phases[0]
    target = phase.targets[0].model_copy(update={"Z": float(Z)})
    phase = phase.model_copy(update={"targets": (target,)})
    spec = spec.model_copy(update={"phases": (phase, *spec.phases[1:])})
    motion = build_motion(spec, load_motion("pick-fruit").anatomy)
    assert motion.steps[0].targets[0].Z == end


def test_a_point_just_off_the_trunk_is_quoted_with_all_its_digits(trunk):
    with pytest.raises(InputError, match=r"Z = 1\.7500001: expected 0 <= Z <= L = 1\.75 m"):
        solve_statics(trunk, REST).position([1.7500001])

"""The integrators that judge every plan, against a third one."""

import numpy as np
import pytest

from trunk_ocp.model.loads import Loads
from trunk_ocp.planning.two_point import equilibria
from trunk_ocp.planning.verification import integrate
from trunk_ocp.rod.collocation import mesh_for
from trunk_ocp.rod.statics import solve_statics
from trust import reference

Z = np.unique(np.append(np.linspace(0, 1.75, 11), [0.875, 1.4, 1.4875]))
LOADS = [
    Loads(9.8, (20.0, -30.0, 40.0), 1.4, (10.0, 20.0, 100.0), (-60.0, 20.0, 10.0)),
    Loads(0.0, (0.0, 5.0, 0.0), 1.4, (0.0, 0.0, 144.5), (0.0, 0.0, 0.0)),
    Loads(9.8, (0.0, 0.0, 0.0), 1.4, (0.0, 0.0, 0.0), (-113.8, 0.0, 0.0)),
]


@pytest.fixture(scope="module")
def rods(trunk, draw):
    """Unknowns x (3, 30) and base moments (3, 3) of the size that plans have."""
    rng = np.random.default_rng(60)
    x = np.hstack([draw(trunk, 3, seed=61), rng.uniform(-0.5, 0.5, (3, 2))])
    return x, rng.normal(0, 150, (3, 3))


@pytest.mark.parametrize("method", ["LSODA", "Radau"])
def test_it_agrees_with_a_third_integrator(trunk, rods, method):
    x, moment = rods
    path = integrate(trunk, x, LOADS, moment, Z)
    # Radau is of order 5: 1e-9 a step is what it does in reasonable time, some 100 steps.
    rtol = 1e-11 if method == "LSODA" else 3e-10
    count = 3 if method == "LSODA" else 1
    r, d, m = reference.march(
        trunk, x[:count, :28], x[:count, 28:], LOADS[:count], moment[:count], Z,
        method=method, rtol=rtol, atol=rtol,
    )  # fmt: skip
    assert np.abs(path.position[:count] - r).max() < 1e-8
    assert np.abs(path.directors[:count] - d).max() < 1e-7
    assert np.abs(path.moment[:count] - m).max() < 1e-5  # of some 100 N m


@pytest.fixture(scope="module")
def equilibrium(trunk, rods):
    """The equilibria (3,) of the check, found from shapes on a coarse mesh."""
    x, _ = rods
    mesh = mesh_for(trunk, 1.4, 4, 4)
    shapes = solve_statics(trunk, x[:, :28], x[:, 28:], LOADS, mesh)
    path = equilibria(trunk, x, LOADS, shapes, Z)
    assert np.linalg.norm(path.position - shapes.position(Z), axis=2).max() > 1e-5
    return path


def test_the_equilibria_of_the_check_are_those_of_a_third_integrator(trunk, rods, equilibrium):
    (x, _), path = rods, equilibrium
    start = path.moment[:, 0]
    r, d, m = reference.march(
        trunk, x[:, :28], x[:, 28:], LOADS, start, Z, method="LSODA", rtol=1e-11, atol=1e-11
    )
    # Errors of m(0), 1e-8 of it, grow along the trunk.
    assert np.abs(path.position - r).max() < 1e-7
    assert np.abs(path.directors - d).max() < 1e-6
    assert np.abs(path.moment - m).max() < 1e-4  # of some 100 N m
    assert np.abs(path.moment[:, -1]).max() < 1e-6


def test_each_rod_is_integrated_as_if_alone(trunk, rods):
    x, moment = rods
    together = integrate(trunk, x, LOADS, moment, Z)
    for t in range(3):
        alone = integrate(trunk, x[t : t + 1], LOADS[t : t + 1], moment[t : t + 1], Z)
        # Step sizes differ: 1e-10 a step.
        np.testing.assert_allclose(together.position[t], alone.position[0], atol=1e-8)


def test_rods_may_touch_at_different_places(trunk, rods):
    x, moment = rods
    loads = [
        Loads(9.8, contact_from=at, contact_force=(0, 0, 50.0), contact_couple=(0, 30.0, 0))
        for at in (0.5, 1.4)
    ] + [Loads()]
    path = integrate(trunk, x, loads, moment, Z)
    for t, load in enumerate(loads):
        r, _, m = reference.march(trunk, x[t, :28], x[t, 28:], [load], moment[t], Z)
        np.testing.assert_allclose(path.position[t], r[0], atol=1e-8)
        np.testing.assert_allclose(path.moment[t], m[0], atol=1e-5)


def test_it_starts_at_the_clamp_with_the_moment_given(trunk, rods):
    x, moment = rods
    path = integrate(trunk, x, LOADS, moment, Z)
    for t in range(3):
        r0, d0 = reference.base(trunk, x[t, 28:])
        np.testing.assert_allclose(path.position[t, 0], r0, atol=1e-14)
        np.testing.assert_allclose(path.directors[t, 0], d0, atol=1e-14)
    np.testing.assert_array_equal(path.moment[:, 0], moment)


def test_frames_stay_orthonormal(trunk, rods):
    x, moment = rods
    d = integrate(trunk, x, LOADS, moment, Z).directors
    gram = d @ d.swapaxes(-1, -2)
    np.testing.assert_allclose(gram, np.broadcast_to(np.eye(3), gram.shape), atol=1e-8)


def test_points_off_the_edges_and_a_single_point_are_reached(trunk, rods):
    x, moment = rods
    whole = integrate(trunk, x, LOADS, moment, Z)
    tip = integrate(trunk, x, LOADS, moment, np.array([1.75]))
    np.testing.assert_allclose(tip.position[:, 0], whole.position[:, -1], atol=1e-8)
    assert tip.position.shape == (3, 1, 3)

"""The Jacobian of the tip is that of the shapes statics computes."""

import numpy as np
import pytest

from trunk_ocp import Loads, solve_statics, tip_jacobian
from trunk_ocp.rod.collocation import mesh_for

LOADS = Loads(
    tip_force=(20.0, -15.0, 30.0),
    contact_from=1.4,
    contact_force=(0.0, 10.0, 150.0),
    contact_couple=(-60.0, 5.0, 0.0),
)


def tip(trunk, x, loads, mesh):
    shape = solve_statics(trunk, x[..., :-2], x[..., -2:], loads, mesh)
    end = np.array([trunk.length])
    return np.concatenate([shape.position(end)[..., 0, :], shape.directors(end)[..., 0, 2, :]], -1)


@pytest.mark.parametrize("loads", [Loads(), LOADS], ids=["weight", "all loads"])
@pytest.mark.parametrize("degree", [2, 6])
def test_it_agrees_with_differences_of_shapes(trunk, draw, loads, degree):
    """On any mesh: it is the derivative of the collocated trunk, not of the exact one."""
    rng = np.random.default_rng(3)
    for activation in draw(trunk, 3, seed=11):
        x = np.append(activation, rng.uniform(-0.2, 0.2, 2))
        mesh = mesh_for(trunk, loads.contact_from, 4, degree)
        shape = solve_statics(trunk, x[:-2], x[-2:], loads, mesh)
        position, tangent = tip_jacobian(shape, x[:-2], x[-2:], loads)
        h = 1e-4
        steps = h * np.eye(30)
        points = np.concatenate([x + k * steps for k in (-2, -1, 1, 2)])
        tips = tip(trunk, points, loads, mesh).reshape(4, 30, 6)
        expected = (tips[0] - 8 * tips[1] + 8 * tips[2] - tips[3]) / (12 * h)
        # Fourth-order differences: h^4 = 1e-16 times fifth derivatives, and 1e-12 / h rounding.
        np.testing.assert_allclose(np.concatenate([position, tangent]), expected.T, atol=2e-8)


def test_the_tangent_turns_about_itself_only_sideways(trunk, draw):
    """|d_3| stays 1."""
    (activation,) = draw(trunk, 1, seed=5)
    shape = solve_statics(trunk, activation, (0.1, 0.2))
    _, tangent = tip_jacobian(shape, activation, (0.1, 0.2), Loads())
    d3 = shape.directors(np.array([trunk.length]))[0, 2]
    assert np.abs(d3 @ tangent).max() < 1e-10


def test_turning_the_head_about_the_vertical_turns_the_tip_with_it(trunk, draw):
    """All loads hang along e_Z, so psi_Z moves the whole trunk rigidly about the pivot."""
    (activation,) = draw(trunk, 1, seed=6)
    head = (0.3, -0.1)
    shape = solve_statics(trunk, activation, head)
    position, tangent = tip_jacobian(shape, activation, head, Loads())
    r, d3 = shape.position([trunk.length])[0], shape.directors([trunk.length])[0, 2]
    # S of eq. (35): a quarter of the length behind the resting base, 100 degrees from e_Z.
    pivot = -0.4375 * np.array([np.sin(np.radians(100)), 0, np.cos(np.radians(100))])
    e_z = np.array([0.0, 0, 1])
    np.testing.assert_allclose(position[:, -2], np.cross(e_z, r - pivot), atol=1e-9)
    np.testing.assert_allclose(tangent[:, -2], np.cross(e_z, d3), atol=1e-9)

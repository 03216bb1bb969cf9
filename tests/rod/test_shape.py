"""Sampling of shapes: strains, stacks of shapes, other meshes."""

import numpy as np
import pytest

from trunk_ocp.errors import InputError
from trunk_ocp.rod.collocation import mesh_for
from trunk_ocp.rod.shape import Shape
from trunk_ocp.rod.statics import solve_statics
from trust import reference
from trust.validation.rods import CONTACT, EVERYTHING, heads


@pytest.fixture(scope="module")
def shapes(trunk, draw):
    """Three shapes under every load, on a fine mesh, and their activations."""
    activation = draw(trunk, 3, seed=60)
    mesh = mesh_for(trunk, CONTACT, elements=12, degree=8)
    return solve_statics(trunk, activation, heads(3, 61), EVERYTHING, mesh), activation


def slope(function, Z, h=1e-3):
    """Derivative by fourth-order differences; their errors are some 1e-9 here."""
    values = [function(Z + k * h) for k in (-2, -1, 1, 2)]
    return (values[0] - 8 * values[1] + 8 * values[2] - values[3]) / (12 * h)


def test_strains_are_those_of_the_centerline_and_of_the_directors(trunk, shapes):
    shape, activation = shapes
    Z = np.array([0.2, 0.7, 1.0, 1.3, 1.45, 1.6, 1.7])  # away from jumps
    zeta, u = shape.strain(Z)
    stretch = np.linalg.norm(slope(shape.position, Z), axis=-1)
    np.testing.assert_allclose(zeta, stretch, rtol=1e-7)
    # Eq. (14), d_i' = zeta_hat u x d_i: u_1 = d_2' . d_3 / zeta_hat, and cyclic.
    d, turn = shape.directors(Z), slope(shape.directors, Z)
    segment = np.searchsorted(trunk.edges[1:-1], Z)
    zeta_hat = reference.strains(trunk, activation)[:, segment, 0]
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        expected = np.sum(turn[..., j, :] * d[..., k, :], axis=-1) / zeta_hat
        np.testing.assert_allclose(u[..., i], expected, atol=1e-6)


def test_at_gauss_points_the_extension_is_that_of_the_equations(shapes):
    shape, _ = shapes
    zeta, _ = shape.strain(shape.mesh.points.ravel())
    np.testing.assert_allclose(zeta, shape.extension.reshape(3, -1), rtol=1e-12)


def test_single_shapes_stack_to_their_batch(shapes):
    shape, _ = shapes
    stacked, Z = Shape.stack([shape[i] for i in range(3)]), np.linspace(0, 1.75, 9)
    np.testing.assert_array_equal(stacked.position(Z), shape.position(Z))
    np.testing.assert_array_equal(stacked.moment(Z), shape.moment(Z))
    np.testing.assert_array_equal(stacked.strain(Z)[1], shape.strain(Z)[1])


def test_shapes_of_several_meshes_stack_on_one(trunk, shapes):
    shape, activation = shapes
    other = solve_statics(trunk, activation[1], heads(3, 61)[1], EVERYTHING)
    assert other.mesh != shape.mesh
    Z = np.linspace(0, 1.75, 9)
    stacked = Shape.stack([shape[0], other])
    assert stacked.mesh == shape.mesh
    np.testing.assert_allclose(stacked.position(Z), shape[:2].position(Z), atol=1e-5)
    assert Shape.stack([shape[0], other], other.mesh).mesh == other.mesh


@pytest.mark.parametrize("Z", [-0.1, 1.8, np.nan])
def test_there_is_no_strain_off_the_trunk(shapes, Z):
    with pytest.raises(InputError, match="expected 0 <= Z <= L"):
        shapes[0].strain([0.5, Z])

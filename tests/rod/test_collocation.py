"""Gauss elements and meshes: exactness, invariants, edges where the data jump."""

import numpy as np
import pytest
from scipy.special import roots_legendre

from trunk_ocp.errors import InputError
from trunk_ocp.model.loads import Loads
from trunk_ocp.rod.collocation import Mesh, gauss, mesh_for
from trunk_ocp.rod.statics import solve_statics

DEGREES = [1, 2, 3, 6, 10, 20]


@pytest.mark.parametrize("degree", DEGREES)
def test_nodes_and_weights_are_gauss_legendre(degree):
    nodes, weights = roots_legendre(degree)
    np.testing.assert_allclose(gauss(degree).nodes, (1 + nodes) / 2, atol=1e-14)
    np.testing.assert_allclose(gauss(degree).integral(1.0), weights / 2, atol=1e-14)


# Lebesgue constants of these nodes with 0 added stay below 1e3 at degree 20, and their
# derivative matrix below 1e3 as well: round-off 1e-16 times that.
@pytest.mark.parametrize("degree", DEGREES)
def test_an_element_reproduces_polynomials_of_its_degree(degree):
    element, tau = gauss(degree), np.linspace(0, 1, 11)
    every = np.append(0.0, element.nodes)
    for power in range(degree + 1):
        np.testing.assert_allclose(element.value(tau) @ every**power, tau**power, atol=1e-11)
        slope = power * element.nodes ** max(power - 1, 0)
        np.testing.assert_allclose(element.derivative @ every**power, slope, atol=1e-10)


@pytest.mark.parametrize("degree", DEGREES)
def test_quadrature_inside_is_exact_to_degree_d_less_1_and_over_the_element_to_2d_less_1(degree):
    element, tau = gauss(degree), np.linspace(0, 1, 11)
    for power in range(degree):
        inside = element.integral(tau) @ element.nodes**power
        np.testing.assert_allclose(inside, tau ** (power + 1) / (power + 1), atol=1e-12)
    for power in range(2 * degree):
        whole = element.integral(1.0) @ element.nodes**power
        assert whole == pytest.approx(1 / (power + 1), rel=1e-12)


@pytest.mark.parametrize("degree", [0, 21, -3])
def test_a_degree_out_of_range_is_refused(degree):
    with pytest.raises(InputError, match=f"degree = {degree}.*1 to 20"):
        gauss(degree)


def test_quaternions_are_unit_at_the_edges_of_the_coarsest_mesh(trunk, draw):
    # |q|^2 is a quadratic invariant, which a Gauss method keeps however coarse the mesh.
    mesh = mesh_for(trunk, 1.4, elements=1, degree=2)
    load = Loads(9.8, (20.0, 30.0, -40.0), 1.4, (0, 0, 100.0), (-50.0, 0, 10.0))
    shape = solve_statics(trunk, draw(trunk, 5, seed=30), (0.2, 0.1), load, mesh)
    ends = np.einsum("j,bejx->bex", gauss(2).value(1.0), shape.states)
    for q in (shape.states[:, :, 0, :4], ends[..., :4]):
        np.testing.assert_allclose(np.linalg.norm(q, axis=-1), 1, atol=1e-11)  # Newton's last step
    np.testing.assert_allclose(ends[:, :-1], shape.states[:, 1:, 0], atol=1e-9)  # continuous
    inside = np.linalg.norm(shape.states[:, :, 1:, :4], axis=-1)
    assert np.abs(inside - 1).max() > 1e-6  # and it is not that the package normalizes them


@pytest.mark.parametrize("contact_from", [None, 0.0, 0.5, 0.875, 1.4, 1.74])
@pytest.mark.parametrize("elements", [1, 6, 13])
def test_an_edge_is_on_every_jump(trunk, contact_from, elements):
    mesh = mesh_for(trunk, contact_from, elements=elements, degree=4)
    jumps = {*trunk.edges, *([] if contact_from is None else [contact_from])}
    assert jumps <= set(mesh.edges)  # exactly, so that no element sees both sides
    assert (np.diff(mesh.edges) > 0).all()
    assert mesh.degree == 4


@pytest.mark.parametrize("contact_from", [None, 1.4])
@pytest.mark.parametrize("elements", [4, 5, 6, 7, 8, 9, 10, 12, 16, 24])
def test_a_mesh_has_as_many_elements_as_asked_for(trunk, contact_from, elements):
    assert mesh_for(trunk, contact_from, elements=elements).elements == elements


def test_elements_between_two_jumps_are_equally_long_in_local_radii(trunk):
    mesh = mesh_for(trunk, elements=20)
    logs = -np.diff(np.log(trunk.radius(np.array(mesh.edges))))  # integral of dZ / R_0(Z)
    stretch = np.searchsorted(trunk.edges, mesh.edges[1:]) - 1
    for index in range(3):
        np.testing.assert_allclose(logs[stretch == index], logs[stretch == index][0], rtol=1e-12)


def test_without_taper_elements_are_equally_long(build):
    edges = mesh_for(build(), elements=5).edges
    np.testing.assert_allclose(edges, np.linspace(0, 1, 6), atol=1e-15)


def test_a_point_is_located_in_the_element_that_it_ends():
    mesh = Mesh((0.0, 0.5, 2.0), 3)
    element, tau = mesh.locate([0.0, 0.25, 0.5, 0.8, 2.0])
    assert element.tolist() == [0, 0, 0, 1, 1]
    np.testing.assert_allclose(tau, [0, 0.5, 1, 0.2, 1], atol=1e-15)
    np.testing.assert_allclose(mesh.points[1], 0.5 + 1.5 * gauss(3).nodes, atol=1e-15)

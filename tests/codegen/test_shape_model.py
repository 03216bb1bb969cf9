"""What is exported: kernels, numbers and CasADi functions, against the model itself."""

import casadi as ca
import numpy as np
import pytest

from trunk_ocp.codegen import casadi_function
from trunk_ocp.codegen import rod_space_axes as kernels
from trunk_ocp.codegen.check_cases import cases, disagreements, resolved
from trunk_ocp.codegen.shape_model import MAX_POINTS, build_model, reference
from trunk_ocp.errors import InputError
from trunk_ocp.model.activation import strains
from trunk_ocp.model.loads import Loads
from trunk_ocp.model.quaternions import directors
from trunk_ocp.rod import equations as rod
from trunk_ocp.rod.statics import solve_statics
from trunk_ocp.rod.tip_jacobian import tip_jacobian
from trunk_ocp.rod.unloaded import unloaded_states
from trust import reference as independent

pytestmark = pytest.mark.slow

CONTACT = Loads(contact_from=1.3)  # no segment's end
SIXTH_ORDER = {-3: -1 / 60, -2: 9 / 60, -1: -45 / 60, 1: 45 / 60, 2: -9 / 60, 3: 1 / 60}


def differences(function, x, v, step):
    """Derivative of a function along v, to the sixth order in the step."""
    return sum(c * function(x + k * step * v) for k, c in SIXTH_ORDER.items()) / step


@pytest.fixture(scope="module")
def model(trunk):
    return resolved(build_model(trunk, [0.0, 0.9, 1.75], CONTACT))


# --- kernels ------------------------------------------------------------------------


def test_the_rod_in_space_axes_is_the_rod_in_its_directors():
    """M = R m turns one set of equations into the other, at any state."""
    rng = np.random.default_rng(200)
    for _ in range(20):
        q, m = rng.normal(size=4), rng.normal(size=3)
        q /= np.linalg.norm(q)
        strain, V, force, couple = (rng.uniform(0.5, 2, n) for n in (5, 3, 3, 3))
        section = rng.uniform(0.5, 2, 5)
        body = rod.rates()([*q, *m, *strain, *V], [*section, *force, *couple]).full().ravel()
        d = np.array(directors(q))
        w = [*q, *(d.T @ m), *strain, *(V + force), *couple]
        space = kernels.rates()(w, section).full().ravel()
        np.testing.assert_allclose(space[:4], body[:4], atol=1e-14)
        np.testing.assert_allclose(space[7:], body[7:], atol=1e-14)
        # (d_i . M)' = d_i . M' + (u x ...)_i: differentiate d_i along q'.
        turning = (np.array(directors(q + 1e-30j * body[:4])) @ (d.T @ m)).imag / 1e-30
        np.testing.assert_allclose(d @ space[4:7] + turning, body[4:7], atol=1e-13)


@pytest.mark.parametrize("size", [0.0, 1e-12, 1e-3, 0.3, 0.999, 1.001, 1.5])
def test_a_piece_of_the_unloaded_trunk_is_its_closed_form(trunk, size):
    """On both sides of theta = 1, where series give way to sines."""
    activation = np.zeros(28)
    activation[:5] = -1.0
    model = build_model(trunk, [trunk.edges[1]], Loads())
    piece = model._piece(0.0, trunk.edges[1])
    full = strains(trunk, activation)[0]
    theta = full[0] * np.linalg.norm(full[1:]) * piece[0]
    activation *= size / theta  # theta is about proportional to it
    strain = strains(trunk, activation)[0]
    r, q = unloaded_states(trunk, activation, np.zeros(2), np.array([0.0, trunk.edges[1]]))
    rho = kernels.spiral()(strain, piece).full().ravel()
    np.testing.assert_allclose(r[0] + np.array(directors(q[0])).T @ rho, r[1], atol=1e-14)
    turn = kernels.turn()(strain, piece[:1]).full().ravel()
    np.testing.assert_allclose(
        casadi_function._product()(q[0], turn).full().ravel(), q[1], atol=1e-14
    )


@pytest.mark.parametrize("kernel", [kernels.turn(), kernels.spiral(), kernels.rates()])
def test_slopes_and_second_derivatives_of_kernels_are_those_of_differences(kernel):
    rng = np.random.default_rng(201)
    w, p = rng.uniform(0.5, 1.0, kernel.size1_in(0)), rng.uniform(0.5, 1.0, kernel.size1_in(1))
    a, b = rng.uniform(-1, 1, (2, w.size))

    def slopes(at):
        return kernels.with_slopes(kernel)(at, p)[1].full()

    def values(at):
        return kernel(at, p).full().ravel()

    np.testing.assert_allclose(slopes(w) @ a, differences(values, w, a, 1e-3), atol=1e-10)
    second = kernels.second_along(kernel)(w, p, a, b).full().ravel()
    np.testing.assert_allclose(second, differences(slopes, w, b, 1e-3) @ a, atol=1e-9)


# --- the map ------------------------------------------------------------------------


def test_shapes_are_those_of_statics_on_another_mesh(model):
    x = cases(model)
    y = np.array([casadi_function.loaded(model)(row).full().ravel() for row in x])
    expected = reference(model, x)
    assert max(disagreements(y.reshape(expected.shape), expected, model.layout).values()) < 1e-10


def test_an_independent_integrator_goes_the_same_way_from_the_base(model):
    x = cases(model)[1:4]
    for row in x:
        y = casadi_function.loaded(model)(row).full().reshape(-1, 19)
        part = {name: row[where] for name, where in model.layout.inputs.items()}
        load = Loads(
            part["gravity"][0],
            part["tip_force"],
            1.3,
            part["contact_force"],
            part["contact_couple"],
        )
        r, d, m = independent.march(
            model.trunk, part["activation"][None], part["head"][None], [load], y[:1, 16:],
            np.array(model.Z), rtol=1e-12, atol=1e-12,
        )  # fmt: skip
        np.testing.assert_allclose(y[:, :3], r[0], atol=1e-8)  # the way to the tip is unstable
        np.testing.assert_allclose(y[:, 3:12].reshape(-1, 3, 3), d[0], atol=1e-7)
        np.testing.assert_allclose(y[:, 16:], m[0], atol=1e-6)


def test_the_jacobian_is_that_of_differences_of_statics(model):
    """Of another formulation on another mesh, along random directions, to 1e-8."""
    rng, x = np.random.default_rng(202), cases(model)[2]
    J = casadi_function.jacobian(casadi_function.loaded(model))(x)[1].full()
    for _ in range(3):
        v = rng.uniform(-1, 1, x.size)
        along = differences(lambda at: reference(model, at[None])[0], x, v, 2e-3)
        error = disagreements((J @ v).reshape(1, -1, 19), along[None], model.layout)
        assert max(error.values()) < 1e-8


def test_the_jacobian_by_muscles_and_head_is_the_one_of_sensitivity(trunk):
    model = build_model(trunk, [trunk.length], Loads())
    x = cases(model)[3]
    part = {name: x[where] for name, where in model.layout.inputs.items()}
    load = Loads(part["gravity"][0], part["tip_force"])
    shape = solve_statics(trunk, part["activation"], part["head"], load)
    position, tangent = tip_jacobian(shape, part["activation"], part["head"], load)
    J = casadi_function.jacobian(casadi_function.loaded(model))(x)[1].full()[:, :30]
    np.testing.assert_allclose(J[:3], position, atol=1e-8)
    np.testing.assert_allclose(J[9:12], tangent, atol=1e-8)


def test_the_second_derivative_is_that_of_differences_of_the_jacobian(model):
    x = cases(model)[4]
    v = np.random.default_rng(203).uniform(-1, 1, x.size)
    function = casadi_function.loaded(model)
    dJ = casadi_function.second(function)(x, v).full()

    def slopes(at):
        return casadi_function.jacobian(function)(at)[1].full()

    expected = differences(slopes, x, v, 2e-3)
    shape = (1, -1, 19, x.size)
    error = disagreements(dJ.reshape(shape), expected.reshape(shape), model.layout)
    assert max(error.values()) < 1e-8


def test_the_unloaded_map_is_the_closed_form_and_has_its_derivative(model, draw):
    function = casadi_function.unloaded(model)
    x = np.append(draw(model.trunk, 1, seed=204)[0], [0.1, -0.2])

    def closed(at):
        r, q = unloaded_states(model.trunk, at[:28], at[28:], np.array(model.Z))
        d = np.stack([np.array(directors(each)).ravel() for each in q])
        return np.hstack([r, d])

    y, J = casadi_function.jacobian(function)(x)
    np.testing.assert_allclose(y.full().reshape(-1, 16)[:, :12], closed(x), atol=1e-14)
    for i in range(x.size):
        slope = differences(closed, x, np.eye(x.size)[i], 1e-3)
        np.testing.assert_allclose(J.full()[:, i].reshape(-1, 16)[:, :12], slope, atol=1e-11)


def test_without_loads_the_loaded_map_is_the_unloaded_one(model, draw):
    x = np.zeros(model.layout.size)
    x[:28] = draw(model.trunk, 1, seed=205)[0]
    loaded = casadi_function.loaded(model)(x).full().reshape(-1, 19)
    free = casadi_function.unloaded(model)(x[:30]).full().reshape(-1, 16)
    np.testing.assert_allclose(loaded[:, :16], free, atol=1e-10)


# --- what is asked for --------------------------------------------------------------


@pytest.mark.parametrize("at", [[], [0.9], [0.0, 0.9, 1.0, 1.75], np.linspace(0, 1.75, 9)])
@pytest.mark.parametrize("loads", [Loads(), CONTACT], ids=["free", "contact"])
def test_every_point_and_every_jump_is_an_edge(trunk, at, loads):
    model = build_model(trunk, at, loads)
    edges = np.asarray(model.mesh.edges)
    np.testing.assert_array_equal(edges[model.tables.edge], model.Z)
    jumps = {*trunk.edges} | ({1.3} if loads is CONTACT else set())
    assert jumps <= {*model.mesh.edges}
    assert model.Z == (tuple(at) or (1.75,))


def test_a_point_off_the_trunk_is_refused(trunk):
    with pytest.raises(InputError, match=r"--at 1.8: expected points Z in m on the trunk, .* 1.75"):
        build_model(trunk, [0.9, 1.8])
    with pytest.raises(InputError, match="--at nan"):
        build_model(trunk, [float("nan")])


def test_too_many_points_are_refused(trunk):
    with pytest.raises(InputError, match=r"65 points make 1235 outputs; expected at most 64"):
        build_model(trunk, np.linspace(0, 1, MAX_POINTS + 1))


def test_a_rod_without_muscles_is_a_model_too(build):
    model = resolved(build_model(build()))
    assert model.layout.inputs["activation"] == slice(0, 0)
    assert casadi_function.loaded(model).size1_in(0) == 6


def test_casadi_functions_can_be_differentiated_again(model):
    """As expressions of a user's own."""
    x = ca.MX.sym("x", model.layout.size)
    height = casadi_function.loaded(model)(x)[-17]
    slope = ca.Function("slope", [x], [ca.gradient(height, x)])(cases(model)[1]).full().ravel()
    J = casadi_function.jacobian(casadi_function.loaded(model))(cases(model)[1])[1].full()
    np.testing.assert_allclose(slope, J[-17], atol=1e-10)

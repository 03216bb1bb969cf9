"""The NumPy module that is exported: values and derivatives by other means."""

import subprocess
import sys

import exported
import numpy as np
import pytest

from trunk_ocp.codegen.numpy_module import check_numpy, write_numpy
from trunk_ocp.codegen.request import CheckError, Request
from trunk_ocp.codegen.shape_model import build_model, reference

VALUE = 1e-10  # promised agreement, with different meshes and formulations on either side
EXACT = 1e-12  # complex steps have no error but round-off


@pytest.fixture(scope="module")
def module(tmp_path_factory):
    """The exported module, with second derivatives."""
    folder = exported.export(
        tmp_path_factory.mktemp("numpy"), write_numpy(exported.request(second=True))
    )
    return exported.load(folder, "trunk_numpy")


@pytest.fixture(scope="module")
def x():
    return exported.inputs()


def controls_of(x):
    return x[:, : exported.model().layout.controls]


def test_loaded_shapes_are_those_of_solve_statics(module, x):
    assert max(exported.agreement(module.loaded(x), reference(exported.model(), x))) < VALUE


def test_unloaded_shapes_are_those_of_solve_statics_without_loads(module, x):
    bare = x.copy()
    bare[:, exported.model().layout.controls :] = 0
    wanted = reference(exported.model(), bare)[:, :, :16]
    assert max(exported.agreement(module.unloaded(controls_of(x)), wanted)) < VALUE


def test_the_jacobian_is_the_complex_step_of_the_shape(module, x):
    y, J = module.jacobian(x)
    np.testing.assert_array_equal(y, module.loaded(x))
    assert max(exported.agreement(J, exported.slopes(module.loaded, x))) < EXACT


def test_the_jacobian_is_the_slope_of_solve_statics(module, x):
    """Sixth-order central differences; round-off of the shapes over the step leaves some 1e-9."""
    model, one, v = exported.model(), x[:1], 0.01 * x[1:2]
    weights = {1: 45, 2: -9, 3: 1}
    wanted = sum(
        w / 60 * (reference(model, one + i * v) - reference(model, one - i * v))
        for i, w in weights.items()
    )
    assert max(exported.agreement(module.jacobian(one)[1] @ v[0], wanted)) < 1e-8


def test_the_second_derivative_is_the_complex_step_of_the_jacobian(module, x):
    v = np.random.default_rng(1).normal(size=x.shape)
    wanted = module.jacobian(x + exported.STEP * 1j * v)[1].imag / exported.STEP
    assert max(exported.agreement(module.second(x, v), wanted)) < EXACT


def test_the_unloaded_jacobian_is_the_complex_step_of_the_unloaded_shape(module, x):
    y, J = module.unloaded_jacobian(controls_of(x))
    np.testing.assert_array_equal(y, module.unloaded(controls_of(x)))
    assert max(exported.agreement(J, exported.slopes(module.unloaded, controls_of(x)))) < EXACT


def test_a_trunk_at_rest_has_finite_derivatives(module):
    for J in (module.jacobian(np.zeros(40))[1], module.unloaded_jacobian(np.zeros(30))[1]):
        assert np.all(np.isfinite(J))


def test_leading_axes_are_only_leading_axes(module, x):
    y, J = module.jacobian(x.reshape(2, 2, 40))
    # A stack of matrices may be factorized in another order than a single one: round-off.
    np.testing.assert_allclose(y[1, 0], module.loaded(x[2]), rtol=0, atol=1e-10)
    np.testing.assert_allclose(J[1, 0], module.jacobian(x[2])[1], rtol=0, atol=1e-9)
    assert module.loaded(np.zeros((0, 40))).shape == (0, 3, 19)


def test_more_shapes_than_are_solved_at_once_come_back_in_order(module, x):
    many = np.tile(x, (40, 1))
    assert len(many) > module.BATCH
    np.testing.assert_allclose(
        module.loaded(many), np.tile(module.loaded(x), (40, 1, 1)), rtol=0, atol=1e-10
    )


def test_pack_and_split_name_what_x_and_y_hold(module, x):
    layout = exported.model().layout
    parts = {name: x[:, at] for name, at in layout.inputs.items()}
    np.testing.assert_array_equal(module.pack(**parts), x)
    assert module.pack(np.zeros(28))[layout.inputs["gravity"]] == 9.8
    y = module.loaded(x)
    rows = module.split(y)["directors"]
    np.testing.assert_allclose(rows @ rows.swapaxes(-1, -2) - np.eye(3), 0, atol=1e-14)
    np.testing.assert_array_equal(rows[..., 2, :], y[..., 9:12])
    assert module.MUSCLES == layout.muscles


def test_a_load_that_newton_does_not_reach_in_one_go_is_raised_in_steps(module, x):
    x = x[:1].copy()
    x[:, 31:] = [300.0, 400, 250, 0, 0, 0, 0, 0, 0]
    assert not module._newton(x, module._unbent(x))[2][0]
    # Under ten times the loads of the other tests, eight elements leave some 1e-10.
    assert max(exported.agreement(module.loaded(x), reference(exported.model(), x))) < 1e-9


def test_a_load_beyond_equilibrium_is_named_with_the_share_reached(module, x, monkeypatch):
    monkeypatch.setattr(module, "MAX_STEPS", 1)  # enough where there is no load, and only there
    some = np.stack([np.where(np.arange(40) < 30, x[0], 0), x[1]])
    with pytest.raises(module.NoShape, match=r"shape \(1,\): no equilibrium beyond 0 of the load"):
        module.loaded(some)


def test_a_shape_that_has_no_answer_does_not_harm_its_neighbors(module, x):
    """Loads so large that matrices become singular: its own error, and NaN nowhere else."""
    hard = x.copy()
    hard[1, 30:] *= 1e6
    with pytest.raises(module.NoShape, match=r"shape \(1,\)"):
        module.loaded(hard)
    inside, _, converged = module._newton(hard, module._unbent(hard))
    np.testing.assert_array_equal(converged, [True, False, True, True])
    np.testing.assert_allclose(inside[2], module._solve(x)[0][2], rtol=0, atol=1e-9)


def test_a_plain_rod_without_taper_muscles_or_contact_is_exported_alike(build, tmp_path):
    rod = build_model(build(), (0.0, 0.4), elements=8)  # at its tip the moment is 0
    text = write_numpy(Request(rod, "shape", "rod"))["trunk_numpy.py"]
    module = exported.load(tmp_path, "trunk_numpy", text)
    x = np.array([[0.1, -0.2, 9.8, 0.3, -0.2, 0.1]])
    wanted = reference(rod, x)
    assert max(exported.agreement(module.loaded(x), wanted)) < VALUE
    slopes = exported.slopes(module.loaded, x)
    assert max(exported.agreement(module.jacobian(x)[1], slopes)) < EXACT


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda m: m.loaded(np.zeros(39)), r"x: expected shape \(..., 40\), got \(39,\)"),
        (lambda m: m.loaded(np.full(40, np.nan)), "finite"),
        (lambda m: m.loaded(np.repeat([-20.0, 0], [28, 12])), "shortens a segment to zero length"),
        (lambda m: m.unloaded(np.zeros(29)), r"controls: expected shape \(..., 30\)"),
        (lambda m: m.pack(np.zeros(27)), "activation: expected 28 numbers"),
        (lambda m: m.pack(np.zeros(28), wind=1.0), "wind: expected one of activation, head"),
    ],
)
def test_bad_input_is_a_clear_error(module, call, message):
    with pytest.raises(ValueError, match=message):
        call(module)


def test_the_module_imports_numpy_alone(tmp_path):
    exported.export(tmp_path, write_numpy(exported.request()))
    code = (
        "import sys; sys.modules |= dict.fromkeys(('casadi', 'trunk_ocp', 'scipy'));"
        "import trunk_numpy; assert not hasattr(trunk_numpy, 'second')"
    )
    assert subprocess.run([sys.executable, "-c", code], cwd=tmp_path).returncode == 0


def test_the_export_checks_itself_and_notices_a_wrong_number(tmp_path):
    exported.export(tmp_path, write_numpy(exported.request(second=True)))
    exported.write_checks(tmp_path)
    printed = check_numpy(tmp_path)
    assert printed.count("\n") == 4 + 4 + 4 + 3 + 3 + 1  # the last: all agree
    assert "second moment" in printed
    table = np.loadtxt(tmp_path / "check.csv", delimiter=",")
    table[0, 40] += 1e-8
    np.savetxt(tmp_path / "check.csv", table, delimiter=",", fmt="%.17g")
    with pytest.raises(CheckError, match=r"loaded position .*ABOVE 1e-10"):
        check_numpy(tmp_path)


def test_a_shape_export_is_checked_for_its_shapes_alone(tmp_path):
    exported.export(tmp_path, write_numpy(exported.request("shape")))
    exported.write_checks(tmp_path, ())
    assert "jacobian" not in check_numpy(tmp_path)

"""The wrappers for JAX and PyTorch: derivatives in every mode, batches, precision.

What they are held against is the NumPy module, which has tests of its own.
"""

import importlib
import importlib.util
from dataclasses import replace

import exported
import numpy as np
import pytest
from hostile import HOSTILE

from trunk_ocp.codegen.formats import FORMATS
from trunk_ocp.codegen.jax_torch import check_jax, check_torch, write_jax, write_torch
from trunk_ocp.codegen.numpy_module import module_text
from trunk_ocp.codegen.request import Request, ToolMissingError
from trunk_ocp.codegen.shape_model import build_model

DOUBLE, SINGLE = 1e-10, 1e-4  # promised agreement
EXACT = 1e-12  # the same numbers by another route

jax = pytest.importorskip("jax", reason="JAX and PyTorch are large: make frameworks")
jnp = jax.numpy
needs_torch = pytest.mark.skipif(
    importlib.util.find_spec("torch") is None, reason="PyTorch is large and not required"
)


@pytest.fixture(scope="module")
def truth(tmp_path_factory):
    """The NumPy module."""
    text = module_text(exported.request(second=True))
    return exported.load(tmp_path_factory.mktemp("truth"), "trunk_numpy", text)


@pytest.fixture(scope="module")
def in_jax(tmp_path_factory):
    files = write_jax(exported.request(second=True))
    return exported.load(exported.export(tmp_path_factory.mktemp("jax"), files), "trunk_jax")


@pytest.fixture(scope="module")
def in_torch(tmp_path_factory):
    files = write_torch(exported.request(second=True))
    return exported.load(exported.export(tmp_path_factory.mktemp("torch"), files), "trunk_torch")


@pytest.fixture
def double():
    jax.config.update("jax_enable_x64", True)  # jax.enable_x64 is there since 0.8 only
    yield
    jax.config.update("jax_enable_x64", False)


@pytest.fixture(scope="module")
def x():
    return exported.inputs()


def controls_of(x):
    return x[:, : exported.model().layout.controls]


def tip(module):
    """The height of the tip, a single number to differentiate twice."""
    return lambda x: module.loaded(x)[-1, 0]


def hessian_of_tip(truth, x):
    """By the NumPy module, a column for each input."""
    return truth.second(np.tile(x, (40, 1)), np.eye(40))[:, -1, 0]


@pytest.mark.usefixtures("double")
@pytest.mark.parametrize("mode", [jax.jacfwd, jax.jacrev])
def test_jax_knows_the_jacobian_in_either_mode_compiled_and_in_a_batch(truth, in_jax, x, mode):
    y, J = truth.jacobian(x[:2])
    got = jax.jit(jax.vmap(mode(in_jax.loaded)))(x[:2])
    assert max(exported.agreement(np.asarray(got), J)) < EXACT
    np.testing.assert_allclose(in_jax.loaded(x[:2]), y, rtol=0, atol=1e-10)


def test_jax_in_single_precision_gives_single_precision(truth, in_jax, x):
    y, J = truth.jacobian(x)
    got = in_jax.loaded(x), jax.vmap(jax.jacrev(in_jax.loaded))(x)
    for single, wanted in zip(got, (y, J), strict=True):
        assert single.dtype == jnp.float32
        assert max(exported.agreement(np.asarray(single), wanted)) < SINGLE


@pytest.mark.usefixtures("double")
def test_jax_hessian_is_the_second_derivative(truth, in_jax, x):
    wanted = hessian_of_tip(truth, x[0])
    got = jax.hessian(tip(in_jax))(x[0])
    np.testing.assert_allclose(got, wanted, rtol=0, atol=EXACT * np.abs(wanted).max())
    product = jax.jit(lambda x, v: jax.jvp(jax.grad(tip(in_jax)), (x,), (v,))[1])(x[0], x[1])
    np.testing.assert_allclose(product, wanted @ x[1], rtol=1e-10)


def test_one_call_of_numpy_serves_a_whole_batch_of_jax(in_jax, x, monkeypatch):
    sizes, solve = [], in_jax.trunk_numpy.loaded
    monkeypatch.setattr(
        in_jax.trunk_numpy, "loaded", lambda x: sizes.append(np.shape(x)) or solve(x)
    )
    jax.vmap(in_jax.loaded)(x).block_until_ready()
    assert sizes == [(4, 40)]


def test_jax_without_second_derivatives_says_how_to_get_them(tmp_path, x):
    files = write_jax(exported.request())
    module = exported.load(exported.export(tmp_path, files), "trunk_jax")
    with pytest.raises(NotImplementedError, match="export again with --second"):
        jax.hessian(tip(module))(x[0])


@pytest.mark.usefixtures("double")
def test_jax_differentiates_the_unloaded_shape_itself_even_at_rest(truth, in_jax, x):
    y, J = truth.unloaded_jacobian(controls_of(x))
    assert max(exported.agreement(np.asarray(in_jax.unloaded(controls_of(x))), y)) < EXACT
    v = np.random.default_rng(2).normal(size=30)
    along = jax.jit(jax.vmap(lambda c: jax.jvp(in_jax.unloaded, (c,), (v,))[1]))
    assert max(exported.agreement(np.asarray(along(controls_of(x))), J @ v)) < EXACT
    pull = jax.jit(jax.vmap(lambda c, w: jax.vjp(in_jax.unloaded, c)[1](w)[0]))
    wanted = np.einsum("bny,bnyx->bx", y, J)
    np.testing.assert_allclose(pull(controls_of(x), y), wanted, rtol=0, atol=1e-10)
    rest = np.zeros((4, 30))
    at_rest = truth.unloaded_jacobian(rest)[1]
    np.testing.assert_allclose(along(rest), at_rest @ v, rtol=0, atol=1e-12)
    wanted = np.einsum("bny,bnyx->bx", y, at_rest)
    np.testing.assert_allclose(pull(rest, y), wanted, rtol=0, atol=1e-10)


def test_jax_refuses_a_wrong_length(in_jax):
    with pytest.raises(ValueError, match=r"x: expected shape \(..., 40\), got \(39,\)"):
        in_jax.loaded(jnp.zeros(39))
    with pytest.raises(ValueError, match=r"controls: expected shape \(..., 30\)"):
        in_jax.unloaded(jnp.zeros(31))


@needs_torch
def test_torch_knows_derivatives_of_first_and_second_order_in_every_mode(truth, in_torch, x):
    import torch

    one = torch.as_tensor(x[0])
    for mode in (torch.func.jacfwd, torch.func.jacrev):
        got = torch.func.vmap(mode(in_torch.loaded))(torch.as_tensor(x[:2]))
        assert max(exported.agreement(got.numpy(), truth.jacobian(x[:2])[1])) < EXACT
    wanted = hessian_of_tip(truth, x[0])
    for outer in (torch.func.jacfwd, torch.func.jacrev):
        got = outer(torch.func.jacrev(tip(in_torch)))(one)
        np.testing.assert_allclose(got, wanted, rtol=0, atol=EXACT * np.abs(wanted).max())
    got = torch.autograd.functional.hessian(tip(in_torch), one)
    np.testing.assert_allclose(got, wanted, rtol=0, atol=EXACT * np.abs(wanted).max())


@needs_torch
def test_torch_passes_gradcheck_and_gradgradcheck(in_torch, x):
    import torch

    one = torch.as_tensor(x[:1]).requires_grad_()
    # The shape's third derivatives times a step of 1e-4 squared are below these tolerances.
    tolerances = {"eps": 1e-4, "atol": 1e-4, "rtol": 1e-4}
    position = lambda x: in_torch.loaded(x)[..., -1, :3]
    assert torch.autograd.gradcheck(position, one, check_forward_ad=True, **tolerances)
    v = torch.as_tensor(x[1:2])
    along = lambda step: position(torch.as_tensor(x[:1]) + step * v)
    assert torch.autograd.gradgradcheck(along, torch.zeros(1, dtype=v.dtype, requires_grad=True))


@needs_torch
def test_torch_follows_the_type_of_its_input(truth, in_torch, x):
    import torch

    single = torch.tensor(x, dtype=torch.float32, requires_grad=True)
    y = in_torch.loaded(single)
    y[:, -1, 0].sum().backward()
    assert (y.dtype, single.grad.dtype) == (torch.float32, torch.float32)
    wanted, J = truth.jacobian(x)
    assert max(exported.agreement(y.detach().numpy(), wanted)) < SINGLE
    np.testing.assert_allclose(single.grad, J[:, -1, 0], rtol=0, atol=SINGLE * np.abs(J).max())
    with pytest.raises(ValueError, match=r"x: expected floating point of shape \(..., 40\)"):
        in_torch.loaded(torch.zeros(40, dtype=torch.int32))


@needs_torch
def test_torch_differentiates_the_unloaded_shape_itself_even_at_rest(truth, in_torch, x):
    import torch

    for controls in (controls_of(x)[:2], np.zeros((1, 30))):
        y, J = truth.unloaded_jacobian(controls)
        given = torch.as_tensor(controls)
        np.testing.assert_allclose(in_torch.unloaded(given), y, rtol=0, atol=1e-12)
        for mode in (torch.func.jacfwd, torch.func.jacrev):
            got = torch.func.vmap(mode(in_torch.unloaded))(given)
            np.testing.assert_allclose(got, J, rtol=0, atol=1e-10)


@needs_torch
def test_torch_without_second_derivatives_says_how_to_get_them(tmp_path, x):
    import torch

    files = write_torch(exported.request())
    module = exported.load(exported.export(tmp_path, files), "trunk_torch")
    with pytest.raises(NotImplementedError, match="export again with --second"):
        torch.func.hessian(tip(module))(torch.as_tensor(x[0]))


@pytest.mark.parametrize("key", ["python", "escaped quotes", "line ends", "half a character"])
@pytest.mark.parametrize("package", ["jax", pytest.param("torch", marks=needs_torch)])
def test_a_hostile_name_is_text_to_a_module_that_runs(tmp_path, build, package, key):
    muscle = {"group": "dl", "architecture": "longitudinal", "radii_over_length": (0.01, 0.04)}
    muscles = ({**muscle, "sector": (0.5, 1.5)},)
    plain = build(({"Z_over_length": (0.0, 1.0), "muscles": muscles},), taper_deg=1.0)
    own = [replace(each, name=f"{each.side}{HOSTILE[key]}") for each in plain.subdomains]
    named = replace(plain, name=HOSTILE[key], subdomains=tuple(own))
    array = importlib.import_module({"jax": "jax.numpy"}.get(package, package)).asarray
    shapes = []
    for folder, trunk in (("plain", plain), ("named", named)):
        files = FORMATS[package].write(Request(build_model(trunk), "jacobian", trunk.name))
        module = exported.load(exported.export(tmp_path / folder, files), f"trunk_{package}")
        x = array(np.full(max(part.stop for part in module.INPUTS.values()), -0.1))
        shapes.append(np.asarray(module.loaded(x)))
    np.testing.assert_array_equal(*shapes)
    assert module.MUSCLES == named.muscles
    assert {path.name for path in tmp_path.iterdir()} == {"plain", "named"}


@pytest.mark.parametrize(("check", "name"), [(check_jax, "jax"), (check_torch, "torch")])
def test_a_missing_package_is_named_with_the_line_that_installs_it(
    tmp_path, monkeypatch, check, name
):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(ToolMissingError, match=f"pip install {name}"):
        check(tmp_path)

"""Shape of a muscular trunk for JAX, with jit, vmap, grad, jacfwd and jacrev.

    y = loaded(x)                   # (..., n, 19)
    y = unloaded(controls)          # (..., n, 16)

x, y, MUSCLES, INPUTS, OUTPUTS, pack and split are those of trunk_numpy.py in the same folder.

NumPy solves for the loaded shape in double precision on the host; the result has the precision of
x, and its derivatives are exact, by the implicit function theorem. The unloaded shape is pure JAX:
it compiles for any device and has derivatives of any order.
"""

import jax
import jax.numpy as jnp
import numpy as np
import trunk_numpy
from trunk_numpy import INPUTS, MUSCLES, OUTPUTS, Z, pack, split

__all__ = ["INPUTS", "MUSCLES", "OUTPUTS", "Z", "loaded", "pack", "split", "unloaded"]
SIZE = max(part.stop for part in INPUTS.values())
Y = (len(Z), 19)


def loaded(x: jax.Array) -> jax.Array:
    """Shapes (..., n, 19) under load, for inputs (..., size).

    If no equilibrium is found, XLA reports trunk_numpy.NoShape. Second derivatives need an export
    with --second, and forward mode outermost, as in jax.hessian(f) or the Hessian-vector product
    jax.jvp(jax.grad(f), (x,), (v,)).
    """
    return _loaded(_of_size(x, SIZE, "x"))


def unloaded(controls: jax.Array) -> jax.Array:
    """Unloaded shapes (..., n, 16) of activations and head angles (..., muscles + 2)."""
    controls = _of_size(controls, INPUTS["head"].stop, "controls")
    return trunk_numpy.unloaded_in(jnp, controls, slopes=False)[0]


def _of_size(x, size, name):
    x = jnp.asarray(x)
    if x.shape[-1:] != (size,):
        raise ValueError(f"{name}: expected shape (..., {size}), got {x.shape}.")
    return x if jnp.issubdtype(x.dtype, jnp.floating) else x.astype(float)


def _call(function, shapes, *arguments):
    """Results of a NumPy function of (..., size) arrays, a whole batch in one call."""
    dtype, batch = arguments[0].dtype, arguments[0].shape[:-1]
    results = [jax.ShapeDtypeStruct((*batch, *shape), dtype) for shape in shapes]

    def on_host(*arrays):
        with np.errstate(all="ignore"):
            results = function(*(np.asarray(array, dtype=float) for array in arrays))
        return [np.asarray(part, dtype=dtype) for part in results]

    return jax.pure_callback(on_host, results, *arguments, vmap_method="broadcast_all")


@jax.custom_jvp
def _loaded(x):
    return _call(lambda x: [trunk_numpy.loaded(x)], [Y], x)[0]


@_loaded.defjvp
def _loaded_along(primals, tangents):
    y, J = _with_jacobian(*primals)
    return y, jnp.einsum("...nyx,...x->...ny", J, tangents[0])


@jax.custom_jvp
def _with_jacobian(x):
    return _call(trunk_numpy.jacobian, [Y, (*Y, SIZE)], x)


@_with_jacobian.defjvp
def _with_jacobian_along(primals, tangents):
    if not hasattr(trunk_numpy, "second"):
        raise NotImplementedError("second derivatives: export again with --second.")
    (x,), (v,) = primals, tangents
    y, J = _with_jacobian(x)
    dJ = _call(lambda x, v: [trunk_numpy.second(x, v)], [(*Y, SIZE)], x, v)[0]
    return [y, J], [jnp.einsum("...nyx,...x->...ny", J, v), dJ]

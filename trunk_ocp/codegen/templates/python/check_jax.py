"""The maps of trunk_jax.py for check.py, in double and single precision."""

# <cut>
# </cut>
import jax
import numpy as np
import trunk_jax as model

POINTS = len(model.Z)
SIZE, CONTROLS = model.SIZE, model.INPUTS["head"].stop
PRECISIONS = {np.float64: 1e-10, np.float32: 1e-4}


def in_precision(function):
    """The function, jitted and for a batch, in the precision of its inputs."""

    def call(*arrays):
        # Not jax.enable_x64, which only JAX 0.8 and later have.
        jax.config.update("jax_enable_x64", bool(arrays[0].dtype == np.float64))
        result = jax.jit(jax.vmap(function))(*arrays)
        assert result.dtype == arrays[0].dtype
        return np.asarray(result)

    return call


MAPS = {
    "loaded": in_precision(model.loaded),
    "jacobian": in_precision(jax.jacrev(model.loaded)),
    "second": in_precision(lambda x, v: jax.jvp(jax.jacrev(model.loaded), (x,), (v,))[1]),
    "unloaded": in_precision(model.unloaded),
    "unloaded_jacobian": in_precision(jax.jacfwd(model.unloaded)),
}

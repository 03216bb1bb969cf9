"""The maps of trunk_torch.py for check.py, in double and single precision."""

import numpy as np

# <cut>
# </cut>
import torch
import trunk_torch as model
from torch.func import jacfwd, jacrev, jvp, vmap

POINTS = len(model.Z)
SIZE, CONTROLS = model.SIZE, model.INPUTS["head"].stop
PRECISIONS = {np.float64: 1e-10, np.float32: 1e-4}


def of_batch(function):
    """The function for a batch, of arrays, in the precision of its inputs."""

    def call(*arrays):
        result = vmap(function)(*(torch.as_tensor(array) for array in arrays)).detach().numpy()
        assert result.dtype == arrays[0].dtype
        return result

    return call


MAPS = {
    "loaded": of_batch(model.loaded),
    "jacobian": of_batch(jacrev(model.loaded)),
    "second": of_batch(lambda x, v: jvp(jacrev(model.loaded), (x,), (v,))[1]),
    "unloaded": of_batch(model.unloaded),
    "unloaded_jacobian": of_batch(jacfwd(model.unloaded)),
}

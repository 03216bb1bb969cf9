"""The maps of trunk_numpy.py for check.py."""

import numpy as np

# <cut>
# </cut>
import trunk_numpy as model

POINTS = len(model.Z)
SIZE, CONTROLS = max(at.stop for at in model.INPUTS.values()), model.INPUTS["head"].stop
PRECISIONS = {np.float64: 1e-10}
MAPS = {
    "loaded": model.loaded,
    "jacobian": lambda x: model.jacobian(x)[1],
    "second": lambda x, v: model.second(x, v),
    "unloaded": model.unloaded,
    "unloaded_jacobian": lambda controls: model.unloaded_jacobian(controls)[1],
}

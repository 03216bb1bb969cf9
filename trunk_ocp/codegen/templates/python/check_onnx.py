"""The maps of trunk.onnx for check.py."""

from pathlib import Path

import numpy as np

# <cut>
# </cut>
import onnxruntime

SESSION = onnxruntime.InferenceSession(Path(__file__).with_name("trunk.onnx"))
KIND = {"tensor(double)": np.float64, "tensor(float)": np.float32}[SESSION.get_inputs()[0].type]
MUSCLES = SESSION.get_inputs()[0].shape[1]
POINTS = SESSION.get_outputs()[0].shape[1]
SIZE, CONTROLS = 0, MUSCLES + 2
PRECISIONS = {np.float64: 1e-10} if KIND is np.float64 else {np.float32: 1e-4}


def run(controls: np.ndarray, ending: str) -> np.ndarray:
    """Outputs whose names have an ending, side by side as in y."""
    names = [name + ending for name in ("position", "directors", "strain")]
    inputs = {"activation": controls[:, :MUSCLES], "head": controls[:, MUSCLES:]}
    last = (CONTROLS,) if ending else ()
    parts = SESSION.run(names, inputs)
    return np.concatenate(
        [part.reshape(len(controls), POINTS, -1, *last) for part in parts], axis=2
    )


MAPS = {
    "unloaded": lambda controls: run(controls, ""),
    "unloaded_jacobian": lambda controls: run(controls, "_jacobian"),
}

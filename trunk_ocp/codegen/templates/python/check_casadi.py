"""The maps of the CasADi function files for check.py."""

from pathlib import Path

# <cut>
# </cut>
import casadi as ca
import numpy as np

FILES = {path.stem: path for path in Path(__file__).parent.glob("*.casadi")}
FUNCTIONS = {name: ca.Function.load(str(path)) for name, path in FILES.items()}
SIZE, CONTROLS = (FUNCTIONS[name].size1_in(0) for name in ("loaded", "unloaded"))
POINTS = FUNCTIONS["loaded"].size1_out(0) // 19
PRECISIONS = {np.float64: 1e-10}


def run(name: str, *inputs: np.ndarray) -> np.ndarray:
    """Last output of a function for each row of its inputs, (cases, points, outputs, ...)."""
    rows = [FUNCTIONS[name].call([*row])[-1].full() for row in zip(*inputs, strict=True)]
    return np.array(rows).reshape(len(rows), POINTS, -1, rows[0].shape[1])


MAPS = {
    "loaded": lambda x: run("loaded", x)[..., 0],
    "jacobian": lambda x: run("loaded_jacobian", x),
    "second": lambda x, v: run("loaded_second", x, v),
    "unloaded": lambda controls: run("unloaded", controls)[..., 0],
    "unloaded_jacobian": lambda controls: run("unloaded_jacobian", controls),
}

"""Numbers and kernels of a generated module, declared here for readers and linters.

The arrays are those of `trunk_ocp.codegen.shape_model.Tables`, in capitals; the kernels are
`trunk_ocp.codegen.rod_space_axes` in Python, `kernel(w, p, value, slopes, xp)`.
"""

from collections.abc import Callable

import numpy as np

MUSCLES: tuple[str, ...]
Z: np.ndarray
INPUTS: dict[str, slice]
OUTPUTS: dict[str, slice]
DEFAULTS: dict[str, tuple[float, ...]]
STRAIN: np.ndarray
FRACTIONS: np.ndarray
SEGMENT: np.ndarray
EDGE: np.ndarray
ENDS: np.ndarray
WIDTHS: np.ndarray
A: np.ndarray
WEIGHTS: np.ndarray
SECTION: np.ndarray
EDGE_SECTION: np.ndarray
FORCE: np.ndarray
EDGE_FORCE: np.ndarray
PIECE: np.ndarray
base_slopes: Callable[..., None]
rates_slopes: Callable[..., None]
report_slopes: Callable[..., None]
turn_slopes: Callable[..., None]
spiral_slopes: Callable[..., None]
base_second: Callable[..., None]
rates_second: Callable[..., None]
report_second: Callable[..., None]

"""Compare this export with its check files: python check.py.

Prints, for each map and each part of a point's outputs, the largest difference over the file,
relative to the largest expected value. Exits with 1 if one is above its limit.
"""

import itertools
import sys
from pathlib import Path

import numpy as np

# <maps>
from check_numpy import CONTROLS, MAPS, POINTS, PRECISIONS, SIZE

# </maps>
ROUND_OFF = 1e-9  # parts below it, such as the moment at the tip, are compared absolutely
PARTS = {
    "position": slice(0, 3),
    "directors": slice(3, 12),
    "strain": slice(12, 16),
    "moment": slice(16, 19),
}


def read(name: str, inputs: int, outputs: int) -> list[np.ndarray]:
    """x, y, J, v, dJ of all cases of a file, if it has them."""
    rest = np.loadtxt(Path(__file__).with_name(name), delimiter=",", ndmin=2)
    shapes = [(inputs,), (POINTS, outputs), (POINTS, outputs, inputs)]
    blocks = []
    for shape in [*shapes, shapes[0], shapes[2]]:
        if rest.shape[1] == 0:
            break
        size = int(np.prod(shape))
        blocks.append(rest[:, :size].reshape(-1, *shape))
        rest = rest[:, size:]
    return blocks


def compare(name: str, got: np.ndarray, wanted: np.ndarray, limit: float) -> bool:
    """Print the error of each part; returns whether all are within the limit."""
    good = got.shape == wanted.shape
    for part, at in PARTS.items() if good else []:
        expected, difference = wanted[:, :, at], (got - wanted)[:, :, at]
        if expected.size:
            largest = np.abs(expected).max()
            error = np.abs(difference).max() / (largest if largest > ROUND_OFF else 1.0)
            good = bool(error <= limit) and good  # NaN is not within
            print(f"{name} {part} {error:.1e}{'' if error <= limit else f'  ABOVE {limit:g}'}")
    return good


def check_file(name: str, inputs: int, outputs: int, maps: list[str]) -> bool:
    """Compare everything in a file, in each precision."""
    x, *wanted = read(name, inputs, outputs)
    good = True
    # The maps give the blocks y, J and dJ; v is an input of the last.
    requests = zip(maps, (0, 1, 3), ((x,), (x,), (x, *wanted[2:3])), strict=False)
    for (which, block, inputs_of), (kind, limit) in itertools.product(requests, PRECISIONS.items()):
        if block < len(wanted):
            label = f"{which} single" if kind is np.float32 else which
            got = np.asarray(MAPS[which](*(part.astype(kind) for part in inputs_of)), dtype=float)
            good = compare(label, got, wanted[block], limit) and good
    return good


def main() -> int:
    """Compare everything; returns the exit code."""
    good = check_file("check_unloaded.csv", CONTROLS, 16, ["unloaded", "unloaded_jacobian"])
    good = check_file("check.csv", SIZE, 19, ["loaded", "jacobian", "second"]) and good
    print("all agree" if good else "some DISAGREE")
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())

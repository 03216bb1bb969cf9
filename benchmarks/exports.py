"""Speed of the exported trunk: `python -m benchmarks.exports`, a minute on a quiet machine.

Exports the elephant for 1, 3 and 10 points, with and without contact, compiles the C code, and
times a shape with its whole Jacobian. Writes the table in docs/how-to/exports.md.
"""

from __future__ import annotations

import re
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import casadi as ca
import numpy as np

import trunk_ocp as to
from trunk_ocp._support.atomic_files import write

PAGE = Path(__file__).parent.parent / "docs" / "how-to" / "exports.md"
START, END = "<!-- speed: python -m benchmarks.exports -->\n", "<!-- end -->"
POINTS = {1: [1.75], 3: [0.5, 1.1, 1.75], 10: [0.175 * (i + 1) for i in range(10)]}
COMPILERS = {"C, `-O3`": ["-O3"]}
RUNS = 3


def main() -> None:
    """Run all timings and write the table."""
    trunk = to.load_anatomy("asian-elephant")
    lines = [
        "| program | points Z | contact | elements | warm start | cold start |",
        "|---|---|---|---|---|---|",
    ]
    for contact in (None, 1.4):
        for count, at in POINTS.items():
            with tempfile.TemporaryDirectory() as folder:
                figures_by_name = of_c(trunk, Path(folder), at, contact)
            lines += [
                row(name, count, contact, *figures) for name, figures in figures_by_name.items()
            ]
            print(lines[-1], flush=True)
    with tempfile.TemporaryDirectory() as folder:
        lines += [row(name, 1, None, *each) for name, each in others(trunk, Path(folder)).items()]
    text = PAGE.read_text()
    before, rest = text.split(START)
    write(PAGE, before + START + "\n" + "\n".join(lines) + "\n\n" + END + rest.split(END)[1])
    print(*lines, sep="\n")


def row(
    name: str, count: int, contact: float | None, elements: int, warm: float, cold: float
) -> str:
    """A row of the table; times in microseconds."""
    times = " | ".join(
        f"{us:.0f} µs" if us < 1000 else f"{us / 1000:.0f} ms" for us in (warm, cold)
    )
    return f"| {name} | {count} | {'yes' if contact else 'no'} | {elements} | {times} |"


def of_c(
    trunk: to.Trunk, folder: Path, at: list[float], contact: float | None
) -> dict[str, tuple[int, float, float]]:
    """Elements and microseconds of the example program, warm and cold."""
    to.export(trunk, "c", folder, at=at, contact_from=contact)
    elements = int(re.search(r"#define TRUNK_ELEMENTS (\d+)", (folder / "trunk.h").read_text())[1])
    figures = {}
    for name, flags in COMPILERS.items():
        sources = ["trunk.c", "example.c", "-lm", "-o", "example"]
        subprocess.run(["cc", "-std=c99", *flags, *sources], cwd=folder, check=True)
        runs = [subprocess.check_output("./example", cwd=folder, text=True) for _ in range(RUNS)]
        times = [[float(us) for us in re.findall(r"median ([\d.]+)", run)] for run in runs]
        warm, cold = (statistics.median(us) for us in zip(*times, strict=True))
        figures[name] = (elements, warm, cold)
    return figures


def others(trunk: to.Trunk, folder: Path) -> dict[str, tuple[int, float, float]]:
    """The same for the NumPy module and the CasADi function, which always start cold."""
    for name in ("numpy", "casadi"):
        to.export(trunk, name, folder / name)
    sys.path.insert(0, str(folder / "numpy"))
    import trunk_numpy

    function = ca.Function.load(str(folder / "casadi" / "loaded_jacobian.casadi"))
    x = trunk_numpy.pack(np.full(len(trunk.muscles), -0.1))
    many = np.tile(x, (100, 1))
    one, casadi = timed(lambda: trunk_numpy.jacobian(x)), timed(lambda: function(x))
    batch = timed(lambda: trunk_numpy.jacobian(many)) / 100
    return {
        "NumPy": (6, one, one),
        "NumPy, each of 100 at once": (6, batch, batch),
        "CasADi": (6, casadi, casadi),
    }


def timed(call: Callable[[], object]) -> float:
    """Median microseconds of a call."""
    call()
    times = []
    for _ in range(30):
        start = time.perf_counter()
        call()
        times.append(1e6 * (time.perf_counter() - start))
    return statistics.median(times)


if __name__ == "__main__":
    main()

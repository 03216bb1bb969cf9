"""`ShapeMap`: start of a second process, shapes per second, and the exported C beside it.

`python -m benchmarks.shape_map` prints all figures; it needs a C compiler and a quiet machine.
"""

from __future__ import annotations

import ctypes
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import trunk_ocp as to

from .common import Cases, cases, distance, fine_mesh, median, seconds

TIP_MASSES = (0.0, 8.0, 20.0)  # kg
STEPS = (4, 5, 8)
FIRST_CALL = """
import time
wall = time.perf_counter()
import numpy as np, trunk_ocp as to
trunk = to.load_anatomy("asian-elephant")
to.ShapeMap(trunk)(np.zeros(len(trunk.muscles)))
print(time.perf_counter() - wall, time.process_time())
"""


def shape_map_figures(shapes: int = 2000, repeats: int = 5) -> dict[str, Any]:
    """All figures of `ShapeMap`; seconds, shapes per second, errors in L."""
    which = cases(shapes, seed=5)
    loads = [to.Loads(9.8, tip_force=(0.0, 0.0, 9.8 * mass)) for mass in TIP_MASSES]
    loaded = [Cases(which.trunk, which.activation, which.head, load) for load in loads]
    exact = [each.solve(fine_mesh(each)) for each in loaded]
    speeds = [by_steps(steps, which, repeats) for steps in STEPS]
    for figures in speeds:
        errors = [error(*pair, figures["steps"]) for pair in zip(loaded, exact, strict=True)]
        figures["error_in_L"] = dict(zip(map("{:g} kg".format, TIP_MASSES), errors, strict=True))
    return first_calls(repeats) | {"by_steps": speeds}


def error(which: Cases, exact: to.Shape, steps: int) -> float:
    """Largest distance from shapes on a fine mesh, in L."""
    solve = to.ShapeMap(which.trunk, which.loads, steps=steps)
    found = solve(which.activation, which.head)
    return distance(found.position, exact.position(solve.Z)) / which.trunk.length


def first_calls(repeats: int = 5) -> dict[str, float]:
    """Wall and CPU seconds up to the first shape, imports included, in a first and later process.

    CPU seconds include the start of Python, wall seconds do not.
    """
    with tempfile.TemporaryDirectory() as folder:
        environment = os.environ | {"NUMBA_CACHE_DIR": folder}
        command = [sys.executable, "-c", FIRST_CALL]
        runs = [
            [float(x) for x in subprocess.check_output(command, env=environment).split()]
            for _ in range(repeats + 1)
        ]
    (wall, cpu), later = runs[0], list(zip(*runs[1:], strict=True))
    return {
        "first_process_wall_seconds": wall,
        "first_process_cpu_seconds": cpu,
        "later_process_wall_seconds": median(later[0]),
        "later_process_cpu_seconds": median(later[1]),
    }


def by_steps(steps: int, which: Cases, repeats: int) -> dict[str, Any]:
    """Speed on one and two threads, and CPU time per shape."""
    shapes = len(which.activation)
    figures: dict[str, Any] = {"steps": steps}
    for threads in (1, 2):
        solve = to.ShapeMap(which.trunk, which.loads, steps=steps, threads=threads)
        call = lambda solve=solve: solve(which.activation, which.head)
        call()
        figures[f"per_second_{threads}_threads"] = shapes / median(seconds(call, repeats))
        figures[f"cpu_us_{threads}_threads"] = 1e6 / shapes * cpu_seconds(call, repeats)
    return figures


def cpu_seconds(call: Callable[[], object], repeats: int) -> float:
    """Median CPU seconds, of all threads."""
    durations = []
    for _ in range(repeats):
        began = time.process_time()
        call()
        durations.append(time.process_time() - began)
    return median(durations)


def beside_c(shapes: int = 1000, repeats: int = 5) -> dict[str, Any]:
    """CPU microseconds of a cold shape and of its Jacobian: kernels here, and the exported C.

    The Jacobian here is of position and tangent at all step edges by the controls; there, of all
    outputs at the tip by controls and loads.
    """
    which = cases(shapes)
    trunk, activation, head = which.trunk, which.activation, which.head
    figures: dict[str, Any] = {}
    for steps in (5, 8):
        solve = to.ShapeMap(trunk, which.loads, steps=steps)
        found = solve(activation, head)
        slopes = lambda solve=solve, found=found: solve.jacobian(found, activation, head)
        slopes()
        call = lambda solve=solve: solve(activation, head)
        figures[f"numba, {steps} steps"] = {
            "shape_us": 1e6 / shapes * cpu_seconds(call, repeats),
            "jacobian_us": 1e6 / shapes * cpu_seconds(slopes, repeats),
        }
    with tempfile.TemporaryDirectory() as folder:
        figures["C"] = of_c(which, Path(folder), repeats)
    return figures


LOOP = """
#include <time.h>
#include <string.h>
#include "trunk.h"
static trunk_work work;
static double seconds(void) {
    struct timespec t;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}
/* CPU seconds of all cold shapes and of their Jacobians; tips (n x 3). Returns failures. */
int all(int n, const double *x, double *tips, double *shape, double *slopes) {
    static double y[TRUNK_POINTS * TRUNK_OUTPUTS], J[TRUNK_POINTS * TRUNK_OUTPUTS * TRUNK_INPUTS];
    int failures = 0;
    *shape = *slopes = 0;
    for (int i = 0; i < n; i++) {
        double a = seconds(), b;
        trunk_reset(&work);
        failures += trunk_loaded(x + i * TRUNK_INPUTS, &work, y) != TRUNK_OK;
        b = seconds();
        trunk_jacobian(&work, J);
        *shape += b - a;
        *slopes += seconds() - b;
        memcpy(tips + 3 * i, y + TRUNK_POSITION, 3 * sizeof *y);
    }
    return failures;
}
"""


def of_c(which: Cases, folder: Path, repeats: int) -> dict[str, Any]:
    """The exported program, compiled with -O3 for this machine."""
    to.export(which.trunk, "c", folder, what="jacobian")
    (folder / "loop.c").write_text(LOOP)
    options = ["-std=gnu99", "-O3", "-march=native", "-fPIC", "-shared", "-o", "loop.so"]
    subprocess.run(["cc", *options, "loop.c", "trunk.c", "-lm"], cwd=folder, check=True)
    library = ctypes.CDLL(str(folder / "loop.so"))
    count = len(which.activation)
    gravity, tip = np.full((count, 1), which.loads.gravity), np.asarray(which.loads.tip_force)
    x = np.hstack([which.activation, which.head, gravity, np.tile(tip, (count, 1))])
    tips, shape, slopes = np.empty((count, 3)), ctypes.c_double(), ctypes.c_double()
    pointer = lambda array: array.ctypes.data_as(ctypes.c_void_p)
    times, failures = [], 0
    for _ in range(repeats):
        failures = library.all(
            count, pointer(x), pointer(tips), ctypes.byref(shape), ctypes.byref(slopes)
        )
        times.append((shape.value, slopes.value))
    solve = to.ShapeMap(which.trunk, which.loads, steps=12)
    exact = solve(which.activation, which.head).position[:, -1]
    us = [1e6 / count * median(each) for each in zip(*times, strict=True)]
    return {
        "shape_us": us[0],
        "jacobian_us": us[1],
        "failures": failures,
        "difference_in_L": distance(tips, exact) / which.trunk.length,
    }


if __name__ == "__main__":
    print(json.dumps({"beside_c": beside_c()}, indent=1))
    print(json.dumps(shape_map_figures(), indent=1))

"""Shared by all benchmark scripts: test cases, timing, and running as a separate process.

A script has a few parts: functions that return a dictionary of figures. `run_part` runs one of
them in this process and prints its figures, CPU and wall seconds and peak memory as JSON.
"""

from __future__ import annotations

import json
import os
import statistics
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import trunk_ocp as to
from trunk_ocp.model.activation import strains
from trunk_ocp.planning.verification import integrate
from trunk_ocp.rod.collocation import Mesh, mesh_for

MOTIONS = ("lift-log", "lift-log-asymmetric", "pick-fruit")
EXTENSION = (0.67, 1.35)
TIP_MASS = 8.0  # kg, the fruit of section 6.1
MARK = "benchmark: "


@dataclass(frozen=True)
class Cases:
    """A family of loaded shapes: activations (n, muscles), head angles (n, 2), one load."""

    trunk: to.Trunk
    activation: np.ndarray
    head: np.ndarray
    loads: to.Loads

    def first(self, count: int) -> Cases:
        return Cases(self.trunk, self.activation[:count], self.head[:count], self.loads)

    def solve(self, mesh: Mesh) -> to.Shape:
        return to.solve_statics(self.trunk, self.activation, self.head, self.loads, mesh)


def cases(count: int, seed: int = 1) -> Cases:
    """Random contractions within the extension bounds, own weight and the fruit's at the tip."""
    trunk = to.load_anatomy("asian-elephant")
    rng = np.random.default_rng(seed)
    activation = -rng.uniform(size=(count, 1)) * rng.uniform(size=(count, len(trunk.muscles)))
    for _ in range(100):
        zeta = strains(trunk, activation)[..., 0]
        outside = np.any((zeta < EXTENSION[0]) | (zeta > EXTENSION[1]), axis=-1)
        activation[outside] *= 0.9
    loads = to.Loads(9.8, tip_force=(0.0, 0.0, 9.8 * TIP_MASS))
    return Cases(trunk, activation, rng.uniform(-0.2, 0.2, size=(count, 2)), loads)


def sample_points(trunk: to.Trunk) -> np.ndarray:
    return np.linspace(0.0, trunk.length, 101)


def reference_lines(which: Cases) -> np.ndarray:
    """Centerlines (n, 101, 3) on a fine mesh."""
    return which.solve(fine_mesh(which)).position(sample_points(which.trunk))


def fine_mesh(which: Cases) -> Mesh:
    return mesh_for(which.trunk, None, 16, 9)


def reference_error(which: Cases) -> float:
    """Difference between the fine mesh and DOP853 from the same m(0), in L."""
    Z, fine = sample_points(which.trunk), which.solve(fine_mesh(which))
    x = np.hstack([which.activation, which.head])
    moment = fine.moment(np.zeros(1))[:, 0]
    path = integrate(which.trunk, x, [which.loads] * len(x), moment, Z)
    return distance(path.position, fine.position(Z)) / which.trunk.length


def distance(a: np.ndarray, b: np.ndarray) -> float:
    """Largest distance between two families of points (..., 3)."""
    return float(np.linalg.norm(a - b, axis=-1).max())


def coarsest(which: Cases, largest_error: float) -> tuple[Mesh, float]:
    """The mesh with the fewest Gauss points that is accurate enough, and its error in L."""
    Z, exact = sample_points(which.trunk), reference_lines(which)
    sizes = sorted(
        ((elements, degree) for elements in range(3, 9) for degree in range(3, 9)),
        key=lambda size: (size[0] * size[1], size[1]),
    )
    for elements, degree in sizes:
        mesh = mesh_for(which.trunk, None, elements, degree)
        error = distance(which.solve(mesh).position(Z), exact) / which.trunk.length
        if error <= largest_error:
            return mesh, error
    raise RuntimeError(f"no mesh reaches {largest_error:g} L")


def seconds(work: Callable[[], Any], repeats: int) -> list[float]:
    """Wall seconds of each of several runs."""
    durations = []
    for _ in range(repeats):
        began = time.perf_counter()
        work()
        durations.append(time.perf_counter() - began)
    return durations


median = statistics.median


def run_part(parts: dict[str, Callable[..., dict[str, Any]]]) -> None:
    """Entry point of a script: run the part named on the command line, print JSON."""
    name, arguments = sys.argv[1], json.loads(sys.argv[2]) if len(sys.argv) > 2 else {}
    wall, cpu = time.perf_counter(), time.process_time()
    before = peak_memory()
    try:
        figures = parts[name](**arguments)
    except ImportError as error:
        figures = {"failed": f"does not import here: {error}"}
    except Exception as error:  # a benchmark that fails is a result
        figures = {"failed": f"{type(error).__name__}: {error}"}
    figures |= {
        "wall_seconds": time.perf_counter() - wall,
        "cpu_seconds": time.process_time() - cpu,
        "peak_memory_mb": peak_memory(),
        "memory_mb_after_import": before,
    }
    print(MARK + json.dumps(figures), flush=True)
    sys.stdout.flush()
    os._exit(0)  # some of the libraries measured here do not exit cleanly


def peak_memory() -> float:
    """Peak resident memory of this process in MB (ru_maxrss may be that of the parent)."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("VmHWM:"):
            return int(line.split()[1]) / 1024
    return float("nan")

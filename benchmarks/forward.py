"""The forward problem, ours: one loaded shape, batches, the closed form, the Jacobian."""

from __future__ import annotations

import inspect
from concurrent.futures import ProcessPoolExecutor
from functools import cache
from typing import Any

import numpy as np

import trunk_ocp as to
from trunk_ocp import statics
from trunk_ocp.collocation import Mesh
from trunk_ocp.unloaded import unloaded_states

from .common import Cases, cases, coarsest, error_of_truth, median, run_part, seconds

ONE, MANY = 1e-6, 1e-5  # error bars of one shape and of a batch, in L
CORES = 2


def mesh_figures(mesh: Mesh, error: float) -> dict[str, Any]:
    return {"elements": mesh.elements, "degree": mesh.degree, "error_in_L": error}


def single(shapes: int = 60, repeats: int = 5) -> dict[str, Any]:
    """One loaded shape after another, each new; and its Jacobian."""
    which = cases(shapes)
    mesh, error = coarsest(which, ONE)
    inputs = list(zip(which.activation, which.head, strict=True))

    def cold(i: int) -> to.Shape:
        return to.solve_statics(which.trunk, *inputs[i], which.loads, mesh)

    solved = [cold(i) for i in range(shapes)]
    cold_times, jacobian_times = [], []
    for i in range(shapes):
        cold_times.append(median(seconds(lambda i=i: cold(i), repeats)))
        jacobian = lambda i=i: to.tip_jacobian(solved[i], *inputs[i], which.loads)
        jacobian_times.append(median(seconds(jacobian, repeats)))
    figures = mesh_figures(mesh, error) | {
        "reference_error_in_L": error_of_truth(which),
        "cold_seconds": median(cold_times),
        "jacobian_seconds": median(jacobian_times),
        "jacobian_over_shape": median(jacobian_times) / median(cold_times),
        "warm_seconds": None,
        "newton_tolerance": statics.TOLERANCE,
    }
    if "start" in inspect.signature(to.solve_statics).parameters:
        figures["warm_seconds"] = warm(which, mesh, repeats)
    return figures


def warm(which: Cases, mesh: Mesh, repeats: int) -> float:
    """One loaded shape from a neighbour: every activation and head angle moved by 0.01."""
    times = []
    for activation, head in zip(which.activation, which.head, strict=True):
        near = to.solve_statics(which.trunk, activation, head, which.loads, mesh)
        moved = (activation - 0.01, head + 0.01)
        work = lambda near=near, moved=moved: to.solve_statics(
            which.trunk, *moved, which.loads, mesh, start=near
        )
        times.append(median(seconds(work, repeats)))
    return median(times)


@cache
def prepared(shapes: int) -> tuple[Cases, Mesh, float]:
    which = cases(shapes)
    mesh, error = coarsest(which.first(100), MANY)
    return which, mesh, error


def loaded_batch(shapes: int) -> None:
    which, mesh, _ = prepared(shapes)
    which.solve(mesh)


def unloaded_batch(shapes: int) -> None:
    """Tip poses, in chunks that stay in the processor's cache."""
    which, _, _ = prepared(1000)
    tip = np.array([which.trunk.length])
    for _ in range(shapes // 1000):
        unloaded_states(which.trunk, which.activation, which.head, tip)


BATCHES = {"loaded": loaded_batch, "unloaded": unloaded_batch}


def batch(kind: str, shapes: int, repeats: int = 5) -> dict[str, Any]:
    """A batch in one process, then one in each of as many processes as cores."""
    which, mesh, error = prepared(1000 if kind == "unloaded" else shapes)
    work = BATCHES[kind]
    work(shapes)
    one = median(seconds(lambda: work(shapes), repeats))
    with ProcessPoolExecutor(CORES) as pool:
        every = [shapes] * CORES
        list(pool.map(work, every))  # start the processes and fill their caches
        both = median(seconds(lambda: list(pool.map(work, every)), repeats))
    figures = {
        "shapes": shapes,
        "per_second_one_core": shapes / one,
        "per_second_two_cores": CORES * shapes / both,
        "seconds": one,
    }
    if kind == "loaded":
        return figures | mesh_figures(mesh, error)
    trunk, some = which.trunk, which.first(50)
    zero = Cases(trunk, some.activation, some.head, to.Loads(gravity=0.0))
    tip = np.array([trunk.length])
    closed, _ = unloaded_states(trunk, some.activation, some.head, tip)
    from_mesh = zero.solve(coarsest(some, 1e-9)[0]).position(tip)
    error = float(np.linalg.norm(closed - from_mesh, axis=-1).max()) / trunk.length
    return figures | {"error_in_L": error}


if __name__ == "__main__":
    run_part({"single": single, "batch": batch})

"""The forward problem in our code: one loaded shape, batches, the closed form, the Jacobian."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

import trunk_ocp as to
from trunk_ocp.rod.newton import STEP_TOL
from trunk_ocp.rod.unloaded import unloaded_states

from .common import (
    Cases,
    cases,
    coarsest,
    distance,
    fine_mesh,
    median,
    reference_error,
    run_part,
    seconds,
)

MAX_ERROR = 1e-6  # of one shape, in L
CORES = 2


def error_of_map(which: Cases, shape_map: to.ShapeMap) -> float:
    """Largest distance at the map's points from shapes on a fine mesh, in L."""
    shapes = shape_map(which.activation, which.head)
    fine = which.solve(fine_mesh(which))
    return distance(shapes.position, fine.position(shape_map.Z)) / which.trunk.length


def single(shapes: int = 60, repeats: int = 5) -> dict[str, Any]:
    """One loaded shape after another, compiled: cold, from a neighbor, and the Jacobian."""
    which = cases(shapes)
    began = time.perf_counter()
    shape_map = to.ShapeMap(which.trunk, which.loads)
    shape_map(which.activation[0], which.head[0])
    compilation = time.perf_counter() - began
    cold, warm, jacobian = [], [], []
    for x, psi in zip(which.activation, which.head, strict=True):
        shape = shape_map(x, psi)
        shape_map.jacobian(shape, x, psi)  # compiled by now
        cold.append(median(seconds(lambda x=x, psi=psi: shape_map(x, psi), repeats)))
        moved = (x - 0.01, psi + 0.01)
        from_neighbor = lambda moved=moved, shape=shape: shape_map(*moved, start=shape)
        warm.append(median(seconds(from_neighbor, repeats)))
        slopes = lambda x=x, psi=psi, shape=shape: shape_map.jacobian(shape, x, psi)
        jacobian.append(median(seconds(slopes, repeats)))
    return {
        "steps": shape_map.Z.size - 1,
        "compilation_seconds": compilation,
        "error_in_L": error_of_map(which, shape_map),
        "reference_error_in_L": reference_error(which),
        "cold_seconds": median(cold),
        "warm_seconds": median(warm),
        "jacobian_seconds": median(jacobian),
        "jacobian_over_shape": median(jacobian) / median(cold),
    }


def collocation(shapes: int = 60, repeats: int = 5) -> dict[str, Any]:
    """The same shapes by collocation in NumPy and CasADi, which needs no compiler."""
    which = cases(shapes)
    mesh, error = coarsest(which, MAX_ERROR)
    cold, jacobian = [], []
    for x, psi in zip(which.activation, which.head, strict=True):
        solve = lambda x=x, psi=psi: to.solve_statics(which.trunk, x, psi, which.loads, mesh)
        shape = solve()
        cold.append(median(seconds(solve, repeats)))
        slopes = lambda x=x, psi=psi, shape=shape: to.tip_jacobian(shape, x, psi, which.loads)
        jacobian.append(median(seconds(slopes, repeats)))
    return {
        "elements": mesh.elements,
        "degree": mesh.degree,
        "error_in_L": error,
        "newton_tolerance": STEP_TOL,
        "cold_seconds": median(cold),
        "jacobian_seconds": median(jacobian),
        "jacobian_over_shape": median(jacobian) / median(cold),
    }


def loaded(shapes: int = 20_000, repeats: int = 5) -> dict[str, Any]:
    """A batch of loaded shapes, on one and on all cores."""
    which = cases(shapes)

    def per_second(threads: int) -> float:
        shape_map = to.ShapeMap(which.trunk, which.loads, threads=threads)
        work = lambda: shape_map(which.activation, which.head)
        work()
        return shapes / median(seconds(work, repeats))

    return {
        "shapes": shapes,
        "error_in_L": error_of_map(which.first(500), to.ShapeMap(which.trunk, which.loads)),
        "per_second_one_core": per_second(1),
        "per_second_two_cores": per_second(CORES),
    }


def unloaded(shapes: int = 500_000, repeats: int = 5) -> dict[str, Any]:
    """Tip poses in closed form, in chunks; compiled, and in NumPy."""
    chunk = 20_000
    which = cases(chunk)
    tip = np.array([which.trunk.length])

    def per_second(threads: int) -> float:
        shape_map = to.ShapeMap(which.trunk, steps=1, threads=threads)

        def work() -> None:
            for _ in range(shapes // chunk):
                shape_map.unloaded(which.activation, which.head)

        work()
        return shapes / median(seconds(work, repeats))

    some = which.first(1000)
    numpy_work = lambda: unloaded_states(some.trunk, some.activation, some.head, tip)
    compiled = to.ShapeMap(which.trunk, steps=1).unloaded(some.activation, some.head)
    loadless = Cases(some.trunk, some.activation, some.head, to.Loads(gravity=0.0)).first(50)
    mesh, _ = coarsest(loadless, 1e-9)
    error = distance(compiled.position[:50, -1:], loadless.solve(mesh).position(tip))
    return {
        "shapes": shapes,
        "error_in_L": error / which.trunk.length,
        "difference_of_codes_in_L": distance(compiled.position[:, -1:], numpy_work()[0])
        / which.trunk.length,
        "per_second_one_core": per_second(1),
        "per_second_two_cores": per_second(CORES),
        "per_second_numpy": 1000 / median(seconds(numpy_work, 50)),
    }


if __name__ == "__main__":
    run_part({"single": single, "collocation": collocation, "loaded": loaded, "unloaded": unloaded})

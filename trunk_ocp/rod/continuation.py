"""Continuation: the load of one rod raised in steps, on a mesh refined where the rod bends sharply.

A thin tip under load bends within a hundredth of the trunk's length, or less. Uniform meshes that
resolve that are wasteful, and on coarser ones Newton's method finds shapes that no rod has.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ..errors import StaticsError
from .collocation import Mesh, gauss
from .newton import compressed, newton
from .rod_batch import RodBatch
from .shape import defects

MAX_ELEMENTS = 200
MAX_WORK = 800  # elements, summed over all tries of Newton's method; some seconds
FIRST_LOAD_STEP = 0.25
MIN_LOAD_STEP = 1e-4
STEP_CUT, TOO_SHARP_CUT = 2, 8
"""Divisors of a failed load step: to run out of elements is the most expensive way to fail."""
NOT_FOUND = (
    "no equilibrium found",
    "the trunk may bend too sharply, coil or buckle. Reduce the load or the activation.",
)
OUT_OF_WORK = (
    "no equilibrium found",
    "the search reached its limit of work, so there may be one. Start from a shape nearby, or "
    "reduce the load or the activation.",
)
COMPRESSED = (
    "the loads compress part of the trunk to nothing",
    "a rod has no shape there. Reduce the load, or check youngs_modulus and radii.",
)
TOO_SHARP = (
    f"the shape bends too sharply for {MAX_ELEMENTS} elements",
    "reduce the load, or use a finer mesh.",
)
Failure = tuple[str, str]  # what is wrong beyond some share of the load, and what to do


def raise_load(rod: RodBatch, max_defect: float = math.inf) -> tuple[Mesh, np.ndarray]:
    """Mesh and states (1, elements, degree + 1, 7) of one rod, its load raised from zero in steps.

    Parameters
    ----------
    rod : with the mesh to start from
    max_defect : see `Shape.defect`; by default the mesh is kept

    Raises
    ------
    StaticsError
        If no equilibrium is found, or not within `MAX_WORK`; names the share of the load reached.
    """
    load, states, reached, ahead, work = rod.loads[0], rod.unloaded(), 0.0, FIRST_LOAD_STEP, 0
    while reached < 1:
        work += rod.mesh.elements
        target = min(1.0, reached + ahead)
        result = solve_refined(replace(rod, loads=[load.scaled(target)]), states, max_defect)
        if isinstance(result[0], Mesh):
            rod, states = replace(rod, mesh=result[0]), result[1]
            reached, ahead = target, 2 * ahead
            continue
        ahead /= TOO_SHARP_CUT if result == TOO_SHARP else STEP_CUT
        if ahead < MIN_LOAD_STEP:
            raise _failed(result, reached)
        if work > MAX_WORK:
            raise _failed(OUT_OF_WORK if result == NOT_FOUND else result, reached)
    return rod.mesh, states


def solve_refined(
    rod: RodBatch, states: np.ndarray, max_defect: float
) -> tuple[Mesh, np.ndarray] | Failure:
    """Mesh and states of one rod near a guess, with elements halved until all resolve it."""
    while True:
        states, converged = newton(rod, states)
        if not converged[0]:
            return NOT_FOUND
        if compressed(rod, states)[0]:
            return COMPRESSED
        mesh, rough = rod.mesh, defects(states[0]) > max_defect
        if not np.any(rough):
            return mesh, states
        if mesh.elements + 2 * np.count_nonzero(rough) > MAX_ELEMENTS:  # once is seldom enough
            return TOO_SHARP
        middles = np.asarray(mesh.edges[:-1])[rough] + mesh.widths[rough] / 2
        finer = Mesh(tuple(np.union1d(mesh.edges, middles).tolist()), mesh.degree)
        states, rod = resample(states, mesh, finer), replace(rod, mesh=finer)


def resample(states: np.ndarray, mesh: Mesh, finer: Mesh) -> np.ndarray:
    """States (B, elements, degree + 1, 7) at the points of a mesh that refines theirs."""
    starts = np.asarray(finer.edges[:-1])
    # By its start, not its points: an element's left edge takes its own side of a jump.
    element = np.searchsorted(np.asarray(mesh.edges[1:-1]), starts, side="right")
    Z = np.hstack([starts[:, None], finer.points])
    tau = (Z - np.asarray(mesh.edges)[element, None]) / mesh.widths[element, None]
    weights = gauss(mesh.degree).value(tau)  # (finer, degree + 1, degree + 1)
    return np.einsum("kij,bkjx->bkix", weights, states[:, element])


def _failed(failure: Failure, reached: float) -> StaticsError:
    """The error of a rod whose load could be raised to a share `reached`."""
    return StaticsError(
        f"{failure[0]} beyond {100 * reached:.1f} % of the load; {failure[1]}", reached
    )

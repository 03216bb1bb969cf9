"""A load raised in steps, on elements that are halved where the shape bends too sharply for them.

A thin tip under load bends within a hundredth of the trunk's length, or less. Even meshes that
resolve that are wasteful, and on coarser ones Newton's method finds what is not there.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..errors import StaticsError
from .collocation import Mesh, gauss

if TYPE_CHECKING:
    from .statics import _Problem

MOST_ELEMENTS = 200
MOST_WORK = 800  # elements, times Newton's method was tried on them; some seconds
SMALLEST_LOAD_STEP = 1e-4
SHORTER = {True: 8, False: 2}
"""By what a load step is divided; more where elements ran out, which costs most to find out."""
LOST = (
    "no equilibrium found",
    "the trunk may bend too sharply, coil or buckle. Reduce the load or the activation.",
)
GIVEN_UP = (
    "no equilibrium found",
    "the search reached its limit of work, so there may be one. Start from a shape nearby, or "
    "reduce the load or the activation.",
)
SQUEEZED = (
    "the loads compress part of the trunk to nothing",
    "a rod has no shape there. Reduce the load, or check youngs_modulus and radii.",
)
ROUGH = (
    f"the shape bends too sharply for {MOST_ELEMENTS} elements",
    "reduce the load, or bring a finer mesh.",
)
Failure = tuple[str, str]  # what is wrong beyond some share of the load, and what to do


def not_found(failure: Failure, reached: float) -> StaticsError:
    """The error of a rod whose load could be raised to a share `reached`."""
    return StaticsError(
        f"{failure[0]} beyond {100 * reached:.1f} % of the load; {failure[1]}", reached
    )


def followed(problem: _Problem, defect: float = math.inf) -> tuple[Mesh, np.ndarray]:
    """Mesh and states (1, elements, degree + 1, 7) of one rod, its load raised from zero in steps.

    Parameters
    ----------
    problem : one rod, with the mesh to start from
    defect : the largest that is allowed, see `Shape.defect`; by default the mesh is kept

    Raises
    ------
    StaticsError
        If no equilibrium is found, or none with so much work; names the share of the load that
        was reached.
    """
    load, states, reached, ahead = problem.loads[0], problem.unloaded(), 0.0, 0.25
    work = 0
    while reached < 1:
        work += problem.mesh.elements
        target = min(1.0, reached + ahead)
        found = settled(replace(problem, loads=[load.scaled(target)]), states, defect)
        if isinstance(found[0], Mesh):
            problem, states = replace(problem, mesh=found[0]), found[1]
            reached, ahead = target, 2 * ahead
        elif (ahead := ahead / SHORTER[found == ROUGH]) < SMALLEST_LOAD_STEP:
            raise not_found(found, reached)
        elif work > MOST_WORK:
            raise not_found(GIVEN_UP if found == LOST else found, reached)
    return problem.mesh, states


def settled(
    problem: _Problem, states: np.ndarray, defect: float
) -> tuple[Mesh, np.ndarray] | Failure:
    """Mesh and states of one rod near a guess, with elements halved until all resolve it."""
    while True:
        states, converged = problem.newton(states)
        if not converged[0]:
            return LOST
        if problem.squeezed(states)[0]:
            return SQUEEZED
        rough = np.abs(np.sum(states[0, ..., :4] ** 2, axis=-1) - 1).max(axis=-1) > defect
        if not np.any(rough):
            return problem.mesh, states
        if problem.mesh.elements + np.count_nonzero(rough) > MOST_ELEMENTS:
            return ROUGH
        mesh = problem.mesh
        middles = np.asarray(mesh.edges[:-1])[rough] + mesh.widths[rough] / 2
        finer = Mesh(tuple(np.union1d(mesh.edges, middles).tolist()), mesh.degree)
        states, problem = resampled(states, mesh, finer), replace(problem, mesh=finer)


def resampled(states: np.ndarray, mesh: Mesh, finer: Mesh) -> np.ndarray:
    """States (B, elements, degree + 1, 7) at the points of a mesh that refines theirs."""
    starts = np.asarray(finer.edges[:-1])
    element = np.searchsorted(np.asarray(mesh.edges[1:-1]), starts, side="right")
    Z = np.hstack([starts[:, None], finer.points])
    tau = (Z - np.asarray(mesh.edges)[element, None]) / mesh.widths[element, None]
    weights = gauss(mesh.degree).value(tau)  # (finer, degree + 1, degree + 1)
    return np.einsum("kij,bkjx->bkix", weights, states[:, element])

"""The forward problem: the equilibrium shape of an activated, loaded trunk.

Newton's method on the collocation equations, for one shape or many at once; where it does not get
from the unloaded shape to the full load, `continuation` raises the load in steps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from .._support.arguments import check_arguments
from .._support.deferred_signals import deferred_interrupts
from ..errors import InputError, StaticsError
from ..model.anatomy import Trunk
from ..model.loads import Loads
from .arguments import check_batch, check_controls, check_mesh
from .collocation import Mesh, mesh_for
from .continuation import raise_load, resample, solve_refined
from .equations import ORIENTATION
from .newton import compressed, newton
from .rod_batch import RodBatch
from .shape import Shape, defects

MESH_ELEMENTS = (6, 12, 24, 48)  # of the default mesh: the first that resolves the shape
MAX_DEFECT = 1e-5  # of a shape that counts as resolved; see Shape.defect
UNRESOLVED_DEFECT = 0.95  # of a shape whose frames have shrunk to nothing, which no rod has


@check_arguments
@deferred_interrupts()
def solve_statics(
    trunk: Trunk,
    activation: np.ndarray,
    head: np.ndarray | tuple[float, float] = (0.0, 0.0),
    loads: Loads | Sequence[Loads] | None = None,
    mesh: Mesh | None = None,
    near: Shape | None = None,
) -> Shape:
    """Equilibrium shape under activation and loads (eqs. 14, 15).

    Starts from the unloaded shape, which is known in closed form. Where Newton's method
    does not get from there to the full load, the load is raised in steps. Of several equilibria,
    the one found is not checked for stability; see `buckling_margin`.

    Parameters
    ----------
    activation : (..., muscles)
        Negative values contract. Leading axes make a batch.
    head : (..., 2)
        psi_Z, psi_Y in radians.
    loads : Loads or one for each shape of the batch
        Default: weight alone.
    mesh : Mesh, optional
        Default: `mesh_for(trunk, contact_from)`, refined until `Shape.defect` is below 1e-5,
        in the end only where the shape needs it.
    near : Shape, optional
        One for each of the batch, to start from; its mesh is used.

    Raises
    ------
    InputError
        For wrong shapes, an activation that collapses a segment, or mixed contact regions.
    StaticsError
        If no equilibrium is found, or none that the finest default mesh resolves; if the loads
        compress the trunk to nothing, zeta <= 0. Names the load fraction reached.
    """
    activation, head = check_controls(trunk, activation, head)
    each = [loads or Loads()] if isinstance(loads, Loads | None) else list(loads)
    batch = check_batch(activation, head, len(each))
    if near is not None:
        mesh = near.mesh
        if near.states.shape[:-3] != batch:
            raise InputError(f"near: expected shapes {batch}, got {near.states.shape[:-3]}.")
    if mesh is None and len({load.contact_from for load in each}) > 1:
        raise InputError("loads: a batch must share one contact_from, or come with a mesh.")
    first = mesh or mesh_for(trunk, each[0].contact_from, MESH_ELEMENTS[0])
    check_mesh(first, trunk, each)
    count = int(np.prod(batch))
    rods = RodBatch(
        trunk,
        first,
        np.broadcast_to(activation, (*batch, activation.shape[-1])).reshape(count, -1),
        np.broadcast_to(head, (*batch, 2)).reshape(count, 2),
        each * (count // len(each)),
    )
    return _solve_refined(rods, batch) if mesh is None else _solve_on_mesh(rods, batch, near)


def refined(shape: Shape, activation: np.ndarray, head: np.ndarray, loads: Loads) -> Shape:
    """The equilibrium of one rod solved again, with elements halved until they resolve it.

    Raises
    ------
    StaticsError
        If no such mesh is found.
    """
    rod = RodBatch(shape.trunk, shape.mesh, activation[None], head[None], [loads])
    result = solve_refined(rod, shape.states[None], MAX_DEFECT)
    if not isinstance(result[0], Mesh):
        raise StaticsError("; ".join(result), 1.0)
    return replace(rod, mesh=result[0]).shape(result[1], ())


def _solve_on_mesh(rods: RodBatch, batch: tuple[int, ...], near: Shape | None) -> Shape:
    """Shapes on the rods' own mesh."""
    start = rods.unloaded()
    if near is not None:
        base = start[:, 0, 0, ORIENTATION].copy()  # Newton leaves the base where the head has it
        start = near.states.reshape(start.shape).copy()
        start[:, 0, 0, ORIENTATION] = base
    shape = rods.shape(_solved(rods, start), batch)
    if np.any(shape.defect > UNRESOLVED_DEFECT):
        raise StaticsError(
            f"the shape bends too sharply for the {rods.mesh.elements} elements of its mesh; "
            "reduce the load, or use a finer mesh.",
            1.0,
        )
    return shape


def _solve_refined(rods: RodBatch, batch: tuple[int, ...]) -> Shape:
    """Shapes on the coarsest mesh that resolves them all.

    Rods that Newton's method does not find from their unloaded shape are left to local refinement:
    to raise their load on each of these meshes takes longest where it helps least.
    """
    for elements in MESH_ELEMENTS:
        rods = replace(rods, mesh=mesh_for(rods.trunk, rods.loads[0].contact_from, elements))
        states, converged = newton(rods, rods.unloaded())
        states[~converged | compressed(rods, states)] = np.nan
        defect = defects(states).max(axis=1)  # NaN where not found
        if not np.any(defect > MAX_DEFECT):
            break
    rough = ~(defect <= MAX_DEFECT)
    return _refine_locally(rods, states, rough, batch) if rough.any() else rods.shape(states, batch)


def _refine_locally(
    rods: RodBatch, states: np.ndarray, rough: np.ndarray, batch: tuple[int, ...]
) -> Shape:
    """Shapes on one mesh, finer where the `rough` ones of the rods (B,) need it.

    states : (B, ...), of the others
    """
    results = {i: (rods.mesh, states[i : i + 1]) for i in range(len(rough))}
    for index in np.flatnonzero(rough).tolist():
        try:
            results[index] = raise_load(rods.only(index), MAX_DEFECT)
        except StaticsError as error:
            raise rods.named(error, index) from None
    edges = np.unique(np.concatenate([mesh.edges for mesh, _ in results.values()]))
    finer = Mesh(tuple(edges.tolist()), rods.mesh.degree)
    start = np.concatenate([resample(its, mesh, finer) for mesh, its in results.values()])
    rods = replace(rods, mesh=finer)
    return rods.shape(_solved(rods, start), batch)


def _solved(rods: RodBatch, start: np.ndarray) -> np.ndarray:
    """States from guesses; raises the first rod's error if some equilibrium is not found."""
    states, errors = _solve(rods, start)
    for index, error in errors.items():
        raise rods.named(error, index)
    return states


def _solve(rods: RodBatch, start: np.ndarray) -> tuple[np.ndarray, dict[int, StaticsError]]:
    """States from guesses, or else by raising the load; NaN and an error where not found."""
    states, converged = newton(rods, start)
    errors: dict[int, StaticsError] = {}
    for index in np.flatnonzero(~converged | compressed(rods, states)).tolist():
        try:
            states[index] = raise_load(rods.only(index))[1][0]
        except StaticsError as error:
            states[index], errors[index] = np.nan, error
    return states, errors

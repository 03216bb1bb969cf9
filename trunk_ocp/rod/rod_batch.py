"""A batch of rods on one mesh: the arguments of their equations, and shapes from their states."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import casadi as ca
import numpy as np

from ..errors import StaticsError
from ..model.activation import mean_extension, segment_at, strains
from ..model.anatomy import Trunk
from ..model.head import base_pose
from ..model.loads import Loads
from .collocation import Mesh, gauss
from .equations import (
    ARGUMENTS,
    HUNG_PARAMETERS,
    ORIENTATION,
    PARAMETERS,
    POSITION,
    STATES,
    is_hung,
    mesh_parameters,
    rates,
)
from .shape import Shape
from .unloaded import unloaded_states


@dataclass(frozen=True, eq=False)
class RodBatch:
    """B rods: activation (B, muscles), head angles (B, 2) in radians, one load each."""

    trunk: Trunk
    mesh: Mesh
    activation: np.ndarray
    head: np.ndarray
    loads: list[Loads]

    def only(self, index: int) -> RodBatch:
        """One rod of the batch, as a batch."""
        one = slice(index, index + 1)
        return replace(
            self, activation=self.activation[one], head=self.head[one], loads=self.loads[one]
        )

    def named(self, error: StaticsError, index: int) -> StaticsError:
        """The error of one rod, with its number if the batch has others."""
        count = len(self.loads)
        which = f"shape {index + 1} of {count}: " if count > 1 else ""
        return StaticsError(f"{which}{error}", error.load_fraction)

    @cached_property
    def intrinsic(self) -> np.ndarray:
        """Strain numbers (B, segments, 4); see `activation.strains`."""
        return strains(self.trunk, self.activation)

    @property
    def hung(self) -> bool:
        """Whether the contact force of any rod acts on a lever; see `rates`."""
        return any(map(is_hung, self.loads))

    @cached_property
    def arguments(self) -> tuple[np.ndarray, np.ndarray]:
        """Arguments of `rates` besides the states: (8, B, E, d) of w and (11, B, E, d) of p.

        Of hung rods p is (14, B, E, d).
        """
        B, E, d = len(self.loads), self.mesh.elements, self.mesh.degree
        w = np.empty((ARGUMENTS - STATES, B, E, d))
        segment = segment_at(self.trunk, self.mesh.points[:, 0])
        w[:4] = np.moveaxis(self.intrinsic[:, segment, :], -1, 0)[..., None]
        w[4] = mean_extension(self.trunk, self.intrinsic)[:, None, None]
        tip = np.array([load.tip_force for load in self.loads]).reshape(B, 3)
        w[5:] = tip.T[:, :, None, None]
        hung = self.hung
        p = np.empty((HUNG_PARAMETERS if hung else PARAMETERS, B, E, d))
        for i, load in enumerate(self.loads):
            p[:, i] = mesh_parameters(self.trunk, load, self.mesh, hung).reshape(len(p), E, d)
        return w, p

    def unloaded(self) -> np.ndarray:
        """Unloaded states (B, elements, degree + 1, 7): the start of Newton's method."""
        points = np.hstack([np.asarray(self.mesh.edges[:-1])[:, None], self.mesh.points])
        _, q = unloaded_states(self.trunk, self.activation, self.head, points.ravel())
        states = np.zeros((len(self.loads), *points.shape, STATES))
        states[..., ORIENTATION] = q.reshape(*states.shape[:-1], 4)
        return states

    def shape(self, states: np.ndarray, batch: tuple[int, ...]) -> Shape:
        """Shapes of states (B, ...), with the centerline integrated from the base."""
        (rate,) = evaluate(rates(self.hung), states[..., 1:, :], *self.arguments)
        slopes = rate[..., POSITION]
        weights = gauss(self.mesh.degree).integral(1.0)
        steps = np.einsum("d,bkdc->bkc", weights, slopes) * self.mesh.widths[:, None]
        r0, _ = base_pose(self.trunk.head, self.head[:, 0], self.head[:, 1])
        edges = np.concatenate([np.stack(r0, axis=-1)[:, None], steps], axis=1).cumsum(axis=1)
        arrays = (self.intrinsic, states, edges, slopes)
        return Shape(
            self.trunk, self.mesh, *(array.reshape(*batch, *array.shape[1:]) for array in arrays)
        )


def shape_of_states(
    trunk: Trunk, mesh: Mesh, x: np.ndarray, loads: Sequence[Loads], states: np.ndarray
) -> Shape:
    """Shapes (H,) from states already known, such as those of an optimal plan.

    x : (H, muscles + 2), activations and head angles; states : (H, elements, degree + 1, 7).
    """
    rods = RodBatch(trunk, mesh, x[:, :-2], x[:, -2:], list(loads))
    return rods.shape(states, (len(x),))


def unloaded_shape(trunk: Trunk, mesh: Mesh, x: np.ndarray, loads: Sequence[Loads]) -> Shape:
    """Shapes (H,) without loads, in closed form; x as in `shape_of_states`."""
    rods = RodBatch(trunk, mesh, x[:, :-2], x[:, -2:], [load.scaled(0.0) for load in loads])
    return rods.shape(rods.unloaded(), (len(x),))


def evaluate(
    function: ca.Function, states: np.ndarray, w: np.ndarray, p: np.ndarray
) -> list[np.ndarray]:
    """Outputs (B, E, d, ...) of a function like `rates` at Gauss-point states (B, E, d, 7).

    w, p : the other arguments, as in `RodBatch.arguments`.
    """
    points = states.shape[:3]
    sizes = [function.size1_out(i) for i in range(function.n_out())]
    if not states.size:
        return [np.zeros((*points, size)) for size in sizes]
    count = int(np.prod(points))
    columns = np.empty((count, ARGUMENTS))  # one row a point, as CasADi stores columns
    columns[:, :STATES] = states.reshape(count, STATES)
    columns[:, STATES:] = w.reshape(len(w), count).T
    values = [np.empty((count, size)) for size in sizes]
    buffer, run = _mapped(function, count).buffer()
    arguments = columns, np.ascontiguousarray(p.reshape(len(p), count).T)
    for i, array in enumerate(arguments):
        buffer.set_arg(i, memoryview(array))  # type: ignore
    for i, array in enumerate(values):
        buffer.set_res(i, memoryview(array))  # type: ignore
    run()
    return [value.reshape(*points, -1) for value in values]


@lru_cache(maxsize=64)
def _mapped(function: ca.Function, count: int) -> ca.Function:
    """A function at many points, all of whose inputs and outputs are dense."""
    return function.map(count)

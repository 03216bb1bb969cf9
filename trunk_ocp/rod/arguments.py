"""Arguments of the solvers in this folder, checked."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from .._support.arguments import real_array
from .._support.ranges import check
from ..errors import InputError
from ..model.activation import mean_extension, strains
from ..model.anatomy import Trunk, check_activation
from ..model.loads import Loads
from .collocation import Mesh
from .point_shapes import PointShapes
from .shape import points_on

FULL_TURN = 2 * math.pi  # larger head angles are most likely in degrees


def check_controls(
    trunk: Trunk,
    activation: np.ndarray,
    head: np.ndarray | tuple[float, float],
) -> tuple[np.ndarray, np.ndarray]:
    """Activations (..., muscles) and head angles (..., 2) as float arrays.

    Raises
    ------
    InputError
        For wrong shapes, values that are not finite, or an activation that collapses a segment.
    """
    activation, head = _check_values(trunk, activation, head)
    _check_extension(strains(trunk, activation)[..., 0])
    return activation, head


def _check_values(
    trunk: Trunk, activation: np.ndarray, head: np.ndarray | tuple[float, float]
) -> tuple[np.ndarray, np.ndarray]:
    activation, head = check_activation(trunk, activation), real_array(head, "head")
    if head.shape[-1:] != (2,) or not np.all(np.isfinite(head)):
        raise InputError("head: expected finite angles (psi_Z, psi_Y), shape (..., 2).")
    if np.abs(head).max(initial=0.0) > FULL_TURN:
        raise InputError(f"head: expected radians, got {np.abs(head).max():g}; is that in degrees?")
    return activation, head


def _check_extension(zeta: np.ndarray) -> None:
    """Raise InputError if an extension zeta (..., segments) is not above 0."""
    if np.any(zeta <= 0):
        worst = np.unravel_index(np.argmin(zeta), zeta.shape)[:-1]
        which = f"[{', '.join(map(str, worst))}]" if worst else ""
        raise InputError(
            f"activation{which}: contracts a segment to {zeta.min():.3g} of its length; "
            "the extension must stay above 0."
        )


@dataclass(frozen=True, eq=False)
class Controls:
    """Checked arguments of a batch of B shapes, whose axes are flattened into one."""

    batch: tuple[int, ...]
    activation: np.ndarray  # (B, muscles)
    head: np.ndarray  # (B, 2)
    strain: np.ndarray  # (B, segments, 4)
    mean: np.ndarray  # (B,)
    collapsed: np.ndarray  # (B,), whether a segment's extension is not above 0

    def __getitem__(self, index: np.ndarray | slice) -> Controls:
        """Some shapes of the batch; `batch` stays that of all."""
        arrays = (self.activation, self.head, self.strain, self.mean, self.collapsed)
        return Controls(self.batch, *(array[index] for array in arrays))

    @classmethod
    def of(
        cls,
        trunk: Trunk,
        activation: np.ndarray,
        head: np.ndarray | tuple[float, float],
        strict: bool,
        shapes: tuple[int, ...] = (),
    ) -> Self:
        """Checked arguments, broadcast to the batch axes `shapes` that come with them.

        strict : whether an activation that collapses a segment raises InputError.
        """
        activation, head = _check_values(trunk, activation, head)
        strain = strains(trunk, activation)
        if strict:
            _check_extension(strain[..., 0])
        axes = [activation.shape[:-1], head.shape[:-1], *([shapes] if shapes else [])]
        try:
            batch = np.broadcast_shapes(*axes)
        except ValueError:
            raise InputError(
                "activation, head and shapes: expected leading axes that match, got "
                f"{', '.join(map(str, axes))}."
            ) from None
        count, muscles = math.prod(batch), activation.shape[-1]
        gamma = np.broadcast_to(activation, (*batch, muscles)).reshape(count, muscles)
        psi = np.broadcast_to(head, (*batch, 2)).reshape(count, 2)
        strain = np.broadcast_to(strain, (*batch, *strain.shape[-2:]))
        strain = strain.reshape(count, *strain.shape[-2:]).copy()
        mean, collapsed = mean_extension(trunk, strain), np.any(strain[..., 0] <= 0, axis=1)
        return cls(batch, gamma, psi, strain, mean, np.asarray(collapsed))


def check_batch(activation: np.ndarray, head: np.ndarray, loads: int) -> tuple[int, ...]:
    """Leading axes of the shapes for controls and a number of loads, along the last axis.

    Raises
    ------
    InputError
        If they do not match.
    """
    axes = activation.shape[:-1], head.shape[:-1]
    try:
        batch = np.broadcast_shapes(*axes, () if loads == 1 else (loads,))
    except ValueError:
        batch = (0,)
    if loads == 0 or 0 in batch or (loads > 1 and batch[-1] != loads):
        raise InputError(
            f"activation, head and loads: expected leading axes that match, got {axes[0]} "
            f"and {axes[1]} with {loads} loads."
        )
    return batch


def check_mesh(mesh: Mesh, trunk: Trunk, loads: Sequence[Loads]) -> None:
    """Raise InputError unless a mesh covers the trunk, with an edge on every jump."""
    jumps = {*trunk.edges} | {x.contact_from for x in loads if x.contact_from is not None}
    ends = (mesh.edges[0], mesh.edges[-1])
    increasing = bool(np.all(mesh.widths > 0))
    if not increasing or ends != (0.0, trunk.length) or not jumps <= {*mesh.edges}:
        raise InputError(
            f"mesh: expected edges from 0 to {trunk.length:g} m, with one at every segment end and "
            "start of contact; mesh_for makes such a mesh."
        )


def check_map_arguments(trunk: Trunk, at: Sequence[float], steps: int, threads: int) -> None:
    """Raise InputError for invalid arguments of a `ShapeMap`."""
    check(int(steps), "elements", "steps")
    check(int(threads), "processes", "threads")
    points = real_array(at, "at")
    if points.ndim != 1:
        raise InputError(f"at = {at!r}: expected a list of points Z in m.")
    points_on(trunk, points)


def check_points(Z: np.ndarray, shapes: PointShapes) -> None:
    """Raise InputError unless shapes are at the points Z of a map."""
    if not isinstance(shapes, PointShapes):
        raise InputError(
            f"shapes: expected PointShapes of a ShapeMap, got {type(shapes).__name__}."
        )
    if not np.array_equal(shapes.Z, Z):
        raise InputError(
            f"shapes: expected shapes at this map's {Z.size} points, got {shapes.Z.size} "
            "points of another map."
        )


def check_start(shapes: PointShapes, batch: tuple[int, ...]) -> None:
    """Raise InputError unless there is a start for each shape of a batch."""
    axes = shapes.path.shape[:-2]
    try:
        matches = np.broadcast_shapes(axes, batch) == batch
    except ValueError:
        matches = False
    if not matches:
        raise InputError(f"start: expected shapes with leading axes {batch}, got {axes}.")

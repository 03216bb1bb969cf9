"""Activations and head angles of a batch of shapes, checked, with the strains that they cause."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Self

import numpy as np

from ..errors import InputError
from ..model.activation import mean_extension, strains
from ..model.anatomy import Trunk
from .arguments import check_controls


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
        activation, head = check_controls(trunk, activation, head, not strict)
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
        strain = np.ascontiguousarray(strains(trunk, gamma))
        mean, collapsed = mean_extension(trunk, strain), np.any(strain[..., 0] <= 0, axis=1)
        return cls(batch, gamma, psi, strain, mean, np.asarray(collapsed))

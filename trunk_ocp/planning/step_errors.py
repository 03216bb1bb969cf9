"""Errors of a plan at its targets, from the independently integrated shapes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .._support.wording import rounded
from ..problem.motion import Motion
from ..problem.targets import Direction, HeldDirection, Target
from .verification import Verification


@dataclass(frozen=True, eq=False)
class StepErrors:
    """Errors of one time step, target by target.

    `position` in m at `position_Z`; `direction` is the length of the director's error at
    `direction_Z`; `paper` is J_T of eq. (42).
    """

    position_Z: np.ndarray
    position: np.ndarray
    position_weights: np.ndarray
    direction_Z: np.ndarray
    direction: np.ndarray
    direction_weights: np.ndarray

    @property
    def paper(self) -> float:
        """J_T of eq. (42): weighted sum of distances, not squared."""
        return float(
            self.position_weights @ self.position + self.direction_weights @ self.direction
        )

    def squared(self, position_scale: float) -> float:
        """Weighted sum of squared errors, positions in units of 1 / `position_scale` m."""
        position = float(self.position_weights @ self.position**2)
        return position * position_scale**2 + float(self.direction_weights @ self.direction**2)

    def exceed(self, tolerance: tuple[float, float]) -> bool:
        """Whether a position (m) or a direction is missed by more than a tolerance."""
        far = np.any(~(self.position <= tolerance[0]))
        return bool(far or np.any(~(self.direction <= tolerance[1])))


def step_errors(
    motion: Motion, verification: Verification, head: np.ndarray
) -> tuple[StepErrors, ...]:
    """Errors of each verified step of a motion, from the independently integrated shapes.

    head : (H, 2), head angles of the steps in rad
    """
    at = verification.at

    def wanted(target: Target, direction: Direction, head: np.ndarray) -> np.ndarray:
        if isinstance(direction, HeldDirection):
            return at(direction.step, direction.Z)[1][direction.director]
        return target.direction_at(direction, head)

    errors = []
    for t, step in enumerate(motion.steps[: len(verification.targets)]):
        positions = [
            (
                target.Z,
                _distance(at(t, target.Z)[0], target.position_at(motion.trunk, head[t])),
                target.position_weight,
            )
            for target in step.targets
            if target.position is not None and target.position_weight > 0
        ]
        directions = [
            (target.Z, _distance(at(t, target.Z)[1][j], wanted(target, direction, head[t])), weight)
            for target in step.targets
            for j, direction, weight in target.pairs()
        ]
        errors.append(StepErrors(*_columns(positions), *_columns(directions)))
    return tuple(errors)


def missed_targets(errors: Sequence[StepErrors], tolerance: tuple[float, float]) -> list[str]:
    """Targets missed by more than a tolerance of positions (m) and directions, a sentence each."""
    position, direction = tolerance
    sentences = []
    for number, step in enumerate(errors, 1):
        for Z, error in zip(step.position_Z, step.position, strict=True):
            if not error <= position:
                sentences.append(
                    f"step {number}: the target at Z = {Z:g} m is missed by "
                    f"{rounded(1e3 * error, 4)} mm, {1e3 * position:g} mm is allowed"
                )
        for Z, error in zip(step.direction_Z, step.direction, strict=True):
            if not error <= direction:
                sentences.append(
                    f"step {number}: the direction at Z = {Z:g} m is missed by "
                    f"{error:.3g}, {direction:g} is allowed"
                )
    return sentences


def _distance(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.linalg.norm(a - b))


def _columns(rows: list[tuple[float, float, float]]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    table = np.array(rows, dtype=float).reshape(-1, 3)
    return table[:, 0], table[:, 1], table[:, 2]

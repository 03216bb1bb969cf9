"""The paper's J_T, eq. (42): un-squared norms and the extension penalty, over our shapes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import trunk_ocp as to
from trunk_ocp.activation import strains
from trunk_ocp.loads import Loads
from trunk_ocp.planner import first_mesh
from trunk_ocp.rotations import directors
from trunk_ocp.targets import Held
from trunk_ocp.unloaded import unloaded_states

PENALTY = 1e3
FAILED = 2e3  # no shape, or none found
SMALLEST = 0.05  # extension below which no shape is asked for


class Objective:
    """J_T of a motion for batches of unknowns x (n, muscles + 2)."""

    def __init__(self, motion: to.Motion) -> None:
        self.motion, self.trunk = motion, motion.trunk
        options = to.Options()
        self.mesh = first_mesh(motion, options)
        self.held: dict[Held, np.ndarray] = {}
        self.evaluations = 0

    def decide(self, t: int, x: np.ndarray) -> None:
        """Note the directions that later steps take from step t."""
        for held in self.motion.held:
            if held.step == t:
                shape = to.solve_statics(self.trunk, x[:-2], x[-2:], self.loads(t), self.mesh)
                self.held[held] = shape.directors(np.array([held.Z]))[0, held.director]

    def loads(self, t: int) -> Loads:
        step = self.motion.steps[t]
        if step.pull is None:
            return step.loads
        strength, held = step.pull
        force = np.asarray(step.loads.tip_force) + strength * self.held[held]
        return replace(step.loads, tip_force=tuple(force.tolist()))

    def loaded(self, t: int, x: np.ndarray) -> np.ndarray:
        """J_T (n,) of the main problem."""
        J, zeta = np.full(len(x), FAILED), strains(self.trunk, x[:, :-2])[..., 0].min(axis=-1)
        usable = np.flatnonzero(zeta > SMALLEST)
        self.evaluations += usable.size
        if usable.size:
            J[usable] = self._some(t, x[usable])
        return J

    def _some(self, t: int, x: np.ndarray) -> np.ndarray:
        try:
            shape = to.solve_statics(self.trunk, x[:, :-2], x[:, -2:], self.loads(t), self.mesh)
        except to.StaticsError:
            if len(x) == 1:
                return np.array([FAILED])
            return np.concatenate([self._some(t, x[i : i + 1]) for i in range(len(x))])
        Z = np.array([target.Z for target in self.motion.steps[t].targets])
        return self._misses(t, x, shape.position(Z), shape.directors(Z))

    def unloaded(self, t: int, x: np.ndarray) -> np.ndarray:
        """J_T (n,) of the auxiliary problem, by the closed form."""
        Z = np.array([target.Z for target in self.motion.steps[t].targets])
        with np.errstate(all="ignore"):
            r, q = unloaded_states(self.trunk, x[:, :-2], x[:, -2:], Z)
            rows = directors(tuple(np.moveaxis(q, -1, 0)))
            d = np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
            return np.nan_to_num(self._misses(t, x, r, d), nan=FAILED)

    def _misses(self, t: int, x: np.ndarray, r: np.ndarray, d: np.ndarray) -> np.ndarray:
        low, high = self.motion.extension
        zeta = strains(self.trunk, x[:, :-2])[..., 0]
        outside = np.any((zeta < low) | (zeta > high), axis=-1)
        J = np.where(outside, PENALTY, 0.0)
        for p, target in enumerate(self.motion.steps[t].targets):
            if target.position is not None:
                miss = np.linalg.norm(r[:, p] - np.asarray(target.position), axis=-1)
                J += target.position_weight * miss
            for j, wanted, weight in target.pairs():
                goal = self.held[wanted] if isinstance(wanted, Held) else np.asarray(wanted)
                J += weight * np.linalg.norm(d[:, p, j] - goal, axis=-1)
        return J

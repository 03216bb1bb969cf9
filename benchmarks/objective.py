"""The paper's J_T (eq. 42, un-squared norms and extension penalty), for our shapes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import trunk_ocp as to
from trunk_ocp.model.activation import strains
from trunk_ocp.model.loads import Loads
from trunk_ocp.problem.targets import HeldDirection

PENALTY = 1e3
FAILED = 2e3  # J if no shape was found
MIN_EXTENSION = 0.05  # below which no shape is computed


class Objective:
    """J_T of a motion for batches of unknowns x (n, muscles + 2)."""

    def __init__(self, motion: to.Motion) -> None:
        self.motion, self.trunk = motion, motion.trunk
        self.maps: dict[tuple[int, Loads], to.ShapeMap] = {}
        self.held: dict[HeldDirection, np.ndarray] = {}
        self.evaluations = 0

    def decide(self, t: int, x: np.ndarray) -> None:
        """Record the directions of step t that later steps refer to."""
        for held in self.motion.held:
            if held.step == t:
                shape_map = to.ShapeMap(self.trunk, self.loads(t), [held.Z])
                shape = shape_map(x[:-2], x[-2:])
                (at,) = np.flatnonzero(shape_map.Z == held.Z)
                self.held[held] = shape.directors[at, held.director]

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
        usable = np.flatnonzero(zeta > MIN_EXTENSION)
        self.evaluations += usable.size
        if usable.size:
            J[usable] = self._some(t, x[usable])
        return J

    def _some(self, t: int, x: np.ndarray) -> np.ndarray:
        shapes = self.map(t, self.loads(t))(x[:, :-2], x[:, -2:])
        return np.nan_to_num(self._misses(t, x, shapes), nan=FAILED)

    def unloaded(self, t: int, x: np.ndarray) -> np.ndarray:
        """J_T (n,) of the auxiliary problem, by the closed form."""
        J, zeta = np.full(len(x), FAILED), strains(self.trunk, x[:, :-2])[..., 0].min(axis=-1)
        usable = np.flatnonzero(zeta > MIN_EXTENSION)
        if usable.size:
            shapes = self.map(t, self.loads(t)).unloaded(x[usable, :-2], x[usable, -2:])
            J[usable] = self._misses(t, x[usable], shapes)
        return J

    def map(self, t: int, loads: Loads) -> to.ShapeMap:
        """The fastest forward solve, with a point at every target of step t."""
        key = (t, loads)
        if key not in self.maps:
            points = [target.Z for target in self.motion.steps[t].targets]
            self.maps = {key: to.ShapeMap(self.trunk, loads, points, steps=4, strict=False)}
        return self.maps[key]

    def _misses(self, t: int, x: np.ndarray, shapes: to.PointShapes) -> np.ndarray:
        at = np.searchsorted(shapes.Z, [target.Z for target in self.motion.steps[t].targets])
        r, d = shapes.position[:, at], shapes.directors[:, at]
        low, high = self.motion.extension
        zeta = strains(self.trunk, x[:, :-2])[..., 0]
        outside = np.any((zeta < low) | (zeta > high), axis=-1)
        J = np.where(outside, PENALTY, 0.0)
        for p, target in enumerate(self.motion.steps[t].targets):
            if target.position is not None:
                miss = np.linalg.norm(r[:, p] - np.asarray(target.position), axis=-1)
                J += target.position_weight * miss
            for j, wanted, weight in target.pairs():
                goal = (
                    self.held[wanted] if isinstance(wanted, HeldDirection) else np.asarray(wanted)
                )
                J += weight * np.linalg.norm(d[:, p, j] - goal, axis=-1)
        return J

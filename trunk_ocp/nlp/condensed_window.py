"""A window of time steps condensed to its controls: quadratic models with exact derivatives.

The NLP of a window has some 230 variables a time step, all but 30 of which follow from the
controls. Here they are eliminated, which leaves the controls of all steps and the held directions,
z = (x_1, ..., x_H, D). `CondensedWindow.model` gives objective and Lagrangian to second order in z,
from which sequential quadratic programming takes its steps. It has the solutions of the full NLP.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np

from ..model.activation import segment_at, segment_fractions, strain_matrix, strains
from ..problem.targets import HeldDirection
from ..rod.collocation import Mesh, gauss
from ..rod.equations import MOMENT, POSITION, STATES, is_hung, mesh_parameters
from ..rod.shape import Shape
from .condensed_rods import FORCED, CondensedRods, RodEquationsAt
from .control_costs import ControlCosts
from .point_functions import base, director, scaled_rates
from .quadratic_model import QuadraticModel
from .term_derivatives import first_derivatives, second_derivatives, values
from .window import Window

MAX_SETTLING = 8
"""Simplified Newton steps to equilibrium after a change of the controls."""
MAX_RESIDUAL = 1.0
"""Beyond which simplified Newton steps are not worth trying."""
SETTLED_TOL = 1e-8
"""Residual of the rods' equations, in the NLP's units, that counts as equilibrium."""


class CondensedWindow:
    """The NLP of a window that `can_condense`, in its controls and held directions.

    Attributes
    ----------
    x : (H, controls) int
        Indices of the controls in the decision vector.
    held : (D, 3) int
        Those of the held directions.
    local : int
        Number C of local controls: a step's own, and all held directions.
    size : int
        Length of z.
    extension : (segments, muscles)
        Derivative of the segments' extensions by the activations.
    """

    def __init__(self, window: Window) -> None:
        unknowns = window.unknowns
        self.x = np.stack([u.x for u in unknowns])
        self._edges = np.stack([u.edges for u in unknowns])
        self._inner = np.stack([u.inner for u in unknowns])
        self._strain = np.stack([u.strain for u in unknowns])
        self._mean = np.stack([u.mean[0] for u in unknowns])
        self._tip_force = np.stack([u.tip_force for u in unknowns])
        self._line = np.stack([u.line for u in unknowns])
        self._references = list(window.held)
        self.held = np.array([*window.held.values()], dtype=int).reshape(-1, 3)
        self.local = self.x.shape[1] + self.held.size
        self.size = self.x.size + self.held.size
        self._trunk, self._mesh, self._length = window.motion.trunk, window.mesh, window.length
        self._segment = segment_at(self._trunk, self._mesh.points[:, 0])
        self._set_points(window)
        self._costs = ControlCosts.of(window)
        self._set_numbers(window)

    def renumbered(self, window: Window) -> CondensedWindow:
        """The same for a window that differs in numbers only; see `layout_of`."""
        other = copy.copy(self)
        other._set_numbers(window)
        return other

    # --- layout ----------------------------------------------------------------------------

    def _set_points(self, window: Window) -> None:
        """Points with a target or a held direction, and how states and rates give their poses."""
        rows = []
        for t, u in enumerate(window.unknowns):
            for Z, (q, r) in u.points.items():
                rows.append((t, q, r, *_pose_weights(window.mesh, window.length, Z)))
        E, d, P = window.mesh.elements, window.mesh.degree, len(rows)
        columns: list[Any] = list(zip(*rows, strict=True)) if P else [()] * 7
        step, q, r, element, edge, of_states, of_rates = columns
        self._point_step, self._point_element = np.array(step, int), np.array(element, int)
        self._point_edge = np.array(edge, int)
        self._q, self._r = np.array(q, int).reshape(P, 4), np.array(r, int).reshape(P, 3)
        self._of_states = np.array(of_states).reshape(P, d + 1)
        self._of_rates = np.array(of_rates).reshape(P, E, d)
        self._step_of = np.zeros(window.bounds["lbx"].size, dtype=int)
        for t, u in enumerate(window.unknowns):
            for index in (u.x, *(part for pose in u.points.values() for part in pose)):
                self._step_of[index] = t

    def _set_numbers(self, window: Window) -> None:
        """Everything that may change from one motion to the next: targets, loads, the start."""
        self.window = window
        mesh, trunk, H = self._mesh, self._trunk, len(self.x)
        steps = window.steps
        hung = any(is_hung(step.loads) for step in steps)
        self._function = scaled_rates(window.length, window.moment, hung)
        by_load = {
            load: mesh_parameters(trunk, load, mesh, hung).T
            for load in {step.loads for step in steps}
        }
        shape = (H, mesh.elements, mesh.degree, -1)
        self._parameters = np.stack([by_load[step.loads] for step in steps]).reshape(shape)
        self._force = np.array([step.loads.tip_force for step in steps]) / window.force
        self._pull = np.zeros((H, 3, self.held.size))
        for t, step in enumerate(steps):
            if step.pull is None:
                continue
            strength, held = step.pull
            if held in window.held:
                at = 3 * self._references.index(held)
                self._pull[t, :, at : at + 3] = strength / window.force * np.eye(3)
            else:
                self._force[t] += strength / window.force * window.known[held]
        self._goals = [
            (function, variables.T, parameters.T, self._step_of[variables].max(axis=0))
            for function, variables, parameters in window.tracking()
        ]
        A = strain_matrix(trunk) * np.array([1, *3 * [trunk.length]])[:, None]
        self.extension = A[:, 0]
        self._forced = np.zeros((H, mesh.elements, FORCED, self.local))
        muscles, n = A.shape[2], self.x.shape[1]
        self._forced[:, :, :4, :muscles] = A[self._segment]
        self._forced[:, :, 4, :muscles] = segment_fractions(trunk) @ A[:, 0]
        self._forced[:, :, 5:, n:] = self._pull[:, None]

    # --- values ------------------------------------------------------------------------------

    def _equations(self, full: np.ndarray) -> RodEquationsAt:
        """The rods' equations at a decision vector, in which explicit variables are updated."""
        L, trunk = self._length, self._trunk
        full[self.window.previous] = self.window.before
        x = full[self.x]
        strain = strains(trunk, x[:, :-2]) * np.array([1, L, L, L])
        full[self._strain] = strain
        full[self._mean] = strain[:, :, 0] @ segment_fractions(trunk)
        full[self._tip_force] = self._force + self._pull @ full[self.held].ravel()
        pose = values(base(trunk), x[:, -2:], np.zeros((len(x), 0)))
        full[self._line[:, 0]], full[self._edges[:, 0, :4]] = pose[:, :3], pose[:, 3:]
        others = np.column_stack([full[self._mean], full[self._tip_force]])
        own = strain[:, self._segment]
        forced = np.concatenate(
            [own, np.broadcast_to(others[:, None], (*own.shape[:2], FORCED - 4))], axis=-1
        )
        edges, inner = full[self._edges], full[self._inner]
        mesh = self._mesh
        return RodEquationsAt(mesh, L, self._function, edges, inner, forced, self._parameters)

    def _set_poses(self, full: np.ndarray, rates: np.ndarray) -> None:
        """Update centerline, and poses of points, by the rates (H, E, d, 10)."""
        slopes = rates[..., POSITION]
        weights = gauss(self._mesh.degree).quadrature
        lengths = (
            np.tensordot(weights, slopes, (0, 2)) * (self._mesh.widths / self._length)[:, None]
        )
        origin = full[self._line[:, :1]]
        full[self._line] = np.concatenate([origin, lengths], axis=1).cumsum(axis=1)
        t, k = self._point_step, self._point_element
        edges, inner = full[self._edges[t, self._point_edge, :4]], full[self._inner[t, k, :, :4]]
        states = np.concatenate([edges[:, None], inner], axis=1)
        full[self._q] = (self._of_states[:, None] @ states)[:, 0]
        full[self._r] = origin[t, 0] + np.einsum("ped,pedc->pc", self._of_rates, slopes[t])

    def updated(self, full: np.ndarray) -> tuple[np.ndarray, float]:
        """The decision vector with the variables updated that follow from others explicitly.

        Such as those of a window of other loads or targets, or with its steps moved on. And the
        largest residual of the rods' equations there.
        """
        full = full.copy()
        at = self._equations(full)
        rates = at.rates()
        self._set_poses(full, rates)
        for reference, D in zip(self._references, self.held, strict=True):
            full[D] = self._direction(full, reference)[0]
        return full, at.largest_residual(rates)

    def objective(self, full: np.ndarray) -> float:
        """Objective at a decision vector whose explicit variables are up to date."""
        goals = (float(values(f, full[v], p).sum()) for f, v, p, _ in self._goals)
        return sum(goals) + self._costs.at(self.window.before, full[self.x])[0]

    def shape(self, full: np.ndarray) -> Shape:
        """The rods at a settled decision vector, batch axis (H,)."""
        rates = self._equations(full.copy()).rates()
        intrinsic = strains(self._trunk, full[self.x][:, :-2])
        left = full[self._edges[:, :-1, None]]
        states = np.concatenate([left, full[self._inner]], axis=2)
        states[..., MOMENT] *= self.window.moment
        edges = full[self._line] * self._length
        return Shape(self._trunk, self._mesh, intrinsic, states, edges, rates[..., POSITION])

    def moved(self, model: QuadraticModel, step: np.ndarray, share: float = 1.0) -> np.ndarray:
        """Decision vector after a share of a step in z, to first order."""
        rods, full, local = (
            model.rods,
            model.full.copy(),
            self._local(model, step)[:, None, :, None],
        )
        full[self.x] += share * step[: self.x.size].reshape(self.x.shape)
        full[self.held.ravel()] += share * step[self.x.size :]
        full[self._edges] += share * (rods.edges @ local)[..., 0]
        full[self._inner] += share * (rods.states @ (rods.inputs @ local)[:, :, None])[..., 0]
        return full

    def settled(self, full: np.ndarray, rods: CondensedRods) -> tuple[np.ndarray, float]:
        """The decision vector with its rods in equilibrium, and the residual that is left.

        By simplified Newton steps with the matrices of `rods`, a linearization nearby.
        """
        full, n = full.copy(), self.x.shape[1]
        for left in reversed(range(MAX_SETTLING)):
            at = self._equations(full)
            rates = at.rates()
            if self.held.size:
                self._set_poses(full, rates)
            edges, inner, residual = rods.newton_step(at, rates)
            if self.held.size:  # pulls along these directions move other rods
                directions = np.ravel([self._direction(full, d)[0] for d in self._references])
                change = directions - full[self.held.ravel()]
                full[self.held.ravel()] = directions
                inputs = rods.inputs[..., n:-1] @ change
                edges += rods.edges[..., n:-1] @ change
                inner += (rods.states @ inputs[:, :, None, :, None])[..., 0]
                residual = max(residual, float(np.abs(change).max()))
            if residual <= SETTLED_TOL or not residual <= MAX_RESIDUAL or not left:
                break
            full[self._edges] += edges
            full[self._inner] += inner
        self._set_poses(full, rates)
        return full, residual

    def _direction(
        self, full: np.ndarray, reference: HeldDirection
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Value (3,) of a held direction, derivative by its orientation q, and indices of q."""
        q = self.window.unknowns[reference.step - self.window.offset].points[reference.Z][0]
        value, slope = first_derivatives(director(reference.director), full[q][None], _NONE)
        return value[0], slope[0], q

    # --- model -------------------------------------------------------------------------------

    def model(
        self, full: np.ndarray, multipliers: np.ndarray, forces: np.ndarray | None = None
    ) -> QuadraticModel:
        """Quadratic model at a decision vector.

        Parameters
        ----------
        multipliers : (3 D,)
            Of the equations of held directions.
        forces : (variables,), optional
            Derivatives of the objective by the variables, with which the curvature of the rods
            counts. Those of `expected_forces` converge much faster than those at this point, the
            default: large errors of targets are about to vanish.

        Raises
        ------
        IllConditionedError
        """
        full, n, C = full.copy(), self.x.shape[1], self.local
        at = self._equations(full)
        head = full[self.x[:, -2:]]
        base_slope = np.zeros((len(head), STATES, C))
        none = np.zeros((len(head), 0))
        base_slope[:, :, n - 2 : n] = first_derivatives(base(self._trunk), head, none)[1]
        rods = CondensedRods.of(at, base_slope[:, 3:], self._forced)
        self._set_poses(full, rods.rates)
        changes = self._changes(full.size, rods, base_slope[:, :3])
        objective, gradient, blocks, own_forces, targets = self._tracking(full, changes)
        forces = own_forces if forces is None else forces.copy()
        rows, rest = self._held_equations(full, changes, multipliers, forces, blocks)
        blocks += self._curvature(rods, head, forces)
        gradient += blocks[:, :C, C]  # along the Newton step
        value, by_controls = self._costs.at(self.window.before, full[self.x])
        whole = np.append(by_controls + gradient[:, :n], gradient[:, n:].sum(axis=0))
        blocks = blocks[:, :C, :C].copy()
        blocks[:, np.arange(n), np.arange(n)] += self._costs.diagonal[1:]
        links = self._costs.links[1:]
        return QuadraticModel(
            full, objective + value, whole, blocks, links, rows, rest, rods, targets, changes
        )

    def recentered(self, model: QuadraticModel, full: np.ndarray) -> QuadraticModel:
        """The model at a settled vector nearby: exact gradients of targets, all else as before.

        For second-order corrections: a long step takes targets off by its square, which costs more
        than all that the step gains, and one more step with the same matrices takes that back.
        """
        n, changes = self.x.shape[1], model.changes.copy()
        changes[:, -1] = 0.0
        objective, gradient, _, _, targets = self._tracking(full, changes)
        value, by_controls = self._costs.at(self.window.before, full[self.x])
        whole = np.append(by_controls + gradient[:, :n], gradient[:, n:].sum(axis=0))
        rest = np.zeros_like(model.held_rest)
        return replace(
            model,
            full=full,
            objective=objective + value,
            gradient=whole,
            held_rest=rest,
            targets=targets,
            changes=changes,
            newton=0.0,
        )

    def _changes(self, size: int, rods: CondensedRods, base_slope: np.ndarray) -> np.ndarray:
        """Changes (variables, C + 1) of controls, held directions and points; 0 for the others."""
        n, C = self.x.shape[1], self.local
        changes = np.zeros((size, C + 1))
        changes[self.x], changes[self.held.ravel()] = np.eye(n, C + 1), np.eye(C + 1)[n:-1]
        t, k = self._point_step, self._point_element
        inputs = rods.inputs[t]  # (P, E, 16, C + 1)
        P, E, d = self._of_rates.shape
        inside = self._of_states[:, None, 1:] @ rods.states[t, k, :, :4].reshape(P, d, -1)
        q = inside.reshape(P, 4, -1) @ inputs[np.arange(P), k]
        changes[self._q] = q + self._of_states[:, :1, None] * rods.edges[t, self._point_edge, :4]
        along = self._of_rates[:, :, None] @ rods.centerline[t].reshape(P, E, d, -1)
        r = (along.reshape(P, E, 3, -1) @ inputs).sum(axis=1)
        r[:, :, :-1] += base_slope[t]
        changes[self._r] = r
        return changes

    def _tracking(
        self, full: np.ndarray, changes: np.ndarray
    ) -> tuple[float, np.ndarray, np.ndarray, np.ndarray, Sequence[tuple[np.ndarray, ...]]]:
        """Cost of targets: value, gradients, Hessians, forces, and `QuadraticModel.targets`."""
        H, C = len(self.x), self.local
        value, gradient, forces = 0.0, np.zeros((H, C)), np.zeros(full.size)
        blocks = np.zeros((H, C + 1, C + 1))
        parts: list[tuple[np.ndarray, ...]] = []
        for function, variables, parameters, steps in self._goals:
            w = full[variables]
            error, slope = first_derivatives(function, w, parameters)
            second = second_derivatives(function, w, parameters, np.ones((len(w), 1)))
            change = changes[variables]  # (N, n, C + 1)
            bent = second @ change
            value += float(error.sum())
            np.add.at(forces, variables, slope[:, 0])
            gradient += _by_step(H, steps, (slope @ change)[:, 0, :-1])
            blocks += _by_step(H, steps, change.swapaxes(-1, -2) @ bent)
            parts.append((variables, steps, slope[:, 0], bent))
        return value, gradient, blocks, forces, parts

    def expected_forces(self, model: QuadraticModel, step: np.ndarray) -> np.ndarray:
        """Derivatives (variables,) of the targets' cost after a step in z, by the model."""
        forces, local = np.zeros(model.full.size), self._local(model, step)
        for variables, steps, slope, bent in model.targets:
            np.add.at(forces, variables, slope + (bent @ local[steps, :, None])[..., 0])
        return forces

    def _local(self, model: QuadraticModel, step: np.ndarray) -> np.ndarray:
        """A step in z by local controls of each time step, and the Newton step, (H, C + 1)."""
        H = len(self.x)
        held = np.broadcast_to(step[self.x.size :], (H, self.held.size))
        return np.concatenate(
            [step[: self.x.size].reshape(self.x.shape), held, np.full((H, 1), model.newton)], axis=1
        )

    def _held_equations(
        self,
        full: np.ndarray,
        changes: np.ndarray,
        multipliers: np.ndarray,
        forces: np.ndarray,
        blocks: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Linearized D - d(q) = 0; adds its share to forces and to the Hessians."""
        n, first = self.x.shape[1], self.x.size
        rows, rest = np.zeros((self.held.size, self.size)), np.zeros(self.held.size)
        for i, reference in enumerate(self._references):
            own, t = slice(3 * i, 3 * i + 3), reference.step - self.window.offset
            d, slope, q = self._direction(full, reference)
            change, weights = slope @ changes[q], -multipliers[own]
            rows[own, first + 3 * i : first + 3 * i + 3] = np.eye(3)
            rows[own, t * n : t * n + n] -= change[:, :n]
            rows[own, first:] -= change[:, n:-1]
            rest[own] = d + change[:, -1] - full[self.held[i]]
            forces[q] += weights @ slope
            function = director(reference.director)
            second = second_derivatives(function, full[q][None], _NONE, weights[None])[0]
            blocks[t] += changes[q].T @ second @ changes[q]
        return rows, rest

    def _curvature(self, rods: CondensedRods, head: np.ndarray, forces: np.ndarray) -> np.ndarray:
        """Hessians (H, C + 1, C + 1) of poses, which forces on them weigh."""
        H, E, d = rods.rates.shape[:3]
        t, k = self._point_step, self._point_element
        by_q, by_r = forces[self._q], forces[self._r]
        by_edges, by_states = np.zeros((H, E + 1, STATES)), np.zeros((H, E, d, STATES))
        by_line, by_base = np.zeros((H, E, d, 3)), np.zeros((H, STATES))
        np.add.at(by_edges[..., :4], (t, self._point_edge), self._of_states[:, :1] * by_q)
        np.add.at(by_states[..., :4], (t, k), self._of_states[:, 1:, None] * by_q[:, None])
        by_line += _by_step(H, t, self._of_rates[..., None] * by_r[:, None, None])
        np.add.at(by_base[:, :3], t, by_r)
        weights, by_base[:, 3:] = rods.multipliers(by_edges, by_states, by_line)
        blocks, n = rods.hessians(weights), self.x.shape[1]
        turns = second_derivatives(base(self._trunk), head, np.zeros((H, 0)), by_base)
        blocks[:, n - 2 : n, n - 2 : n] += turns
        return blocks


_NONE = np.zeros((1, 0))


def _by_step(count: int, steps: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Sums (count, ...) of values (N, ...) by their time steps (N,)."""
    chosen = (steps == np.arange(count)[:, None]).astype(float)
    sums = chosen @ values.reshape(len(values), -1)  # np.add.at takes ten times as long
    return np.asarray(sums.reshape(count, *values.shape[1:]))


@lru_cache(maxsize=1024)
def _pose_weights(mesh: Mesh, length: float, Z: float) -> tuple[int, int, np.ndarray, np.ndarray]:
    """How the pose at Z in m follows: its element, an edge, and weights of states and rates.

    The orientation is weights (d + 1) of the states at that edge and the element's Gauss points;
    the position is r(0) and weights (E, d) of the rates r'.
    """
    element, h = gauss(mesh.degree), mesh.widths / length
    k, tau = (value.item() for value in mesh.locate(Z))
    before = np.arange(mesh.elements)[:, None] < k
    of_rates = np.where(before, h[:, None] * element.quadrature, 0.0)
    of_rates[k] = h[k] * element.integral(tau)
    if tau in (0.0, 1.0):
        return k, k + int(tau), np.eye(mesh.degree + 1)[0], of_rates
    return k, k, element.value(tau), of_rates

"""A window of time steps condensed to its controls: quadratic models with exact derivatives.

The NLP of a window has some 230 variables a time step, all but 30 of which follow from the
controls. Here they are eliminated, which leaves the controls of all steps and the held directions,
z = (x_1, ..., x_H, D). `CondensedWindow.model` gives objective and Lagrangian to second order in z,
from which sequential quadratic programming takes its steps. It has the solutions of the full NLP.

A rod feels its muscles only by the strain numbers of its segments. So derivatives are taken in
local variables of each step, far fewer than its controls: strain numbers, head angles, and D.
"""

from __future__ import annotations

import copy
from dataclasses import replace

import numpy as np

from ..model.activation import segment_at, segment_fractions, strain_matrix, strains
from ..problem.targets import HeldDirection
from ..rod.collocation import gauss
from ..rod.equations import MOMENT, POSITION, STATES, is_hung, mesh_parameters
from ..rod.shape import Shape
from .condensed_rods import FORCED, CondensedRods, RodEquationsAt
from .control_costs import ControlCosts
from .point_functions import base, director, rates_in_units
from .point_poses import PointPoses
from .quadratic_model import QuadraticModel
from .term_derivatives import first_derivatives, second_derivatives, values
from .tracking_costs import TrackingCosts
from .window import Window

MAX_SETTLING = 8
"""Simplified Newton steps to equilibrium after a change of the controls."""
MAX_RESIDUAL = 1.0
"""Beyond which simplified Newton steps are not worth trying."""
SETTLED_TOL = 1e-8
"""Residual of the rods' equations, in the NLP's units, that counts as equilibrium."""

DAMPING = 1e-3
"""Of second-order corrections, over the largest second derivative by a local variable."""


class CondensedWindow:
    """The NLP of a window that `can_condense`, in its controls and held directions.

    Attributes
    ----------
    x : (H, controls) int
        Indices of the controls in the decision vector.
    held : (D, 3) int
        Those of the held directions.
    size : int
        Length of z.
    to_local : (C, controls + 3 D)
        Derivatives of a step's local variables by its controls and the held directions.
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
        self.size = self.x.size + self.held.size
        self._trunk, self._mesh, self._length = window.motion.trunk, window.mesh, window.length
        self._segment = segment_at(self._trunk, self._mesh.points[:, 0])
        self._set_local()
        self._points = PointPoses(window)
        self._tracking, self._costs = TrackingCosts(window), ControlCosts.of(window)
        self._set_numbers(window)

    def renumbered(self, window: Window) -> CondensedWindow:
        """The same for a window that differs in numbers only; see `layout_of`."""
        other = copy.copy(self)
        other._tracking = copy.copy(self._tracking)
        other._tracking.renumber(window)
        other._set_numbers(window)
        return other

    # --- layout ----------------------------------------------------------------------------

    def _set_local(self) -> None:
        """Local variables by controls, and the elements' inputs by these, but for the tip force."""
        trunk, (H, n), D = self._trunk, self.x.shape, self.held.size
        A = strain_matrix(trunk) * np.array([1, *3 * [trunk.length]])[:, None]
        self.extension = A[:, 0]
        segments, muscles = len(A), n - 2
        self._head = slice(4 * segments, 4 * segments + 2)
        C = self._head.stop + D
        self.to_local = np.zeros((C, n + D))
        self.to_local[: self._head.start, :muscles] = A.reshape(-1, muscles)
        self.to_local[self._head.start :, muscles:] = np.eye(2 + D)
        self._forced = np.zeros((H, self._mesh.elements, FORCED, C))
        strain = np.eye(4 * segments).reshape(segments, 4, -1)
        self._forced[:, :, :4, : self._head.start] = strain[self._segment]
        mean = np.tensordot(segment_fractions(trunk), strain[:, 0], 1)
        self._forced[:, :, 4, : self._head.start] = mean

    def _set_numbers(self, window: Window) -> None:
        """Everything that may change from one motion to the next: targets, loads, the start."""
        self.window = window
        mesh, trunk, H = self._mesh, self._trunk, len(self.x)
        steps = window.steps
        hung = any(is_hung(step.loads) for step in steps)
        self._function = rates_in_units(hung)
        by_load = {
            load: mesh_parameters(trunk, load, mesh, hung).T
            for load in {step.loads for step in steps}
        }
        shape = (H, mesh.elements, mesh.degree, -1)
        loaded = np.stack([by_load[step.loads] for step in steps]).reshape(shape)
        units = np.broadcast_to([window.length, window.moment], (*loaded.shape[:3], 2))
        self._parameters = np.concatenate([loaded, units], axis=-1)
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
        if self.held.size:
            self._forced = self._forced.copy()
            self._forced[:, :, 5:, self._head.stop :] = self._pull[:, None]

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
        lengths = (weights @ slopes) * (self._mesh.widths / self._length)[:, None]
        origin = full[self._line[:, :1]]
        full[self._line] = np.concatenate([origin, lengths], axis=1).cumsum(axis=1)
        self._points.set(full, slopes)

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
        return self._tracking.value(full) + self._costs.at(self.window.before, full[self.x])[0]

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
        rods, full = model.rods, model.full.copy()
        local, (own, held) = _with_newton(model, step)[:, None, :, None], model.by_step(step)
        full[self.x] += share * own
        full[self.held.ravel()] += share * held
        full[self._edges] += share * (rods.edges @ local)[..., 0]
        full[self._inner] += share * (rods.states @ (rods.inputs @ local)[:, :, None])[..., 0]
        return full

    def settled(self, full: np.ndarray, rods: CondensedRods) -> tuple[np.ndarray, float]:
        """The decision vector with its rods in equilibrium, and the residual that is left.

        By simplified Newton steps with the matrices of `rods`, a linearization nearby.
        """
        full, first = full.copy(), self._head.stop
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
                inputs = rods.inputs[..., first:-1] @ change
                edges += rods.edges[..., first:-1] @ change
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
        full, H, C = full.copy(), len(self.x), len(self.to_local)
        at = self._equations(full)
        head = full[self.x[:, -2:]]
        pose = np.zeros((H, STATES, C))
        pose[:, :, self._head] = first_derivatives(base(self._trunk), head, np.zeros((H, 0)))[1]
        rods = CondensedRods.of(at, pose[:, 3:], self._forced)
        self._set_poses(full, rods.rates)
        changes = np.zeros((full.size, C + 1))
        changes[self.x[:, -2:]] = np.eye(C + 1)[self._head]
        changes[self.held.ravel()] = np.eye(C + 1)[self._head.stop : -1]
        self._points.set_changes(changes, rods, pose[:, :3])
        tracking = self._tracking.at(full, changes)
        forces, blocks = (tracking.forces if forces is None else forces).copy(), tracking.blocks
        rows, rest = self._held_equations(full, changes, multipliers, forces, blocks)
        blocks += self._curvature(rods, head, forces)
        value, by_controls = self._costs.at(self.window.before, full[self.x])
        along_newton = blocks[:, :C, C]
        return QuadraticModel(
            full,
            tracking.value + value,
            self._in_controls(tracking.gradient + along_newton, by_controls),
            blocks[:, :C, :C],
            self.to_local,
            self._costs.diagonal[1:],
            self._costs.links[1:],
            rows,
            rest,
            rods,
            tracking,
            changes,
        )

    def recentered(self, model: QuadraticModel, full: np.ndarray) -> QuadraticModel:
        """A model at a settled vector after a step, for second-order corrections.

        A long step takes targets off by its square, which costs more than all that the step gains.
        One more step takes that back: by the poses' changes at hand, with a damped Gauss-Newton
        Hessian, which leaves alone the directions that targets hardly feel.
        """
        changes = model.changes.copy()
        changes[:, -1] = 0.0
        tracking, C = self._tracking.at(full, changes), len(self.to_local)
        value, by_controls = self._costs.at(self.window.before, full[self.x])
        blocks = tracking.blocks[:, :C, :C]
        return replace(
            model,
            full=full,
            objective=tracking.value + value,
            gradient=self._in_controls(tracking.gradient, by_controls),
            blocks=blocks,
            diagonal=model.diagonal + DAMPING * np.abs(blocks).max(),
            held_rest=np.zeros_like(model.held_rest),
            tracking=tracking,
            changes=changes,
            newton=0.0,
        )

    def expected_forces(self, model: QuadraticModel, step: np.ndarray) -> np.ndarray:
        """Derivatives (variables,) of the targets' cost after a step in z, by the model."""
        return model.tracking.forces_after(_with_newton(model, step))

    def _in_controls(self, by_local: np.ndarray, by_controls: np.ndarray) -> np.ndarray:
        """Gradient in z from those by the local variables (H, C) and of the controls' costs."""
        n, gradient = self.x.shape[1], by_local @ self.to_local
        return np.append(by_controls + gradient[:, :n], gradient[:, n:].sum(axis=0))

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
            by_own = change[:, :-1] @ self.to_local
            rows[own, first + 3 * i : first + 3 * i + 3] = np.eye(3)
            rows[own, t * n : t * n + n] -= by_own[:, :n]
            rows[own, first:] -= by_own[:, n:]
            rest[own] = d + change[:, -1] - full[self.held[i]]
            forces[q] += weights @ slope
            function = director(reference.director)
            second = second_derivatives(function, full[q][None], _NONE, weights[None])[0]
            blocks[t] += changes[q].T @ second @ changes[q]
        return rows, rest

    def _curvature(self, rods: CondensedRods, head: np.ndarray, forces: np.ndarray) -> np.ndarray:
        """Hessians (H, C + 1, C + 1) of poses, which forces on them weigh."""
        by_edges, by_states, by_line, by_origin = self._points.forces_on(rods, forces)
        weights, by_orientation = rods.multipliers(by_edges, by_states, by_line)
        blocks, by_base = rods.hessians(weights), np.hstack([by_origin, by_orientation])
        turns = second_derivatives(base(self._trunk), head, np.zeros((len(head), 0)), by_base)
        blocks[:, self._head, self._head] += turns
        return blocks


_NONE = np.zeros((1, 0))


def _with_newton(model: QuadraticModel, step: np.ndarray) -> np.ndarray:
    """A step in z by local variables of each time step, and the Newton step, (H, C + 1)."""
    local = model.local(step)
    return np.column_stack([local, np.full(len(local), model.newton)])

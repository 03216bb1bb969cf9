"""A window of consecutive time steps as one NLP.

Each step has the unknowns and equations of `rod_equations`; bounds on change, and directions
held from an earlier step, couple the steps. Internally, lengths are in units of L and moments in
E I(0) / L; everything that callers pass or get is in SI units.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np
import scipy.sparse as sp

from .._support.deferred_signals import deferred_interrupts
from ..model.activation import segment_fractions, strains
from ..model.loads import Loads
from ..model.quaternions import directors
from ..problem.mirror import mirror_order
from ..problem.motion import Motion, Step
from ..problem.targets import Direction, HeldDirection, Target
from ..problem.weights import Weights
from ..rod.collocation import Mesh
from ..rod.equations import PARAMETERS, is_hung, point_parameters
from ..rod.shape import Shape
from ..rod.volume import volume_weights
from .gap_rows import GapRow, add_gaps, add_volume
from .nlp_builder import Block, NLPBuilder
from .point_functions import (
    director,
    scaled_rates,
    scaled_vector,
    square,
    squared_change,
    squared_direction,
    squared_direction_in_head,
    squared_distance,
    squared_distance_in_head,
    squared_held_direction,
)
from .quantities import Meaning, quantities, units_of
from .rod_block import Unknowns, rod_equations, step_points
from .separable_nlp import SeparableNLP
from .tracked_positions import TrackedPositions


@dataclass(frozen=True, eq=False)
class Goal:
    """A desired position or direction, as a weighted squared error.

    Attributes
    ----------
    function : casadi.Function
        (w, p) -> weighted squared error.
    variables : (n,) int
        Indices of w in the decision vector.
    parameters, weight : (k - 1,), float
        Values of p: the weight comes last.
    tolerance : float
        Error that counts as reached, in m or as length of a director's difference.
    """

    function: ca.Function
    variables: np.ndarray
    parameters: np.ndarray
    weight: float
    tolerance: float


class Window:
    """The NLP of consecutive time steps.

    Parameters
    ----------
    steps : sequence of Step
        The time steps.
    previous : (muscles + 2,)
        Known activations and head angles of the step before.
    held : dict
        Known values (3,) of the directions that these steps need from earlier ones.
    offset : int
        Index of the window's first step in the motion, from 0.
    gaps : dict, optional
        Gaps that time steps of the motion (from 0) keep; see `GapRow`.
    """

    @deferred_interrupts()
    def __init__(
        self,
        motion: Motion,
        mesh: Mesh,
        steps: Sequence[Step],
        previous: np.ndarray,
        held: dict[HeldDirection, np.ndarray],
        offset: int,
        weights: Weights,
        gaps: Mapping[int, tuple[GapRow, ...]] | None = None,
    ) -> None:
        self.motion, self.mesh, self.steps, self.offset = motion, mesh, tuple(steps), offset
        self.known, self.before, self.weights = held, previous, weights
        trunk = motion.trunk
        units = units_of(trunk)
        self.length, self.moment, self.force = units.length, units.moment, units.force
        vars(self)["_builder"] = NLPBuilder()
        self._points: dict[Loads, np.ndarray] = {}  # parameters of `rates`, by load
        self._gaps = gaps or {}
        self.gap_rows: list[tuple[GapRow, int, int]] = []  # with time step and row number in F
        self._volumes: list[np.ndarray | None] = []  # volume ratio (1,) of each step with gaps
        self.previous = self._builder.variables(previous.size, lower=previous, upper=previous)
        self.unknowns = [self._step(offset + t, step) for t, step in enumerate(self.steps)]
        self.held = self._held_directions()
        self._couplings()
        for cost in (*self.tracking(), *self.regularization()):
            self._builder.cost(*cost)

    @cached_property
    def bounds(self) -> dict[str, np.ndarray]:
        """Bounds of the decision vector and the constraints, as arguments of CasADi's solvers."""
        return self._builder.bounds

    @cached_property
    def parameters(self) -> np.ndarray:
        """Parameters of the NLP."""
        return self._builder.parameters

    @cached_property
    def nlp(self) -> SeparableNLP:
        """The NLP itself; a solver needs it only once for each structure."""
        return self._builder.nlp()

    @property
    def blocks(self) -> list[Block]:
        """The constraint rows, with what they mean."""
        return self._builder.blocks

    def renumbered(self, motion: Motion) -> Window:
        """The window of a whole motion of the same structure: other targets, loads, bounds, start.

        Its decision vector has the same layout. The NLP is built only if it is asked for, so that
        a re-planner which does not need it saves the time.
        """
        other = copy.copy(self)
        other.motion, other.steps, other.before = motion, motion.steps, motion.start
        for name in ("_builder", "bounds", "parameters", "nlp", "structure", "_tracked"):
            vars(other).pop(name, None)
        return other

    @cached_property
    def _builder(self) -> NLPBuilder:
        """Variables, rows and terms; see `renumbered`."""
        arguments = (self.motion, self.mesh, self.steps, self.before, self.known, self.offset)
        return Window(*arguments, self.weights, self._gaps)._builder

    @cached_property
    def structure(self) -> bytes:
        """Fingerprint; equal for windows whose NLPs differ only in parameters and bounds."""
        return self._builder.digest()

    # --- one step --------------------------------------------------------------------

    def _step(self, number: int, step: Step) -> Unknowns:
        """Add the variables of one step and the equations of its rod."""
        add, motion = self._builder, self.motion
        gaps = self._gaps.get(number, ())
        points = step_points(motion, step, number, [Z for gap in gaps for Z in gap.points])
        rod = rod_equations(motion.trunk, self.mesh, motion.extension, points)
        tip = np.asarray(step.loads.tip_force) / self.force
        if step.pull is not None and self._is_known(step.pull[1]):
            tip = tip + step.pull[0] / self.force * self.known[step.pull[1]]
        free = np.inf if step.pull is not None and not self._is_known(step.pull[1]) else 0.0
        bounds = [
            (rod.unknowns.x, step.box.lower, step.box.upper),
            (rod.unknowns.tip_force, tip - free, tip + free),
        ]
        variables, shift = add.include(rod.builder, bounds, number)
        hung = is_hung(step.loads)
        if step.loads not in self._points:
            self._points[step.loads] = point_parameters(
                motion.trunk, step.loads, self.mesh.points.ravel(), hung
            )
        add.term(
            scaled_rates(self.length, self.moment, hung),
            rod.variables + variables,
            self._points[step.loads],
            rod.output,
            rod.place,
            rod.rows + shift,
            rod.weights,
        )
        unknowns = rod.unknowns.moved(variables)
        self._volumes.append(None)
        if gaps:
            moved, at = rod.variables + variables, self._points[step.loads][:PARAMETERS]
            volume = add_volume(add, motion.trunk, self.mesh, rod, moved, at, number)
            rows = add_gaps(add, motion.trunk, unknowns, volume, gaps, number)
            self.gap_rows += zip(gaps, [number] * len(rows), rows, strict=True)
            self._volumes[-1] = volume
        return unknowns

    # --- between steps ---------------------------------------------------------------

    def _is_known(self, reference: HeldDirection) -> bool:
        return reference.step < self.offset

    def _held_directions(self) -> dict[HeldDirection, np.ndarray]:
        """Add a variable for each held direction, with an equation at the step that defines it.

        Without these variables, every step that uses the direction would be coupled to the rod of
        that step, and the factorization would fill in.
        """
        add, indices = self._builder, {}
        held = Meaning("held direction", quantities(self.motion.trunk)["direction"])
        for reference in self.motion.held:
            if not 0 <= reference.step - self.offset < len(self.steps):
                continue
            unknowns = self.unknowns[reference.step - self.offset]
            D, rows = add.variables(3), add.rows(held, 3, step=reference.step)
            add.linear(rows, D)
            q = unknowns.points[reference.Z][0]
            add.term(
                director(reference.director),
                q[:, None],
                np.zeros((0, 1)),
                np.arange(3),
                0,
                rows,
                -1.0,
            )
            indices[reference] = D
        return indices

    def _couplings(self) -> None:
        """Add pulls along held directions, and bounds on change."""
        add, known = self._builder, quantities(self.motion.trunk)
        along = tuple(f"the pull along a held direction, {axis}," for axis in "XYZ")
        pull = Meaning("pull", known["force"], along)
        controls = known["controls"]
        names = tuple(f"change of {control.name}" for control in controls.components)
        changes = Meaning("change", controls, names)
        before = self.previous
        numbered = enumerate(zip(self.steps, self.unknowns, strict=True), self.offset)
        for number, (step, u) in numbered:
            pulled = step.pull is not None and not self._is_known(step.pull[1])
            if pulled and step.pull is not None:
                tip = np.asarray(step.loads.tip_force) / self.force
                rows = add.rows(pull, 3, lower=tip, upper=tip, step=number)
                add.linear(rows, u.tip_force)
                strength = np.array([[-step.pull[0] / self.force]])
                D = self.held[step.pull[1]]
                add.term(scaled_vector(), D[:, None], strength, np.arange(3), 0, rows)
            change = step.change
            limited = change.limited
            lower, upper = change.lower[limited], change.upper[limited]
            rows = add.rows(
                changes, limited.size, lower=lower, upper=upper, step=number, controls=limited
            )
            add.linear(rows, u.x[limited])
            add.linear(rows, before[limited], -1.0)
            before = u.x
        if self.motion.spec.weights.symmetric:
            self._symmetry()

    def _symmetry(self) -> None:
        """Add rows by which both sides contract alike."""
        add, trunk = self._builder, self.motion.trunk
        partners = mirror_order(trunk)
        right = np.flatnonzero(np.arange(partners.size) < partners)
        names = tuple(f"the difference of {name} and its partner" for name in trunk.muscles)
        same = Meaning("symmetry", quantities(trunk)["activations"], names)
        for number, u in enumerate(self.unknowns, self.offset):
            rows = add.rows(same, right.size, step=number, controls=right)
            add.linear(rows, u.x[right])
            add.linear(rows, u.x[partners[right]], -1.0)

    def goals(self) -> Iterator[Goal]:
        """Goals of the targets, one for each position and direction."""
        position, direction = self.motion.tolerance
        squared_scale = self.motion.position_scale**2
        for step, u in zip(self.steps, self.unknowns, strict=True):
            for target in step.targets:
                q, r = u.points[target.Z]
                turns = target.frame == "head"
                if turns:
                    q, r = np.append(q, u.x[-2:]), np.append(r, u.x[-2:])
                if target.position is not None:
                    distance = squared_distance(self.length)
                    if turns:
                        distance = squared_distance_in_head(self.motion.trunk)
                    goal = np.asarray(target.position)
                    weight = target.position_weight * squared_scale
                    yield Goal(distance, r, goal, weight, position)
                for j, d, weight in target.pairs():
                    if isinstance(d, HeldDirection) and not self._is_known(d):
                        unknown = np.append(q[:4], self.held[d])
                        none = np.zeros(0)
                        yield Goal(squared_held_direction(j), unknown, none, weight, direction)
                    elif isinstance(d, HeldDirection):
                        yield Goal(squared_direction(j), q[:4], self.known[d], weight, direction)
                    else:
                        make = squared_direction_in_head if turns else squared_direction
                        yield Goal(make(j), q, np.asarray(d), weight, direction)

    def tracking(self) -> Iterator[tuple[ca.Function, np.ndarray, np.ndarray]]:
        """Cost of the distance to targets (eq. 42, squared), function by function.

        With its variables (n, N) and parameters (k, N) at N places.
        """
        tracking: dict[ca.Function, list[Goal]] = {}
        for goal in self.goals():
            tracking.setdefault(goal.function, []).append(goal)
        for function, goals in tracking.items():
            variables = np.stack([goal.variables for goal in goals], axis=-1)
            weighted = [np.append(goal.parameters, goal.weight) for goal in goals]
            yield function, variables, np.stack(weighted, axis=-1)

    def regularization(self) -> Iterator[tuple[ca.Function, np.ndarray, np.ndarray]]:
        """Costs of effort and of rate of change, as `tracking`; quadratic in the controls.

        Steps without targets cost no effort: they would sag on the way for the sake of it.
        """
        weights = self.weights
        x = np.stack([self.previous, *(u.x for u in self.unknowns)])
        working = x[1:][[bool(step.targets) for step in self.steps]]
        effort = np.append(weights.of_muscles(self.motion.trunk.muscles), 2 * [weights.head_effort])
        yield square(), working.reshape(1, -1), np.tile(effort, len(working))[None]
        per_second = np.array([[weights.rate / step.duration] for step in self.steps])
        pairs = np.stack([x[:-1].ravel(), x[1:].ravel()])
        yield squared_change(), pairs, (per_second * np.ones_like(x[1:])).reshape(1, -1)

    # --- decision vector ---------------------------------------------------------------

    def pulls(self, shapes: Shape | None) -> np.ndarray:
        """Pull of each step along its held direction, (H, 3) N, with the directions of `shapes`.

        Without shapes, only pulls along directions known from earlier windows.
        """
        forces = np.zeros((len(self.steps), 3))
        for t, step in enumerate(self.steps):
            if step.pull is None:
                continue
            strength, held = step.pull
            if held not in self.held:
                forces[t] = strength * self.known[held]
            elif shapes is not None:
                rows = shapes.directors(np.array([held.Z]))
                forces[t] = strength * rows[held.step - self.offset, 0, held.director]
        return forces

    def pack(self, x: np.ndarray, shapes: Shape) -> np.ndarray:
        """Decision vector from controls (H, muscles + 2) and the shapes (H,) of the steps."""
        trunk, L = self.motion.trunk, self.length
        full = np.zeros(self.bounds["lbx"].size)
        full[self.previous] = self.bounds["lbx"][self.previous]
        scale = np.array([1, 1, 1, 1, *3 * [1 / self.moment]])
        strain = strains(trunk, x[:, :-2]) * np.array([1, L, L, L])
        at_edges = shapes.state(np.asarray(self.mesh.edges)) * scale
        inner = shapes.state(self.mesh.points.ravel()) * scale
        line = shapes.position(np.asarray(self.mesh.edges)) / L
        pulls = self.pulls(shapes)
        for t, (step, u) in enumerate(zip(self.steps, self.unknowns, strict=True)):
            full[u.x], full[u.strain] = x[t], strain[t]
            full[u.mean] = strain[t, :, 0] @ segment_fractions(trunk)
            full[u.tip_force] = (np.asarray(step.loads.tip_force) + pulls[t]) / self.force
            full[u.edges], full[u.line] = at_edges[t], line[t]
            full[u.inner] = inner[t].reshape(u.inner.shape)
            for Z, (q, r) in u.points.items():
                full[q] = shapes.state(np.array([Z]))[t, 0, :4]
                full[r] = shapes.position(np.array([Z]))[t, 0] / L
        for t, volume in enumerate(self._volumes):
            if volume is not None:
                weights = volume_weights(trunk, self.mesh)
                full[volume] = np.sum(weights * shapes.extension[t])
        for reference, D in self.held.items():
            rows = shapes.directors(np.array([reference.Z]))
            full[D] = rows[reference.step - self.offset, 0, reference.director]
        return full

    def advanced(self, full: np.ndarray, count: int) -> np.ndarray:
        """Decision vector whose steps are those `count` later; the last one fills the end."""
        last = len(self.steps) - 1
        return self._from(full, [min(t + count, last) for t in range(last + 1)])

    def repeated(self, full: np.ndarray) -> np.ndarray:
        """Decision vector whose steps are all the first."""
        return self._from(full, [0] * len(self.steps))

    def _from(self, full: np.ndarray, steps: Sequence[int]) -> np.ndarray:
        """Decision vector whose steps are some of those of another."""
        moved = full.copy()
        for u, step in zip(self.unknowns, steps, strict=True):
            other = self.unknowns[step]
            for name in ("x", "strain", "mean", "tip_force", "edges", "inner", "line"):
                moved[getattr(u, name)] = full[getattr(other, name)]
        return moved

    def controls_of(self, full: np.ndarray) -> np.ndarray:
        """Activations and head angles of the steps, (H, muscles + 2)."""
        return np.stack([full[u.x] for u in self.unknowns])

    @cached_property
    def _tracked(self) -> TrackedPositions:
        """The positions that have a target."""
        return TrackedPositions.of(
            self.motion.trunk,
            (
                (target, u.points[target.Z][1], u.x[-2:])
                for step, u in zip(self.steps, self.unknowns, strict=True)
                for target in step.targets
            ),
        )

    def worst_error(self, full: np.ndarray) -> float:
        """Largest distance in m between the trunk and a target position."""
        return float(self._tracked.errors(full).max(initial=0.0))

    def target_errors(self, full: np.ndarray) -> tuple[np.ndarray, sp.csr_matrix]:
        """Distances (n,) in m to all target positions, and their Jacobian (n, variables)."""
        return self._tracked.errors_and_slopes(full)

    def reached(self, full: np.ndarray) -> bool:
        """Whether every target of positive weight is met within the motion's tolerance."""
        position, direction = self.motion.tolerance
        for step, u in zip(self.steps, self.unknowns, strict=True):
            for target in step.targets:
                for j, d, _ in target.pairs():
                    d_j = np.array(directors(full[u.points[target.Z][0]])[j])
                    goal = self._goal(full, d, target, u)
                    if not np.linalg.norm(d_j - goal) <= direction:
                        return False
        return self.worst_error(full) <= position

    def _goal(
        self, full: np.ndarray, direction: Direction, target: Target, u: Unknowns
    ) -> np.ndarray:
        """Value (3,) in space of a direction that a target asks for."""
        if not isinstance(direction, HeldDirection):
            return target.direction_at(direction, full[u.x[-2:]])
        return self.known[direction] if self._is_known(direction) else full[self.held[direction]]

    def states_of(self, full: np.ndarray) -> np.ndarray:
        """Rod states of the steps, (H, elements, degree + 1, 7), in SI units."""
        states = np.stack(
            [full[np.concatenate([u.edges[:-1, None], u.inner], axis=1)] for u in self.unknowns]
        )
        states[..., 4:] *= self.moment
        return states

    def directions_of(self, full: np.ndarray) -> dict[HeldDirection, np.ndarray]:
        """Value (3,) of each direction that this window defines for later ones."""
        return {reference: full[D] for reference, D in self.held.items()}

    def tip_forces_of(self, full: np.ndarray) -> np.ndarray:
        """Tip force V of the steps, (H, 3) N."""
        return np.stack([full[u.tip_force] * self.force for u in self.unknowns])

"""One pass over a motion: windows of time steps, solved one after the other."""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from .._support.deferred_signals import deferred_interrupts
from ..errors import InputError, StaticsError
from ..model.activation import strains
from ..model.loads import Loads, vector
from ..nlp.ipopt import Optimizer
from ..nlp.outcome import CONVERGED_STATUSES, FEASIBILITY_TOL, Outcome, rank
from ..nlp.window import Window
from ..problem.motion import Bounds, Motion, Step, allowed
from ..rod.collocation import Mesh
from ..rod.equations import STATES
from ..rod.statics import Shape, shape_of_states, solve_statics, unloaded_shape
from .checkpoint import Checkpoint
from .plan import Plan, loads_of
from .state import Options, State

ROUGH_ITERATIONS = 200
"""Most iterations of a step of a plan that only starts a horizon; the shipped motions take 60."""


RANDOM = 0.4
"""Largest activation of a random start, as a share of its lower bound."""


@dataclass(eq=False)
class PlanningRun:
    """One pass over a motion with a given lookahead.

    With a `guess` (all steps, muscles + 2), each window is solved from there alone.
    """

    motion: Motion
    mesh: Mesh
    mode: str
    lookahead: int
    options: Options
    optimizer: Optimizer
    start: Plan | None = None
    checkpoint: Checkpoint | None = None
    guess: np.ndarray | None = None

    @property
    def unknowns(self) -> int:
        """Number of activations and head angles of a step."""
        return len(self.motion.trunk.muscles) + 2

    @property
    def stopped(self) -> bool:
        """Whether the user asked to stop, or the deadline has passed."""
        return self.optimizer.reporter.stop or self.optimizer.late

    @deferred_interrupts()
    def run(self) -> Plan:
        """Solve all windows, one after the other."""
        state, count = State(), len(self.motion.steps)
        previous: np.ndarray | None = None  # solution of the window before
        if self.checkpoint is not None:
            state, previous = self.checkpoint.enter(
                self.mode, self.mesh, min(self.lookahead, count), self.optimizer
            )
        first = len(state.x)
        while first < count and not self.stopped:
            last = min(first + self.lookahead, count)
            if self.mode == "sequential":
                window, outcome = self._one_step(first, state)
            else:
                window, outcome = self._several_steps(first, last, state, previous)
            previous = window.unknowns_of(outcome.full)
            self.keep(window, outcome, count if last == count else first + 1, state)
            if self.checkpoint is not None and not self.stopped:
                self.checkpoint.save(self.optimizer, previous)
            first = len(state.x)
        return self.plan(state)

    def keep(self, window: Window, outcome: Outcome, until: int, state: State) -> None:
        """Decide the steps of a solved window up to `until`."""
        take = until - window.offset
        state.x += list(window.unknowns_of(outcome.full)[:take])
        state.tip_forces += list(window.tip_forces_of(outcome.full)[:take])
        state.states += list(window.states_of(outcome.full)[:take])
        directions = window.directions_of(outcome.full)
        state.held |= {held: d for held, d in directions.items() if held.step < until}
        state.converged &= outcome.converged

    # --- windows ---------------------------------------------------------------------

    def window(self, first: int, steps: Sequence[Step], state: State) -> Window:
        """The NLP of `steps` from step `first` on, after what has been decided."""
        before = state.x[-1] if state.x else np.zeros(self.unknowns)
        return Window(
            self.motion, self.mesh, steps, before, state.held, first, self.options.weights
        )

    def _solve(self, window: Window, x: np.ndarray, detail: str) -> Outcome:
        return self.optimizer.solve(window, self.packed(window, x), self.mode, detail)

    def packed(self, window: Window, x: np.ndarray) -> np.ndarray:
        """All unknowns of a window from those of its steps, within bounds, rods in equilibrium."""
        boxes = [step.box for step in window.steps]
        x = np.clip(x, [box.lower for box in boxes], [box.upper for box in boxes])
        if np.any(strains(self.motion.trunk, x[:, :-2])[..., 0] <= 0):
            x = np.zeros_like(x)  # no shape has such activations; let Ipopt find its way
        try:
            shapes = self._shapes(x, _pulled(window, None))
            if window.held:
                shapes = self._shapes(x, _pulled(window, shapes))
        except StaticsError:  # a start need not be in equilibrium
            loads = [step.loads for step in window.steps]
            shapes = unloaded_shape(self.motion.trunk, self.mesh, x, loads)
        return window.pack(x, shapes)

    def _shapes(self, x: np.ndarray, loads: list[Loads]) -> Shape:
        return solve_statics(self.motion.trunk, x[:, :-2], x[:, -2:], loads, self.mesh)

    def _several_steps(
        self, first: int, last: int, state: State, previous: np.ndarray | None
    ) -> tuple[Window, Outcome]:
        """A window of the horizon: the best of several starts."""
        steps = self.motion.steps[first:last]
        window = self.window(first, list(steps), state)
        named = f"steps {first + 1} to {last}"
        best: Outcome | None = None
        converged = False
        start = self.start
        if start and start.converged and last == len(start.x) and start.mesh == self.mesh:
            kept = window.pack(start.x[first:last], start.part(first, last))
            given = self.optimizer.evaluate(window, kept)
            best = given if given.infeasibility <= FEASIBILITY_TOL else None
        for number, (label, x) in enumerate(self._starts(first, last, previous)):
            good = best is not None and converged and window.reached(best.full)
            if number >= self.options.starts and (good or number > 1):
                break
            outcome = self._solve(window, x, f"{named}, from the {label}")
            converged |= outcome.converged
            if best is None or rank(outcome) < rank(best):
                best = outcome
            if outcome.stopped:
                break
        if best is None:
            raise AssertionError("every window has a start")
        # A start that no solve improves on is as good as converged once a solve has converged.
        return window, replace(best, message=CONVERGED_STATUSES[0]) if converged else best

    def _starts(
        self, first: int, last: int, previous: np.ndarray | None
    ) -> Iterator[tuple[str, np.ndarray]]:
        """Where the solve of a window starts: (name, unknowns of its steps)."""
        if self.guess is not None:
            yield "given unknowns", self.guess[first:last]
            return
        if previous is not None:
            yield "window before", np.vstack([previous[1:], previous[-1:]])
            return
        if self.start is not None and len(self.start.x) >= last:
            yield f"{self.start.mode} plan", self.start.x[first:last]
        yield "passive trunk", np.zeros((last - first, self.unknowns))
        for seed in itertools.count():
            rng = np.random.default_rng(seed)
            box = self.motion.box
            x = RANDOM * rng.uniform() * rng.uniform(box.lower, box.upper)
            x[-2:] = 0.0
            yield f"random start {seed + 1}", np.tile(x, (last - first, 1))

    def _one_step(self, first: int, state: State) -> tuple[Window, Outcome]:
        """A window of one step, as in the paper: see appendix B for each clause."""
        step = self.motion.steps[first]
        named = f"step {first + 1} of {len(self.motion.steps)}"
        before = state.x[-1] if state.x else np.zeros(self.unknowns)
        if step.auxiliary is None:
            state.auxiliary = None
            window = self.window(first, [step], state)
            return window, self._solve(window, self._guess(first, before), named)
        guess = self._auxiliary(first, f"{named}, unloaded", state)
        loaded = step
        if step.auxiliary.binds:
            state.near[first] = guess
            box = allowed(self.motion, step, guess)
            loaded = replace(step, box=box, change=_anything(self.unknowns))
        window = self.window(first, [loaded], state)
        return window, self._solve(window, guess[None], named)

    def _guess(self, first: int, otherwise: np.ndarray) -> np.ndarray:
        """Where the solve of one step starts, (1, muscles + 2)."""
        return otherwise[None] if self.guess is None else self.guess[first : first + 1]

    def _auxiliary(self, first: int, named: str, state: State) -> np.ndarray:
        """Optimum of a step without loads, from and near the unloaded one before it."""
        step = self.motion.steps[first]
        chained = bool(np.any(np.isfinite(step.change.upper))) and state.auxiliary is not None
        before = state.x[-1] if state.x else np.zeros(self.unknowns)
        reference = state.auxiliary if chained and state.auxiliary is not None else before
        unloaded = step.loads.scaled(0.0)
        alone = replace(
            step,
            loads=unloaded,
            pull=None,
            change=step.change if chained else _anything(self.unknowns),
        )
        window = Window(
            self.motion, self.mesh, [alone], reference, state.held, first, self.options.weights
        )
        outcome = self._solve(window, self._guess(first, reference), named)
        if not outcome.converged and not outcome.stopped:
            again = self._solve(window, np.zeros((1, self.unknowns)), named)
            outcome = again if rank(again) < rank(outcome) else outcome
        state.converged &= outcome.converged
        state.auxiliary = window.unknowns_of(outcome.full)[0]
        return state.auxiliary

    def plan(self, state: State) -> Plan:
        """The plan of what has been decided."""
        x = np.array(state.x).reshape(-1, self.unknowns)
        forces = np.array(state.tip_forces).reshape(-1, 3)
        loads = loads_of(self.motion, forces)
        rod = (self.mesh.elements, self.mesh.degree + 1, STATES)
        states = np.array(state.states).reshape(-1, *rod)
        shape = shape_of_states(self.motion.trunk, self.mesh, x, loads, states)
        if len(x) and not state.converged:
            # An iterate's rods are not in equilibrium; what its activations do is worth more.
            with contextlib.suppress(StaticsError, InputError):
                shape = self._shapes(x, list(loads))
        return Plan(
            motion=self.motion,
            x=x,
            tip_forces=forces,
            shape=shape,
            mode=self.mode,
            lookahead=self.lookahead,
            weights=self.options.weights,
            near=state.near,
            converged=state.converged,
            interrupted=self.optimizer.reporter.stop,
            late=self.optimizer.late and not (state.converged and len(x) == len(self.motion.steps)),
        )


def _pulled(window: Window, shapes: Shape | None) -> list[Loads]:
    """Loads of a window's steps, pulls included; see `Window.pulls`."""
    return [
        replace(step.loads, tip_force=vector(np.add(step.loads.tip_force, pull)))
        for step, pull in zip(window.steps, window.pulls(shapes), strict=True)
    ]


def _anything(size: int) -> Bounds:
    return Bounds(np.full(size, -np.inf), np.full(size, np.inf))

"""One run of the planner over a motion: windows of time steps, solved in order."""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from .._support.deferred_signals import deferred_interrupts
from ..errors import InputError, StaticsError
from ..model.activation import strains
from ..model.loads import Loads, vector
from ..nlp.gap_rows import GapRow
from ..nlp.ipopt import Optimizer
from ..nlp.outcome import CONVERGED_STATUSES, FEASIBILITY_TOL, Outcome, rank
from ..nlp.warm_start import Multipliers, as_start, multipliers_of
from ..nlp.window import Window
from ..problem.motion import Bounds, Motion, Step, allowed
from ..problem.weights import Weights
from ..rod.collocation import Mesh
from ..rod.equations import STATES
from ..rod.rod_batch import shape_of_states, unloaded_shape
from ..rod.shape import Shape
from ..rod.statics import solve_statics
from .checkpoint import Checkpoint
from .decided_steps import DecidedSteps
from .options import Options
from .plan import Plan, planned_loads

RANDOM_START_SIZE = 0.4
"""Largest activation of a random start, as a share of its lower bound."""


@dataclass(eq=False)
class PlanningRun:
    """One run over a motion, on one mesh and with one lookahead.

    Attributes
    ----------
    start : Plan, optional
        First start of the horizon's windows; no window ends worse than it.
    checkpoint : Checkpoint, optional
        Where the run is saved after every window.
    guess : (steps, muscles + 2), optional
        Controls from which each window is solved first; other starts are tried only if it has
        gaps to keep, because the way around a body that the guess leads to may be the wrong one.
    gaps : dict
        Gaps that each time step (from 0) keeps.
    near : Shape, optional
        Shapes of the guess on the run's mesh, batch axis (steps,), from which equilibria are found.
    multipliers : dict
        Multipliers of windows of several steps by their first step (from 0): those of the last run
        on the same mesh with the guess as its plan, replaced by those of this run.
    only_starts : bool
        Whether the run's plan only starts a horizon. Then only the first step, which has no step
        before it to start from, has an auxiliary problem.
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
    gaps: Mapping[int, tuple[GapRow, ...]] = field(default_factory=dict)
    near: Shape | None = None
    multipliers: dict[int, Multipliers] = field(default_factory=dict)
    only_starts: bool = False

    @property
    def controls(self) -> int:
        """Number of activations and head angles of a step."""
        return len(self.motion.trunk.muscles) + 2

    @property
    def weights(self) -> Weights:
        """Weights of the costs beside tracking."""
        return self.options.weights_for(self.motion)

    @property
    def stopped(self) -> bool:
        """Whether the user asked to stop, or the deadline has passed."""
        return self.optimizer.reporter.stop or self.optimizer.late

    @deferred_interrupts()
    def run(self) -> Plan:
        """Solve all windows in order."""
        decided, count = DecidedSteps(), len(self.motion.steps)
        previous: np.ndarray | None = None  # controls of the last window
        if self.checkpoint is not None:
            decided, previous = self.checkpoint.enter(
                self.mode, self.mesh, min(self.lookahead, count), self.optimizer
            )
        first = len(decided.x)
        while first < count and not self.stopped:
            last = min(first + self.lookahead, count)
            if self.mode == "sequential":
                window, outcome = self._one_step(first, decided)
            else:
                window, outcome = self._several_steps(first, last, decided, previous)
            previous = window.controls_of(outcome.full)
            self.keep(window, outcome, count if last == count else first + 1, decided)
            if self.checkpoint is not None and not self.stopped:
                self.checkpoint.save(self.optimizer, previous)
            first = len(decided.x)
        return self.plan(decided)

    def keep(self, window: Window, outcome: Outcome, until: int, decided: DecidedSteps) -> None:
        """Decide the steps of a solved window before step `until`."""
        take = until - window.offset
        decided.x += list(window.controls_of(outcome.full)[:take])
        decided.tip_forces += list(window.tip_forces_of(outcome.full)[:take])
        decided.states += list(window.states_of(outcome.full)[:take])
        directions = window.directions_of(outcome.full)
        decided.held |= {held: d for held, d in directions.items() if held.step < until}
        decided.converged &= outcome.converged

    def _before(self, decided: DecidedSteps) -> np.ndarray:
        """Controls (muscles + 2,) of the last decided step, or else where the motion starts."""
        return decided.x[-1] if decided.x else self.motion.start

    # --- windows ---------------------------------------------------------------------

    def window(self, first: int, steps: Sequence[Step], decided: DecidedSteps) -> Window:
        """The NLP of `steps` from step `first` on, given the decided ones."""
        before = self._before(decided)
        return Window(
            self.motion,
            self.mesh,
            steps,
            before,
            decided.held,
            first,
            self.weights,
            self.gaps,
        )

    def _solve(self, window: Window, x: np.ndarray, detail: str) -> Outcome:
        return self.optimizer.solve(window, self.packed(window, x), self.mode, detail)

    def _solve_again(self, window: Window, x: np.ndarray, detail: str) -> Outcome:
        """Solve from the optimum `x` of nearly the same window, if its multipliers are known."""
        known = self.multipliers.get(window.offset)
        if known is not None and self.near is not None:
            full = window.pack(x, self.near[window.offset : window.offset + len(x)])
            start = as_start(window, known)
            outcome = self.optimizer.solve(window, full, self.mode, detail, start)
            if outcome.converged or outcome.stopped:
                return outcome
        return self._solve(window, x, detail)

    def packed(self, window: Window, x: np.ndarray) -> np.ndarray:
        """Decision vector of a window from its controls, within bounds, rods in equilibrium."""
        boxes = [step.box for step in window.steps]
        x = np.clip(x, [box.lower for box in boxes], [box.upper for box in boxes])
        if np.any(strains(self.motion.trunk, x[:, :-2])[..., 0] <= 0):
            x = np.zeros_like(x)  # no shape has negative extensions; start from rest
        near = None
        if self.near is not None:
            near = self.near[window.offset : window.offset + len(x)]
        try:
            shapes = self._shapes(x, _pulled(window, None), near)
            if window.held:
                shapes = self._shapes(x, _pulled(window, shapes), near)
        except StaticsError:  # a start does not have to be in equilibrium
            loads = [step.loads for step in window.steps]
            shapes = unloaded_shape(self.motion.trunk, self.mesh, x, loads)
        return window.pack(x, shapes)

    def _shapes(self, x: np.ndarray, loads: list[Loads], near: Shape | None = None) -> Shape:
        return solve_statics(self.motion.trunk, x[:, :-2], x[:, -2:], loads, self.mesh, near)

    def _several_steps(
        self, first: int, last: int, decided: DecidedSteps, previous: np.ndarray | None
    ) -> tuple[Window, Outcome]:
        """A window of several steps: the best solution from several starts."""
        steps = self.motion.steps[first:last]
        window = self.window(first, list(steps), decided)
        detail = f"steps {first + 1} to {last}"
        best: Outcome | None = None
        converged = False
        start = self.start
        if start and start.converged and last == len(start.x) and start.mesh == self.mesh:
            kept = window.pack(start.x[first:last], start.part(first, last))
            unsolved = self.optimizer.evaluate(window, kept)
            best = unsolved if unsolved.infeasibility <= FEASIBILITY_TOL else None
        for number, (label, x) in enumerate(self._starts(first, last, previous)):
            reached = best is not None and converged and window.reached(best.full)
            if number >= self.options.starts and (reached or number > 1):
                break
            solve = self._solve if number else self._solve_again
            outcome = solve(window, x, f"{detail}, from the {label}")
            converged |= outcome.converged
            if best is None or rank(outcome) < rank(best):
                best = outcome
            if outcome.stopped:
                break
        if best is None:
            raise AssertionError("every window has a start")
        self.multipliers.pop(first, None)
        if self.motion.contact and best.multipliers:
            self.multipliers[first] = multipliers_of(window, best)
        # A start that no solve improves on counts as converged once some solve has converged.
        return window, replace(best, message=CONVERGED_STATUSES[0]) if converged else best

    def _starts(
        self, first: int, last: int, previous: np.ndarray | None
    ) -> Iterator[tuple[str, np.ndarray]]:
        """Starts of a window: (name, controls of its steps)."""
        if self.guess is not None:
            yield "given controls", self.guess[first:last]
            if not self.gaps:
                return
        if previous is not None:
            yield "window before", np.vstack([previous[1:], previous[-1:]])
            return
        if self.start is not None and len(self.start.x) >= last:
            yield f"{self.start.mode} plan", self.start.x[first:last]
        yield "passive trunk", np.zeros((last - first, self.controls))
        for seed in itertools.count():
            rng = np.random.default_rng(seed)
            box = self.motion.box
            x = RANDOM_START_SIZE * rng.uniform() * rng.uniform(box.lower, box.upper)
            x[-2:] = 0.0
            yield f"random start {seed + 1}", np.tile(x, (last - first, 1))

    def _one_step(self, first: int, decided: DecidedSteps) -> tuple[Window, Outcome]:
        """A window of one step, with its auxiliary problem if it has one (appendix B)."""
        step = self.motion.steps[first]
        detail = f"step {first + 1} of {len(self.motion.steps)}"
        before = self._before(decided)
        if step.auxiliary is None or (self.only_starts and first):
            decided.unloaded = None
            window = self.window(first, [step], decided)
            return window, self._solve(window, self._guess(first, before), detail)
        guess = self._auxiliary(first, f"{detail}, unloaded", decided)
        loaded = step
        if step.auxiliary.binds:
            decided.auxiliary[first] = guess
            box = allowed(self.motion, step, guess)
            loaded = replace(step, box=box, change=_unbounded(self.controls))
        window = self.window(first, [loaded], decided)
        return window, self._solve(window, guess[None], detail)

    def _guess(self, first: int, default: np.ndarray) -> np.ndarray:
        """Start of the solve of one step, (1, muscles + 2)."""
        return default[None] if self.guess is None else self.guess[first : first + 1]

    def _auxiliary(self, first: int, detail: str, decided: DecidedSteps) -> np.ndarray:
        """Optimum of a step without loads, started from the unloaded one before it and near it."""
        step = self.motion.steps[first]
        chained = bool(np.any(np.isfinite(step.change.upper))) and decided.unloaded is not None
        before = self._before(decided)
        reference = decided.unloaded if chained and decided.unloaded is not None else before
        unloaded = step.loads.scaled(0.0)
        unloaded_step = replace(
            step,
            loads=unloaded,
            pull=None,
            change=step.change if chained else _unbounded(self.controls),
        )
        window = Window(
            self.motion,
            self.mesh,
            [unloaded_step],
            reference,
            decided.held,
            first,
            self.weights,
            self.gaps,
        )
        outcome = self._solve(window, self._guess(first, reference), detail)
        if not outcome.converged and not outcome.stopped:
            again = self._solve(window, np.zeros((1, self.controls)), detail)
            outcome = again if rank(again) < rank(outcome) else outcome
        decided.converged &= outcome.converged
        decided.unloaded = window.controls_of(outcome.full)[0]
        return decided.unloaded

    def plan(self, decided: DecidedSteps, shape: Shape | None = None) -> Plan:
        """The plan of the decided steps.

        shape : of the steps, if known; otherwise from their states, or by statics if those are of
            solves that did not converge.
        """
        x = np.array(decided.x).reshape(-1, self.controls)
        forces = np.array(decided.tip_forces).reshape(-1, 3)
        loads = planned_loads(self.motion, forces)
        finished = decided.converged and len(x) == len(self.motion.steps)
        shape = shape or self._shape(decided, x, loads)
        return Plan(
            motion=self.motion,
            x=x,
            tip_forces=forces,
            shape=shape,
            mode=self.mode,
            lookahead=self.lookahead,
            weights=self.weights,
            auxiliary=decided.auxiliary,
            gaps=dict(self.gaps),
            converged=decided.converged,
            interrupted=self.optimizer.reporter.stop,
            late=self.optimizer.late and not finished,
        )

    def _shape(self, decided: DecidedSteps, x: np.ndarray, loads: Sequence[Loads]) -> Shape:
        """Shapes of the decided steps under their loads."""
        rod = (self.mesh.elements, self.mesh.degree + 1, STATES)
        states = np.array(decided.states).reshape(-1, *rod)
        shape = shape_of_states(self.motion.trunk, self.mesh, x, loads, states)
        if len(x) and not decided.converged:
            # Rods of an unconverged iterate are not in equilibrium; those of its activations are.
            with contextlib.suppress(StaticsError, InputError):
                shape = self._shapes(x, list(loads))
        return shape


def _pulled(window: Window, shapes: Shape | None) -> list[Loads]:
    """Loads of a window's steps with their pulls; see `Window.pulls`."""
    return [
        replace(step.loads, tip_force=vector(np.add(step.loads.tip_force, pull)))
        for step, pull in zip(window.steps, window.pulls(shapes), strict=True)
    ]


def _unbounded(size: int) -> Bounds:
    return Bounds(np.full(size, -np.inf), np.full(size, np.inf))

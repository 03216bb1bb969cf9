"""Planning a motion: windows of time steps, solved one after the other.

A window of H consecutive steps is one nonlinear programme. After each solve the first step
of the window is kept and the window moves on by one; the last window keeps all of its steps.
H = 1 is the paper's sequential solve, H = all the horizon, anything between a receding
horizon; the loop is the same.
"""

from __future__ import annotations

import contextlib
import itertools
import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field, replace
from numbers import Real
from typing import TYPE_CHECKING

import numpy as np

from .._support.blas_threads import one_thread
from .._support.deferred_signals import deferred_interrupts
from .._support.provenance import versions
from .._support.ranges import check
from ..errors import InputError, StaticsError
from ..model.activation import strains
from ..model.loads import Loads, vector
from ..nlp.ipopt import CONVERGED, FEASIBLE, ROUGH, Optimiser, Outcome, rank
from ..nlp.size import check_size
from ..nlp.window import Weights, Window
from ..problem.motion import Box, Motion, Step, allowed
from ..problem.targets import Held
from ..reporting import Reporter
from ..rod.collocation import Mesh, mesh_for
from ..rod.equations import STATES
from ..rod.statics import Shape, shape_of_states, solve_statics, unloaded_shape
from .plan import Plan, loads_of

if TYPE_CHECKING:
    from .checkpoint import Checkpoint

GAUSS_POINTS = 24
"""Along the trunk; with fewer, the shipped motions come near the check's limit."""
REFINEMENTS = 2
"""How often the mesh is halved where the independent check finds it too coarse."""
ROUGH_ITERATIONS = 200
"""Most iterations of a step of a plan that only starts a horizon; the shipped motions take 60."""
RANDOM = 0.4
"""Largest activation of a random start, as a share of its lower bound."""


@dataclass(frozen=True)
class Options:
    """Choices of the planner; the defaults serve every shipped motion.

    Attributes
    ----------
    elements, degree : int
        Mesh of the transcription, see `mesh_for`; refined if a plan's check asks for it. The
        degree is 6 by default, less (3 at least) where many segments bring many elements.
    linear_solver : str
        Of Ipopt: mumps comes with CasADi, ma27 ... ma97 and spral need installing.
    max_iterations : int
        Of Ipopt, for each solve.
    starts : int
        From how many starts a window of several steps is solved at least; the best is kept.
        The first is the sequential plan, the second the passive trunk, further ones are
        random. More are tried, the passive trunk at least, if the best misses a target.
    """

    weights: Weights = field(default_factory=Weights)
    elements: int = 3
    degree: int | None = None
    linear_solver: str = "mumps"
    max_iterations: int = 1000
    starts: int = 1

    def __post_init__(self) -> None:
        for name in ("elements", "degree", "max_iterations", "starts"):
            if (value := getattr(self, name)) is not None:
                check(value, name)


@dataclass(eq=False)
class State:
    """What has been decided so far: unknowns, shapes and directions of the kept steps."""

    x: list[np.ndarray] = field(default_factory=list)
    tip_forces: list[np.ndarray] = field(default_factory=list)
    states: list[np.ndarray] = field(default_factory=list)
    held: dict[Held, np.ndarray] = field(default_factory=dict)
    auxiliary: np.ndarray | None = None  # the last unloaded optimum
    near: dict[int, np.ndarray] = field(default_factory=dict)
    converged: bool = True


@one_thread()
def plan_motion(
    motion: Motion,
    lookahead: int | None = None,
    options: Options | None = None,
    reporter: Reporter | None = None,
    start: Plan | None = None,
    checkpoint: Checkpoint | None = None,
    throw: bool = True,
    deadline: float | None = None,
) -> Plan:
    """Find activations and head angles that perform a motion.

    Parameters
    ----------
    lookahead : int, optional
        Time steps planned together: 1 is the paper's sequential solve (with appendix B's
        auxiliary problems, guesses and feasible sets), None all of them.
    start : Plan, optional
        A plan of the same motion to improve on. By default a lookahead beyond 1 first makes
        the sequential plan. A horizon returns nothing worse by its own objective, as long as
        the start keeps the horizon's bounds, which appendix B does not ask of a sequential plan.
    checkpoint : Checkpoint, optional
        Where every finished window is kept, and gone on from.
    throw : bool
        False to get a plan that is not solved as well: look at its `status`.
    deadline : float, optional
        Seconds of wall time after which no iteration of the optimizer begins. What was reached is
        returned, with status TIME_LIMIT; its check comes on top.

    Returns
    -------
    Plan
        Solved and verified.

    Raises
    ------
    PlanError
        If it is not solved; the error has the plan.
    InputError
        If the lookahead is not a whole number from 1 on, the deadline not positive, or the
        checkpoint of another plan.
    KeyboardInterrupt
        On Ctrl-C, unless its handler has been replaced. Whatever else a reporter raises reaches
        the caller as well.
    SolverMissingError
        If the linear solver is not there.
    """
    began = time.perf_counter()
    options, reporter = options or Options(), reporter or Reporter()
    mode, lookahead = mode_of(motion, lookahead)
    ends = began + seconds_allowed(deadline)
    _check_start(start, motion)
    optimiser = Optimiser(options.linear_solver, options.max_iterations, reporter, deadline=ends)
    few = min(options.max_iterations, ROUGH_ITERATIONS)
    rough = Optimiser(options.linear_solver, few, reporter, ROUGH, ends)
    mesh = first_mesh(motion, options)
    if large := check_size(motion, mesh, lookahead):
        reporter.note(large)
    given = start  # its own cost counts as well
    if checkpoint is not None:
        checkpoint.open(motion, mode, lookahead, options, start)
    if mode != "sequential" and start is None:
        start = Pass(motion, mesh, "sequential", 1, options, rough, None, checkpoint).run()
    own = Pass(motion, mesh, mode, lookahead, options, optimiser, start, checkpoint)
    if own.stopped and start is not None:
        plan = _instead(start, own)
    else:
        plan = _on_finer_meshes(own.run(), own)
    parts: list[Optimiser | Plan] = [optimiser, rough, *([given] if given else [])]
    plan = plan.recorded(
        iterations=sum(part.iterations for part in parts),
        setup_seconds=sum(part.setup_seconds for part in parts),
        solve_seconds=sum(part.solve_seconds for part in parts),
        derivative_seconds=sum(part.derivative_seconds for part in parts),
        total_seconds=time.perf_counter()
        - began
        + (given.total_seconds if given else 0)
        + (checkpoint.seconds if checkpoint else 0),
        solves=(*(given.solves if given else ()), *rough.solves, *optimiser.solves),
        versions=versions(),
        options=asdict(options),
        notes=(*plan.notes, *plan.verification.doubts),
    )
    return plan.checked() if throw else plan


def _check_start(start: Plan | None, motion: Motion) -> None:
    """Raise InputError for a plan that a plan of this motion cannot start from."""
    if start is None:
        return
    if start.motion.trunk != motion.trunk:
        raise InputError("start: expected a plan of the same trunk.")
    if len(start.x) > len(motion.steps):
        raise InputError(
            f"start: has {len(start.x)} time steps; expected at most the motion's, "
            f"{len(motion.steps)}."
        )


def _instead(start: Plan, own: Pass) -> Plan:
    """The plan that a horizon starts from, where there was no time for the horizon itself."""
    how = "interrupted" if own.optimiser.reporter.stop else "out of time"
    whole = len(start.x) == len(own.motion.steps)
    what = "the plan it starts from" if whole else "a part of the plan it would start from"
    note = f"{how} before the horizon's own solve; this is {what}"
    kept = replace(start, motion=own.motion, mode=own.mode, lookahead=own.lookahead, notes=(note,))
    return _cut_short(kept, own)


def _on_finer_meshes(plan: Plan, own: Pass) -> Plan:
    """The plan, made again on finer meshes where its check asks for them."""
    mesh = own.mesh
    for _ in range(REFINEMENTS):
        if not plan.converged or not plan.verification.too_coarse or plan.cut_short:
            break
        if own.stopped:
            return _cut_short(plan, own)
        mesh = mesh_for(own.motion.trunk, own.motion.contact_from, 2 * mesh.elements, mesh.degree)
        told = f"The mesh was too coarse; planning again with {mesh.elements} elements."
        own.optimiser.reporter.note(told)
        again = plan if own.mode != "sequential" else None
        finer = replace(own, mesh=mesh, start=again).run()
        plan = finer if len(finer.x) == len(plan.x) else _cut_short(plan, own)
    return plan


def _cut_short(plan: Plan, own: Pass) -> Plan:
    """The plan, marked as what was there when the user or the deadline ended it."""
    stop = own.optimiser.reporter.stop
    return plan.recorded(interrupted=stop, late=not stop)


def seconds_allowed(deadline: float | None) -> float:
    """A deadline in s, infinite if there is none.

    Raises
    ------
    InputError
        If it is not a positive number.
    """
    if deadline is None:
        return math.inf
    if isinstance(deadline, bool) or not isinstance(deadline, Real) or not deadline > 0:
        raise InputError(f"deadline = {deadline!r}: expected seconds, more than 0.")
    return float(deadline)


def mode_of(motion: Motion, lookahead: int | None) -> tuple[str, int]:
    """Name of the mode that a lookahead makes, and the lookahead as a number of time steps.

    Raises
    ------
    InputError
        If the lookahead is not a whole number from 1 on.
    """
    count = len(motion.steps)
    if lookahead is not None and not (isinstance(lookahead, int) and lookahead >= 1):
        raise InputError(f"lookahead = {lookahead}: expected a whole number from 1 on.")
    mode = "horizon" if lookahead is None or lookahead >= count else "receding"
    return "sequential" if lookahead == 1 else mode, min(lookahead or count, count)


def plan_from(
    motion: Motion,
    x: np.ndarray,
    lookahead: int | None = None,
    options: Options | None = None,
    reporter: Reporter | None = None,
) -> Plan:
    """The plan that one solve of each window from given unknowns leads to, good or bad.

    `plan_motion` looks for a good plan; this is for asking how many there are.

    Parameters
    ----------
    x : (H, muscles + 2)
        Activations and head angles of all time steps; brought within bounds first.
    """
    began = time.perf_counter()
    options, (mode, lookahead) = options or Options(), mode_of(motion, lookahead)
    optimiser = Optimiser(options.linear_solver, options.max_iterations, reporter or Reporter())
    mesh = first_mesh(motion, options)
    plan = Pass(motion, mesh, mode, lookahead, options, optimiser, guess=x).run()
    return replace(
        plan,
        iterations=optimiser.iterations,
        setup_seconds=optimiser.setup_seconds,
        solve_seconds=optimiser.solve_seconds,
        derivative_seconds=optimiser.derivative_seconds,
        total_seconds=time.perf_counter() - began,
        solves=tuple(optimiser.solves),
    )


def first_mesh(motion: Motion, options: Options) -> Mesh:
    """Mesh to try first: some 24 Gauss points along the trunk, of a degree from 3 to 6."""
    coarse = mesh_for(motion.trunk, motion.contact_from, options.elements)
    degree = options.degree or min(max(GAUSS_POINTS // coarse.elements, 3), 6)
    return Mesh(coarse.edges, degree)


@dataclass(eq=False)
class Pass:
    """One pass over a motion with a given lookahead.

    With a `guess` (all steps, muscles + 2), each window is solved from there alone.
    """

    motion: Motion
    mesh: Mesh
    mode: str
    lookahead: int
    options: Options
    optimiser: Optimiser
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
        return self.optimiser.reporter.stop or self.optimiser.late

    @deferred_interrupts()
    def run(self) -> Plan:
        """Solve all windows, one after the other."""
        state, count = State(), len(self.motion.steps)
        previous: np.ndarray | None = None  # solution of the window before
        if self.checkpoint is not None:
            state, previous = self.checkpoint.enter(self)
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
                self.checkpoint.save(self, previous)
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
        """The programme of `steps` from step `first` on, after what has been decided."""
        before = state.x[-1] if state.x else np.zeros(self.unknowns)
        return Window(
            self.motion, self.mesh, steps, before, state.held, first, self.options.weights
        )

    def _solve(self, window: Window, x: np.ndarray, detail: str) -> Outcome:
        return self.optimiser.solve(window, self.packed(window, x), self.mode, detail)

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
            given = self.optimiser.evaluate(window, kept)
            best = given if given.infeasibility <= FEASIBLE else None
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
        return window, replace(best, message=CONVERGED[0]) if converged else best

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
            interrupted=self.optimiser.reporter.stop,
            late=self.optimiser.late and not (state.converged and len(x) == len(self.motion.steps)),
        )


def _pulled(window: Window, shapes: Shape | None) -> list[Loads]:
    """Loads of a window's steps, pulls included; see `Window.pulls`."""
    return [
        replace(step.loads, tip_force=vector(np.add(step.loads.tip_force, pull)))
        for step, pull in zip(window.steps, window.pulls(shapes), strict=True)
    ]


def _anything(size: int) -> Box:
    return Box(np.full(size, -np.inf), np.full(size, np.inf))

"""A planned motion: its controls and shapes, their quality, and the motion between time steps."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from .._support.blas_threads import one_thread
from .._support.wording import rounded, step_list
from ..contact.between import gaps_between_steps
from ..contact.clearance import Clearance
from ..contact.gaps import Gap, gaps_at_steps, sharpest_bend
from ..contact.obstructions import obstructions
from ..errors import TrunkError
from ..model.loads import Loads
from ..nlp.gap_rows import GapRow
from ..nlp.outcome import Solve, rank
from ..problem.interpolation import interpolate, jumps, loads_at, planned_time
from ..problem.motion import Motion
from ..problem.weights import Weights
from ..rod.buckling import Stability, all_stable, buckling_margin
from ..rod.collocation import Mesh
from ..rod.flutter import MODES as VIBRATION_MODES
from ..rod.flutter import Flutter, flutter
from ..rod.shape import Shape
from ..rod.statics import refined, solve_statics
from .status import FAILURES, Status
from .step_errors import StepErrors, step_errors
from .verification import Verification, verify

MODES = ("sequential", "horizon", "receding")

CHECKS = (
    "verification",
    "stability",
    "flutter",
    "errors",
    "gaps_between",
    "clearance",
    "_checked_status",
)
"""Results of checks, which stay with a plan when only its record changes."""

MAX_DEFECT = 1e-4
"""Largest `Shape.defect` of a sample, beyond which its mesh is refined."""


@dataclass(frozen=True)
class Objective:
    """Costs of a plan: the paper's J (eq. 42, un-squared norms, in m) and the planner's own.

    The planner minimizes `tracking` + `effort` + `rate` + `head_effort`; see `Weights`.
    """

    paper: float
    tracking: float
    effort: float
    rate: float
    head_effort: float

    @property
    def total(self) -> float:
        """What the planner minimizes."""
        return self.tracking + self.effort + self.rate + self.head_effort


@dataclass(frozen=True, eq=False)
class Sample:
    """The moving trunk at one instant; `after` on the later side of a jump of the loads."""

    time: float
    activation: np.ndarray
    head: np.ndarray
    loads: Loads
    shape: Shape
    after: bool = False


def planned_loads(motion: Motion, tip_forces: np.ndarray) -> tuple[Loads, ...]:
    """Loads of the first H steps, with the tip forces (H, 3) N that a plan found."""
    return tuple(
        step.loads
        if tuple(force) == step.loads.tip_force
        else replace(step.loads, tip_force=tuple(force))
        for step, force in zip(motion.steps, tip_forces.tolist(), strict=False)
    )


@dataclass(frozen=True, repr=False, eq=False)
class Plan:
    """A motion with the activations and head angles that perform it.

    Attributes
    ----------
    x : (H, muscles + 2)
        Activations and head angles (rad) of time steps 1 to H; H is less than the motion's
        number of steps only if the plan was cut short.
    tip_forces : (H, 3)
        Tip force V in N, those along held directions included.
    shape : Shape
        Planned shapes, batch axis (H,).
    mode : str
        "sequential", "horizon" or "receding".
    lookahead : int
        Time steps planned together.
    auxiliary : dict
        Controls (muscles + 2,) of the auxiliary problem, by step (from 0), for the steps that must
        stay near it rather than near the step before (sequential plans, appendix B).
    gaps : dict
        Gaps that steps (from 0) had to keep, if the motion asks for contact.
    interrupted, late : bool
        Whether the user, or the deadline, stopped the planner before it was done.
    deferred : bool
        Whether the plan counts as unchecked until `check` is called.
    derivative_seconds : float
        Part of `solve_seconds` spent in the objective, the constraints and their derivatives.
    notes : tuple of str
        Remarks on how it was made, a sentence each.
    solves : tuple of Solve
        Record of every solve, in order.
    versions : dict
        Of the software that made it; see `provenance`.
    options : dict
        Options of the planner; under "command" those of the command line.
    """

    motion: Motion
    x: np.ndarray
    tip_forces: np.ndarray
    shape: Shape
    mode: str
    lookahead: int
    weights: Weights
    auxiliary: dict[int, np.ndarray] = field(default_factory=dict)
    gaps: dict[int, tuple[GapRow, ...]] = field(default_factory=dict)
    converged: bool = True
    interrupted: bool = False
    late: bool = False
    deferred: bool = False
    iterations: int = 0
    setup_seconds: float = 0.0
    solve_seconds: float = 0.0
    derivative_seconds: float = 0.0
    total_seconds: float = 0.0
    notes: tuple[str, ...] = ()
    solves: tuple[Solve, ...] = ()
    versions: dict[str, str] = field(default_factory=dict)
    options: dict[str, Any] = field(default_factory=dict)

    def __repr__(self) -> str:
        steps = f"{len(self.x)} of {len(self.motion.steps)} steps"
        known = vars(self).keys() & {"verification", "objective"}  # integrating all rods is slow
        cost = f", J = {self.objective.paper:.4g}" if known else ""
        return f"<Plan of {self.motion.name}: {self.mode}, {steps}{cost}>"

    @property
    def activations(self) -> np.ndarray:
        """Activations (H, muscles); negative contracts."""
        return self.x[:, :-2]

    @property
    def head(self) -> np.ndarray:
        """Head angles (H, 2): psi_Z, psi_Y in rad."""
        return self.x[:, -2:]

    @property
    def trajectory(self) -> np.ndarray:
        """Controls (H + 1, muscles + 2) of time steps 0 (the start), 1, ..., H."""
        return np.concatenate([self.motion.start[None], self.x])

    @property
    def times(self) -> np.ndarray:
        """Times (H + 1,) in s of the rows of `trajectory`."""
        return np.append(0.0, self.motion.times[: len(self.x)])

    @property
    def mesh(self) -> Mesh:
        """Mesh of the planned shapes."""
        return self.shape.mesh

    def part(self, first: int, last: int) -> Shape:
        """Planned shapes of steps first to last - 1 (from 0)."""
        return self.shape[first:last]

    @cached_property
    def loads(self) -> tuple[Loads, ...]:
        """Loads of each step."""
        return planned_loads(self.motion, self.tip_forces)

    @cached_property
    def verification(self) -> Verification:
        """Independent check of every step; integrates all rods, about 1 ms each."""
        return verify(self.motion, self.x, self.loads, self.shape, self.auxiliary)

    @cached_property
    @one_thread()
    def stability(self) -> Stability:
        """Whether each planned shape is stable, (H,)."""
        return buckling_margin(self.shape, self.activations, self.loads)

    @cached_property
    def gaps_between(self) -> tuple[Gap, ...]:
        """Gaps on the way to each time step, to every solid and itself; see `clearance`.

        Lower bounds are accurate for bodies that the motion asks to avoid, and rough otherwise.
        """
        return self.gaps_on_ways(hurry=False)

    def gaps_on_ways(self, hurry: bool) -> tuple[Gap, ...]:
        """As `gaps_between`; `hurry` if lower bounds do not matter once some gap is too small."""
        off, precise = self.verification.position_difference, self.motion.contact
        plan = (self.motion, self.x, self.loads, self.shape)
        return tuple(gaps_between_steps(*plan, precise, off, hurry))

    @cached_property
    def clearance(self) -> Clearance:
        """Gaps between the trunk, every solid and itself, at time steps and between them.

        Takes about half a second.
        """
        at_steps = gaps_at_steps(self.motion, self.x, self.shape)
        off = self.verification.position_difference.tolist()
        return Clearance(
            tuple(replace(gap, bound=gap.bound - off[gap.step]) for gap in at_steps),
            self.gaps_between,
            self.motion.trunk.length,
            sharpest_bend(self.motion, self.shape),
        )

    @property
    def collisions(self) -> list[str]:
        """Bodies that the motion asks to avoid and the trunk is too close to, a sentence each."""
        return self.clearance.sentences(self.motion.contact) if self.motion.contact else []

    @cached_property
    def flutter(self) -> Flutter:
        """Vibrations of the planned shapes (H,) under a couple fixed in space; NaN elsewhere.

        What the trunk carries vibrates with it: a log of the problem file, and the tip mass.
        """
        rates = np.full((len(self.x), VIBRATION_MODES), np.nan, dtype=complex)
        if self.motion.trunk.density > 0:
            for t, (step, load) in enumerate(zip(self.motion.steps, self.loads, strict=False)):
                if any(load.contact_couple):
                    carried = step.log is not None and step.log.contact_from is not None
                    contact = step.log.mass if carried and step.log else None
                    tip = self.motion.spec.phases[step.phase].loads.tip_mass
                    parts = self.shape[t], self.activations[t], load, contact or 0.0, tip
                    rates[t] = flutter(*parts).rates
        return Flutter(rates)

    @property
    def doubts(self) -> list[str]:
        """Warnings on a plan that passes its checks, a sentence each."""
        return [*self.verification.doubts, *self.fluttering]

    @property
    def fluttering(self) -> list[str]:
        """A sentence on the steps that flutter, if any do."""
        steps = np.flatnonzero(self.flutter.flutters)
        if not steps.size:
            return []
        worst = steps[np.argmax(self.flutter.growth[steps])]
        growth, frequency = self.flutter.growth[worst], self.flutter.frequency[worst]
        words = f"up to {growth:.2g}" if steps.size > 1 else f"{growth:.2g}"
        return [
            f"{step_list((steps + 1).tolist())} flutter{'s' * (steps.size == 1)}: growth {words} "
            f"/s at {frequency:.2g} Hz, undamped; the couple is fixed in space"
        ]

    @cached_property
    def errors(self) -> tuple[StepErrors, ...]:
        """Errors of each step, from the independently integrated shapes."""
        return step_errors(self.motion, self.verification, self.head)

    @cached_property
    def objective(self) -> Objective:
        """Costs, from the independently integrated shapes."""
        position = sum(float(e.position_weights @ e.position**2) for e in self.errors)
        direction = sum(float(e.direction_weights @ e.direction**2) for e in self.errors)
        return self.costs(
            self.weights,
            sum(e.paper for e in self.errors),
            position * self.motion.position_scale**2 + direction,
        )

    def costs(self, weights: Weights, paper: float, tracking: float) -> Objective:
        """The objective with these weights, given its parts that do not depend on them."""
        steps = self.motion.steps[: len(self.x)]
        working = np.array([bool(step.targets) for step in steps], dtype=bool)  # others are free
        squares = np.sum(self.x[working] ** 2, axis=0)
        return Objective(
            paper,
            tracking,
            effort=float(weights.of_muscles(self.motion.trunk.muscles) @ squares[:-2]),
            rate=weights.rate * self.squared_rate,
            head_effort=weights.head_effort * float(squares[-2:].sum()),
        )

    @property
    def squared_rate(self) -> float:
        """Integral over time of the squared rates of activations and head angles, 1/s.

        Of straight lines between time steps, from the start on; interpolation adds to it.
        """
        change = np.diff(self.trajectory, axis=0)
        duration = np.array([step.duration for step in self.motion.steps[: len(self.x)]])
        return float(np.sum(change**2 / duration[:, None]))

    @property
    def status(self) -> Status:
        """How the plan ended; UNCHECKED if its check was put off and `check` not called since."""
        return Status.UNCHECKED if self.unchecked else self.check()

    @property
    def unchecked(self) -> bool:
        """Whether the plan converged, but its check was put off and not made up for."""
        known = "_checked_status" in vars(self) or self._stopped_status is not None
        return self.deferred and not known

    def check(self) -> Status:
        """Check the plan now, if that was put off, and return its status from now on."""
        return self._stopped_status or self._checked_status

    @property
    def _stopped_status(self) -> Status | None:
        """Status of a plan that did not converge, or was stopped before; None otherwise."""
        if self.interrupted:
            return Status.INTERRUPTED
        if self.late:
            return Status.TIME_LIMIT
        if not self.converged or len(self.x) < len(self.motion.steps):
            message = self.failure.message if self.failure else ""
            return FAILURES.get(message, Status.NOT_CONVERGED)
        return None

    @cached_property
    @one_thread()
    def _checked_status(self) -> Status:
        """Status of a converged plan by its checks."""
        if self.verification.faults:
            return Status.UNVERIFIED
        if self.collisions:
            return Status.COLLIDING
        if not all_stable(self.shape, self.activations, self.loads):
            return Status.UNSTABLE
        return Status.MISSED if self.missed else Status.SOLVED

    @property
    def cut_short(self) -> bool:
        """Whether the user or the deadline stopped the planner before it was done."""
        return self.interrupted or self.late

    @property
    def failure(self) -> Solve | None:
        """Of a plan that did not converge, the best solve of the first window that failed.

        A window fails if none of its starts leads to a solution. If no window failed, the plan
        did on a finer mesh, and the last window counts.
        """
        solves = [solve for solve in self.solves if solve.stage == self.mode]
        windows = [list(starts) for _, starts in itertools.groupby(solves, key=lambda s: s.task)]
        failed = [starts for starts in windows if not any(solve.converged for solve in starts)]
        for starts in (*failed, *windows[-1:]) if not self.converged else ():
            return min((solve for solve in starts if not solve.converged), key=rank, default=None)
        return None

    def with_record(self, **record: Any) -> Plan:
        """The plan with other fields on how it was made; results of its checks are kept."""
        plan = replace(self, **record)
        vars(plan).update({name: vars(self)[name] for name in CHECKS if name in vars(self)})
        return plan

    def checked(self) -> Plan:
        """The plan itself, if it is solved and verified; a check that was put off is made now.

        Raises
        ------
        PlanError
            If it is anything else.
        """
        if self.check() is not Status.SOLVED:
            raise PlanError(self)
        return self

    @property
    def verified(self) -> bool:
        """Whether every independent check of a whole plan passed."""
        return len(self.x) == len(self.motion.steps) and not self.verification.faults

    @property
    def missed(self) -> list[str]:
        """Targets missed by more than the motion's tolerance, a sentence each."""
        position, direction = self.motion.tolerance
        sentences = []
        for number, errors in enumerate(self.errors, 1):
            for Z, error in zip(errors.position_Z, errors.position, strict=True):
                if not error <= position:
                    sentences.append(
                        f"step {number}: the target at Z = {Z:g} m is missed by "
                        f"{rounded(1e3 * error, 4)} mm, {1e3 * position:g} mm is allowed"
                    )
            for Z, error in zip(errors.direction_Z, errors.direction, strict=True):
                if not error <= direction:
                    sentences.append(
                        f"step {number}: the direction at Z = {Z:g} m is missed by "
                        f"{error:.3g}, {direction:g} is allowed"
                    )
        return sentences

    @cached_property
    def jumps(self) -> tuple[float, ...]:
        """Times in s at which loads jump; all are time steps, or 0."""
        return jumps(self.motion, self.loads)

    def sample(self, t: float, *, after: bool = False) -> Sample:
        """The moving trunk at time t in s, from 0 to the end of the plan (section 5.2).

        Activations, head angles and loads follow each phase's interpolation, except loads that
        jump where a phase starts; at a time step it is the planned step, loads and all.

        Parameters
        ----------
        after : bool
            At one of `jumps`, the other side: the trunk under the loads that the next phase
            starts with.

        Raises
        ------
        InputError
            If t is outside the plan.
        StaticsError
            If the trunk has no equilibrium at that time, or none that a mesh resolves.
        """
        t = planned_time(self.motion, len(self.x), t)
        controls = interpolate(self.motion, self.trajectory, t)
        loads = loads_at(self.motion, self.loads, t, after)
        activation, head = controls[:-2], controls[-2:]
        # Of several equilibria, the one close to the planned shape of the nearest time step.
        times = self.motion.times[: len(self.x)]
        near = self.shape[int(np.argmin(np.abs(times - t)))] if len(times) else None
        shape = solve_statics(self.motion.trunk, activation, head, loads, near=near)
        if shape.defect > MAX_DEFECT:  # the plan's mesh was checked at its time steps only
            shape = refined(shape, activation, head, loads)
        return Sample(t, activation, head, loads, shape, after)


class PlanError(TrunkError):
    """A plan is not solved and verified; the message has its status and the first problem.

    Attributes
    ----------
    plan : Plan
        The plan as far as it was reached.
    """

    def __init__(self, plan: Plan) -> None:
        violated = plan.failure.violations if plan.failure else ()
        collisions = plan.collisions if plan.status is Status.COLLIDING else []
        # A plan whose check was put off is in a hurry: its error says what is known already.
        unknown = plan.deferred and "verification" not in vars(plan)
        off = [] if unknown else [*plan.verification.faults, *collisions, *plan.missed]
        blocks = plan.motion.contact and not plan.cut_short
        blocked = obstructions(plan.motion).sentences if blocks else ()
        problems = [*blocked, *map(str, violated), *off, *plan.notes]
        first = f" {problems[0][0].upper()}{problems[0][1:]}." if problems else ""
        super().__init__(
            f"{plan.motion.name}, {plan.mode}: {plan.status.value}.{first} The error's attribute "
            "`plan` has the plan; throw=False returns it instead, and explain(plan) says more."
        )
        self.plan = plan

    def __reduce__(self) -> tuple[type[PlanError], tuple[Plan]]:
        return type(self), (self.plan,)  # see StaticsError

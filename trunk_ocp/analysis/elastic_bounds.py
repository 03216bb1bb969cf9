"""Elastic bounds: which bounds of a motion are in the way, and by how much they must be relaxed.

Every bound that a problem file states - on the activation of a muscle, a head angle, the
extension of a segment, the change between time steps - may be exceeded at a price. If the bounds
contradict each other, the cheapest excess that reconciles them solves a linear program. If they
keep the trunk from its targets, it solves the NLP of all time steps with targets as constraints.
The price is linear (an l1 penalty), so bounds that need not be relaxed stay exact.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from scipy.optimize import linprog

from .._support.wording import step_list
from ..model.activation import strain_matrix
from ..nlp.gap_rows import GapRow
from ..nlp.ipopt import Optimizer
from ..nlp.ipopt_options import DEFAULT_OPTIONS
from ..nlp.outcome import Outcome
from ..nlp.point_functions import weighted
from ..nlp.quantities import scalar
from ..nlp.window import Window
from ..planning.plan import Plan
from ..problem.motion import Bounds, Motion
from ..problem.weights import Weights
from ..reporting import Reporter
from ..rod.collocation import Mesh

PRICE = 100.0  # of an excess as large as the range; effort and rate cost far less than 1
MARGIN = 1.00001  # advised excess over the least one, which would leave no feasible interior
NLP_TOL = 1e-3  # fraction of the range; smaller excesses are inaccuracies of the optimizer
LP_TOL = 1e-6  # the same for the linear program
MAX_ITERATIONS = 200
LOOSE_EXTENSION = (0.05, 20.0)  # practically unbounded, but a segment must not vanish

# Advice stays within what a body can do, unless the file itself goes beyond.
MAX_ACTIVATION = 3.5  # |activation|, the largest in the paper
EXTENSION_RANGE = (0.5, 1.6)  # of a segment; muscular hydrostats from elephants to octopuses
MAX_HEAD_ANGLE = math.radians(60.0)
PHYSICAL = (
    f"activations to {-MAX_ACTIVATION:g}, segments {EXTENSION_RANGE[0]:g} to "
    f"{EXTENSION_RANGE[1]:g} times as long, a head turned by {math.degrees(MAX_HEAD_ANGLE):g} deg"
)
"""The same limits in words."""


@dataclass(frozen=True)
class Bound:
    """A bound that may be relaxed: its name, value, unit, and the scale of its price.

    `sign` is -1 for a lower bound and +1 for an upper one. `steps` (from 1) are those at which it
    has this value; it is relaxed by the same amount at all of them. `most` is the largest plausible
    excess, in the unit of the unknown: muscles cannot push, heads cannot turn around. `muscle` is
    the one whose change between steps it limits, if it does.
    """

    name: str
    value: float
    sign: int
    unit: str
    scale: float
    steps: tuple[int, ...]
    most: float
    muscle: str = ""


@dataclass(frozen=True)
class Excess:
    """By how much one bound must be relaxed, in its own unit (degrees for angles)."""

    bound: Bound
    amount: float

    def __str__(self) -> str:
        bound = self.bound
        unit = f" {bound.unit}" if bound.unit else ""
        to = outward(bound.value + bound.sign * MARGIN * self.amount, bound.sign)
        return f"{bound.name} ({step_list(bound.steps)}): from {bound.value:.4g} to {to:.4g}{unit}"


def in_words(excesses: Sequence[Excess], motion: Motion) -> tuple[str, ...]:
    """A sentence for each bound, or one for all muscles whose change one key limits.

    A file has one `change.activation` for all muscles and both signs; the largest excess counts.
    """
    largest: dict[object, Excess] = {}
    for excess in excesses:
        bound = excess.bound
        key = (bound.steps, abs(bound.value)) if bound.muscle else bound.name, bound.steps
        largest[key] = max(largest.get(key, excess), excess, key=lambda one: one.amount)
    return tuple(
        _of_change(excess, motion) if excess.bound.muscle else str(excess)
        for excess in largest.values()
    )


def _of_change(excess: Excess, motion: Motion) -> str:
    """The excess of a bound on the change of an activation, named by its key in the file."""
    bound = excess.bound
    phases = sorted({motion.steps[step - 1].phase + 1 for step in bound.steps})
    where = ", ".join(f"phases[{phase}]" for phase in phases)
    to = outward(abs(bound.value) + MARGIN * excess.amount, 1)
    return (
        f"change.activation of {where} ({step_list(bound.steps)}): from {abs(bound.value):.4g} to "
        f"{to:.4g}, for {bound.muscle}"
    )


def outward(value: float, sign: int) -> float:
    """A value for a bound, rounded to four digits: down if the sign is negative, else up."""
    if value == 0:
        return 0.0
    step = 10.0 ** (math.floor(math.log10(abs(value))) - 3)
    return (math.floor if sign < 0 else math.ceil)(value / step) * step


@dataclass(frozen=True, eq=False)
class Elastic:
    """All bounds of a motion as rows lower <= C (x, s) <= upper, with one s >= 0 for each bound.

    x holds the activations and head angles of all steps, step by step.
    """

    matrix: sp.coo_matrix
    lower: np.ndarray
    upper: np.ndarray
    bounds: tuple[Bound, ...]


def contradictions(motion: Motion) -> tuple[Excess, ...]:
    """The bounds that must be relaxed for any activation to satisfy them all; usually none."""
    elastic = elastic_rows(motion)
    count = elastic.matrix.shape[1] - len(elastic.bounds)
    price = np.concatenate([np.zeros(count), [1 / bound.scale for bound in elastic.bounds]])
    C = sp.csr_matrix(elastic.matrix)
    rows = sp.vstack([C[np.isfinite(elastic.upper)], -C[np.isfinite(elastic.lower)]])
    limit = np.concatenate(
        [elastic.upper[np.isfinite(elastic.upper)], -elastic.lower[np.isfinite(elastic.lower)]]
    )
    free = [(None, None)] * count + [(0, bound.most) for bound in elastic.bounds]
    result = linprog(price, A_ub=rows, b_ub=limit, bounds=free, method="highs")
    return _excesses(elastic, result.x[count:], LP_TOL)


def reach(plan: Plan, reporter: Reporter | None = None) -> tuple[Excess, ...] | None:
    """The bounds that must be relaxed for a plan's motion to reach all targets.

    All targets within the motion's tolerance, at the lowest price found from the plan: a local
    optimum. None if no such motion was found within the limits `PHYSICAL`.
    """
    window = ElasticWindow(plan.motion, plan.mesh, plan.gaps)
    outcome = _solved(window, plan, "bounds to relax", reporter)
    if not outcome.converged:
        return None
    return _excesses(window.elastic, outcome.full[window.excess], NLP_TOL)


def nearest(plan: Plan, reporter: Reporter | None = None) -> float | None:
    """Worst distance in m to a target with every bound relaxed to the limits `PHYSICAL`.

    A local optimum, found from the plan; None if the solve does not converge.
    """
    motion = plan.motion
    n = len(motion.trunk.muscles) + 2
    unbounded = Bounds(np.full(n, -np.inf), np.full(n, np.inf))
    lower, upper = (np.array(side) for side in zip(*_physical(motion), strict=True))
    low, high = EXTENSION_RANGE
    widest = (min(motion.extension[0], low), max(motion.extension[1], high))
    steps = [replace(step, box=_widened(step.box, lower, upper), change=unbounded)
             for step in motion.steps]  # fmt: skip
    window = Window(
        replace(motion, steps=tuple(steps), extension=widest), plan.mesh, steps, motion.start, {},
        0, plan.weights, plan.gaps,
    )  # fmt: skip
    outcome = _solved(window, plan, "distance to the targets", reporter)
    return window.worst_error(outcome.full) if outcome.converged else None


def _solved(window: Window, plan: Plan, detail: str, reporter: Reporter | None) -> Outcome:
    """Outcome of a window that starts from a plan."""
    choices = DEFAULT_OPTIONS | {"mu_init": 1e-2}
    optimizer = Optimizer("mumps", MAX_ITERATIONS, reporter or Reporter(), choices)
    return optimizer.solve(window, window.pack(plan.x, plan.shape), "relaxation", detail)


def _widened(box: Bounds, lower: np.ndarray, upper: np.ndarray) -> Bounds:
    """Bounds widened to physical limits; an upper bound of 0 stays, since muscles cannot push."""
    return Bounds(np.minimum(box.lower, lower), np.maximum(box.upper, upper))


def _physical(motion: Motion) -> list[tuple[float, float]]:
    """Smallest and largest plausible value of each unknown.

    Muscles only contract. A base without a head stays where the file clamps it.
    """
    limits = [(-MAX_ACTIVATION, 0.0)] * len(motion.trunk.muscles)
    for box in zip(motion.box.lower[-2:].tolist(), motion.box.upper[-2:].tolist(), strict=True):
        clamped = motion.trunk.head.pivot_radius == 0 and box[0] == box[1]
        limits.append(box if clamped else (-MAX_HEAD_ANGLE, MAX_HEAD_ANGLE))
    return limits


def _excesses(elastic: Elastic, amounts: np.ndarray, smallest: float) -> tuple[Excess, ...]:
    """Excesses above a fraction of their bound's range, the largest fraction first."""
    excesses = [
        Excess(b, float(np.degrees(amount)) if b.unit == "deg" else amount)
        for b, amount in zip(elastic.bounds, amounts.tolist(), strict=True)
        if amount > smallest * b.scale
    ]
    return tuple(sorted(excesses, key=lambda excess: -excess.amount / excess.bound.scale))


def elastic_rows(motion: Motion) -> Elastic:
    """Every bound of a motion as a row that may be relaxed."""
    trunk, n, H = motion.trunk, len(motion.trunk.muscles) + 2, len(motion.steps)
    names = (*(f"activation of {m}" for m in trunk.muscles), "head psi_Z", "head psi_Y")
    units = ("",) * (n - 2) + ("deg", "deg")
    lower = np.array([step.box.lower for step in motion.steps])
    upper = np.array([step.box.upper for step in motion.steps])
    rows = _Rows(H * n)
    x = np.arange(H * n).reshape(H, n)
    eye = sp.identity(H * n, format="csr")
    physical = _physical(motion)
    for i, (name, unit) in enumerate(zip(names, units, strict=True)):
        scale = max(float(motion.box.upper[i] - motion.box.lower[i]), 0.1)
        ends = (lower[:, i], upper[:, i])
        rows.add(eye[x[:, i]], name, unit, scale, *ends, within=physical[i])
    A = sp.csr_matrix(strain_matrix(trunk)[:, 0])
    low, high = motion.extension
    for segment in range(trunk.segments):
        zeta = sp.hstack([A[segment], sp.csr_matrix((1, 2))])
        extension_rows = sp.kron(sp.identity(H), zeta, format="csr")
        ends = (np.full(H, low - 1), np.full(H, high - 1))
        limits = (EXTENSION_RANGE[0] - 1, EXTENSION_RANGE[1] - 1)
        name = f"extension of segment {segment + 1}"
        rows.add(extension_rows, name, "", 0.3, *ends, offset=1.0, within=limits)
    difference = sp.csr_matrix(eye - sp.eye(H * n, k=-n))
    least = np.array([step.change.lower for step in motion.steps])
    most = np.array([step.change.upper for step in motion.steps])
    for i, (name, unit) in enumerate(zip(names, units, strict=True)):
        scale = 0.2 if unit else 0.5
        ends, muscle = (least[:, i], most[:, i]), (*trunk.muscles, "", "")[i]
        before = np.where(np.arange(H) == 0, motion.start[i], 0.0)  # known, so it has no column
        of_change = f"change of {name}"
        rows.add(difference[x[:, i]], of_change, unit, scale, *ends, muscle=muscle, known=before)
    return rows.elastic()


class _Rows:
    """Collects rows of linear bounds, with a separate excess for each end and value."""

    def __init__(self, unknowns: int) -> None:
        self.unknowns = unknowns
        self.parts: list[tuple[sp.csr_matrix, int, np.ndarray]] = []
        self.bounds: list[Bound] = []

    def add(
        self,
        matrix: sp.csr_matrix,
        name: str,
        unit: str,
        scale: float,
        lower: np.ndarray,
        upper: np.ndarray,
        offset: float = 0.0,
        within: tuple[float, float] = (-np.inf, np.inf),
        muscle: str = "",
        known: np.ndarray | float = 0.0,
    ) -> None:
        """Add lower <= matrix x - known <= upper; `offset` is added to reported values.

        No bound is relaxed beyond `within`; those already beyond it are not relaxed at all.
        """
        per_unit = float(np.degrees(1.0)) if unit == "deg" else 1.0
        sides = ((-1, lower, "least", within[0]), (1, upper, "largest", within[1]))
        for sign, values, word, limit in sides:
            for value in np.unique(values[np.isfinite(values)]).tolist():
                same = np.flatnonzero(values == value)
                steps = tuple((same + 1).tolist())
                most = max(0.0, sign * (limit - value))
                reported = per_unit * value + offset
                bound = Bound(f"{word} {name}", reported, sign, unit, scale, steps, most, muscle)
                self.parts.append((matrix[same], sign, (values + known)[same]))
                self.bounds.append(bound)

    def elastic(self) -> Elastic:
        """All rows together."""
        matrices, signs, values = zip(*self.parts, strict=True)
        counts = [matrix.shape[0] for matrix in matrices]
        slacks = sp.block_diag(
            [np.full((n, 1), -sign) for n, sign in zip(counts, signs, strict=True)]
        )
        low, value = np.repeat(signs, counts) < 0, np.concatenate(values)
        return Elastic(
            sp.coo_matrix(sp.hstack([sp.vstack(matrices), slacks])),
            np.where(low, value, -np.inf),
            np.where(low, np.inf, value),
            tuple(self.bounds),
        )


class ElasticWindow(Window):
    """All time steps of a motion, with targets as constraints and bounds that may be relaxed.

    Tracking has no cost, so that targets met within tolerance cause no further excess.

    Attributes
    ----------
    elastic : Elastic
    excess : (bounds,)
        Indices of the excesses in the decision vector.
    """

    def __init__(
        self, motion: Motion, mesh: Mesh, gaps: Mapping[int, tuple[GapRow, ...]] | None = None
    ) -> None:
        n = len(motion.trunk.muscles) + 2
        unbounded = Bounds(np.full(n, -np.inf), np.full(n, np.inf))
        steps = [replace(step, box=unbounded, change=unbounded) for step in motion.steps]
        unbounded_motion = replace(motion, steps=tuple(steps), extension=LOOSE_EXTENSION)
        super().__init__(unbounded_motion, mesh, steps, motion.start, {}, 0, Weights(), gaps)
        self.elastic = elastic_rows(motion)
        add = self._builder
        most = np.array([bound.most for bound in self.elastic.bounds])
        self.excess = add.variables(most.size, lower=0.0, upper=most)
        unknowns = np.concatenate([*(u.x for u in self.unknowns), self.excess])
        C = self.elastic.matrix
        lower, upper = self.elastic.lower[:, None], self.elastic.upper[:, None]
        rows = add.rows(scalar("elastic bound"), C.shape[0], 1, lower=lower, upper=upper)
        add.linear(rows[C.row, 0], unknowns[C.col], C.data)
        for goal in self.goals():
            if goal.weight > 0:
                # In units of the tolerance.
                row = add.rows(scalar("target"), 1, lower=-np.inf, upper=1.0)
                parameters = np.append(goal.parameters, goal.tolerance**-2)
                add.term(goal.function, goal.variables[:, None], parameters[:, None], 0, 0, row)
        price = np.array([[PRICE / bound.scale for bound in self.elastic.bounds]])
        add.cost(weighted(), self.excess[None], price)

    def _tracking(self) -> None:
        """No cost; targets are constraints."""

"""Elastic bounds: which of a motion's bounds stand in the way, and how far they would have to give.

Every bound that a problem file states - on the activation of a muscle, a head angle, the
extension of a segment, the change between time steps - may be exceeded at a price. Where the
bounds contradict each other, the cheapest excess that reconciles them is a linear program; where
they keep the trunk from its targets, it is the window of all time steps once more, with targets
as constraints. A price per unit (an l1 penalty) leaves all bounds alone that need not give.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from scipy.optimize import linprog

from ..model.activation import strain_matrix
from ..nlp.ipopt import Optimizer
from ..nlp.ipopt_options import DEFAULT_OPTIONS
from ..nlp.point_functions import weighted
from ..nlp.quantities import scalar
from ..nlp.window import Weights, Window
from ..planning.plan import Plan
from ..problem.motion import Bounds, Motion
from ..reporting import Reporter
from ..rod.collocation import Mesh

PRICE = 100.0  # of an excess of its bounds' whole range; effort and rate cost far less than 1
ROOM = 1.00001  # times the least excess is what is advised: bounds that just meet leave none
SMALLEST = 1e-3  # share of the range, below which an excess is the optimizer's inaccuracy
EXACT = 1e-6  # the same for the linear program
ITERATIONS = 200
OPTIONS = DEFAULT_OPTIONS | {"mu_init": 1e-2}
LOOSE_EXTENSION = (0.05, 20.0)  # what no bound excludes; a segment must not vanish

# No advice goes beyond what a body can do, unless the file itself does.
STRONGEST = 3.5  # |activation|, the largest of the paper
LONGEST = (0.5, 1.6)  # of a segment; muscular hydrostats from elephants to octopuses
FARTHEST = math.radians(60.0)  # of a head
PHYSICAL = (
    f"activations to {-STRONGEST:g}, segments {LONGEST[0]:g} to {LONGEST[1]:g} times as long, a "
    f"head turned by {math.degrees(FARTHEST):g} deg"
)
"""These limits in words."""


@dataclass(frozen=True)
class Bound:
    """A bound that may give: its name, the value it states, its unit and its price's scale.

    `sign` is -1 for a lower bound and +1 for an upper one, `steps` (from 1) are those at which it
    has this value: it gives by the same amount at all of them. `most` is the largest excess that
    makes sense, in the unknown's own unit: no muscle can push, no head turns right round.
    `muscle` is the one whose change between steps it limits, if it does.
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
    """How far one bound has to give, in its own unit (degrees for angles)."""

    bound: Bound
    amount: float

    def __str__(self) -> str:
        bound = self.bound
        unit = f" {bound.unit}" if bound.unit else ""
        to = outwards(bound.value + bound.sign * ROOM * self.amount, bound.sign)
        return f"{bound.name} ({said(bound.steps)}): from {bound.value:.4g} to {to:.4g}{unit}"


def in_words(excesses: Sequence[Excess], motion: Motion) -> tuple[str, ...]:
    """A sentence for each bound, but for all muscles whose change is limited by one key.

    A file has one `change.activation` for all muscles, either way; the largest excess counts.
    """
    told: dict[object, Excess] = {}
    for excess in excesses:
        bound = excess.bound
        key = (bound.steps, abs(bound.value)) if bound.muscle else bound.name, bound.steps
        told[key] = max(told.get(key, excess), excess, key=lambda one: one.amount)
    return tuple(
        _of_change(excess, motion) if excess.bound.muscle else str(excess)
        for excess in told.values()
    )


def _of_change(excess: Excess, motion: Motion) -> str:
    """The excess of a bound on an activation's change, by the key that the file has for it."""
    bound = excess.bound
    phases = sorted({motion.steps[step - 1].phase + 1 for step in bound.steps})
    where = ", ".join(f"phases[{phase}]" for phase in phases)
    to = outwards(abs(bound.value) + ROOM * excess.amount, 1)
    return (
        f"change.activation of {where} ({said(bound.steps)}): from {abs(bound.value):.4g} to "
        f"{to:.4g}, for {bound.muscle}"
    )


def outwards(value: float, sign: int) -> float:
    """A number of four digits, rounded down or up by the sign, for a bound to be set to."""
    if value == 0:
        return 0.0
    step = 10.0 ** (math.floor(math.log10(abs(value))) - 3)
    return (math.floor if sign < 0 else math.ceil)(value / step) * step


def said(steps: Sequence[int]) -> str:
    """Step numbers in words: 1, 2, 3, 7 as "steps 1 to 3, 7"."""
    runs: list[list[int]] = []
    for step in steps:
        if runs and step == runs[-1][-1] + 1:
            runs[-1].append(step)
        else:
            runs.append([step])
    words = [str(run[0]) if len(run) == 1 else f"{run[0]} to {run[-1]}" for run in runs]
    return f"step{'s' * (len(steps) > 1)} {', '.join(words)}"


@dataclass(frozen=True, eq=False)
class Elastic:
    """All bounds of a motion as rows: lower <= C (x, s) <= upper, s >= 0 one for each bound.

    x are the activations and head angles of all steps, one after the other.
    """

    matrix: sp.coo_matrix
    lower: np.ndarray
    upper: np.ndarray
    bounds: tuple[Bound, ...]


def contradictions(motion: Motion) -> tuple[Excess, ...]:
    """The bounds that would have to give for any activation to keep them all; none as a rule."""
    elastic = elastic_bounds(motion)
    count = elastic.matrix.shape[1] - len(elastic.bounds)
    price = np.concatenate([np.zeros(count), [1 / bound.scale for bound in elastic.bounds]])
    C = sp.csr_matrix(elastic.matrix)
    rows = sp.vstack([C[np.isfinite(elastic.upper)], -C[np.isfinite(elastic.lower)]])
    limit = np.concatenate(
        [elastic.upper[np.isfinite(elastic.upper)], -elastic.lower[np.isfinite(elastic.lower)]]
    )
    free = [(None, None)] * count + [(0, bound.most) for bound in elastic.bounds]
    result = linprog(price, A_ub=rows, b_ub=limit, bounds=free, method="highs")
    return _told(elastic, result.x[count:], EXACT)


def reach(plan: Plan, reporter: Reporter | None = None) -> tuple[Excess, ...] | None:
    """The bounds that would have to give for a plan's motion to reach all targets.

    All targets within the motion's tolerance, at the least price found from the plan; a local
    optimum, like every plan. None if no such motion was found within what is `PHYSICAL`.
    """
    window = ElasticWindow(plan.motion, plan.mesh)
    optimizer = Optimizer("mumps", ITERATIONS, reporter or Reporter(), OPTIONS)
    start = window.pack(plan.x, plan.shape)
    outcome = optimizer.solve(window, start, "relaxation", "what would have to give")
    if not outcome.converged:
        return None
    return _told(window.elastic, outcome.full[window.excess], SMALLEST)


def nearest(plan: Plan, reporter: Reporter | None = None) -> float | None:
    """Worst distance in m to a target with every bound loosened as far as is `PHYSICAL`.

    None if the solve does not converge; a local optimum, found from the plan.
    """
    motion = plan.motion
    n = len(motion.trunk.muscles) + 2
    loose = Bounds(np.full(n, -np.inf), np.full(n, np.inf))
    lower, upper = (np.array(side) for side in zip(*_physical(motion), strict=True))
    low, high = LONGEST
    widest = (min(motion.extension[0], low), max(motion.extension[1], high))
    steps = [replace(step, box=_loosened(step.box, lower, upper), change=loose)
             for step in motion.steps]  # fmt: skip
    window = Window(
        replace(motion, steps=tuple(steps), extension=widest), plan.mesh, steps, np.zeros(n), {}, 0,
        plan.weights,
    )  # fmt: skip
    optimizer = Optimizer("mumps", ITERATIONS, reporter or Reporter(), OPTIONS)
    start = window.pack(plan.x, plan.shape)
    outcome = optimizer.solve(window, start, "relaxation", "how near the targets are")
    return window.worst_error(outcome.full) if outcome.converged else None


def _loosened(box: Bounds, lower: np.ndarray, upper: np.ndarray) -> Bounds:
    """A box of unknowns widened to physical limits; an upper bound of 0 stays: no muscle pushes."""
    return Bounds(np.minimum(box.lower, lower), np.maximum(box.upper, upper))


def _physical(motion: Motion) -> list[tuple[float, float]]:
    """Least and largest value that makes sense of each unknown.

    Activations contract. A base without a head to move it stays where the file clamps it.
    """
    limits = [(-STRONGEST, 0.0)] * len(motion.trunk.muscles)
    for box in zip(motion.box.lower[-2:].tolist(), motion.box.upper[-2:].tolist(), strict=True):
        clamped = motion.trunk.head.pivot_radius == 0 and box[0] == box[1]
        limits.append(box if clamped else (-FARTHEST, FARTHEST))
    return limits


def _told(elastic: Elastic, amounts: np.ndarray, smallest: float) -> tuple[Excess, ...]:
    """Excesses of more than a share of their bound's range, the largest share first."""
    pairs = zip(elastic.bounds, amounts.tolist(), strict=True)
    some = [
        Excess(b, float(np.degrees(amount)) if b.unit == "deg" else amount)
        for b, amount in pairs
        if amount > smallest * b.scale
    ]
    return tuple(sorted(some, key=lambda excess: -excess.amount / excess.bound.scale))


def elastic_bounds(motion: Motion) -> Elastic:
    """Every bound of a motion as a row that may give."""
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
        every = sp.kron(sp.identity(H), zeta, format="csr")
        ends = (np.full(H, low - 1), np.full(H, high - 1))
        limits = (LONGEST[0] - 1, LONGEST[1] - 1)
        name = f"extension of segment {segment + 1}"
        rows.add(every, name, "", 0.3, *ends, offset=1.0, within=limits)
    difference = sp.csr_matrix(eye - sp.eye(H * n, k=-n))
    least = np.array([step.change.lower for step in motion.steps])
    most = np.array([step.change.upper for step in motion.steps])
    for i, (name, unit) in enumerate(zip(names, units, strict=True)):
        scale = 0.2 if unit else 0.5
        ends, muscle = (least[:, i], most[:, i]), (*trunk.muscles, "", "")[i]
        rows.add(difference[x[:, i]], f"change of {name}", unit, scale, *ends, muscle=muscle)
    return rows.elastic()


class _Rows:
    """Collects rows of linear bounds, each with an excess of its own at either end."""

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
    ) -> None:
        """Add lower <= matrix x <= upper; `offset` is what is added to a value that is told.

        No bound gives beyond `within`, those that are beyond it already not at all.
        """
        per = float(np.degrees(1.0)) if unit == "deg" else 1.0
        sides = ((-1, lower, "least", within[0]), (1, upper, "largest", within[1]))
        for sign, values, word, limit in sides:
            for value in np.unique(values[np.isfinite(values)]).tolist():
                same = np.flatnonzero(values == value)
                steps = tuple((same + 1).tolist())
                most = max(0.0, sign * (limit - value))
                told = per * value + offset
                bound = Bound(f"{word} {name}", told, sign, unit, scale, steps, most, muscle)
                self.parts.append((matrix[same], sign, values[same]))
                self.bounds.append(bound)

    def elastic(self) -> Elastic:
        """All rows together."""
        matrices, signs, values = zip(*self.parts, strict=True)
        counts = [matrix.shape[0] for matrix in matrices]
        gives = sp.block_diag(
            [np.full((n, 1), -sign) for n, sign in zip(counts, signs, strict=True)]
        )
        low, value = np.repeat(signs, counts) < 0, np.concatenate(values)
        return Elastic(
            sp.coo_matrix(sp.hstack([sp.vstack(matrices), gives])),
            np.where(low, value, -np.inf),
            np.where(low, np.inf, value),
            tuple(self.bounds),
        )


class ElasticWindow(Window):
    """All time steps of a motion, with targets as constraints and bounds that may give.

    Tracking costs nothing: a target that is met within its tolerance buys no more excess.

    Attributes
    ----------
    elastic : Elastic
    excess : (bounds,)
        Indices of the excesses among the unknowns.
    """

    def __init__(self, motion: Motion, mesh: Mesh) -> None:
        n = len(motion.trunk.muscles) + 2
        loose = Bounds(np.full(n, -np.inf), np.full(n, np.inf))
        steps = [replace(step, box=loose, change=loose) for step in motion.steps]
        without = replace(motion, steps=tuple(steps), extension=LOOSE_EXTENSION)
        super().__init__(without, mesh, steps, np.zeros(n), {}, 0, Weights())
        self.elastic = elastic_bounds(motion)
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

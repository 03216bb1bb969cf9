"""First-order sensitivity of a plan to its bounds: the effect of relaxing one by 1 %.

At an optimum the active bounds and the multipliers determine how all unknowns follow a small
change of one bound: the linear system of the Karush-Kuhn-Tucker conditions with a fixed active
set (Fiacco, Introduction to Sensitivity and Stability Analysis in Nonlinear Programming, 1983,
chapter 3). The result is reported in millimeters at the targets rather than as a multiplier.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from .._support.wording import rounded, step_list
from ..nlp.ipopt import Optimizer
from ..nlp.ipopt_options import WARM_OPTIONS
from ..nlp.outcome import Outcome
from ..nlp.window import Window
from ..planning.plan import Plan
from ..problem.motion import Bounds, allowed

RELAXATION = 0.01  # fraction by which a bound is moved; a bound of 0 moves by 0.01, or 0.01 rad
GAP_CHANGE = 1e-3
"""By how much a clearance is reduced, in m."""
SHARP = WARM_OPTIONS | {"tol": 1e-9, "compl_inf_tol": 1e-13}
"""Ends with a barrier low enough for the multipliers to show which bounds are active."""
TINY = np.finfo(float).tiny
OBJECTIVE_RTOL = 1e-3
"""Largest relative difference between the objectives of a plan and its re-solve."""
SMALLEST_EFFECT = 1e-6 / 1.75  # of a bound, in trunk lengths; smaller effects are left out
MAX_EFFECTS = 6  # sentences
REGULARIZATION = 1e-10
"""Softens the active rows, so that duplicate bounds do not make the system singular."""


@dataclass(frozen=True)
class Response:
    """First-order effect of moving one bound outward by 1 % of its value (or from 0 by 0.01).

    Attributes
    ----------
    name : str
        Such as "contraction of R3-vr", "extension of segment 1" or "clearance of the log".
    steps : tuple of int
        Time steps, from 1, at which it is active; it is moved at these.
    value, moved : float
        The bound (the widest, if phases differ) and by how much it is moved; degrees for angles,
        mm for clearances, which are reduced by 1 mm.
    worst, mean : float
        Change in m of the worst and of the mean distance to a target over the windows of these
        steps; negative brings the trunk closer.
    objective : float
        Relative change of the planner's objective; never positive, except for round-off.
    """

    name: str
    steps: tuple[int, ...]
    value: float
    moved: float
    worst: float
    mean: float
    objective: float


def responses(plan: Plan) -> tuple[Response, ...]:
    """Response of a converged plan to each of its active bounds, the strongest first.

    A horizon responds as a whole; in a sequential plan each step responds alone, with the earlier
    steps fixed. Empty for a receding horizon, whose windows extend beyond the steps they keep, and
    if the plan is not a unique optimum: with weights of 0 on effort and rate, nothing determines
    how the muscles share a change.
    """
    if not plan.converged or plan.mode == "receding" or len(plan.x) < len(plan.motion.steps):
        return ()
    optimizer = Optimizer(ipopt=SHARP)
    effects_of_bounds: list[Response] = []
    for window, first, last in _windows(plan):
        start = window.pack(plan.x[first:last], plan.part(first, last))
        outcome = optimizer.solve(window, start, "sensitivity", "multipliers")
        planned = optimizer.evaluate(window, start).objective
        same_optimum = abs(outcome.objective - planned) <= OBJECTIVE_RTOL * abs(planned)
        if outcome.converged and same_optimum:
            effects_of_bounds += _responses(window, outcome, optimizer)
    return tuple(sorted(effects_of_bounds, key=lambda response: response.objective))


def _windows(plan: Plan) -> Iterator[tuple[Window, int, int]]:
    """The NLPs that a plan solves, with their first and last steps."""
    motion, count = plan.motion, len(plan.x)
    if plan.mode == "horizon":
        yield (
            Window(motion, plan.mesh, motion.steps, motion.start, {}, 0, plan.weights, plan.gaps),
            0,
            count,
        )
        return
    unbounded = Bounds(motion.start - np.inf, motion.start + np.inf)
    held = {d: plan.shape.directors(np.array([d.Z]))[d.step, 0, d.director] for d in motion.held}
    for t, step in enumerate(motion.steps):
        if t in plan.auxiliary and step.follows:
            step = replace(step, box=allowed(motion, step, plan.auxiliary[t]), change=unbounded)
        previous = plan.x[t - 1] if t else motion.start
        known = {d: value for d, value in held.items() if d.step < t}
        yield (
            Window(motion, plan.mesh, [step], previous, known, t, plan.weights, plan.gaps),
            t,
            t + 1,
        )


@dataclass
class _Move:
    """A bound to be moved outward where it is active.

    `places` are unknowns, or constraints if `in_rows`; `shifts` are added to their bounds, in the
    NLP's units; `scale` converts these to the unit of `value`.
    """

    name: str
    value: float
    scale: float
    in_rows: bool = False
    steps: list[int] = field(default_factory=list)
    places: list[int] = field(default_factory=list)
    shifts: list[float] = field(default_factory=list)


def _responses(window: Window, outcome: Outcome, optimizer: Optimizer) -> list[Response]:
    """Responses of one window at its optimum."""
    point = optimizer.derivatives(window, outcome)
    x, bounds = outcome.full, window.bounds
    fixed = bounds["lbx"] == bounds["ubx"]  # Ipopt has no multipliers for these
    pull = -(point.gradient + point.jacobian.T @ point.lam_g)
    # Multipliers relative to the objective, since effort alone may make them very small.
    lam_x = np.where(fixed, pull, point.lam_x) / max(outcome.objective, TINY)
    lam_g = point.lam_g / max(outcome.objective, TINY)
    at_x = _active(x, bounds["lbx"], bounds["ubx"], lam_x)
    at_g = _active(point.g, bounds["lbg"], bounds["ubg"], lam_g)
    moves = _moves(window, at_x, at_g)
    if not moves:
        return []
    dx, dg = np.zeros((x.size, len(moves))), np.zeros((point.g.size, len(moves)))
    for k, move in enumerate(moves):
        (dg if move.in_rows else dx)[move.places, k] = move.shifts
    fixed, free, rows = np.flatnonzero(at_x), np.flatnonzero(at_x == 0), np.flatnonzero(at_g)
    H, J = point.hessian[free], point.jacobian[rows]
    # Duplicate bounds would make the system singular.
    softening = -REGULARIZATION * sp.identity(rows.size)
    system = sp.bmat([[H[:, free], J[:, free].T], [J[:, free], softening]], format="csc")
    right = np.vstack([-H[:, fixed] @ dx[fixed], dg[rows] - J[:, fixed] @ dx[fixed]])
    try:
        dx[free] = splu(system).solve(right)[: free.size]
    except RuntimeError:  # exactly singular
        return []
    if not np.all(np.isfinite(dx)):
        return []
    error, slope = window.target_errors(x)
    change = slope @ dx
    worst = change[np.argmax(error)] if error.size else np.zeros(len(moves))
    mean = change.mean(axis=0) if error.size else np.zeros(len(moves))
    relative = point.gradient @ dx / max(outcome.objective, TINY)
    return [
        Response(
            move.name,
            tuple(move.steps),
            move.value,
            move.scale * max(move.shifts, key=abs),
            *(float(figures[k]) for figures in (worst, mean, relative)),
        )
        for k, move in enumerate(moves)
    ]


def _active(x: np.ndarray, lower: np.ndarray, upper: np.ndarray, lam: np.ndarray) -> np.ndarray:
    """-1 where the lower bound is active, +1 the upper, 0 neither; equations are active.

    An interior-point optimum has multiplier > distance at an active bound and the reverse at an
    inactive one, both made dimensionless by the range.
    """
    side, room = np.where(lam > 0, 1, -1), upper - lower
    room = np.where(np.isfinite(room), room, 1.0)
    binds = np.abs(lam) * room**2 > np.where(lam > 0, upper - x, x - lower)
    return np.where(binds | (lower == upper), side, 0)


def _moves(window: Window, at_x: np.ndarray, at_g: np.ndarray) -> list[_Move]:
    """Every bound of the problem that is active somewhere in a window."""
    motion = window.motion
    names, count = (*motion.trunk.muscles, "head psi_Z", "head psi_Y"), len(motion.trunk.muscles)
    scales = [1.0] * count + [float(np.degrees(1.0))] * 2
    moves: dict[tuple[str, int], _Move] = {}

    def add(
        name: str, side: int, step: int, place: int, bound: float, scale: float, in_rows: bool
    ) -> None:
        move = moves.setdefault((name, side), _Move(name, scale * bound, scale, in_rows))
        move.value = side * max(side * move.value, side * scale * bound)
        move.steps.append(step + 1)
        move.places.append(place)
        move.shifts.append(side * RELAXATION * (abs(bound) or 1.0))

    for step, u in enumerate(window.unknowns, window.offset):
        boxes = (window.steps[step - window.offset].box, motion.steps[step].box, motion.box)
        for i in np.flatnonzero(at_x[u.x]).tolist():
            side = int(at_x[u.x[i]])
            bound, *stated = (float((box.lower if side < 0 else box.upper)[i]) for box in boxes)
            near = "" if bound in stated else ", held near its unloaded value"
            if (
                i >= count
                and motion.trunk.head.pivot_radius == 0
                and motion.box.lower[i] == motion.box.upper[i]
            ):
                continue  # a clamped base has no head to move it
            if i >= count:
                name = f"{names[i]}{near}"
            elif side > 0 and bound == 0:
                continue  # muscles cannot push, so this bound is not a choice
            else:
                word = "contraction" if bound <= 0 else "stretch"
                name = f"{word} of {names[i]}{near}"
            add(name, side, step, int(u.x[i]), bound, scales[i], False)
        for segment, place in enumerate(u.strain[:, 0].tolist()):
            if at_x[place]:
                side = int(at_x[place])
                bound = motion.extension[side > 0]
                add(f"extension of segment {segment + 1}", side, step, place, bound, 1.0, False)
    for block in window.blocks:
        if block.controls is None:
            continue
        change = window.steps[block.step - window.offset].change
        for component, row in enumerate((block.rows - 1).tolist()):
            i, side = block.component(component), int(at_g[row])
            if side:
                bound = float((change.lower if side < 0 else change.upper)[i])
                add(f"change of {names[i]}", side, block.step, row, bound, scales[i], True)
    return [*moves.values(), *_gap_moves(window, at_g)]


def _gap_moves(window: Window, at_g: np.ndarray) -> list[_Move]:
    """Gaps that are as small as allowed, body by body, each to be made smaller."""
    L = window.length
    moves: dict[str, _Move] = {}
    for gap, step, row in window.gap_rows:
        if at_g[row - 1]:
            name = (
                f"clearance of {gap.body}" if gap.solid is None else f"clearance of the {gap.body}"
            )
            least = gap.solid.clearance if gap.solid is not None else 0.0
            move = moves.setdefault(name, _Move(name, 1e3 * least, 1e3 * L, in_rows=True))
            move.steps += [step + 1] if step + 1 not in move.steps else []
            move.places.append(row - 1)
            move.shifts.append(-GAP_CHANGE / L)
    return [*moves.values()]


def effects(responses: tuple[Response, ...], length: float, most: int = MAX_EFFECTS) -> list[str]:
    """Effect of relaxing the strongest bounds a little, one sentence for each bound.

    Effects that are negligible compared with the trunk's length, in m, are left out.
    """
    sentences: dict[str, str] = {}
    for response in responses:
        if response.name in sentences or abs(response.worst) < SMALLEST_EFFECT * length:
            continue
        unit = " deg" if "psi" in response.name else " mm" if "clearance" in response.name else ""
        sentences[response.name] = (
            f"{response.name} ({step_list(response.steps)}), {response.value + 0.0:.4g}{unit} "
            f"moved by {response.moved:+.2g}{unit}: the worst point comes {_way(response.worst)}, "
            f"the mean distance {_way(response.mean)}"
        )
    return [*sentences.values()][:most]


def _way(change: float) -> str:
    return f"{rounded(1e3 * abs(change))} mm {'closer' if change < 0 else 'farther'}"

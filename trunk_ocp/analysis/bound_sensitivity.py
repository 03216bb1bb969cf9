"""What relaxing a bound by 1 % would do to a plan: first-order sensitivity of its optimum.

At an optimum the active bounds and the multipliers determine how all unknowns follow a small
change of one bound: the linear system of the Karush-Kuhn-Tucker conditions with the active set
kept (Fiacco, Introduction to Sensitivity and Stability Analysis in Nonlinear Programming, 1983,
chapter 3). The answer is told in millimeters at the targets rather than as a multiplier.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from ..nlp.ipopt import Optimizer
from ..nlp.ipopt_options import WARM_OPTIONS
from ..nlp.outcome import Outcome
from ..nlp.window import Window
from ..planning.plan import Plan
from ..problem.motion import Bounds, allowed

PART = 0.01  # by which a bound is moved: 1 %; one of 0 by 0.01, or 0.01 rad
SHARP = WARM_OPTIONS | {"tol": 1e-9, "compl_inf_tol": 1e-13}
"""Ends with a barrier so low that multipliers tell which bounds bind."""
TINY = np.finfo(float).tiny
SAME = 1e-3
"""Largest difference, relative, of the objectives of a plan and its re-solve."""
REGULAR = 1e-10
"""Share of a bound that is left out where several say the same."""


@dataclass(frozen=True)
class Response:
    """What moving one bound outwards by 1 % of its value (or from 0 by 0.01) would do.

    To first order.

    Attributes
    ----------
    name : str
        Such as "contraction of R3-vr" or "extension of segment 1".
    steps : tuple of int
        Time steps, from 1, at which it binds; it is moved at these.
    value, moved : float
        The bound (the widest, if phases differ) and by how much it is moved; degrees for angles.
    worst, mean : float
        Change in m of the worst and of the mean distance to a target over these steps' windows;
        negative brings the trunk closer.
    objective : float
        Change of the planner's objective, as a fraction of it; never positive but for round-off.
    """

    name: str
    steps: tuple[int, ...]
    value: float
    moved: float
    worst: float
    mean: float
    objective: float


def responses(plan: Plan) -> tuple[Response, ...]:
    """Response of a converged plan to each bound that it pushes against, the strongest first.

    A horizon answers as a whole; of a sequential plan each step answers for itself, the earlier
    ones held. Empty for a receding horizon, whose windows reach beyond the steps it keeps, and if
    the plan is not an optimum to begin with, or one among many: with weights of 0 on effort and
    rate nothing says how the muscles would share a change.
    """
    if not plan.converged or plan.mode == "receding" or len(plan.x) < len(plan.motion.steps):
        return ()
    optimizer = Optimizer(ipopt=SHARP)
    found: list[Response] = []
    for window, first, last in _windows(plan):
        start = window.pack(plan.x[first:last], plan.part(first, last))
        outcome = optimizer.solve(window, start, "sensitivity", "multipliers")
        given = optimizer.evaluate(window, start).objective
        same = abs(outcome.objective - given) <= SAME * abs(given)
        if outcome.converged and same:
            found += _responses(window, outcome, optimizer)
    return tuple(sorted(found, key=lambda response: response.objective))


def _windows(plan: Plan) -> Iterator[tuple[Window, int, int]]:
    """The NLPs whose optimum a plan is, with their first and last steps."""
    motion, count = plan.motion, len(plan.x)
    nothing = np.zeros(plan.x.shape[1])
    if plan.mode == "horizon":
        yield Window(motion, plan.mesh, motion.steps, nothing, {}, 0, plan.weights), 0, count
        return
    anything = Bounds(nothing - np.inf, nothing + np.inf)
    held = {d: plan.shape.directors(np.array([d.Z]))[d.step, 0, d.director] for d in motion.held}
    for t, step in enumerate(motion.steps):
        if t in plan.auxiliary and step.follows:
            step = replace(step, box=allowed(motion, step, plan.auxiliary[t]), change=anything)
        before = plan.x[t - 1] if t else nothing
        known = {d: value for d, value in held.items() if d.step < t}
        yield Window(motion, plan.mesh, [step], before, known, t, plan.weights), t, t + 1


@dataclass
class _Move:
    """A bound to be moved outwards where it binds.

    `places` are unknowns, or constraints if `in_rows`, `shifts` what is added to their bounds in
    the NLP's units, `scale` leads from these to the unit of `value`.
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
    fixed = bounds["lbx"] == bounds["ubx"]  # of these Ipopt has no multiplier
    pull = -(point.gradient + point.jacobian.T @ point.lam_g)
    # Multipliers as shares of the objective, since effort alone may make them very small.
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
    # Bounds that say the same twice would make the system singular.
    spare = -REGULAR * sp.identity(rows.size)
    system = sp.bmat([[H[:, free], J[:, free].T], [J[:, free], spare]], format="csc")
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
    """-1 where the lower bound binds, +1 the upper, 0 where none; equations bind.

    At an interior point's optimum the multiplier of a bound that binds is larger than the
    distance to it, and the smaller of the two otherwise; both without a unit, by the range.
    """
    side, room = np.where(lam > 0, 1, -1), upper - lower
    room = np.where(np.isfinite(room), room, 1.0)
    binds = np.abs(lam) * room**2 > np.where(lam > 0, upper - x, x - lower)
    return np.where(binds | (lower == upper), side, 0)


def _moves(window: Window, at_x: np.ndarray, at_g: np.ndarray) -> list[_Move]:
    """Every bound of the problem that binds somewhere in a window."""
    motion = window.motion
    names = motion.trunk.muscles
    count, degree = len(names), float(np.degrees(1.0))
    found: dict[tuple[str, int], _Move] = {}

    def add(
        name: str, side: int, step: int, place: int, bound: float, scale: float, in_rows: bool
    ) -> None:
        move = found.setdefault((name, side), _Move(name, scale * bound, scale, in_rows))
        move.value = side * max(side * move.value, side * scale * bound)
        move.steps.append(step + 1)
        move.places.append(place)
        move.shifts.append(side * PART * (abs(bound) or 1.0))

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
                continue  # a base that is clamped has no head to move it
            if i >= count:
                name, scale = f"head psi_{'ZY'[i - count]}{near}", degree
            elif side > 0 and bound == 0:
                continue  # a muscle cannot push; that bound is no choice
            else:
                word = "contraction" if bound <= 0 else "stretch"
                name, scale = f"{word} of {names[i]}{near}", 1.0
            add(name, side, step, int(u.x[i]), bound, scale, False)
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
                name = names[i] if i < count else f"head psi_{'ZY'[i - count]}"
                bound = float((change.lower if side < 0 else change.upper)[i])
                scale = 1.0 if i < count else degree
                add(f"change of {name}", side, block.step, row, bound, scale, True)
    return [*found.values()]

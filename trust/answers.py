"""Is a plan called solved solved? Judged by the text of the problem file and a second rod code.

Targets, loads and bounds are worked out again from the tables of the file, and every rod is solved
again as a two-point problem by `trust.judge`. Of the package only the trunk's data and the planned
unknowns are used, and the planned shapes as first guesses.
"""

from __future__ import annotations

import fnmatch
import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from trunk_ocp.model.anatomy import Trunk
from trunk_ocp.model.loads import Loads, vector
from trunk_ocp.planning.plan import Plan
from trunk_ocp.rod.statics import solve_statics
from trust import reference
from trust.judge import Judge

Table = dict[str, Any]
NEAR = 1.1e-4 / 1.75
"""Of the trunk's length: a tenth above what the package's own check lets pass, at other points."""
EXACT = 1e-5
"""Of the trunk's length, and of a director: by which two solvers may differ at a target."""
SLACK = 2e-6
"""By which a bound may be exceeded."""


def wrongs(problem: Table, plan: Plan) -> list[str]:
    """What does not hold of a plan that claims to be solved, a sentence each."""
    trunk = plan.motion.trunk
    found: list[str] = []
    bounds = Bounds(problem, trunk)
    origins = {"base": np.zeros(3), "passive-tip": _passive_tip(problem, trunk)}
    tolerance = problem.get("tolerance", {})
    near = tolerance.get("position", 0.02), tolerance.get("direction", 0.05)
    Z = np.unique([0.0, trunk.length, *_points(problem, trunk)])
    frames: list[np.ndarray] = []
    before = _start(problem, trunk)
    steps = list(_steps(problem))
    if len(steps) != len(plan.x):
        return [f"{len(plan.x)} of {len(steps)} steps are planned"]
    for t, (phase, i) in enumerate(steps):
        x, where = plan.x[t], f"step {t + 1}"
        judge = Judge(trunk, x[:-2], x[-2:], _loads(problem, phase, i, trunk, frames, Z))
        rod = judge.solve(plan.shape[t], Z)
        if rod is None:
            return [*found, f"{where}: not in equilibrium, and the judge finds none nearby"]
        off = judge.difference(rod, plan.shape[t])
        if not off <= NEAR:
            found.append(f"{where}: not in equilibrium, off by {off * trunk.length:.3g} m")
        at = [rod.at(Z_p) for Z_p in Z]
        frames.append(np.array([directors for _, directors in at]))
        for Z_p, position, directions in _targets(phase, i, trunk, origins, frames, Z):
            r, d = rod.at(Z_p)
            if position is not None:
                distance = _distance(r, position)
                if not distance <= near[0] + EXACT * trunk.length:
                    found.append(f"{where}: {distance:.6g} m from its target")
            for j, goal in directions:
                if not _distance(d[j], goal) <= near[1] + EXACT:
                    found.append(f"{where}: d{j + 1} is off by {_distance(d[j], goal):.6g}")
        found += [f"{where}: {text}" for text in bounds.wrongs(phase, i, x, before, plan.mode)]
        before = x
    return found


def _start(problem: Table, trunk: Trunk) -> np.ndarray:
    """Activations and head angles, in rad, before the first step."""
    start, x = problem.get("start", {}), np.zeros(len(trunk.muscles) + 2)
    for pattern, value in start.get("activation", {}).items():
        x[[fnmatch.fnmatchcase(name, pattern) for name in (*trunk.muscles, "", "")]] = value
    x[-2:] = np.radians([start.get("head_z_deg", 0.0), start.get("head_y_deg", 0.0)])
    return x


def _distance(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.linalg.norm(a - b))


def _steps(problem: Table) -> Iterator[tuple[Table, int]]:
    """Each time step as its phase and its number there, from 1."""
    for phase in problem["phases"]:
        for i in range(1, phase.get("steps", 1) + 1):
            yield phase, i


def _points(problem: Table, trunk: Trunk) -> Iterator[float]:
    """Every Z at which some target asks for something."""
    for phase in problem["phases"]:
        yield from (target["Z"] for target in phase.get("targets", []))
        if "wrap" in phase:
            first, last = phase["wrap"]["Z"]
            yield from np.linspace(first, last, phase["wrap"].get("points", 6))


def _passive_tip(problem: Table, trunk: Trunk) -> np.ndarray:
    """Where the tip of the passive trunk hangs."""
    load = Loads(problem.get("gravity", 9.8))
    if '"passive-tip"' not in repr(problem).replace("'", '"'):
        return np.zeros(3)
    rest = np.zeros(len(trunk.muscles))
    shape = solve_statics(trunk, rest, loads=load)
    rod = Judge(trunk, rest, np.zeros(2), load).solve(shape)
    return np.full(3, np.nan) if rod is None else rod.position[-1]


def _bezier(points: list[list[float]], t: float) -> np.ndarray:
    """By Bernstein polynomials; the package uses de Casteljau's scheme."""
    n = len(points) - 1
    weights = [math.comb(n, k) * t**k * (1 - t) ** (n - k) for k in range(n + 1)]
    return np.array(weights) @ np.array(points, dtype=float)


def _targets(
    phase: Table,
    i: int,
    trunk: Trunk,
    origins: dict[str, np.ndarray],
    frames: list[np.ndarray],
    Z: np.ndarray,
) -> Iterator[tuple[float, np.ndarray | None, list[tuple[int, np.ndarray]]]]:
    """What counts at step i of a phase: Z, position, and (director, direction)."""
    t = i / phase.get("steps", 1)
    for spec in phase.get("targets", []):
        position = None
        if "path" in spec:
            position = _bezier(spec["path"], t)
        elif "position" in spec:
            position = np.array(spec["position"], dtype=float)
        if position is not None:
            position = position + origins[spec.get("origin", "base")]
        directions = []
        for j in range(3):
            wanted = spec.get(f"d{j + 1}")
            if wanted is None or spec.get(f"d{j + 1}_weight", 1.0) == 0:
                continue
            if isinstance(wanted, dict):
                at = int(np.searchsorted(Z, spec["Z"]))
                directions.append((j, frames[wanted["held_from_step"] - 1][at, j]))
            else:
                directions.append((j, np.array(wanted) / math.hypot(*wanted)))
        counts = spec.get("position_weight", 1.0) > 0
        yield spec["Z"], position if counts else None, directions
    if "wrap" in phase:
        yield from _wrap(phase["wrap"], t, trunk, origins)


def _wrap(
    spec: Table, t: float, trunk: Trunk, origins: dict[str, np.ndarray]
) -> Iterator[tuple[float, np.ndarray | None, list[tuple[int, np.ndarray]]]]:
    """Points of an arc and its chords, the last of which goes on by one more angle."""
    center = _bezier(spec["path"], t) if "path" in spec else np.array(spec["center"])
    center = center + origins[spec.get("origin", "base")]
    count, (first, last) = spec.get("points", 6), np.radians(spec["angles_deg"])
    Z = np.linspace(spec["Z"][0], spec["Z"][1], count)

    def point(p: int) -> np.ndarray:
        angle = first + (last - first) * p / (count - 1)
        radius = trunk.base_radius - Z[min(p, count - 1)] * trunk.tan_taper + spec["log_radius"]
        return center + radius * np.array([math.sin(angle), 0.0, math.cos(angle)])

    for p in range(count):
        chord = point(p + 1) - point(p)
        yield (
            float(Z[p]),
            point(p) if spec["position_weights"][p] > 0 else None,
            [(2, chord / np.linalg.norm(chord))] if spec["d3_weights"][p] > 0 else [],
        )


def _loads(
    problem: Table, phase: Table, i: int, trunk: Trunk, frames: list[np.ndarray], Z: np.ndarray
) -> Loads:
    """Loads of step i of a phase, a pull along what earlier frames say."""
    g, spec = problem.get("gravity", 9.8), phase.get("loads", {})
    tip = np.array(spec.get("tip_force", [0.0] * 3))
    tip = tip + np.array([0.0, 0.0, spec.get("tip_mass", 0.0) * g])
    if "pull" in spec:
        pull = spec["pull"]
        share = i / phase.get("steps", 1) if pull.get("ramp", True) else 1.0
        at, j = int(np.searchsorted(Z, trunk.length)), int(pull.get("along", "d3")[1]) - 1
        tip = tip + share * pull["force"] * frames[pull["held_from_step"] - 1][at, j]
    start, force, couple = spec.get("contact_from"), [0.0] * 3, [0.0] * 3
    force, couple = spec.get("contact_force", force), spec.get("contact_couple", couple)
    if "log" in spec:
        log = spec["log"]
        weight = math.pi * log["radius"] ** 2 * log["length"] * log["density"] * g
        start, force = log["contact_from"], [0.0, 0.0, weight]
        couple = [-log.get("offset", 0.0) * weight, 0.0, 0.0]
    return Loads(g, vector(tip), start, vector(np.array(force)), vector(np.array(couple)))


class Bounds:
    """All bounds, as the file words them."""

    def __init__(self, problem: Table, trunk: Trunk) -> None:
        self.trunk, self.whole = trunk, problem["bounds"]
        self.extension = self.whole["extension"]

    def wrongs(
        self, phase: Table, i: int, x: np.ndarray, before: np.ndarray, mode: str
    ) -> Iterator[str]:
        """Bounds that the unknowns of step i of a phase exceed."""
        zeta = reference.strains(self.trunk, x[None, :-2])[0, :, 0]
        if np.any(zeta < self.extension[0] - SLACK) or np.any(zeta > self.extension[1] + SLACK):
            yield f"extension {zeta}"
        # Beside an auxiliary solution the motion's own bounds hold (appendix B).
        loose = mode == "sequential" and bool(phase.get("auxiliary"))
        for limits in (self.whole, *([] if loose else [phase.get("bounds", {})])):
            low, high = self._box(limits)
            if np.any(x < low - SLACK) or np.any(x > high + SLACK):
                yield f"bounds by {np.maximum(low - x, x - high).max():.3g}"
        if not loose:
            low, high = self._change(phase, i)
            if np.any(x - before < low - SLACK) or np.any(x - before > high + SLACK):
                yield f"change by {np.maximum(low - x + before, x - before - high).max():.3g}"

    def _box(self, limits: Table) -> tuple[np.ndarray, np.ndarray]:
        names = self.trunk.muscles
        low, high = np.full(len(names) + 2, -np.inf), np.full(len(names) + 2, np.inf)
        low[-2:], high[-2:] = -math.pi / 2, math.pi / 2
        if "activation" in limits:
            low[:-2], high[:-2] = limits["activation"]
        for pattern, pair in limits.get("muscles", {}).items():
            for k, name in enumerate(names):
                if fnmatch.fnmatchcase(name, pattern):
                    low[k], high[k] = pair
        for k, key in ((-2, "head_z_deg"), (-1, "head_y_deg")):
            if key in limits:
                low[k], high[k] = np.radians(limits[key])
        return low, high

    def _change(self, phase: Table, i: int) -> tuple[np.ndarray, np.ndarray]:
        count = len(self.trunk.muscles) + 2
        low, high = np.full(count, -np.inf), np.full(count, np.inf)
        for spec in phase.get("change", []):
            first, last = spec.get("steps", [1, phase.get("steps", 1)])
            if not first <= i <= last:
                continue
            if "activation" in spec:
                low[:-2], high[:-2] = -spec["activation"], spec["activation"]
            for k, key in ((-2, "head_z_deg"), (-1, "head_y_deg")):
                if key in spec:
                    low[k], high[k] = np.radians(spec[key])
        return low, high

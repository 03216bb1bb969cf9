"""Random extreme trunks and loads, with equilibria checked by an independent solver.

    python -m trust.equilibria --count 500 --seed 1 --json FILE

Trunks of 10 mm to 10 m, from cylinders to near cones, soft and stiff, are bent by muscles and by
thrusts and pulls far above their buckling loads. Each shape that statics finds and each plan is
judged by scipy's `solve_bvp`, on equations written out once more: in quaternions, with curvature
in place of moment, all segments stacked on one interval.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
import warnings
from collections import Counter
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from scipy.integrate import solve_bvp

from trunk_ocp.errors import InputError, StaticsError
from trunk_ocp.model.anatomy import AnatomySpec, Trunk, build_trunk
from trunk_ocp.model.loads import Loads, Vector, vector
from trunk_ocp.planning.plan import Plan, Status
from trunk_ocp.planning.planner import plan_motion
from trunk_ocp.planning.state import Options
from trunk_ocp.problem.motion import build_motion
from trunk_ocp.problem.problem_file import ProblemSpec
from trunk_ocp.rod.statics import Shape, solve_statics
from trust import reference
from trust.trial import Deadline

NEAR = 1e-4
"""Of the trunk's length: twice what the package's own check lets pass."""
CERTAIN = 2e-5
"""Of the trunk's length: a plan this close to an equilibrium must pass the check."""
TOLERANCE = 1e-7
MOST_NODES = 20_000
PLANNING = 20.0  # s

Array = np.ndarray


@dataclass
class Tally:
    """Counts of trials and outcomes."""

    outcomes: Counter[str] = field(default_factory=Counter)
    judged: int = 0
    undecided: int = 0
    worst: float = 0.0
    faults: list[str] = field(default_factory=list)


class Judge:
    """One trunk under one load, as a two-point problem for `solve_bvp` on 0 <= s <= 1.

    Unknowns are q (4) and moment times L / E I(Z) (3) of each segment. What a thin tip needs is
    resolved at its own scale: s runs evenly in local radii.
    """

    def __init__(self, trunk: Trunk, activation: Array, head: Array, load: Loads) -> None:
        self.trunk, self.load = trunk, load
        self.strain = reference.strains(trunk, activation[None])[0]
        self.mean = float(self.strain[:, 0] @ np.diff(trunk.edges)) / trunk.length
        self.r0, frame = reference.base(trunk, head)
        self.frame = frame
        self.rate = trunk.tan_taper / trunk.base_radius

    def points(self, segment: int, s: Array) -> tuple[Array, Array]:
        """Z and dZ/ds of a segment at s."""
        start, end = self.trunk.edges[segment : segment + 2]
        if self.rate == 0:
            return start + s * (end - start), np.full_like(s, end - start)
        first, last = (math.log1p(-self.rate * Z) for Z in (start, end))
        f = np.exp(first + s * (last - first))
        return (1 - f) / self.rate, -(last - first) * f / self.rate

    def rates(self, segment: int, Z: Array, y: Array) -> tuple[Array, Array, Array]:
        """Derivatives by Z of the seven unknowns (7, n), dr/dZ (3, n) and zeta / zeta_hat (n,)."""
        trunk, load, L = self.trunk, self.load, self.trunk.length
        f = 1 - self.rate * Z
        radius = trunk.base_radius * f
        EA = trunk.youngs_modulus * math.pi * radius**2 / self.mean
        EI = trunk.youngs_modulus * math.pi / 4 * radius**4  # of the initial shape
        force = np.array(load.tip_force)[:, None] * np.ones_like(Z)
        force[2] += load.gravity * np.array([reference.weight_beyond(trunk, at) for at in Z])
        d = frames(y[:4])
        n = np.einsum("ijn,jn->in", d, force)
        zeta_hat, c = self.strain[segment, 0], self.strain[segment, 1:]
        stretch = 1 + n[2] / EA
        zeta = zeta_hat * stretch
        m = y[4:] * EI / L
        soft = self.mean**2 / EI * np.array([[1.0], [1.0], [1 + trunk.poisson_ratio]])
        u = c[:, None] / f + m * soft
        q0, v = y[0], y[1:4]
        spin = zeta_hat * u
        dq = np.vstack([-(v * spin).sum(axis=0), q0 * spin + np.cross(v, spin, axis=0)]) / 2
        dm = zeta_hat * np.cross(m, u, axis=0)
        dm[0] += zeta * n[1]
        dm[1] -= zeta * n[0]
        curvature = dm * L / EI + 4 * self.rate / f * y[4:]
        return np.vstack([dq, curvature]), zeta * d[2], stretch

    def solve(self, shape: Shape) -> tuple[Array, Array, float] | None:
        """Points Z, the centerline (n, 3) there and least stretch of the equilibrium near a shape.

        None if `solve_bvp` finds none.
        """
        S, EI = len(self.strain), self.trunk.youngs_modulus * math.pi / 4
        s = np.linspace(0.0, 1.0, 200)
        guess = []
        for i in range(S):
            Z, _ = self.points(i, s)
            state = shape.state(np.clip(Z, 0.0, self.trunk.length)).T
            local = EI * (self.trunk.base_radius * (1 - self.rate * Z)) ** 4
            guess.append(np.vstack([state[:4], state[4:] * self.trunk.length / local]))

        def slope(s: Array, y: Array) -> Array:
            parts = []
            for i in range(S):
                Z, per_s = self.points(i, s)
                parts.append(self.rates(i, Z, y[7 * i : 7 * i + 7])[0] * per_s)
            return np.vstack(parts)

        q0 = shape.state(np.zeros(1))[0, :4]

        def ends(left: Array, right: Array) -> Array:
            return np.concatenate([left[:4] - q0, left[7:] - right[:-7], right[-3:]])

        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = solve_bvp(slope, ends, s, np.vstack(guess), tol=TOLERANCE, max_nodes=MOST_NODES)
        if not found.success or np.abs(frames(q0[:, None])[..., 0] - self.frame).max() > 1e-9:
            return None
        return self._line(found)

    def _line(self, found: Any) -> tuple[Array, Array, float]:
        """The centerline by a Gauss rule on the intervals that `solve_bvp` chose."""
        nodes, weights = np.polynomial.legendre.leggauss(4)
        width = np.diff(found.x)[:, None]
        s = found.x[:-1, None] + width * (1 + nodes) / 2
        every_Z, every_r, least, r = [], [], math.inf, self.r0
        for i in range(len(self.strain)):
            Z, per_s = self.points(i, s.ravel())
            y = found.sol(s.ravel())[7 * i : 7 * i + 7]
            _, slope, stretch = self.rates(i, Z, y)
            steps = (slope * per_s).reshape(3, *s.shape) @ weights * width[:, 0] / 2
            line = r + np.concatenate([np.zeros((1, 3)), steps.T.cumsum(axis=0)])
            every_Z.append(self.points(i, found.x)[0])
            every_r.append(line)
            least, r = min(least, float(stretch.min())), line[-1]
        return np.concatenate(every_Z), np.concatenate(every_r), least

    def error(self, shape: Shape) -> float | None:
        """How far a shape is from the equilibrium next to it, in L; infinite if none exists.

        None if `solve_bvp` cannot tell.
        """
        found = self.solve(shape)
        if found is None:
            return None
        Z, line, least = found
        claimed = shape.position(np.clip(Z, 0.0, self.trunk.length))
        off = float(np.linalg.norm(claimed - line, axis=1).max()) / self.trunk.length
        return off if least > 0 else math.inf


def frames(q: Array) -> Array:
    """Directors (3, 3, n), d_i first, of quaternions (4, n) of any length."""
    w, v = q[0], q[1:]
    size = (q**2).sum(axis=0)
    d = []
    for e in np.eye(3):
        e = e[:, None] * np.ones_like(w)
        turned = (w**2 - (v**2).sum(axis=0)) * e + 2 * (v * e).sum(axis=0) * v
        d.append((turned + 2 * w * np.cross(v, e, axis=0)) / size)
    return np.array(d)


def anatomy(rng: np.random.Generator) -> dict[str, Any]:
    """A random anatomy, as in its file."""
    thick = float(rng.uniform(0.02, 0.12))
    tip = float(rng.choice([1.0, rng.uniform(0.05, 1.0), rng.uniform(0.01, 0.1)]))  # radius ratio
    count = int(rng.integers(1, 4))
    edges = np.concatenate([[0.0], np.sort(rng.uniform(0.2, 0.8, count - 1)), [1.0]])
    helix = float(rng.choice([0.0, rng.uniform(10, 50)]))
    muscles = [
        {
            "group": name,
            "architecture": "helical" if helix and name == "d" else "longitudinal",
            "radii_over_length": [0.4 * thick, 0.98 * thick],
            "sector": sector,
            **({"helix_deg": helix} if helix and name == "d" else {}),
        }
        for name, sector in (("d", [0.0, 1.2]), ("v", [1.9, 3.1]))
    ]
    return {
        "name": "random",
        "length": float(10 ** rng.uniform(-2, 1)),
        "base_radius_over_length": thick,
        "taper_deg": math.degrees(math.atan(thick * (1 - tip))),
        "material": {
            "youngs_modulus": float(10 ** rng.uniform(4, 7)),
            "poisson_ratio": float(rng.uniform(0, 0.5)),
            "density": float(rng.choice([0.0, rng.uniform(500, 2000)])),
        },
        "segments": [
            {"Z_over_length": [float(a), float(b)], "muscles": muscles} for a, b in pairwise(edges)
        ],
    }


def tip_force(rng: np.random.Generator, trunk: Trunk) -> Vector:
    """A tip force of 0.1 to 10 times E I / L^2 in a random direction, or a thrust or pull."""
    scale = trunk.youngs_modulus * math.pi / 4 * trunk.base_radius**4 / trunk.length**2
    ends = [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]
    direction = rng.normal(size=3) if rng.uniform() < 0.6 else np.array(ends[int(rng.integers(2))])
    tip = 1 - trunk.length * trunk.tan_taper / trunk.base_radius
    size = scale * 10 ** rng.uniform(-1, 1) * float(rng.choice([1.0, tip**2, tip**4]))
    return vector(size * direction / np.linalg.norm(direction))


def drawn(rng: np.random.Generator) -> tuple[AnatomySpec, Trunk, Array, Loads]:
    """A random trunk, its activation and loads."""
    while True:
        spec = AnatomySpec.model_validate(_frozen(anatomy(rng)))
        trunk = build_trunk(spec)
        activation = rng.uniform(-1.0, 0.0, len(trunk.muscles)) * rng.uniform(0, 1.5)
        gravity = float(rng.choice([0.0, 9.8]))
        sag = trunk.density * gravity * trunk.length / trunk.youngs_modulus
        zeta = reference.strains(trunk, activation[None])[0, :, 0]
        if sag < 2.0 and zeta.min() > 0.3:
            return spec, trunk, activation, Loads(gravity, tip_force(rng, trunk))


def _frozen(value: Any) -> Any:
    """Lists as tuples, as strict pydantic models require them."""
    if isinstance(value, list):
        return tuple(_frozen(item) for item in value)
    if isinstance(value, dict):
        return {key: _frozen(item) for key, item in value.items()}
    return value


def judge_shapes(count: int, seed: int) -> Tally:
    """Check random shapes that statics finds."""
    tally = Tally()
    for number in range(count):
        _print_progress("shapes", number, tally)
        rng = np.random.default_rng([seed, 0, number])
        _, trunk, activation, load = drawn(rng)
        try:
            shape = solve_statics(trunk, activation, loads=load)
        except StaticsError as error:
            tally.outcomes["refused: " + " ".join(str(error).split()[:4])] += 1
            continue
        tally.outcomes["found"] += 1
        off = Judge(trunk, activation, np.zeros(2), load).error(shape)
        _count(tally, off, f"shape {number}", off is not None and not off <= NEAR)
    return tally


def _print_progress(kind: str, number: int, tally: Tally) -> None:
    if number % 20 == 0:
        print(f"{number} {kind}, {tally.judged} checked, faults: {tally.faults}", flush=True)


def _count(tally: Tally, off: float | None, name: str, wrong: bool) -> None:
    tally.undecided += off is None
    tally.judged += off is not None
    if off is not None and math.isfinite(off):
        tally.worst = max(tally.worst, off) if not wrong else tally.worst
    if wrong:
        tally.faults.append(f"{name}: off by {off:.3g} L")


def problem(rng: np.random.Generator, trunk: Trunk, activation: Array, load: Loads) -> Any:
    """A problem as in its file: hold the tip where another activation puts it."""
    other = activation * rng.uniform(0.3, 1.0, activation.size)
    tip = solve_statics(trunk, other, loads=load).position(np.array([trunk.length]))[0]
    return {
        "name": "random",
        "gravity": load.gravity,
        "anatomy": "random.toml",
        "bounds": {"activation": [-2.0, 0.0], "extension": [0.3, 1.5]},
        "tolerance": {"position": 0.02 * trunk.length},
        "phases": [
            {
                "name": "hold",
                "duration": 1.0,
                "loads": {"tip_force": list(load.tip_force)},
                "targets": [{"Z": trunk.length, "position": [float(v) for v in tip]}],
            }
        ],
    }


def judge_plans(count: int, seed: int) -> Tally:
    """Check random plans: those that converged, whether or not they passed the verification."""
    tally, number = Tally(), 0
    while sum(tally.outcomes.values()) < count:
        number += 1
        _print_progress("plans", sum(tally.outcomes.values()), tally)
        rng = np.random.default_rng([seed, 1, number])
        spec, trunk, activation, load = drawn(rng)
        try:
            tables = _frozen(problem(rng, trunk, activation, load))
            motion = build_motion(ProblemSpec.model_validate(tables), spec)
        except (StaticsError, InputError):
            continue  # no such target
        plan = plan_motion(motion, 1, Options(max_iterations=300), Deadline(PLANNING), throw=False)
        tally.outcomes[plan.status.name.lower()] += 1
        if plan.status in (Status.SOLVED, Status.UNVERIFIED, Status.MISSED, Status.UNSTABLE):
            _judge_plan(plan, load, tally, f"plan {number}")
    return tally


def _judge_plan(plan: Plan, load: Loads, tally: Tally, name: str) -> None:
    judge = Judge(plan.motion.trunk, plan.activations[0], plan.head[0], load)
    off = judge.error(plan.shape[0])
    wrong = off is not None and not off <= NEAR
    if plan.status is Status.UNVERIFIED:
        wrong = off is not None and off <= CERTAIN and plan.verification.turn[0] <= CERTAIN
    _count(tally, off, f"{name}, {plan.status.name.lower()}", wrong)


def measure(shapes: int, plans: int, seed: int) -> dict[str, Any]:
    """Counts of all trials."""
    began, counts = time.perf_counter(), {}
    for name, tally in (
        ("shapes", judge_shapes(shapes, seed)),
        ("plans", judge_plans(plans, seed)),
    ):
        counts[name] = vars(tally) | {"outcomes": dict(tally.outcomes)}
    return {**counts, "seconds": round(time.perf_counter() - began, 1), "seed": seed}


def main() -> None:
    """Run the trials, print and write the counts; exit code 1 if any failed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--count", type=int, default=500, help="number of shapes; a fifth as many plans"
    )
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=Path, dest="path")
    chosen = parser.parse_args()
    counts = measure(chosen.count, chosen.count // 5, chosen.seed)
    text = json.dumps(counts, indent=1)
    print(text)
    if chosen.path:
        chosen.path.write_text(text + "\n")
    sys.exit(bool(counts["shapes"]["faults"] or counts["plans"]["faults"]))


if __name__ == "__main__":
    main()

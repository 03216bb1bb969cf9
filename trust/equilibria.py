"""Random extreme trunks and loads, with equilibria checked by an independent solver.

    python -m trust.equilibria --count 500 --seed 1 --json FILE

Trunks of 10 mm to 10 m, from cylinders to near cones, soft and stiff, are bent by muscles and by
thrusts and pulls far beyond what they would bear. Each shape that statics finds and each plan is
judged by the two-point solver of `trust.judge`.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from collections import Counter
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from trunk_ocp.errors import InputError, StaticsError
from trunk_ocp.model.anatomy import AnatomySpec, Trunk, build_trunk
from trunk_ocp.model.loads import Loads, Vector, vector
from trunk_ocp.planning.options import Options
from trunk_ocp.planning.plan import Plan
from trunk_ocp.planning.planner import plan_motion
from trunk_ocp.planning.status import Status
from trunk_ocp.problem.build import build_motion
from trunk_ocp.problem.problem_file import ProblemSpec
from trunk_ocp.rod.statics import solve_statics
from trust import reference
from trust.judge import Judge
from trust.trial import Deadline

NEAR = 1e-4
"""Of the trunk's length: twice what the package's own check lets pass."""
CERTAIN = 2e-5
"""Of the trunk's length: a plan this close to an equilibrium must pass the check."""
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

"""The fruit motion between its time steps, integrated again under the loads of the paper.

    python -m trust.between --count 50

Sections 5.2 and 6.1, written out for this motion alone: activations and head follow a raised cosine
in the first and third phase and stay in the second; the pull is T/20 of 100 N from step T + 1 until
the next; at 2.17 s it is gone, and the fruit's weight acts at once. Every instant is a two-point
problem that scipy solves on `trust.reference`. Of the package only the trunk's data and the planned
unknowns are used, and the planned moments at the base as a first guess. Exit code 1 if a shape is
off by more than 0.1 mm.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from pathlib import Path

import numpy as np

from trunk_ocp.model.loads import Loads
from trunk_ocp.planning.plan import Plan
from trunk_ocp.planning.planner import plan_motion
from trunk_ocp.problem.motion import load_motion
from trust import reference

ALLOWED = 1e-4
"""m; the tolerance, which the planner's mesh keeps."""
REACH, PULL, EAT = 1.5, 2 / 3, 2.0  # s
PULLS, FORCE, MASS, GRAVITY = 20, 100.0, 8.0, 9.8  # steps, N, kg, m/s^2
PICKED = REACH + PULL
POINTS = np.linspace(0.0, 1.75, 15)  # m
Unknowns = tuple[np.ndarray, Loads]


def prescribed(plan: Plan, t: float, after: bool = False) -> Unknowns:
    """Activations with head angles (30,), and loads, at a time in s; `after` picking at 2.17 s."""
    x = np.vstack([np.zeros(30), plan.x])
    if t < REACH:
        share = (1 - math.cos(math.pi * t / REACH)) / 2
        return share * x[1], Loads(GRAVITY)
    if t < PICKED or (t == PICKED and not after):
        step = math.floor((t - REACH) / (PULL / PULLS) + 1e-9)  # T, of the last one reached
        force = step / PULLS * FORCE * _tangent(plan)
        return x[1 + step], Loads(GRAVITY, tuple(force))
    share = (1 - math.cos(math.pi * (t - PICKED) / EAT)) / 2
    weight = (0.0, 0.0, MASS * GRAVITY)
    return (1 - share) * x[1 + PULLS] + share * x[2 + PULLS], Loads(GRAVITY, weight)


def _tangent(plan: Plan) -> np.ndarray:
    """d3 at the tip at time step 1."""
    found = _solved([(plan.x[0], Loads(GRAVITY))], plan.shape.moment(np.zeros(1))[:1, 0])
    tangent: np.ndarray = found[1][0, -1, 2]
    return tangent


def _solved(rods: list[Unknowns], guess: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Centerlines (B, n, 3) and frames of rods with free tips, from moments (B, 3) at the base.

    Newton's method on the tip's moment, by differences.
    """
    trunk = load_motion("pick-fruit").trunk
    x, loads = np.array([x for x, _ in rods]), [load for _, load in rods]

    def ends(moment: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return reference.march(
            trunk, x[:, :-2], x[:, -2:], loads, moment, POINTS, rtol=1e-9, atol=1e-9
        )

    moment, h = guess, 1e-3 * np.abs(guess).max()
    for _ in range(5):
        position, frame, along = ends(moment)
        tip = along[:, -1]
        if np.abs(tip).max() < 1e-6 * np.abs(moment).max():
            return position, frame
        columns = [(ends(moment + h * axis)[2][:, -1] - tip) / h for axis in np.eye(3)]
        moment = moment - np.linalg.solve(np.stack(columns, axis=-1), tip[..., None])[..., 0]
    raise ArithmeticError(f"no equilibrium: {np.abs(tip).max():.3g} N m are left at the tip")


def deviations(plan: Plan, instants: list[tuple[float, bool]]) -> np.ndarray:
    """Largest distance (n,) in m of sampled from integrated centerlines at (time, after)."""
    samples = [plan.sample(t, after=after) for t, after in instants]
    guess = np.array([sample.shape.moment(np.zeros(1))[0] for sample in samples])
    exact, _ = _solved([prescribed(plan, *instant) for instant in instants], guess)
    sampled = np.array([sample.shape.position(POINTS) for sample in samples])
    largest: np.ndarray = np.linalg.norm(sampled - exact, axis=-1).max(axis=-1)
    return largest


def main() -> None:
    """Compare, print and exit."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=50, help="instants of each phase")
    parser.add_argument("--json", type=Path, help="file for the counts")
    chosen = parser.parse_args()
    report = {}
    sequential = plan_motion(load_motion("pick-fruit"), lookahead=1)
    for plan in (sequential, plan_motion(sequential.motion, start=sequential)):
        for name, start, end in (
            ("reach", 0.0, REACH), ("pull", REACH, PICKED), ("eat", PICKED, PICKED + EAT),
        ):  # fmt: skip
            times = np.linspace(start, end, chosen.count).tolist()
            instants = [(t, name == "eat" and t == PICKED) for t in times]
            off = deviations(plan, instants)
            largest = float(off.max())
            wrong = [] if largest <= ALLOWED else [f"{plan.mode}, {name}: {largest:g} m"]
            report[f"{plan.mode}, {name}"] = {
                "instants": len(off), "largest_m": largest, "faults": wrong,
            }  # fmt: skip
    text = json.dumps(report, indent=1)
    print(text)
    if chosen.json:
        chosen.json.write_text(text + "\n")
    sys.exit(any(part["faults"] for part in report.values()))


if __name__ == "__main__":
    main()

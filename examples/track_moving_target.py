"""The tip of the trunk follows a target that moves, and for a while is out of reach: MPC at 20 Hz.

    python examples/track_moving_target.py                  # each plan has 30 ms
    python examples/track_moving_target.py --deadline 0.01  # less: plans are worse, but there

At every tick, the target's place is measured, and where it will be is extrapolated from the last
three places. From the current activations, a `Replanner` plans the next 0.4 s in steps of 0.05 s,
and the first step is carried out. No activation may change by more than 0.15 a step. Draws
track-moving-target.png.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import trunk_ocp as to

TIP = 1.75  # m
TICK, STEPS, END = 0.05, 8, 4.5  # s
LEAVES, RETURNS, AWAY = 0.9, 3.1, np.array([1.6, 0.4, -0.9])  # s, m: flies off, beyond reach
NEAR = 0.01  # m, a plan whose first step comes closer than that to the target reaches it


@dataclass(frozen=True, eq=False)
class Tick:
    """What happened in one tick: the target at its end, and the plan whose first step leads there.

    `seconds` is what the controller took.
    """

    end: float
    target: np.ndarray
    plan: to.Plan
    status: to.Status
    seconds: float

    @property
    def line(self) -> np.ndarray:
        """Centerline (n, 3) of the trunk."""
        return self.plan.shape[0].position(np.linspace(0, TIP, 60))

    @property
    def distance(self) -> float:
        """From the tip to the target, in mm."""
        return 1e3 * float(np.linalg.norm(self.line[-1] - self.target))

    @property
    def in_reach(self) -> bool:
        """Whether the plan is where it expects the target at once."""
        return float(self.plan.errors[0].position[0]) < NEAR


def target(t: float) -> np.ndarray:
    """Place of the target at a time in s."""
    swing = [0.10 * np.cos(2.4 * t), 0.20 * np.sin(2.4 * t), 0.08 * np.sin(4.8 * t)]
    away = np.sin(np.pi * np.clip((t - LEAVES) / (RETURNS - LEAVES), 0, 1)) ** 4
    return np.array([0.80, 0.0, 1.30]) + swing + away * AWAY


def ahead(t: float) -> list[list[float]]:
    """Bezier points of the parabola through the target's places at t and the two ticks before."""
    here, before, earlier = (target(t - n * TICK) for n in range(3))
    bend = here - 2 * before + earlier
    move = STEPS * (here - before + bend / 2)
    return [(here + part).tolist() for part in (0 * move, move / 2, move + STEPS**2 * bend / 2)]


def motion() -> to.Motion:
    """The task of one plan: the tip where the target will be, from now on."""
    phase = {
        "duration": STEPS * TICK,
        "steps": STEPS,
        "targets": [{"Z": TIP, "path": ahead(0.0), "position_weight": 10.0}],
        "change": [{"activation": 0.15, "head_z_deg": (-1.0, 1.0), "head_y_deg": (-1.0, 1.0)}],
    }
    bounds = {"head_z_deg": (-15.0, 15.0), "head_y_deg": (-15.0, 15.0)}
    return to.Motion.build("track", [phase], bounds=bounds)


def track(deadline: float, until: float = END) -> list[Tick]:
    """Run the loop."""
    plan = to.plan_motion(motion(), throw=False)  # from rest, which misses its first steps
    replan = to.Replanner(plan)
    ticks = []
    for t in TICK * np.arange(1, round(until / TICK)):
        now = plan.x[0]  # activations and head angles by now: as planned, or as measured
        began = time.perf_counter()
        moved = plan.motion.retarget(path=ahead(t))
        plan = replan(moved, throw=False, initial=now, deadline=deadline, check="later")
        seconds = time.perf_counter() - began
        ticks.append(Tick(t + TICK, target(t + TICK), plan, plan.status, seconds))
        plan.check()  # in the time that is left, or in another thread
    return ticks


def report(ticks: list[Tick]) -> str:
    """Summary in a few lines."""
    ms = 1e3 * np.array([tick.seconds for tick in ticks])
    follows = [tick for tick in ticks if tick.in_reach]
    distance = np.array([tick.distance for tick in follows])
    worst = max(ticks, key=lambda tick: tick.distance)
    statuses = Counter(tick.status.value for tick in ticks)
    faults = sum(bool(tick.plan.verification.faults) for tick in ticks)
    return "\n".join(
        [
            f"{len(ticks)} ticks of {1e3 * TICK:g} ms. A plan of {STEPS} steps takes "
            f"{np.median(ms):.0f} ms (median), {np.quantile(ms, 0.99):.0f} ms (99th percentile), "
            f"{ms.max():.0f} ms (max).",
            f"In reach: {len(follows)} ticks, the tip {np.median(distance):.2f} mm from the "
            f"target (median), {distance.max():.1f} mm (max).",
            f"Out of reach: {len(ticks) - len(follows)} ticks, the target up to "
            f"{worst.distance:.0f} mm away, at {worst.end:.2f} s.",
            "Plans: " + "; ".join(f"{n} {status}" for status, n in statuses.most_common()) + ".",
            f"Checked later: {len(ticks) - faults} keep their bounds, in equilibrium; {faults} "
            "do not.",
        ]
    )


def draw(ticks: list[Tick], path: Path) -> None:
    """Side and front view of trunk and target; distance, time per tick and activations."""
    figure = Figure(figsize=(9.0, 5.6), layout="constrained")
    panels = figure.subplot_mosaic(
        [["side", "front", name] for name in ("distance", "ms", "activation")],
        width_ratios=[1.2, 0.8, 1.4],
    )
    _views(panels["side"], panels["front"], ticks)
    times = [tick.end for tick in ticks]
    panels["distance"].semilogy(times, [max(tick.distance, 1e-2) for tick in ticks], "#0072B2")
    panels["distance"].set_ylabel("tip to target (mm)")
    panels["distance"].set_title("shaded: out of reach in one step", fontsize=9)
    panels["ms"].plot(times, [1e3 * tick.seconds for tick in ticks], ".", color="#D55E00", ms=3)
    panels["ms"].axhline(1e3 * TICK, color="0.6", linewidth=0.8)
    panels["ms"].set(ylabel="time of a plan (ms)", ylim=(0, None))
    controls = np.array([tick.plan.activations[0] for tick in ticks])
    panels["activation"].plot(times, controls, color="0.4", linewidth=0.6)
    panels["activation"].set(xlabel="time (s)", ylabel="activation", ylim=(None, 0.02))
    for name in ("distance", "ms", "activation"):
        panels[name].set_xlim(0, END)
        for tick in ticks:
            if not tick.in_reach:
                panels[name].axvspan(tick.end - TICK, tick.end, color="0.9", linewidth=0)
    for axes in panels.values():
        axes.spines[["top", "right"]].set_visible(False)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)


def _views(side: Axes, front: Axes, ticks: list[Tick]) -> None:
    shown = np.linspace(0, len(ticks) - 1, 13).astype(int)
    goal, tip = (np.array(p) for p in zip(*((t.target, t.line[-1]) for t in ticks), strict=True))
    for axes, axis, label in ((side, 0, "X (m)"), (front, 1, "Y (m)")):
        for i, number in enumerate(shown):
            line, shade = ticks[number].line, str(0.85 - 0.7 * i / (len(shown) - 1))
            axes.plot(line[:, axis], line[:, 2], color=shade, linewidth=1.2)
        axes.plot(goal[:, axis], goal[:, 2], color="#E69F00", linewidth=2, label="target")
        axes.plot(tip[:, axis], tip[:, 2], color="#0072B2", linewidth=1, label="tip")
        axes.set(xlabel=label, ylabel="Z (m)", aspect="equal")
        axes.invert_yaxis()
    side.legend(frameon=False, fontsize=8, loc="lower left")
    side.set_title("side view; darker is later", fontsize=9)
    front.set_title("front view", fontsize=9)


def main() -> None:
    """Run the loop, report and draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--deadline", type=float, default=0.03, help="of each plan, in s")
    parser.add_argument("--until", type=float, default=END, help="time in s to stop at")
    parser.add_argument("--out", type=Path, default=Path("out/track-moving-target"))
    arguments = parser.parse_args()
    ticks = track(arguments.deadline, arguments.until)
    print(report(ticks))
    picture = arguments.out / "track-moving-target.png"
    draw(ticks, picture)
    print(f"Figure: {picture}")


if __name__ == "__main__":
    main()

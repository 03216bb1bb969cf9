"""The tip of the trunk follows a swinging fruit: resolved-rate control at 100 Hz.

    python examples/follow_target.py                  # with the exported C code, through ctypes
    python examples/follow_target.py --model numpy    # with the exported NumPy module

At every tick, the controller computes the shape and its Jacobian at the current activations with
the exported model, and the small change of activations and head angles that moves the tip as
required. The simulated trunk is the same model with 1.5 kg at its tip, unknown to the controller,
which only measures the tip position. Draws follow-target.png.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
from exported import Compiled, Interpreted, export_trunk
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from scipy.interpolate import CubicHermiteSpline
from scipy.optimize import lsq_linear

POINTS = [0.0, 0.35, 0.7, 1.05, 1.4, 1.75]  # m; the last is the tip
TICK = 0.01  # s
END = 20.0  # s
REACH = 3.0  # s, to bring the tip to the fruit
GAIN = 8.0  # 1/s, rate at which a tip error decays
FRUIT = 1.5 * 9.8  # N
MAX_CONTRACTION, MAX_RATE = 0.8, 2.0  # -, 1/s
HEAD_LIMITS, HEAD_RATE = np.deg2rad([15.0, 30.0]), 0.5  # rad, rad/s
EFFORT, HEAD_EFFORT, RATE = 2e-3, 2e-2, 2e-2  # weights relative to the tip error in m
GROUPS = {"dl": "#0072B2", "ovo": "#D55E00", "ivo": "#E69F00", "dr": "#009E73", "vr": "#CC79A7"}


def fruit(t: float) -> np.ndarray:
    """Position of the fruit at a time in s: it swings from its branch along all axes."""
    swing = [0.10 * np.sin(2.1 * t), 0.25 * np.sin(1.3 * t), 0.06 * np.cos(2.6 * t)]
    return np.array([0.95, 0.0, 1.25]) + swing


def target(t: float, start: np.ndarray) -> np.ndarray:
    """Target of the tip: from its passive position to the fruit, then with the fruit."""
    s = min(t / REACH, 1.0)
    s = s**3 * (10 - 15 * s + 6 * s**2)
    return (1 - s) * start + s * fruit(t)


def change(J: np.ndarray, move: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Change of activations and head angles that moves the tip by `move` (3), within bounds.

    Least squares of the tip error, of the effort, which resolves the redundancy, and of the change.
    """
    n = x.size
    effort = np.append(np.full(n - 2, EFFORT), [HEAD_EFFORT, HEAD_EFFORT])
    rows = np.vstack([J, np.diag(effort), RATE * np.eye(n)])
    right = np.concatenate([move, -effort * x, np.zeros(n)])
    limit = np.append(np.full(n - 2, MAX_CONTRACTION), HEAD_LIMITS)
    rate = TICK * np.append(np.full(n - 2, MAX_RATE), [HEAD_RATE, HEAD_RATE])
    upper = np.append(np.zeros(n - 2), HEAD_LIMITS)  # muscles contract; they do not push
    low, high = np.maximum(-rate, -limit - x), np.minimum(rate, upper - x)
    return lsq_linear(rows, right, (low, np.maximum(high, low + 1e-12)), method="bvls").x


def follow(model, plant) -> dict[str, np.ndarray]:
    """Simulate the loop; `model` and `plant` have `shape(x)`, the model also `jacobian()`."""
    x, load = model.rest.copy(), np.zeros(model.rest.size)
    n = 30  # activations and head angles come first, then gravity and the tip force
    load[n + 1 : n + 4] = [0.0, 0.0, FRUIT]
    start = plant.shape(x + load)[-1, :3]
    log = {name: [] for name in ("time", "tip", "target", "x", "ms", "line", "extension")}
    for tick in range(round(END / TICK)):
        t = tick * TICK
        measured = plant.shape(x + load)
        began = time.perf_counter()
        model.shape(x)
        J = model.jacobian()[-1, :3, :n]
        ahead = target(t + TICK, start) - target(t, start)
        move = ahead + GAIN * TICK * (target(t, start) - measured[-1, :3])
        x[:n] += change(J, move, x[:n])
        duration = 1e3 * (time.perf_counter() - began)
        values = (
            *(t, measured[-1, :3], target(t, start), x[:n].copy(), duration),
            *(measured[:, :13], measured[:, 12]),
        )
        for name, value in zip(log, values, strict=True):
            log[name].append(value)
    return {name: np.array(values) for name, values in log.items()}


def report(log: dict[str, np.ndarray]) -> str:
    """Summary in a few lines."""
    error = 1e3 * np.linalg.norm(log["tip"] - log["target"], axis=1)
    later = error[log["time"] > REACH]
    ms = log["ms"]
    return "\n".join(
        [
            f"{len(ms)} ticks of {1e3 * TICK:g} ms. The controller takes {np.median(ms):.2f} ms "
            f"(median), {np.quantile(ms, 0.99):.2f} ms (99th percentile), {ms.max():.2f} ms (max).",
            f"Distance of tip and fruit after {REACH:g} s: {np.sqrt(np.mean(later**2)):.1f} mm "
            f"(RMS), {later.max():.1f} mm (max).",
            f"Extension of the segments: {log['extension'].min():.2f} to "
            f"{log['extension'].max():.2f}.",
        ]
    )


def draw(log: dict[str, np.ndarray], muscles: list[str], path: Path) -> None:
    """Side and front view of the trunk and its target; error and activations over time."""
    figure = Figure(figsize=(9.0, 5.4), layout="constrained")
    panels = figure.subplot_mosaic(
        [["side", "front", "error"], ["side", "front", "activation"]], width_ratios=[1.1, 0.9, 1.4]
    )
    _views(panels["side"], panels["front"], log)
    there = log["time"] >= REACH
    error = 1e3 * np.linalg.norm(log["tip"] - log["target"], axis=1)
    panels["error"].plot(log["time"][there], error[there], color="#0072B2", linewidth=1)
    panels["error"].set(ylim=(0, None), xlim=(0, END), ylabel="distance of tip and fruit (mm)")
    panels["error"].set_title(
        f"{1 / TICK:g} Hz; one tick takes {np.median(log['ms']):.2g} ms", fontsize=9
    )
    for muscle, values in zip(muscles, log["x"].T, strict=False):
        style = {"color": GROUPS[muscle[3:]], "linestyle": "-" if muscle[0] == "R" else ":"}
        panels["activation"].plot(log["time"], values, linewidth=0.8, **style)
    keys = [Line2D([], [], color=color, label=group) for group, color in GROUPS.items()]
    panels["activation"].legend(handles=keys, frameon=False, fontsize=7, ncols=5, loc="lower left")
    panels["activation"].set(xlabel="time (s)", ylabel="activation; right solid, left dotted")
    panels["activation"].set_ylim(1.2 * log["x"][:, :-2].min(), 0.01)
    for axes in panels.values():
        axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(path, dpi=110)


def _views(side: Axes, front: Axes, log: dict[str, np.ndarray]) -> None:
    shown = np.linspace(0, len(log["time"]) - 1, 9).astype(int)
    path = np.array([fruit(t) for t in log["time"]])
    for axes, axis, label in ((side, 0, "X (m)"), (front, 1, "Y (m)")):
        for i, tick in enumerate(shown):
            line, shade = _centerline(log["line"][tick]), str(0.8 - 0.65 * i / (len(shown) - 1))
            axes.plot(line[:, axis], line[:, 2], color=shade, linewidth=1.4)
        axes.plot(path[:, axis], path[:, 2], color="#E69F00", linewidth=2, label="fruit")
        tip = log["tip"]
        axes.plot(tip[:, axis], tip[:, 2], color="#0072B2", linewidth=0.8, label="tip")
        axes.set(xlabel=label, ylabel="Z (m)", aspect="equal")
        axes.invert_yaxis()
    side.legend(frameon=False, fontsize=8, loc="lower left")
    side.set_title("side view; darker is later", fontsize=9)
    front.set_title("front view", fontsize=9)


def _centerline(points: np.ndarray) -> np.ndarray:
    """Curve through the positions with slopes r' = zeta d_3."""
    slopes = points[:, 12:] * points[:, 9:12]
    return CubicHermiteSpline(POINTS, points[:, :3], slopes)(np.linspace(0, POINTS[-1], 60))


def main() -> None:
    """Export, simulate, report and draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--model", choices=["c", "numpy"], default="c")
    parser.add_argument("--out", type=Path, default=Path("out/follow-target"))
    arguments = parser.parse_args()
    folder = arguments.out / arguments.model
    export_trunk(folder, arguments.model, POINTS)
    kind = {"c": Compiled, "numpy": Interpreted}[arguments.model]
    model, plant = kind(folder), kind(folder)
    log = follow(model, plant)
    print(report(log))
    draw(log, model.muscles, arguments.out / "follow-target.png")
    print(f"Figure: {arguments.out / 'follow-target.png'}")


if __name__ == "__main__":
    main()

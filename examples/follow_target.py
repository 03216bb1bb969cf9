"""The tip of the trunk follows a swinging fruit: resolved rates, 100 times a second.

    python examples/follow_target.py                  # by the exported C, through ctypes
    python examples/follow_target.py --model numpy    # by the exported NumPy module

Every tick asks the exported map for the shape and its Jacobian at the current activations, and
takes the small change of activations and head angles that moves the tip as wanted. The trunk that
is moved is the same map with 1.5 kg in its tip, which the controller does not know of: it sees
only where the tip is. Draws follow-target.png.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
from exported import Compiled, Interpreted, make
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from scipy.interpolate import CubicHermiteSpline
from scipy.optimize import lsq_linear

POINTS = [0.0, 0.35, 0.7, 1.05, 1.4, 1.75]  # m; the last is the tip
TICK = 0.01  # s
END = 20.0  # s
REACH = 3.0  # s, in which the trunk is brought to the fruit
GAIN = 8.0  # 1/s, with which an error of the tip decays
FRUIT = 1.5 * 9.8  # N
STRONGEST, FASTEST = 0.8, 2.0  # contraction, and its change in 1/s
HEAD, TURN = np.deg2rad([15.0, 30.0]), 0.5  # head angles' bounds in rad, their rate in rad/s
EFFORT, HEAD_EFFORT, RATE = 2e-3, 2e-2, 2e-2  # weights beside the tip's error in m
GROUPS = {"dl": "#0072B2", "ovo": "#D55E00", "ivo": "#E69F00", "dr": "#009E73", "vr": "#CC79A7"}


def fruit(t: float) -> np.ndarray:
    """Where the fruit is at a time in s: it swings from its branch, along two axes."""
    swing = [0.10 * np.sin(2.1 * t), 0.25 * np.sin(1.3 * t), 0.06 * np.cos(2.6 * t)]
    return np.array([0.95, 0.0, 1.25]) + swing


def wanted(t: float, start: np.ndarray) -> np.ndarray:
    """Where the tip should be: from where it hangs to the fruit, then with it."""
    s = min(t / REACH, 1.0)
    s = s**3 * (10 - 15 * s + 6 * s**2)
    return (1 - s) * start + s * fruit(t)


def change(J: np.ndarray, move: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Change of activations and head angles that moves the tip by `move` (3), within bounds.

    Least squares: the tip's error; effort, which chooses among the many ways there; the change.
    """
    n = x.size
    effort = np.append(np.full(n - 2, EFFORT), [HEAD_EFFORT, HEAD_EFFORT])
    rows = np.vstack([J, np.diag(effort), RATE * np.eye(n)])
    right = np.concatenate([move, -effort * x, np.zeros(n)])
    limit = np.append(np.full(n - 2, STRONGEST), HEAD)
    rate = TICK * np.append(np.full(n - 2, FASTEST), [TURN, TURN])
    upper = np.append(np.zeros(n - 2), HEAD)  # muscles contract; they do not push
    low, high = np.maximum(-rate, -limit - x), np.minimum(rate, upper - x)
    return lsq_linear(rows, right, (low, np.maximum(high, low + 1e-12)), method="bvls").x


def follow(model, plant) -> dict[str, np.ndarray]:
    """Simulate; model and plant answer `shape(x)`, the model `jacobian()` too."""
    x, load = model.rest.copy(), np.zeros(model.rest.size)
    n = 30  # activations and head angles come first, then gravity and the tip force
    load[n + 1 : n + 4] = [0.0, 0.0, FRUIT]
    start = plant.shape(x + load)[-1, :3]
    log = {name: [] for name in ("time", "tip", "wanted", "x", "ms", "line", "extension")}
    for tick in range(round(END / TICK)):
        t = tick * TICK
        seen = plant.shape(x + load)
        began = time.perf_counter()
        model.shape(x)
        J = model.jacobian()[-1, :3, :n]
        ahead = wanted(t + TICK, start) - wanted(t, start)
        move = ahead + GAIN * TICK * (wanted(t, start) - seen[-1, :3])
        x[:n] += change(J, move, x[:n])
        took = 1e3 * (time.perf_counter() - began)
        values = (t, seen[-1, :3], wanted(t, start), x[:n].copy(), took, seen[:, :13], seen[:, 12])
        for name, value in zip(log, values, strict=True):
            log[name].append(value)
    return {name: np.array(values) for name, values in log.items()}


def report(log: dict[str, np.ndarray]) -> str:
    """What happened, in a few lines."""
    error = 1e3 * np.linalg.norm(log["tip"] - log["wanted"], axis=1)
    later = error[log["time"] > REACH]
    ms = log["ms"]
    return "\n".join(
        [
            f"{len(ms)} ticks of {1e3 * TICK:g} ms; the controller took {np.median(ms):.2f} ms in "
            f"the median, {np.quantile(ms, 0.99):.2f} ms in 99 of 100, {ms.max():.2f} ms at most:",
            f"{1e3 / np.quantile(ms, 0.99):.0f} Hz could be kept in 99 of 100 ticks.",
            f"Tip to fruit: {np.sqrt(np.mean(later**2)):.1f} mm in the mean square, "
            f"{later.max():.1f} mm at most, once there.",
            f"Extension of the segments: {log['extension'].min():.2f} to "
            f"{log['extension'].max():.2f}.",
        ]
    )


def draw(log: dict[str, np.ndarray], muscles: list[str], path: Path) -> None:
    """Side view and front view of the trunk and its target; error and activations over time."""
    figure = Figure(figsize=(9.0, 5.4), layout="constrained")
    panels = figure.subplot_mosaic(
        [["side", "front", "error"], ["side", "front", "activation"]], width_ratios=[1.1, 0.9, 1.4]
    )
    _views(panels["side"], panels["front"], log)
    there = log["time"] >= REACH
    error = 1e3 * np.linalg.norm(log["tip"] - log["wanted"], axis=1)
    panels["error"].plot(log["time"][there], error[there], color="#0072B2", linewidth=1)
    panels["error"].set(ylim=(0, None), xlim=(0, END), ylabel="tip to fruit (mm)")
    panels["error"].set_title(
        f"{1 / TICK:g} ticks a second; one takes {np.median(log['ms']):.2g} ms", fontsize=9
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
    target = np.array([fruit(t) for t in log["time"]])
    for axes, axis, label in ((side, 0, "X (m)"), (front, 1, "Y (m)")):
        for i, tick in enumerate(shown):
            line, shade = _centerline(log["line"][tick]), str(0.8 - 0.65 * i / (len(shown) - 1))
            axes.plot(line[:, axis], line[:, 2], color=shade, linewidth=1.4)
        axes.plot(target[:, axis], target[:, 2], color="#E69F00", linewidth=2, label="fruit")
        tip = log["tip"]
        axes.plot(tip[:, axis], tip[:, 2], color="#0072B2", linewidth=0.8, label="tip")
        axes.set(xlabel=label, ylabel="Z (m)", aspect="equal")
        axes.invert_yaxis()
    side.legend(frameon=False, fontsize=8, loc="lower left")
    side.set_title("from the side; darker is later", fontsize=9)
    front.set_title("from the front", fontsize=9)


def _centerline(points: np.ndarray) -> np.ndarray:
    """Curve through positions with slopes r' = zeta d_3, as the shape tells them."""
    slopes = points[:, 12:] * points[:, 9:12]
    return CubicHermiteSpline(POINTS, points[:, :3], slopes)(np.linspace(0, POINTS[-1], 60))


def main() -> None:
    """Export, follow, tell, draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--model", choices=["c", "numpy"], default="c")
    parser.add_argument("--out", type=Path, default=Path("out/follow-target"))
    arguments = parser.parse_args()
    folder = arguments.out / arguments.model
    make(folder, arguments.model, POINTS)
    kind = {"c": Compiled, "numpy": Interpreted}[arguments.model]
    model, plant = kind(folder), kind(folder)
    log = follow(model, plant)
    print(report(log))
    draw(log, model.muscles, arguments.out / "follow-target.png")
    print(f"Figure: {arguments.out / 'follow-target.png'}")


if __name__ == "__main__":
    main()

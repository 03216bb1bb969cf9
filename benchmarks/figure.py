"""Figure of the paper's J vs. time for all methods and motions."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
from matplotlib.ticker import NullFormatter

from .jobs import BUDGETS, MOTIONS

CURVES = {
    "sbplx": ("Sbplx, step by step", "tab:brown"),
    "nomad": ("NOMAD, step by step", "tab:gray"),
}
POINTS = {
    "sequential": ("ours, step by step", "tab:blue", "s"),
    "horizon": ("ours, horizon", "tab:red", "*"),
    "expand": ("same horizon, nlpsol, expand on", "tab:green", "^"),
    "plain": ("same horizon, nlpsol, expand off", "tab:olive", "v"),
    "opti-expand": ("same horizon, Opti by hand, expand on", "tab:purple", ">"),
    "opti-plain": ("same horizon, Opti by hand, expand off", "tab:pink", "<"),
}


def draw(parts: dict[str, Any], path: Path) -> None:
    figure, axes = plt.subplots(1, len(MOTIONS), figsize=(11, 4), layout="constrained")
    shown: dict[str, Any] = {}
    for axis, motion in zip(axes, MOTIONS, strict=True):
        for method, (label, color) in CURVES.items():
            results = [parts.get(f"{method} {motion} {budget} s", {}) for budget in BUDGETS]
            runs = [run for run in results if "J" in run]
            if runs:
                axis.plot(*zip(*runs[-1]["curve"], strict=True), color=color, lw=0.6)
                ends = zip(*((run["total_seconds"], run["J"]) for run in runs), strict=True)
                axis.plot(*ends, "o-", color=color, label=label, ms=5)
        for key, (label, color, marker) in POINTS.items():
            figures = parts.get(f"{key} {motion}", {})
            if figures.get("J") is not None:
                point = ([figures["total_seconds"]], [figures["J"]])
                axis.plot(*point, marker, color=color, label=label, ms=9, mfc="none", mew=1.6)
        axis.set(
            xscale="log", yscale="log", title=motion, xlabel="seconds, including initial guess"
        )
        axis.set_xlim(0.1, 2 * BUDGETS[-1])
        axis.grid(which="major", lw=0.3)
        for ticks in (axis.xaxis, axis.yaxis):
            ticks.set_minor_formatter(NullFormatter())
        shown |= dict(zip(*reversed(axis.get_legend_handles_labels()), strict=True))
    axes[0].set_ylabel("J summed over the steps (eq. 42)")
    if shown:
        place = "outside lower center"
        figure.legend(shown.values(), shown.keys(), loc=place, ncols=3, fontsize=8)
    figure.savefig(path, dpi=90)


if __name__ == "__main__":
    source = Path(sys.argv[1])
    draw(json.loads(source.read_text())["parts"], source.with_name("benchmarks-inverse.png"))

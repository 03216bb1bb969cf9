"""Compute all data of docs/foresight.md again, then write the page.

    python -m study.run             # several minutes on two cores
    python -m study.run --quick     # few lookaheads, limits and starts; to out/study, no page
    python -m study.run --only optima

Each part is written as soon as it is finished. A failed part is named at the end, keeps its old
data, and makes the exit code 1.
"""

from __future__ import annotations

import argparse
import os
import platform
import sys
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from trunk_ocp.analysis.lookahead_study import (
    Foresight,
    compare_lookaheads,
    smoothness_tradeoff,
    survey_limits,
)
from trunk_ocp.analysis.multistart import find_optima
from trunk_ocp.analysis.redundancy.ablation import ablate_muscles
from trunk_ocp.analysis.redundancy.report import analyze_redundancy
from trunk_ocp.figures import draw_foresight, draw_front, draw_survey
from trunk_ocp.figures.redundancy import draw_redundancy
from trunk_ocp.planning.active_bounds import touching
from trunk_ocp.planning.plan import Plan
from trunk_ocp.planning.planner import plan_motion
from trunk_ocp.problem.build import load_motion

from . import data
from .page import write_page

ACTIVATIONS = {"pick-fruit": (None, 1.5, 1.2), "lift-log": (None, 2.5, 2.2)}
RATES = {"pick-fruit": (None, 0.7, 0.6), "lift-log": (None, 2.4, 2.0)}
LOOKAHEADS = {"pick-fruit": (1, 2, 3, 6, 22), "lift-log": (1, 2, 3, 5, 10)}
SMOOTHNESS = tuple(10.0 ** np.arange(-7, -0.9))
STARTS = 8
COLORS = 96


@dataclass(frozen=True)
class Size:
    """Where results go, and whether to run the short version."""

    folder: Path
    quick: bool


def limits(table: dict[str, tuple[Any, ...]], name: str) -> tuple[Any, ...]:
    """The entry of a table for a motion; both lifts share one."""
    return table.get(name, table["lift-log"])


def compared(name: str, size: Size) -> None:
    """The paper's method and every lookahead."""
    motion = load_motion(name)
    some = (1, 2, len(motion.steps)) if size.quick else None
    result = compare_lookaheads(motion, lookaheads=some)
    data.write(f"compare-{name}", result.as_dict(), size.folder)
    data.write(f"plans-{name}", plans(result), size.folder)
    named = draw_foresight(result, size.folder, ("png",))
    shrunk(named[0].replace(size.folder / f"compare-{name}.png"))


def plans(result: Foresight) -> dict[str, Any]:
    """Activations and head angles of the four plans that are compared with section 6."""
    motion = result.motion
    ways = {
        "paper": result.paper,
        "paper, same cost": result.paper_costed,
        "blind": result.curve.blind,
        "horizon": result.curve.best,
    }
    return {
        "problem": motion.name,
        "times": motion.times.tolist(),
        "phases": [motion.phases[step.phase].name for step in motion.steps],
        "muscles": [
            {"name": m.name, "group": m.group, "side": m.side, "segment": m.segment + 1}
            for m in motion.trunk.subdomains
        ],
        "ways": {way: numbers(plan) for way, plan in ways.items()},
    }


def numbers(plan: Plan) -> dict[str, Any]:
    """A plan's unknowns, and the muscles at their bound of contraction at each step."""
    names = np.array(plan.motion.trunk.muscles)
    return {
        "activations": plan.activations.tolist(),
        "head_deg": np.degrees(plan.head).tolist(),
        "J": [error.paper for error in plan.errors],
        "at_bound": [names[row].tolist() for row in touching(plan)[0][:, :-2]],
    }


def surveyed(name: str, size: Size) -> None:
    """Sufficient lookaheads under limits on strength and speed."""
    most, fastest = limits(ACTIVATIONS, name), limits(RATES, name)
    ahead = limits(LOOKAHEADS, name)
    if size.quick:
        most, fastest, ahead = most[:1], fastest[::2], ahead[::4]
    result = survey_limits(load_motion(name), most, fastest, ahead)
    data.write(f"survey-{name}", result, size.folder)
    (drawn,) = draw_survey(result, size.folder, ("png",))
    shrunk(drawn.replace(size.folder / f"survey-{name}.png"))


def swept(name: str, size: Size) -> None:
    """Tracking against smoothness."""
    result = smoothness_tradeoff(load_motion(name), SMOOTHNESS[::3] if size.quick else SMOOTHNESS)
    data.write(f"front-{name}", result, size.folder)
    (drawn,) = draw_front(result, size.folder, ("png",))
    shrunk(drawn)


def started(name: str, size: Size) -> None:
    """The same motion from many starts."""
    for mode, lookahead in (("horizon", None), ("sequential", 1)):
        result = find_optima(load_motion(name), lookahead, 1 if size.quick else STARTS)
        data.write(f"optima-{name}-{mode}", result.as_dict(), size.folder)


def redundant(name: str, size: Size) -> None:
    """The freedom of each muscle, and the cost of its absence."""
    result = analyze_redundancy(plan_motion(load_motion(name)))
    if not size.quick:
        result = replace(result, needs=ablate_muscles(result.plan))
    report = result.as_dict()
    for muscle in report["muscles"]:  # the figure shows them; 2 x 2 x 28 x 22 numbers
        del muscle["range_alone"], muscle["range_joint"]
    for unit in ("range_alone", "range_joint"):
        del report["units"][unit]
    data.write(f"redundancy-{name}", report, size.folder)
    (drawn,) = draw_redundancy(result, size.folder, ("png",))
    shrunk(drawn.replace(size.folder / f"redundancy-{name}.png"))


def shrunk(picture: Path) -> None:
    """Reduce a picture to `COLORS` colors, to keep the repository small."""
    with Image.open(picture) as image:
        few = image.convert("RGB").quantize(COLORS, dither=Image.Dither.NONE)
    few.save(picture, optimize=True)


PARTS: dict[str, Callable[[str, Size], None]] = {
    "compare": compared,
    "optima": started,
    "survey": surveyed,
    "redundancy": redundant,
    "front": swept,
}


def main() -> None:
    """Run the parts, store their times, write the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="short version: to out/study, no page")
    parser.add_argument("--only", choices=PARTS, action="append", help="one part; may be repeated")
    chosen = parser.parse_args()
    size = Size(data.ROOT / "out" / "study" if chosen.quick else data.DATA, chosen.quick)
    failed = []
    for part in chosen.only or PARTS:
        for name in data.MOTIONS:
            print(f"{part} {name} ...", flush=True)
            began = time.perf_counter()
            load = os.getloadavg()[0]
            try:
                PARTS[part](name, size)
            except Exception:
                traceback.print_exc()
                failed.append(f"{part} {name}")
                continue
            timed(f"{part} {name}", time.perf_counter() - began, load, size)
    if not chosen.quick:
        write_page()
    for what in failed:
        print(f"failed: {what}", file=sys.stderr)
    sys.exit(1 if failed else 0)


def timed(part: str, seconds: float, load: float, size: Size) -> None:
    """Store how long a part took and the load of the machine before."""
    try:
        known = data.read("times", size.folder)
    except FileNotFoundError:
        known = {"parts": {}}
    known["machine"] = {"cores": os.cpu_count(), "python": platform.python_version()}
    known["parts"][part] = {"seconds": round(seconds), "load_before": round(load, 1)}
    data.write("times", known, size.folder)
    print(f"{part}: {seconds:.0f} s", flush=True)


if __name__ == "__main__":
    main()

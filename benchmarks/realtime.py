"""Whether the planner fits in a control loop: `python -m benchmarks.realtime [--quick] [--busy]`.

Writes results/realtime.md: re-plans of 1,000 moved targets in a row under a deadline, a control
loop that also meets a target out of reach, whole plans, checks, compiled shapes and start-up. The
path that they replace is beside them: re-plans by Ipopt with the last multipliers, whose objectives
are compared. With --busy all again while another process keeps a second core busy. Needs a quiet
machine and numba.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

import trunk_ocp as to
from trunk_ocp._support.blas_threads import one_thread
from trunk_ocp.nlp.ipopt import Optimizer
from trunk_ocp.nlp.ipopt_options import WARM_OPTIONS
from trunk_ocp.planning.decided_steps import DecidedSteps
from trunk_ocp.planning.options import Options
from trunk_ocp.planning.planning_run import PlanningRun

from .common import MOTIONS, cases, fine_mesh
from .shape_map import by_steps, error, first_calls

ROOT = Path(__file__).parent.parent
IN_A_ROW = {"lift-log": 0.015, "pick-fruit": 0.03}
"""Motions of 10 and of 22 steps, and the deadline of each re-plan in s."""
LOOP_DEADLINE = 0.04
FAR = (2.0, 0.5, -0.5)
"""Target out of reach, in m."""
TIP, STEP = 1.75, 0.05
LIMIT = 1.0
"""Seconds for a solve of the loop by Ipopt, which takes hundreds of iterations beyond reach."""
SPIN = "import os\nparent = os.getppid()\nwhile os.getppid() == parent:\n    sum(range(100000))"

Planner = Callable[..., to.Plan]
Result = TypeVar("Result")
Figures = dict[str, Any]


@dataclass(frozen=True, eq=False)
class Tick:
    """One re-plan: the plan, its wall and CPU seconds, and those of its motion and its check."""

    plan: to.Plan
    seconds: tuple[float, float]
    built: tuple[float, float]
    checked: tuple[float, float]


def timed(work: Callable[[], Result]) -> tuple[Result, tuple[float, float]]:
    """What the work returns, and its wall and CPU seconds."""
    wall, cpu = time.perf_counter(), time.process_time()
    result = work()
    return result, (time.perf_counter() - wall, time.process_time() - cpu)


class IpoptReplanner:
    """The path that `Replanner` replaces: all variables, by Ipopt, with the last multipliers."""

    def __init__(self, plan: to.Plan) -> None:
        self.newest, self._multipliers = plan, None
        self._optimizer = Optimizer(ipopt=WARM_OPTIONS)
        self._run = PlanningRun(
            plan.motion, plan.mesh, "horizon", len(plan.x), Options(), self._optimizer
        )
        self._window = self._run.window(0, plan.motion.steps, DecidedSteps())
        self(plan.motion)

    @one_thread()
    def __call__(
        self, motion: to.Motion, initial: np.ndarray | None = None, deadline: float = np.inf
    ) -> to.Plan:
        """Plan from the newest plan; its check is put off."""
        motion = motion if initial is None else motion.started(initial)
        self._optimizer.deadline = time.perf_counter() + deadline
        window, newest = self._window.renumbered(motion), self.newest
        start = window.pack(newest.x, newest.shape)
        outcome = self._optimizer.solve(
            window, start, "horizon", "re-plan", self._multipliers, return_last=True
        )
        if outcome.converged:
            self._multipliers = outcome.multipliers
        decided, run = DecidedSteps(), replace(self._run, motion=motion)
        run.keep(window, outcome, len(motion.steps), decided)
        record = {"solves": (self._optimizer.solves.pop(),), "iterations": outcome.iterations}
        self.newest = replace(run.plan(decided), deferred=True, **record)
        return self.newest


# --- moved targets in a row --------------------------------------------------------------------


def path(tick: int) -> tuple[float, float, float]:
    """Offset of the targets in m: a closed curve of 1,000 ticks, up to 3.2 mm each."""
    a = 2 * np.pi * tick / 1000
    x, y, z = 0.03 * np.sin(10 * a), 0.03 * np.sin(13 * a), 0.015 * np.sin(7 * a)
    return float(x), float(y), float(z)


def in_a_row(plan: to.Plan, planner: Planner, count: int, **options: Any) -> list[Tick]:
    """Re-plans of moved targets; motions are built before each, and each is checked after it."""
    ticks = []
    for tick in range(1, count + 1):
        motion, built = timed(lambda tick=tick: plan.motion.shifted(path(tick)))
        new, seconds = timed(lambda motion=motion: planner(motion, **options))
        _, checked = timed(lambda new=new: new.check() if new.converged else new.verification)
        ticks.append(Tick(new, seconds, built, checked))
    return ticks


def against_ipopt(plan: to.Plan, ticks: list[Tick], sample: int) -> Figures:
    """Objectives of a sample over those of converged Ipopt from the same starts."""
    reference, ratios = IpoptReplanner(plan), []
    worse, silent, failed = 0, 0, 0
    before = [plan, *(tick.plan for tick in ticks)]
    for k in np.linspace(0, len(ticks) - 1, sample).astype(int):
        fast, reference.newest = ticks[k].plan, before[k]
        best = reference(fast.motion)
        if not best.converged:
            failed += 1
            continue
        ratios.append(fast.solves[-1].objective / best.solves[-1].objective)
        worse += ratios[-1] > 1.01
        silent += ratios[-1] > 1.01 and fast.check() is to.Status.SOLVED
    return {
        "sample": sample,
        "worst_ratio": max(ratios, default=np.nan),
        "median_ratio": statistics.median(ratios) if ratios else np.nan,
        "worse": worse,
        "silent": silent,
        "reference_failed": failed,
    }


def row_figures(ticks: list[Tick], deadline: float | None = None) -> Figures:
    """Times in ms, endings, and the largest violation of a bound."""
    wall, cpu = (1e3 * np.array([tick.seconds[i] for tick in ticks]) for i in (0, 1))
    check, built = (
        1e3 * statistics.median(getattr(tick, name)[0] for tick in ticks)
        for name in ("checked", "built")
    )
    whole = wall + [1e3 * tick.checked[0] for tick in ticks]
    checks = [tick.plan.verification for tick in ticks]
    return {
        "count": len(ticks),
        "deadline": None if deadline is None else 1e3 * deadline,
        **{f"p{q}": float(np.percentile(wall, q)) for q in (50, 99, 100)},
        "with_check": float(np.median(whole)),
        **{f"cpu_p{q}": float(np.percentile(cpu, q)) for q in (50, 99)},
        "check": check,
        "check_cpu": 1e3 * statistics.median(tick.checked[1] for tick in ticks),
        "built": built,
        "iterations": statistics.mean(tick.plan.iterations for tick in ticks),
        "endings": Counter(tick.plan.status.name for tick in ticks),
        "unfaultless": sum(bool(check.faults) for check in checks),
        "violation": max(
            float(max(c.bounds.max(), c.extension.max(), c.change.max())) for c in checks
        ),
    }


def rows_of(name: str, count: int, sample: int) -> Figures:
    """Figures of a motion: under a deadline, to convergence, and by the path replaced."""
    plan, deadline = to.plan_motion(to.load_motion(name)), IN_A_ROW[name]
    hurried = {"throw": False, "deadline": deadline, "check": "later"}
    ticks = in_a_row(plan, to.Replanner(plan), count, **hurried)
    fast = row_figures(ticks, deadline) | against_ipopt(plan, ticks, sample)
    full = in_a_row(plan, to.Replanner(plan), sample, throw=False, check="later")
    old = in_a_row(plan, IpoptReplanner(plan), sample)
    return {"fast": fast, "full": row_figures(full), "old": row_figures(old)}


# --- a control loop ----------------------------------------------------------------------------


def following(position: np.ndarray, steps: int = 8) -> to.Motion:
    """Bring the tip to a place, in steps that may change activations by 0.15."""
    target = {"Z": TIP, "position": position.tolist(), "position_weight": 10.0}
    change = {"activation": 0.15, "head_z_deg": (-1, 1), "head_y_deg": (-1, 1)}
    phase = {"duration": STEP * steps, "steps": steps, "targets": [target], "change": [change]}
    bounds = {"head_z_deg": (-15, 15), "head_y_deg": (-15, 15)}
    return to.Motion.build("follow", [phase], bounds=bounds, tolerance={"position": 1e-3})


def moving_target(tick: int) -> np.ndarray:
    """Position in m on a closed curve of 50 ticks, 12 to 27 mm each."""
    a = 2 * np.pi * tick / 50
    return np.array([0.75 + 0.1 * np.cos(a), 0.15 * np.sin(a), 1.35 + 0.08 * np.sin(2 * a)])


def follow(planner: type, ticks: int, far: range, deadline: float) -> Figures:
    """A loop in which each tick carries out the first step of its plan."""
    plan = to.plan_motion(following(moving_target(0)), throw=False)  # which takes two steps
    plan = to.plan_motion(plan.motion, initial=plan.x[0])
    again, rows = planner(plan), []
    options = {"throw": False, "check": "later"} if planner is to.Replanner else {}
    for tick in range(1, ticks + 1):
        place = np.array(FAR) if tick in far else moving_target(tick)
        motion, now = plan.motion.retarget(position=place.tolist()), plan.x[0]
        plan, seconds = timed(
            lambda motion=motion, now=now: again(motion, initial=now, deadline=deadline, **options)
        )
        # Whether one step can reach the target from here, by a plan of that step alone.
        alone = to.plan_motion(following(place, 1), 1, initial=now, throw=False)
        error, reachable = (1e3 * p.errors[0].position[0] for p in (plan, alone))
        rows.append((1e3 * seconds[0], 1e3 * seconds[1], error, reachable, plan.status.name))
    wall, cpu, error, least, endings = (np.array(column) for column in zip(*rows, strict=True))
    can = least <= 0.1
    return {
        "ticks": ticks,
        "reachable": int(can.sum()),
        "error": float(error[can].max(initial=0.0)),
        "missed": int(np.sum(error[can] > 0.1)),
        "late": float(wall.max() - 1e3 * deadline),
        "count_late": int(np.sum(wall > 1e3 * deadline + 5)),
        **{f"p{q}": float(np.percentile(wall, q)) for q in (50, 99, 100)},
        "cpu_p50": float(np.median(cpu)),
        "endings": Counter(endings.tolist()),
    }


def loops_of(quick: bool) -> Figures:
    """The loop with targets within reach, and with some out of it, both ways."""
    ticks, none = (16, range(0)) if quick else (50, range(0))
    far = range(ticks // 2, ticks // 2 + (3 if quick else 8))
    return {
        "near": follow(to.Replanner, ticks, none, LOOP_DEADLINE),
        "far": follow(to.Replanner, ticks, far, LOOP_DEADLINE),
        "old near": follow(IpoptReplanner, ticks, none, LIMIT),
        "old far": follow(IpoptReplanner, ticks, far, LIMIT),
    }


# --- the rest ----------------------------------------------------------------------------------


def whole_plans(repeats: int) -> dict[str, tuple[float, float]]:
    """Median wall and CPU seconds of each whole plan, its check included, after a first."""
    result = {}
    for name in MOTIONS:
        motion = to.load_motion(name)
        runs = [timed(lambda motion=motion: to.plan_motion(motion)) for _ in range(repeats + 1)]
        wall, cpu = zip(*(seconds for _, seconds in runs[1:]), strict=True)
        result[name] = statistics.median(wall), statistics.median(cpu)
    return result


def compiled_shapes(repeats: int) -> Figures:
    """Start, speed and error of `ShapeMap`."""
    which, steps = cases(2000, seed=5), 5
    some = which.first(200)  # of which the exact shapes are known within seconds
    off = error(some, some.solve(fine_mesh(some)), steps)
    return {**first_calls(repeats), **by_steps(steps, which, repeats), "error_in_L": off}


def start_up(repeats: int) -> dict[str, float]:
    """CPU seconds of importing the package, and of the command's help; median of processes."""

    def cpu(*command: str | Path) -> float:
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        return usage.ru_utime + usage.ru_stime if process.returncode == 0 else np.nan

    python = Path(sys.executable)
    kinds = {
        "import": (python, "-c", "import trunk_ocp"),
        "help": (python.parent / "solve-motion", "--help"),
    }
    return {
        name: statistics.median(cpu(*command) for _ in range(repeats))
        for name, command in kinds.items()
    }


@contextmanager
def spinning() -> Iterator[None]:
    """Another process keeps a core busy meanwhile."""
    process = subprocess.Popen([sys.executable, "-c", SPIN])
    try:
        yield
    finally:
        process.kill()
        process.wait()


def measured(quick: bool) -> Figures:
    """Figures of all that a busy core may slow down."""
    count, sample = (40, 10) if quick else (1000, 100)
    figures: Figures = {}
    for name in IN_A_ROW:
        figures[name] = progress(name, lambda name=name: rows_of(name, count, sample))
    figures["loop"] = progress("loop", lambda: loops_of(quick))
    figures["plans"] = progress("whole plans", lambda: whole_plans(1 if quick else 3))
    return figures


def progress(name: str, work: Callable[[], Result]) -> Result:
    result, (wall, _) = timed(work)
    print(f"{name}: {wall:.0f} s", flush=True)
    return result


def main() -> None:
    from .realtime_report import text

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="40 targets in a row, not 1,000")
    parser.add_argument("--busy", action="store_true", help="again beside a busy second core")
    parser.add_argument("--out", type=Path, default=ROOT / "results", help="folder of realtime.md")
    options = parser.parse_args()
    began, load = time.perf_counter(), os.getloadavg()[0]
    figures: Figures = {"quick": options.quick, "load": load}
    figures["idle"] = measured(options.quick)
    repeats = 1 if options.quick else 5
    figures["shapes"] = progress("shapes", lambda: compiled_shapes(repeats))
    figures["start"] = progress("start", lambda: start_up(repeats))
    if options.busy:
        with spinning():
            figures["busy"] = measured(options.quick)
    figures["seconds"] = time.perf_counter() - began
    options.out.mkdir(parents=True, exist_ok=True)
    page = text(figures)
    (options.out / "realtime.md").write_text(page)
    print(page)


if __name__ == "__main__":
    main()

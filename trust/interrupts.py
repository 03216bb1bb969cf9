"""Ctrl-C at random moments, once, twice or as SIGTERM, ends every command as it should.

    python -m trust.interrupts --count 50 --seed 1 --json FILE

One signal: exit code 4, or that of a run which had ended before; two: code 4 within a second of the
second one. Never a traceback, never a terminal without its cursor, and never a saved plan that
says it is finished where it is not. `plan_motion`, in a script and in a session, raises
KeyboardInterrupt or says INTERRUPTED; the same session then plans as ever.

Moments begin once a command has been entered: Python's own start is not ours.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import select
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from trust.faults import numbers

AT_ONCE = 1.0  # s, from the second Ctrl-C to the end
PATIENCE = 120.0  # s from one signal to the end; a figure or a window may have to be finished
KINDS = ("once", "once", "twice", "terminated")
BEGUN = "begun"
COMMAND = (
    f"from trunk_ocp.cli.entry import trunk_ocp as f; import os; os.write(2, b'{BEGUN}\\n'); f()"
)
PROBLEM = """
name = "point"
[bounds]
activation = [-3.0, 0.0]
extension = [0.67, 1.35]
[[phases]]
name = "reach"
duration = 1.0
steps = 4
[[phases.targets]]
Z = 1.75
position = [0.6, 0.1, 1.2]
"""
PLANNED = f"""
import os, trunk_ocp as to
motion = to.load_motion('problem.toml')
os.write(2, b'{BEGUN}\\n')
try:
    plan = to.plan_motion(motion, throw=False)
    print(plan.status.name, repr(plan.objective.total))
except KeyboardInterrupt:
    print('KeyboardInterrupt')
"""
SESSION = f"""
import code, os
session = code.InteractiveInterpreter()
session.runsource("import trunk_ocp as to; motion = to.load_motion('problem.toml'); plan = None")
os.write(2, b'{BEGUN}\\n')
session.runsource("plan = to.plan_motion(motion, throw=False)")
plan = session.locals['plan']
print(plan.status.name if plan else 'KeyboardInterrupt', plan and repr(plan.objective.total))
session.runsource("print('again', to.plan_motion(motion, throw=False).status.name)")
"""
COMMANDS: dict[str, tuple[str, ...]] = {
    "solve": ("solve", "problem.toml", "--out", "new", "--mode", "both"),
    "explain": ("explain", "run"),
    "convert": ("convert", "run"),
    "view": ("view", "run", "--no-browser"),
    "redundancy": ("redundancy", "run", "--needed"),
    "compare": ("compare", "problem.toml", "--out", "new"),
    "survey": ("survey", "problem.toml", "--out", "new", "--lookaheads", "1", "--processes", "1"),
    "optima": ("optima", "problem.toml", "--out", "new", "--starts", "3"),
    "export": ("export", "asian-elephant", "--to", "numpy", "--out", "new"),
    "tables": ("tables",),
    "schema": ("schema",),
}
SCRIPTS = {"plan_motion": PLANNED, "plan_motion in a session": SESSION}


@dataclass
class Ended:
    """How a process ended."""

    code: int
    output: str
    errors: str
    seconds: float  # from its beginning, or from the last signal, to its end


@dataclass
class Tally:
    """What was tried and what came of it."""

    trials: int = 0
    outcomes: Counter[str] = field(default_factory=Counter)
    slowest: float = 0.0  # s from a second Ctrl-C to the end
    disagreements: list[str] = field(default_factory=list)


def struck(
    code: str, words: tuple[str, ...], folder: Path, delays: tuple[float, ...], number: int
) -> Ended:
    """Run Python code in a folder, with a signal to its whole group after each delay."""
    process = subprocess.Popen(
        [sys.executable, "-c", code, *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        cwd=folder,
        start_new_session=True,
        env=os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
    )
    try:
        assert process.stderr is not None
        process.stderr.readline()  # BEGUN
        last = time.monotonic()
        for delay in delays:
            select.select([], [], [], delay)
            if process.poll() is None:
                os.killpg(process.pid, number)
                last = time.monotonic()
        while process.poll() is None and time.monotonic() - last < PATIENCE:
            time.sleep(0.005)
        seconds = time.monotonic() - last
        output, errors = process.communicate(timeout=PATIENCE)
    finally:
        process.kill()
    return Ended(process.returncode, output.decode(), errors.decode(), seconds)


def wrong_command(ended: Ended, usual: int, kind: str) -> str:
    """What is wrong with how a command ended, or nothing."""
    if "Traceback" in ended.errors or "Exception ignored" in ended.errors:
        return f"traceback: {ended.errors[-600:]}"
    if ended.code not in (4, usual):
        return f"exit code {ended.code}: {ended.errors[-300:]}"
    if kind == "twice" and ended.code == 4 and ended.seconds > AT_ONCE:
        return f"{ended.seconds:.2f} s after the second Ctrl-C"
    return ""


def wrong_plans(folder: Path, whole: dict[str, bytes]) -> str:
    """Saved plans that call themselves finished and are not those of a run nothing stopped."""
    for path in folder.glob("*/summary.json"):
        mode, status = path.parent.name, json.loads(path.read_text())["status"]
        if status == "interrupted":
            continue
        found = numbers(folder)
        if any(found.get(k) != v for k, v in whole.items() if k.startswith(f"{mode} ")):
            return f"{mode} says {status}"
    return ""


def wrong_answer(ended: Ended, usual: str) -> str:
    """What is wrong with what `plan_motion` came to, or nothing."""
    first, *rest = ended.output.splitlines() or [""]
    over = ended.code == -signal.SIGINT and first == usual  # in Python's own end, after the answer
    told = first.startswith(("KeyboardInterrupt", "INTERRUPTED", usual))
    if (ended.code and not over) or not told:
        return f"{first or ended.errors[-300:]} instead of {usual}"
    return "" if rest in ([], ["again SOLVED"]) else f"then {rest}"


class Trials:
    """All commands and calls, each with what it does when nothing stops it."""

    def __init__(self, folder: Path, seed: int) -> None:
        self.folder, self.dice, self.tally = folder, random.Random(seed), Tally()
        (folder / "problem.toml").write_text(PROBLEM)
        words = ("solve", "problem.toml", "--out", "run", "--mode", "both", "--no-figures")
        ended = struck(COMMAND, words, folder, (), 0)
        if ended.code:
            raise SystemExit(f"planned with exit code {ended.code}: {ended.errors}")
        self.whole = numbers(folder / "run")

    def strike(self, name: str, count: int) -> None:
        """Run a command or call `count` times, each ended at a moment of its own."""
        script = SCRIPTS.get(name)
        code, words = script or COMMAND, COMMANDS.get(name, ())
        usual = self._run(code, words, (), signal.SIGINT)
        for _ in range(count):
            kind = "once" if script else self.dice.choice(KINDS)
            delays = [self.dice.uniform(0.01, usual.seconds)]
            delays += [self.dice.uniform(0.0, 0.5)] * (kind == "twice")
            number = signal.SIGTERM if kind == "terminated" else signal.SIGINT
            ended = self._run(code, words, tuple(delays), number)
            if script:
                wrong = wrong_answer(ended, usual.output.split("\n")[0])
            else:
                wrong = wrong_command(ended, usual.code, kind)
                wrong = wrong or wrong_plans(self.folder / "new", self.whole)
            self._note(name, kind, delays[0], ended, wrong)

    def _run(self, code: str, words: tuple[str, ...], delays: Any, number: int) -> Ended:
        shutil.rmtree(self.folder / "new", ignore_errors=True)
        return struck(code, words, self.folder, delays, number)

    def _note(self, name: str, kind: str, delay: float, ended: Ended, wrong: str) -> None:
        tally = self.tally
        tally.trials += 1
        answer = f", {ended.output.split()[0]}" if name in SCRIPTS and ended.output else ""
        tally.outcomes[f"{kind}, exit code {ended.code}{answer}"] += 1
        if kind == "twice" and ended.code == 4:
            tally.slowest = max(tally.slowest, ended.seconds)
        if wrong:
            tally.disagreements.append(f"{name}, {kind} after {delay:.3f} s: {wrong}")
            print(tally.disagreements[-1], flush=True)


def measure(count: int, seed: int, names: list[str]) -> dict[str, Any]:
    """Counts of `count` trials of each command and call."""
    began = time.perf_counter()
    # What a shell starts in the background ignores Ctrl-C, and so would all that is tried here.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    with tempfile.TemporaryDirectory() as name:
        trials = Trials(Path(name), seed)
        for number, what in enumerate(names, 1):
            trials.strike(what, count)
            tally = trials.tally
            spent = time.perf_counter() - began
            told = f"{tally.trials} trials, {len(tally.disagreements)} wrong, {spent:.0f} s"
            print(f"{number} of {len(names)}, {what}: {told}", flush=True)
    return {
        "trials": trials.tally.trials,
        "of": names,
        "outcomes": dict(trials.tally.outcomes),
        "slowest_second": round(trials.tally.slowest, 3),
        "disagreements": trials.tally.disagreements,
        "seconds": round(time.perf_counter() - began, 1),
        "seed": seed,
    }


def main() -> None:
    """Run the trials, show and write the counts; exit code 1 if one did not hold."""
    every = [*COMMANDS, *SCRIPTS]
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=50, help="moments of each command")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=Path, dest="path")
    parser.add_argument("--only", choices=every, nargs="+", default=every)
    chosen = parser.parse_args()
    counts = measure(chosen.count, chosen.seed, chosen.only)
    text = json.dumps(counts, indent=1)
    print(text)
    if chosen.path:
        chosen.path.write_text(text + "\n")
    sys.exit(bool(counts["disagreements"]))


if __name__ == "__main__":
    main()

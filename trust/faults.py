"""Runs that are stopped at random moments and resumed give identical results.

    python -m trust.faults --count 50 --seed 1 --json FILE

Each trial plans a motion and stops the run one to three times, by `kill -9`, by one Ctrl-C, by two,
or by a limit on the size of its files; then the run may finish. All numbers in its results are
compared with those of an undisturbed run.
"""

from __future__ import annotations

import argparse
import json
import random
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import xarray as xr

from trunk_ocp.planning.checkpoint import FILE

COMMAND = [sys.executable, "-c", "from trunk_ocp.cli.commands import solve; solve()"]
PROBLEMS = ("lift-log", "lift-log-asymmetric", "pick-fruit")
MODES = (("--mode", "sequential"), ("--mode", "horizon"), ("--mode", "both"), ("--lookahead", "3"))
KINDS = ("kill", "kill", "kill", "interrupt", "two interrupts", "no room")  # kill most often
EXIT_CODES = {"interrupt": 4, "two interrupts": 4, "kill": -signal.SIGKILL, "no room": 2}
MAX_FILE_SIZES = (1_000, 400_000)  # bytes
TIMEOUT = 600.0  # s for one run


@dataclass
class Tally:
    """Counts of trials and outcomes."""

    injected: Counter[str] = field(default_factory=Counter)
    came_too_late: int = 0
    nothing_to_resume: int = 0
    resumed: int = 0
    trials: int = 0
    survived: int = 0
    bits_compared: int = 0
    disagreements: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class Case:
    """Problem and mode of a run."""

    problem: str
    mode: tuple[str, str]

    def command(self, folder: Path, resume: bool) -> list[str]:
        """The command line that plans it into a folder."""
        extra = ["--resume"] if resume else []
        return [*COMMAND, self.problem, *self.mode, "--out", str(folder), "--no-figures", *extra]


def numbers(folder: Path) -> dict[str, bytes]:
    """All numbers in a run's results except wall times, by file and name."""
    values: dict[str, bytes] = {}
    for path in sorted(folder.glob("*/solution.nc")):
        mode = path.parent.name
        with xr.open_dataset(path, engine="scipy") as data:
            for name, array in data.variables.items():
                if array.dtype.kind in "fi":
                    values[f"{mode} {name}"] = array.values.tobytes()
            values[f"{mode} iterations"] = str(data.attrs["iterations"]).encode()
        values[f"{mode} csv"] = path.with_name("activations.csv").read_bytes()
    return values


def undisturbed(case: Case, folder: Path, resume: bool) -> tuple[int, str]:
    """Exit code and error output of a run that is not stopped."""
    ended = subprocess.run(
        case.command(folder, resume), capture_output=True, text=True, timeout=TIMEOUT
    )
    return ended.returncode, ended.stderr


def stopped(case: Case, folder: Path, resume: bool, kind: str, delay: float, max_size: int) -> int:
    """Exit code of a run with a fault `delay` seconds after planning started."""
    limit = partial(resource.setrlimit, resource.RLIMIT_FSIZE, (max_size, max_size))
    process = subprocess.Popen(
        case.command(folder, resume),
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        preexec_fn=limit if kind == "no room" else None,
    )
    assert process.stdout is not None
    process.stdout.readline()  # the title, printed when planning starts
    try:
        if kind != "no room":
            time.sleep(delay)
            for _ in range(2 if kind == "two interrupts" else 1):
                process.send_signal(signal.SIGKILL if kind == "kill" else signal.SIGINT)
        process.communicate(timeout=TIMEOUT)
    finally:
        process.kill()
    return process.returncode


def trial(
    case: Case, rng: random.Random, expected: dict[str, bytes], duration: float, t: Tally
) -> str:
    """Stop a run one to three times and resume it; returns what is wrong, or ""."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "run"
        story, code = f"{case.problem} {' '.join(case.mode)}", -1
        for _ in range(rng.randint(1, 3)):
            kind, delay = rng.choice(KINDS), rng.uniform(0.0, 0.9 * duration)
            resume = any(folder.glob(f"*/{Path(FILE).stem}*.npz"))
            code = stopped(case, folder, resume, kind, delay, rng.randint(*MAX_FILE_SIZES))
            story += f", {kind} after {delay:.3f} s"
            t.injected[kind] += 1
            if code == 0:
                t.came_too_late += 1
                break
            if code != EXIT_CODES[kind]:
                return f"{story}: exit code {code}"
        if any(folder.rglob(".*.part*")) and kind != "kill":
            return f"{story}: left an unfinished file"
        if code != 0:
            resume = any(folder.glob(f"*/{Path(FILE).stem}*.npz"))
            t.resumed += resume
            t.nothing_to_resume += not resume
            code, error = undisturbed(case, folder, resume)
            if code != 0:
                return f"{story}: resumed, exit code {code}: {error}"
        left = [p.name for p in folder.rglob("*") if p.name.startswith((".", Path(FILE).stem))]
        if left:
            return f"{story}: left {', '.join(left)}"
        actual = numbers(folder)
        t.bits_compared += 8 * sum(map(len, expected.values()))
        differing = [key for key in expected if expected[key] != actual.get(key)]
        return f"{story}: differs in {', '.join(differing)}" if differing else ""


def measure(count: int, seed: int) -> dict[str, Any]:
    """Counts of `count` trials; a seed fixes the trials up to the exact moment of each fault."""
    rng, tally = random.Random(seed), Tally()
    known: dict[Case, tuple[dict[str, bytes], float]] = {}
    began = time.perf_counter()
    for number in range(1, count + 1):
        case = Case(rng.choice(PROBLEMS), rng.choice(MODES))
        if case not in known:
            with tempfile.TemporaryDirectory() as name:
                started = time.perf_counter()
                code, error = undisturbed(case, Path(name), False)
                if code != 0:
                    raise SystemExit(f"{case}: exit code {code} without a fault: {error}")
                # About 1.5 s of this is start-up, before planning.
                seconds = max(time.perf_counter() - started - 1.5, 0.2)
                known[case] = numbers(Path(name)), seconds
        tally.trials += 1
        wrong = trial(case, rng, *known[case], tally)
        if wrong:
            tally.disagreements.append(wrong)
        tally.survived += not wrong
        faults, spent = sum(tally.injected.values()), time.perf_counter() - began
        progress = f"{number} of {count} trials, {faults} faults, {tally.survived} survived"
        print(f"{progress}, {spent:.0f} s", f"  {wrong}" * bool(wrong), flush=True)
    return {
        "faults_injected": dict(tally.injected),
        "came_after_the_end": tally.came_too_late,
        "trials": tally.trials,
        "resumed": tally.resumed,
        "nothing_to_resume": tally.nothing_to_resume,
        "survived": tally.survived,
        "bits_compared": tally.bits_compared,
        "disagreements": tally.disagreements,
        "seconds": round(time.perf_counter() - began, 1),
        "seed": seed,
    }


def main() -> None:
    """Run the trials, print and write the counts; exit code 1 if any failed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=50)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=Path, dest="path")
    chosen = parser.parse_args()
    counts = measure(chosen.count, chosen.seed)
    text = json.dumps(counts, indent=1)
    print(text)
    if chosen.path:
        chosen.path.write_text(text + "\n")
    sys.exit(bool(counts["disagreements"]))


if __name__ == "__main__":
    main()

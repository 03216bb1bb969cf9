"""All benchmarks: `python -m benchmarks.run [--quick] [--only WORD]`.

Writes results/benchmarks.json, .md and -inverse.png. This process only starts others, one at a
time and with one thread each, so that none slows another down.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from .jobs import MOTIONS, Job, jobs

ROOT = Path(__file__).parent.parent
MARK = "benchmark: "  # as in `common`, which is not imported, to keep this process small
PACKAGES = (
    *("casadi", "numpy", "scipy", "numba", "trunk_ocp"),
    *("exudyn", "pyelastica", "nlopt", "PyNomadBBO", "matplotlib"),
)
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MPLBACKEND": "Agg"}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--quick", action="store_true", help="small budgets; takes about three minutes"
    )
    parser.add_argument("--only", default="", help="only jobs whose key contains this word")
    parser.add_argument("--out", type=Path, default=ROOT / "results", help="folder for the results")
    options = parser.parse_args()
    began = time.perf_counter()
    about = machine()
    parts: dict[str, Any] = {}
    for job in jobs(options.quick):
        if options.only in job.key:
            parts[job.key] = run(job)
            report(job.key, parts[job.key], began)
    for motion in MOTIONS:
        key = f"command {motion}"
        if options.only in key:
            parts[key] = command(motion, 1 if options.quick else 3)
            report(key, parts[key], began)
    document = {
        "quick": options.quick,
        "machine": about,
        "versions": versions(),
        "seconds": time.perf_counter() - began,
        "parts": parts,
    }
    options.out.mkdir(parents=True, exist_ok=True)
    path = options.out / "benchmarks.json"
    path.write_text(json.dumps(document, indent=1, default=str) + "\n")
    for module in ("report", "figure"):
        subprocess.run([sys.executable, "-m", f"benchmarks.{module}", path], cwd=ROOT, check=True)


def report(key: str, figures: dict[str, Any], began: float) -> None:
    ending = figures["failed"] if "failed" in figures else f"{figures['wall_seconds']:.1f} s"
    print(f"{time.perf_counter() - began:6.0f} s  {key}: {ending}", flush=True)


def run(job: Job) -> dict[str, Any]:
    """Figures of a job: medians over its processes."""
    return combined([once(job) for _ in range(job.processes)])


def once(job: Job) -> dict[str, Any]:
    words = [sys.executable, "-m", f"benchmarks.{job.module}", job.part, json.dumps(job.arguments)]
    environment = os.environ | ONE_THREAD
    try:
        done = subprocess.run(
            words, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=job.limit
        )
    except subprocess.TimeoutExpired:
        return {"failed": f"stopped after {job.limit:g} s"}
    lines = [line for line in done.stdout.splitlines() if line.startswith(MARK)]
    if lines:
        return dict(json.loads(lines[-1].removeprefix(MARK)))
    return {"failed": f"exit {done.returncode}: {done.stderr.strip().splitlines()[-1:]}"}


def combined(runs: list[dict[str, Any]]) -> dict[str, Any]:
    """Median of each number; a failure if any run failed; anything else from the last run."""
    for one in runs:
        if "failed" in one:
            return one
    result = dict(runs[-1])
    for name, value in result.items():
        if isinstance(value, float):
            result[name] = statistics.median(one[name] for one in runs)
    return result | {"processes": len(runs)}


def command(motion: str, repeats: int) -> dict[str, Any]:
    """`solve-motion --no-figures` as users run it: wall seconds, CPU seconds, peak memory."""
    executable = Path(sys.executable).parent / "solve-motion"
    runs = []
    for _ in range(repeats):
        with tempfile.TemporaryDirectory() as folder:
            words = [str(executable), motion, "--quiet", "--no-figures", "--out", folder]
            began = time.perf_counter()
            process = subprocess.Popen(words, env=os.environ | ONE_THREAD)
            _, status, usage = os.wait4(process.pid, 0)
            wall = time.perf_counter() - began
            process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode:
            return {"failed": f"solve-motion ended with exit code {process.returncode}"}
        runs.append(
            {
                "wall_seconds": wall,
                "cpu_seconds": usage.ru_utime + usage.ru_stime,
                "peak_memory_mb": usage.ru_maxrss / 1024,
            }
        )
    return combined(runs)


def machine() -> dict[str, Any]:
    cpu = [
        line.split(":")[1].strip()
        for line in Path("/proc/cpuinfo").read_text().splitlines()
        if line.startswith("model name")
    ]
    return {
        "processor": cpu[0] if cpu else platform.processor(),
        "cores": os.cpu_count(),
        "system": platform.platform(),
        "python": platform.python_version(),
        "load_before": os.getloadavg()[0],
    }


def versions() -> dict[str, str]:
    found = {}
    for name in PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "not installed"
    return found


if __name__ == "__main__":
    main()

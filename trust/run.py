"""Everything that is tried to make the product fail, and docs/reliability.md from its counts.

    python -m trust.run --inputs 2000 --trials 60 --seed 1

Cases are validated, files are made up and damaged, runs are killed and resumed, commands are
interrupted, shapes and plans of extreme trunks are judged, and the fruit motion is integrated
between its time steps. The counts go to results/reliability.json, from which the page is written.
Exit code 1 if anything disagreed.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from importlib.metadata import version
from pathlib import Path
from typing import Any

from trust.reliability import page

ROOT = Path(__file__).parent.parent
COUNTS = ROOT / "results" / "reliability.json"
PAGE = ROOT / "docs" / "reliability.md"


def main() -> None:
    """Run all parts, write counts and page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--inputs", type=int, default=2000, help="files tried")
    parser.add_argument("--trials", type=int, default=60, help="runs that are ended and resumed")
    parser.add_argument("--damaged", type=int, default=2000, help="saved files tried")
    parser.add_argument("--moments", type=int, default=5, help="Ctrl-C of each command")
    parser.add_argument("--equilibria", type=int, default=500, help="shapes judged, 5 to a plan")
    parser.add_argument("--seed", type=int, default=1)
    chosen = parser.parse_args()
    began = time.perf_counter()
    seed = f"--seed={chosen.seed}"
    parts = {
        "inputs": [f"--count={chosen.inputs}", seed],
        "faults": [f"--count={chosen.trials}", seed],
        "damaged": [f"--count={chosen.damaged}", seed],
        "interrupts": [f"--count={chosen.moments}", seed],
        "equilibria": [f"--count={chosen.equilibria}", seed],
        "between": [],
    }
    with tempfile.TemporaryDirectory() as folder:
        running = {
            name: subprocess.Popen(
                [sys.executable, "-m", f"trust.{name}", *arguments, f"--json={folder}/{name}.json"],
                cwd=ROOT,
            )
            for name, arguments in parts.items()
        }
        counts: dict[str, Any] = {"validation": validated()}
        for name, process in running.items():
            process.wait()
            counts[name] = json.loads(Path(folder, f"{name}.json").read_text())
    counts |= {
        "version": version("trunk_ocp"),
        "python": sys.version.split()[0],
        "seconds": round(time.perf_counter() - began),
    }
    COUNTS.write_text(json.dumps(counts, indent=1) + "\n")
    PAGE.write_text(page(counts), encoding="utf-8")
    print(f"{PAGE.relative_to(ROOT)} and {COUNTS.relative_to(ROOT)} are written.")
    sys.exit(1 if wrong(counts) else 0)


def wrong(part: Any) -> list[str]:
    """Every sentence on what disagreed, wherever in the counts."""
    if not isinstance(part, dict):
        return []
    own = [text for name in ("faults", "disagreements") for text in _sentences(part.get(name))]
    return [*own, *(text for inner in part.values() for text in wrong(inner))]


def _sentences(found: Any) -> list[str]:
    return found if isinstance(found, list) else []


def validated() -> dict[str, Any]:
    """Cases evaluated and those that are off by more than they may; writes docs/validation.md."""
    from trust.validate import evaluate
    from trust.validation import CASES
    from trust.validation.case import HeldByTest

    failed = evaluate()
    held = sum(isinstance(case, HeldByTest) for case in CASES)
    return {"cases": len(CASES) - held, "held_by_tests": held, "disagreements": failed}


if __name__ == "__main__":
    main()

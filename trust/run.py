"""All reliability trials, and docs/reliability.md from their counts.

    python -m trust.run --inputs 2000 --trials 60 --seed 1

Validation cases are evaluated, files are generated and damaged, runs are killed and resumed,
commands are interrupted, shapes and plans of extreme trunks are checked, and the fruit motion is
integrated between its time steps. The counts go to results/reliability.json, from which the page is
written. Exit code 1 if anything failed.
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
    """Run all parts, and write the counts and the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--inputs", type=int, default=2000, help="number of generated files")
    parser.add_argument("--trials", type=int, default=60, help="number of runs stopped and resumed")
    parser.add_argument("--damaged", type=int, default=2000, help="number of damaged saved files")
    parser.add_argument("--moments", type=int, default=5, help="interrupts per command")
    parser.add_argument(
        "--equilibria",
        type=int,
        default=500,
        help="number of shapes, and five times the number of plans",
    )
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
        counts: dict[str, Any] = {"validation": validate()}
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
    print(f"Wrote {COUNTS.relative_to(ROOT)} and {PAGE.relative_to(ROOT)}.")
    sys.exit(1 if failures(counts) else 0)


def failures(part: Any) -> list[str]:
    """Descriptions of all failures, anywhere in the counts."""
    if not isinstance(part, dict):
        return []
    lists = (part.get(name) for name in ("faults", "disagreements"))
    here = [text for texts in lists if isinstance(texts, list) for text in texts]
    return [*here, *(text for inner in part.values() for text in failures(inner))]


def validate() -> dict[str, Any]:
    """Evaluate the validation cases and write docs/validation.md; counts of cases."""
    from trust.validate import evaluate
    from trust.validation import CASES
    from trust.validation.case import CoveredByTest

    disagreements = evaluate()
    covered = sum(isinstance(case, CoveredByTest) for case in CASES)
    return {"cases": len(CASES) - covered, "held_by_tests": covered, "disagreements": disagreements}


if __name__ == "__main__":
    main()

"""Random problem and anatomy files, many of them damaged.

`trust.random_files` draws well-formed files and `trust.mutations` damages them; `trust.trial` plans
those that are accepted and checks the answers.

    python -m trust.inputs --count 500 --seed 1 --json out/inputs.json
"""

from __future__ import annotations

import argparse
import faulthandler
import json
import sys
import tempfile
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st

from trunk_ocp.planning.labeled import dataset
from trunk_ocp.planning.planner import plan_motion
from trunk_ocp.planning.storage import save_plan
from trunk_ocp.problem.build import load_motion

from .mutations import HOSTILE, damaged, mutated
from .random_files import anatomies, problems
from .toml import toml
from .trial import Verdict, restored, tried

# --- cases -------------------------------------------------------------------------------

KINDS = ("well-formed", "problem", "anatomy", "problem bytes", "anatomy bytes", "solution")
"""What is damaged in a case."""
TIMEOUT = 300
"""Seconds after which a case counts as a hang, and the run stops with a traceback."""


@dataclass
class Case:
    """Files by name, and the lookahead to plan them with; `kind` is one of `KINDS`."""

    kind: str
    files: dict[str, bytes]
    lookahead: int | None

    def judged(self, folder: Path) -> Verdict:
        """Write the files into a folder, and run the trial."""
        for name in ("problem.toml", "arm.toml", "solution.nc"):
            (folder / name).unlink(missing_ok=True)
        for name, content in self.files.items():
            (folder / name).write_bytes(content)
        if self.kind == "solution":
            return restored(folder)
        return tried(folder / "problem.toml", self.lookahead)


@st.composite
def cases(draw: st.DrawFn, kinds: tuple[str, ...] = KINDS) -> Case:
    """A case of one of the given kinds."""
    kind = draw(st.sampled_from(kinds))
    if kind == "solution":
        return Case(kind, {"solution.nc": draw(solutions())}, None)
    anatomy = draw(anatomies()) if "anatomy" in kind or draw(st.booleans()) else None
    problem = draw(problems(anatomy))
    files = {"problem.toml": toml(draw(mutated(problem)) if kind == "problem" else problem)}
    if anatomy is not None:
        files["arm.toml"] = toml(draw(mutated(anatomy)) if kind == "anatomy" else anatomy)
    written = {name: text.encode("utf-8", "surrogatepass") for name, text in files.items()}
    if kind.endswith("bytes"):
        name = "problem.toml" if kind == "problem bytes" else "arm.toml"
        written[name] = draw(damaged(written[name]))
    return Case(kind, written, draw(st.sampled_from([None, 1])))


SAVED = """
name = "saved"
bounds = { activation = [-3.0, 0.0], extension = [0.67, 1.35] }
[[phases]]
name = "reach"
duration = 1.0
auxiliary = { activation_deviation = 0.4 }
[[phases.targets]]
Z = 1.75
position = [0.6, 0.1, 1.2]
"""


@cache
def saved() -> tuple[Any, bytes]:
    """A plan as labeled arrays, and as the bytes of its file."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "saved.toml"
        path.write_text(SAVED)
        plan = plan_motion(load_motion(path), 1)
        save_plan(plan, folder)
        return dataset(plan), (Path(folder) / "solution.nc").read_bytes()


@st.composite
def solutions(draw: st.DrawFn) -> bytes:
    """A saved plan with changed bytes or attributes, or a pickle in its place."""
    data, content = saved()
    kind = draw(st.sampled_from(["bytes", "bytes", "attribute", "json", "pickle"]))
    if kind == "bytes":
        return draw(damaged(content))
    if kind == "pickle":
        return b"\x80\x04\x8c\x05posix\x94\x8c\x06system\x94\x93\x94\x8c\x02id\x94\x85\x94R\x94."
    name = draw(st.sampled_from(sorted(data.attrs)))
    plain = st.sampled_from([v for v in HOSTILE if type(v) in (str, float)])
    value: str | float = draw(plain.filter(lambda v: v != ""))
    if kind == "json":
        name = draw(st.sampled_from(["problem_json", "anatomy_json"]))
        value = json.dumps(draw(mutated(json.loads(data.attrs[name]))), default=str)
    changed = data.assign_attrs({name: value})
    with tempfile.TemporaryDirectory() as folder:
        changed.to_netcdf(Path(folder) / "solution.nc", engine="scipy")
        return (Path(folder) / "solution.nc").read_bytes()


# --- a run -------------------------------------------------------------------------------


def run(
    count: int,
    number: int,
    kinds: tuple[str, ...] = KINDS,
    progress: Callable[[str], object] = lambda line: None,
) -> dict[str, Any]:
    """Run `count` random cases.

    Returns
    -------
    Counts: "tried" in total and by kind, "outcomes" (refused, or the status of the plan),
    "checked" answers, "faults" with their files, and the "slowest" five cases.
    """
    outcomes: Counter[str] = Counter()
    by_kind: Counter[str] = Counter()
    faults: list[dict[str, Any]] = []
    slowest: list[tuple[float, str, dict[str, str]]] = []
    checked = 0

    @seed(number)
    @settings(
        max_examples=count,
        database=None,
        deadline=None,
        suppress_health_check=list(HealthCheck),
        phases=[Phase.generate],
    )
    @given(cases(kinds))
    def one(case: Case) -> None:
        nonlocal checked, slowest
        verdict = case.judged(Path(folder))
        faulthandler.dump_traceback_later(TIMEOUT, exit=True)  # for the next case
        by_kind[case.kind] += 1
        outcomes[verdict.outcome] += 1
        checked += verdict.checked
        files = {name: text.decode("utf-8", "replace") for name, text in case.files.items()}
        files.pop("solution.nc", None)
        seconds = round(verdict.reading + verdict.planning, 2)
        slowest = sorted([*slowest, (seconds, verdict.outcome, files)], key=lambda s: -s[0])[:5]
        for fault in verdict.faults:
            faults.append({"kind": case.kind, "fault": fault, "files": files})
            progress(f"{case.kind}: {fault}")
        done = by_kind.total()
        if done % 25 == 0:
            progress(f"{done}: {dict(outcomes)}, {checked} checked, {len(faults)} faults")

    with tempfile.TemporaryDirectory() as folder:
        one()
    faulthandler.cancel_dump_traceback_later()
    return {
        "seed": number,
        "tried": by_kind.total(),
        "kinds": dict(by_kind),
        "outcomes": dict(outcomes),
        "checked": checked,
        "faults": faults,
        "slowest": [
            {"seconds": seconds, "outcome": outcome, "files": files}
            for seconds, outcome, files in slowest
        ],
    }


def main() -> None:
    """Run the trials, print and write the counts; exit code 1 if any failed."""
    parser = argparse.ArgumentParser(description="Trials of problem, anatomy and solution files.")
    parser.add_argument("--count", type=int, default=500)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=Path, help="file for the counts")
    options = parser.parse_args()
    report = run(options.count, options.seed, progress=lambda line: print(line, flush=True))
    if options.json:
        options.json.parent.mkdir(parents=True, exist_ok=True)
        options.json.write_text(json.dumps(report, indent=2) + "\n")
    print({key: value for key, value in report.items() if key not in ("faults", "slowest")})
    print("slowest:", [(case["seconds"], case["outcome"]) for case in report["slowest"]])
    sys.exit(1 if report["faults"] else 0)


if __name__ == "__main__":
    main()

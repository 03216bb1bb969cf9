"""docs/reliability.md, written from the counts of `trust.run`."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any

from trunk_ocp.planning.status import Status

HEAD = """# Reliability

How this software was tested for wrong answers, tracebacks, hangs and lost results, and what the
tests found. The figures are from results/reliability.json, written by one run of `make trust`
(version {version}, Python {python}, {seconds} s); `make test` repeats a smaller number of the same
trials.

| what | trials | outcomes | failures |
| --- | --- | --- | --- |
{rows}

"""

BODY = """## The trials

**Files** ([trust/inputs.py](../trust/inputs.py), [mutations](../trust/mutations.py)): problem and
anatomy files made up at random - one to four steps, targets of every kind, wraps, logs, pulls,
bounds down to none, trunks of one to four segments with no muscle or many - and then damaged: keys
dropped, doubled or renamed, types changed, numbers at the edge (NaN, infinities, 1e308, 10^400),
bytes flipped, files cut off. Saved plans likewise. Each must be refused in two seconds of processor
time, with the file's name, or be planned; there is no third outcome.

**Saved files** ([trust/damaged.py](../trust/damaged.py)): solution.nc and resume.npz with bytes
flipped, parts missing, headers that claim terabytes, records of wrong types, oversized arrays,
archives that are compressed or have extra members, pipes and devices in their place. Each must be
refused within a second and 300 MB, or load with the contents it claims; no other file may change.

**Answers** ([trust/answers.py](../trust/answers.py)): every plan that calls itself solved is
judged from the text of its file alone: targets and bounds are worked out again, and every shape is
held against the equilibrium that scipy's `solve_bvp` finds next to it
([trust/judge.py](../trust/judge.py)), with nothing of the code that planned or verified.

**Equilibria** ([trust/equilibria.py](../trust/equilibria.py)): trunks of 10 mm to 10 m, cylinders
to near cones, soft and stiff, under thrusts and pulls far above their buckling loads. Every shape
that statics finds, and every plan, is compared with scipy's `solve_bvp` on independent equations:
nothing else may be called an equilibrium, and no plan in equilibrium may fail the check.

**Faults** ([trust/faults.py](../trust/faults.py)): runs are stopped at random moments one to three
times (by `kill -9`, one Ctrl-C, two, or a full disk) and resumed with `--resume`. The result is
compared bit by bit with that of an undisturbed run.

**Interrupts** ([trust/interrupts.py](../trust/interrupts.py)): every command, and `plan_motion` in
a script and in an interactive session, receives Ctrl-C once or twice, or SIGTERM, at a random
moment. It must end with exit code 4 (or its normal exit code if it had finished), within a second
of the second Ctrl-C and without a traceback, and no unfinished plan may be saved as finished.

**Between time steps** ([trust/between.py](../trust/between.py)): the fruit motion at {between}
instants, compared with scipy's solution of the two-point problem under the loads that the paper
prescribes.

**Validation** ([docs/validation.md](validation.md)): closed forms, published figures, balances,
symmetries and limits, each with a tolerance and its reason.

In addition, tests/cli/test_faults.py and tests/cli/test_hostile.py cover: a full disk at every
write, a read-only folder, two runs into one folder, a missing linear solver, compiler or font,
locales with decimal commas, ASCII output, no terminal, a closed pipe, devices and pipes in place
of files, code in file contents. tests/planning/test_determinism.py covers identical bits whatever
the thread settings, hash seed, folder, or earlier plans in the same process.

## How a plan can end

Commands print the text of the status; `plan_motion`, `load_plan` and `Replanner` raise `PlanError`
for all but the first, unless called with `throw=False`.

| status | text | exit code |
| --- | --- | --- |
{statuses}

[When it fails](how-to/when-it-fails.md) explains each status and what to do.

## Limits of these tests

Plans are local optima; a target reported as out of reach is not proved to be. Contact with the
head, the log or the trunk itself is not modeled. Where a couple acts, stability excludes static
buckling; flutter is a warning only. Identical bits are guaranteed only on the same machine with
the same versions. All trials ran on one machine.
"""


def _damaged(counts: Mapping[str, Any]) -> tuple[str, int, str, int]:
    """The row on saved files."""
    refused = sum(n for what, n in counts["outcomes"].items() if what.endswith("refused"))
    tried = sum(counts["tried"].values())
    outcomes = (
        f"{refused} refused, each within {counts['slowest']} s; {tried - refused} loaded as "
        f"claimed; memory grew by {counts['megabytes']} MB in total"
    )
    subject = "damaged or hostile saved plans and unfinished runs"
    return subject, tried, outcomes, len(counts["faults"])


OUTCOMES = {"interrupted": "stopped after 30 s"}  # by the trial itself


def _interrupts(counts: Mapping[str, Any]) -> list[tuple[str, int, str, int]]:
    """The row on interrupted commands, if any were."""
    if "interrupts" not in counts:
        return []
    record = counts["interrupts"]
    by_kind = "; ".join(f"{number} {name}" for name, number in record["outcomes"].items())
    outcomes = f"{by_kind}; at most {record['slowest_second']} s from a second Ctrl-C to the end"
    failures = len(record["disagreements"])
    return [("interrupted commands and calls", record["trials"], outcomes, failures)]


def _equilibria(counts: Mapping[str, Any]) -> list[tuple[Any, ...]]:
    """Rows on extreme trunks, shapes and plans."""
    rows = []
    for kind, tally in ((kind, counts[kind]) for kind in ("shapes", "plans") if kind in counts):
        by_status: Counter[str] = Counter()
        for name, number in tally["outcomes"].items():
            by_status[name.partition(":")[0].replace("_", " ")] += number
        outcomes = ", ".join(f"{number} {name}" for name, number in by_status.items())
        outcomes += f"; {tally['judged']} checked, {tally['undecided']} undecided by solve_bvp"
        rows.append(
            (f"{kind} of extreme trunks", by_status.total(), outcomes, len(tally["faults"]))
        )
    return rows


def _between(counts: Mapping[str, Any]) -> list[tuple[str, int, str, int]]:
    """The row on the fruit motion between its time steps, if it was integrated."""
    parts = counts.get("between", {}).values()
    if not parts:
        return []
    largest = 1e3 * max(part["largest_m"] for part in parts)
    failures = sum(len(part["faults"]) for part in parts)
    outcome = f"at most {largest:.2g} mm from the independent solution"
    return [("instants of the fruit motion", _instants(counts), outcome, failures)]


def _instants(counts: Mapping[str, Any]) -> int:
    return sum(part["instants"] for part in counts.get("between", {}).values())


def page(counts: Mapping[str, Any]) -> str:
    """The page."""
    inputs, faults, validation = counts["inputs"], counts["faults"], counts["validation"]
    outcomes = ", ".join(
        f"{number} {OUTCOMES.get(name, name.replace('_', ' '))}"
        for name, number in sorted(inputs["outcomes"].items(), key=lambda item: -item[1])
    )
    injected = faults["faults_injected"]
    kinds = ", ".join(f"{number} {kind}" for kind, number in sorted(injected.items()))
    rows: list[tuple[Any, ...]] = [
        ("generated and damaged files", inputs["tried"], outcomes, len(inputs["faults"])),
        (
            "solved plans, checked independently",
            inputs["checked"],
            "all correct" if not inputs["faults"] else "see results/reliability.json",
            len(inputs["faults"]),
        ),
        (
            f"faults injected into {faults['trials']} runs",
            sum(injected.values()),
            f"{kinds}; {faults['resumed']} runs resumed, {faults['survived']} with identical "
            f"results ({faults['bits_compared']:,} bits compared)",
            len(faults["disagreements"]),
        ),
        *_interrupts(counts),
        *_equilibria(counts.get("equilibria", {})),
        *_between(counts),
        (
            "validation cases",
            validation["cases"],
            f"within tolerance; {validation['held_by_tests']} more covered by separate tests",
            len(validation["disagreements"]),
        ),
    ]
    if damaged := counts.get("damaged"):
        rows.insert(2, _damaged(damaged))
    table = "\n".join(f"| {' | '.join(map(str, row))} |" for row in rows)
    statuses = "\n".join(f"| {s.name} | {s.value} | {s.exit_code} |" for s in Status)
    return HEAD.format(rows=table, **counts) + BODY.format(
        statuses=statuses, between=_instants(counts)
    )

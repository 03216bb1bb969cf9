"""docs/reliability.md, from the counts of `trust.run`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from trunk_ocp.planning.plan import Status

HEAD = """# Reliability

What was tried to get a wrong answer, a traceback, a hang or a loss out of this software, and how
often it succeeded. The figures on this page are those of results/reliability.json, written in one
run by `make trust` (version {version}, Python {python}, {seconds} s on the machine at hand); a
smaller number of the same trials runs with every `make test`.

| tried | how many | what came of it | wrong |
| --- | --- | --- | --- |
{rows}

"""

BODY = """## What was tried

**Files** ([trust/inputs.py](../trust/inputs.py), [mutations](../trust/mutations.py)): problem and
anatomy files made up at random - one to four steps, targets of every kind, wraps, logs, pulls,
bounds down to none, trunks of one to four segments with no muscle or many - and then damaged: keys
dropped, doubled or renamed, types changed, numbers at the edge (NaN, infinities, 1e308, 10^400),
bytes flipped, files cut off. Saved plans likewise. Each must be refused in two seconds of processor
time, with the file's name, or be planned; there is no third outcome.

**Saved files** ([trust/damaged.py](../trust/damaged.py)): solution.nc and resume.npz with bytes
flipped, parts lost, headers that claim terabytes, records of wrong types, arrays beyond reason,
archives that are compressed or have more in them, pipes and devices in their place. Each must be
refused in a second and in 300 MB, or be what it says; no other file may change.

**Answers** ([trust/answers.py](../trust/answers.py)): every plan that calls itself solved is
judged from the text of its file alone: targets and bounds are worked out again, and every shape is
held against the equilibrium that scipy's `solve_bvp` finds next to it
([trust/judge.py](../trust/judge.py)), with nothing of the code that planned or verified.

**Equilibria** ([trust/equilibria.py](../trust/equilibria.py)): trunks of 10 mm to 10 m, cylinders
to near cones, soft and stiff, under thrusts and pulls far beyond what they would bear. Every shape
that statics finds, and every plan, is held against scipy's `solve_bvp` on equations of its own:
nothing that is no equilibrium may be called one, and no plan that is one may fail the check.

**Faults** ([trust/faults.py](../trust/faults.py)): runs are ended at random moments - `kill -9`,
Ctrl-C, two of them, no room left for a file - one to three times, and resumed by `--resume`.
The result is compared bit by bit with that of a run nothing stopped.

**Interrupts** ([trust/interrupts.py](../trust/interrupts.py)): every command, and `plan_motion` in
a script and in a session, gets Ctrl-C at random moments, once, twice, or SIGTERM in its place. It
must end with exit code 4 (or that of a run that was over), within a second of the second Ctrl-C,
without a traceback, and no saved plan may say that it is finished where it is not.

**Between time steps** ([trust/between.py](../trust/between.py)): the fruit motion at {between}
instants against a two-point solution in scipy, with the loads that the paper prescribes.

**Validation** ([docs/validation.md](validation.md)): closed forms, published figures, balances,
symmetries and limits, each to a tolerance with its reason.

Beyond these, tests/cli/test_faults.py and tests/cli/test_hostile.py hold, one by one: a full disk
at every writer, a folder that cannot be written, two runs into one folder, a missing linear
solver, compiler or font, locales with comma decimals, output in ASCII, no terminal, a closed
pipe, devices and pipes in place of files, code in file contents.
tests/planning/test_determinism.py: the same bits whatever the thread settings, hash seed, folder
or what was planned before.

## How a plan can end

The text of a status is what the command prints; `plan_motion`, `load_plan` and `Replanner` raise
`PlanError` for all but the first unless given `throw=False`.

| status | text | exit code |
| --- | --- | --- |
{statuses}

[When a plan fails](how-to/when-it-fails.md) says what each means and what to do.

## What this does not show

Plans are local optima; that a target is called out of reach is not a proof. Contact with the head,
the log or the trunk itself is not modeled. Stability excludes static buckling, not flutter, where
a couple acts. The same bits are promised on one machine with one set of versions. One person's
machine tried all this.
"""


def _damaged(counts: Mapping[str, Any]) -> tuple[str, int, str, int]:
    """The row of saved files."""
    refused = sum(n for what, n in counts["outcomes"].items() if what.endswith("refused"))
    tried = sum(counts["tried"].values())
    came = (
        f"{refused} refused, the slowest in {counts['slowest']} s; {tried - refused} are what they "
        f"say; {counts['megabytes']} MB more memory in all"
    )
    return "saved plans and unfinished runs, damaged or hostile", tried, came, len(counts["faults"])


WORDS = {"interrupted": "stopped after 30 s"}  # by the trial itself


def _interrupts(counts: Mapping[str, Any]) -> list[tuple[str, int, str, int]]:
    """The row of interrupted commands, if any were."""
    if "interrupts" not in counts:
        return []
    told = counts["interrupts"]
    outcomes = "; ".join(f"{number} {name}" for name, number in told["outcomes"].items())
    slowest = f"{outcomes}; at most {told['slowest_second']} s from a second Ctrl-C to the end"
    return [("commands and calls interrupted", told["trials"], slowest, len(told["disagreements"]))]


def _equilibria(counts: Mapping[str, Any]) -> list[tuple[Any, ...]]:
    """Rows on extreme trunks, shapes and plans."""
    rows = []
    for kind, tally in ((kind, counts[kind]) for kind in ("shapes", "plans") if kind in counts):
        outcomes = ", ".join(
            f"{n} {name.replace('_', ' ')}" for name, n in tally["outcomes"].items()
        )
        told = f"{outcomes}; {tally['judged']} judged, {tally['undecided']} beyond the judge"
        tried = sum(tally["outcomes"].values())
        rows.append((f"{kind} of extreme trunks", tried, told, len(tally["faults"])))
    return rows


def _between(counts: Mapping[str, Any]) -> list[tuple[str, int, str, int]]:
    """The row of the fruit motion between its time steps, if it was integrated."""
    parts = counts.get("between", {}).values()
    if not parts:
        return []
    largest = 1e3 * max(part["largest_m"] for part in parts)
    wrong = sum(len(part["faults"]) for part in parts)
    said = f"at most {largest:.2g} mm from the independent solution"
    return [("instants of the fruit motion", _instants(counts), said, wrong)]


def _instants(counts: Mapping[str, Any]) -> int:
    return sum(part["instants"] for part in counts.get("between", {}).values())


def page(counts: Mapping[str, Any]) -> str:
    """The page."""
    inputs, faults, validation = counts["inputs"], counts["faults"], counts["validation"]
    outcomes = ", ".join(
        f"{number} {WORDS.get(name, name.replace('_', ' '))}"
        for name, number in sorted(inputs["outcomes"].items(), key=lambda item: -item[1])
    )
    injected = faults["faults_injected"]
    kinds = ", ".join(f"{number} {kind}" for kind, number in sorted(injected.items()))
    rows: list[tuple[Any, ...]] = [
        ("files, made up and damaged", inputs["tried"], outcomes, len(inputs["faults"])),
        (
            "answers called solved, checked by other means",
            inputs["checked"],
            "all hold" if not inputs["faults"] else "see the counts",
            len(inputs["faults"]),
        ),
        (
            f"faults in {faults['trials']} runs",
            sum(injected.values()),
            f"{kinds}; {faults['resumed']} resumed, {faults['survived']} runs ended with the same "
            f"{faults['bits_compared']:,} bits",
            len(faults["disagreements"]),
        ),
        *_interrupts(counts),
        *_equilibria(counts.get("equilibria", {})),
        *_between(counts),
        (
            "validation cases",
            validation["cases"],
            f"within tolerance; {validation['held_by_tests']} more held by tests of their own",
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

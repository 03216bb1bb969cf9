"""What contact costs: `make contact`, or `python -m benchmarks.contact [--repeats N]`.

Plans each motion with and without contact, by turns in one process and on one thread, and writes
results/contact.md. Times are CPU seconds of planning and of all checks, the median of the repeats
after a plan that is not counted; the command line adds no work but that of writing files.
"""

from __future__ import annotations

import argparse
import statistics
import time
from dataclasses import dataclass
from pathlib import Path

import trunk_ocp as to
from trunk_ocp.contact.gaps import Gap
from trunk_ocp.planning.status import Status

ROOT = Path(__file__).parent.parent
CONTACT = {  # None: as in the file
    "pick-fruit": "all",
    "feed-fruit": None,
    "lift-log": "all",
    "lift-log-asymmetric": "all",
    "lift-log-hung": None,
    "fruit-behind-posts": None,
    "tight-curl": None,
}
COLUMNS = (
    *("motion", "J", "worst point", "deepest without contact", "gap at least"),
    *("rows", "iterations", "CPU time", "ratio"),
)


@dataclass(frozen=True)
class Timed:
    """A plan, and the CPU seconds that it and its checks took."""

    plan: to.Plan
    seconds: float


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=3, help="plans of each kind")
    parser.add_argument("--only", default="", help="only motions whose name contains this word")
    parser.add_argument("--out", type=Path, default=ROOT / "results", help="folder of contact.md")
    options = parser.parse_args()
    lines = []
    for name in CONTACT:
        if options.only in name:
            lines.append(row(name, options.repeats))
            print(lines[-1], flush=True)
    if not options.only:
        options.out.mkdir(parents=True, exist_ok=True)
        head = [f"| {' | '.join(COLUMNS)} |", "|---" * len(COLUMNS) + "|"]
        (options.out / "contact.md").write_text("\n".join([*head, *lines]) + "\n")


def row(name: str, repeats: int) -> str:
    """The line of a motion: without contact -> with contact."""
    motion = to.load_motion(name)
    asked = motion.with_contact(CONTACT[name] or ",".join(sorted(motion.contact)))
    kinds = (asked.with_contact("none"), asked)
    runs = [[timed(kind) for kind in kinds] for _ in range(repeats + 1)][1:]
    free, kept = (run.plan for run in runs[0])
    before, after = (statistics.median(pair[k].seconds for pair in runs) for k in (0, 1))
    deepest = min(
        (gap for gap in free.clearance.all if gap.group in asked.contact), key=lambda gap: gap.gap
    )
    cells = (
        f"{free.objective.paper:.3g} → {kept.objective.paper:.3g}",
        f"{worst(free):.2g} → {worst(kept):.2g} mm",
        place(deepest) if deepest.gap < 0 else "-",
        f"{certified(kept):+.2f} mm",
        str(sum(map(len, kept.gaps.values()))),
        f"{free.iterations} → {kept.iterations}",
        f"{before:.1f} → {after:.1f} s",
        f"{after / before:.1f}",
    )
    failed = "" if kept.status is Status.SOLVED else f" ({kept.status.name})"
    return f"| `{name}`{failed} | {' | '.join(cells)} |"


def timed(motion: to.Motion) -> Timed:
    """Plan a motion and check it."""
    began = time.process_time()
    plan = to.plan_motion(motion, throw=False)
    plan.status, plan.clearance, plan.errors  # noqa: B018 (computed when first read)
    return Timed(plan, time.process_time() - began)


def worst(plan: to.Plan) -> float:
    """Largest distance from a target, in mm."""
    return 1e3 * max(float(errors.position.max(initial=0.0)) for errors in plan.errors)


def certified(plan: to.Plan) -> float:
    """No point of the trunk is closer than this to a body that it avoids, at any time, in mm."""
    gaps = [gap for gap in plan.clearance.all if gap.group in plan.motion.contact]
    return 1e3 * min(gap.bound - gap.least for gap in gaps)


def place(gap: Gap) -> str:
    """How deep the trunk is in what."""
    return f"{-1e3 * gap.gap:.0f} mm in {'itself' if gap.group == 'self' else 'the ' + gap.body}"


if __name__ == "__main__":
    main()

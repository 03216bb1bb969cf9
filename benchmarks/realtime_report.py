"""results/realtime.md from the figures of `realtime`."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from .run import machine, versions
from .targets import Target

Figures = dict[str, Any]
BUSY_LOAD = 0.5
"""Load average before a run beyond which the machine was not quiet."""
REPLAN_BARS = {"lift-log": (15, 30, 10), "pick-fruit": (30, 60, 20)}
"""p50, p99, and stretch target of p99 in ms."""
PLAN_BARS = {"lift-log": 0.8, "lift-log-asymmetric": 0.8, "pick-fruit": 1.2}
STEPS = {"lift-log": 10, "pick-fruit": 22}


def text(figures: Figures) -> str:
    """The whole page."""
    idle, busy = figures["idle"], figures.get("busy")
    rows = targets(idle)
    beside = {row.name: row for row in targets(busy)} if busy else {}
    table = [
        (
            row.name,
            row.value_text,
            beside[row.name].value_text if row.name in beside else "-",
            row.limit_text,
            {True: "yes", False: "**missed**", None: "-"}[row.met],
            row.stretch_text,
            row.stretch_met,
        )
        for row in [*rows, *others(figures)]
    ]
    header = ("what", "idle", "beside a busy core", "bar", "met", "stretch", "met")
    missed = sum(row[4] == "**missed**" for row in table)
    parts = [
        "# Real time",
        introduction(figures),
        f"## Bars\n\n{len(table) - missed} of {len(table)} bars are met by the idle machine.",
        markdown(header, table),
        "## Moved targets in a row",
        ROWS,
        *(in_a_row(*part) for part in named(idle, busy)),
        "## The control loop",
        LOOPS,
        *(loops(*part) for part in named(idle, busy)),
        "## Whole plans",
        *(plans(*part) for part in named(idle, busy)),
    ]
    return "\n\n".join(parts) + "\n"


def named(idle: Figures, busy: Figures | None) -> list[tuple[str, Figures]]:
    return [("Idle", idle)] + ([("Beside a busy core", busy)] if busy else [])


def introduction(figures: Figures) -> str:
    about, installed = machine(), versions()
    packages = ", ".join(f"{name} {installed[name]}" for name in ("casadi", "numpy", "numba"))
    quick = " **Few targets, for a quick look.**" if figures["quick"] else ""
    quiet = "" if figures["load"] < BUSY_LOAD else " **Other programs ran at the same time.**"
    return (
        f"`make realtime` on {about['cores']} cores of {about['processor']}, Python "
        f"{about['python']}, {packages}; {figures['seconds']:.0f} s. Load average before: "
        f"{figures['load']:.1f}.{quiet}{quick}"
    )


ROWS = """Targets move on a closed curve of a few cm, up to 3.2 mm a tick. Each re-plan starts from
the one before. `motion.shifted` builds each motion before its re-plan, and `plan.check()` checks
each after it (`plan.verification` where the deadline ended it); both are timed apart. Objectives of
a sample are divided by those of converged Ipopt from the same starts. A plan that calls itself
SOLVED and is more than 1 % worse is silently worse. By Ipopt: the path replaced, with the
multipliers of the last solve, to convergence."""

LOOPS = """Eight steps of 0.05 s, activations may change by 0.15 a step, and each tick carries out
the first step of its plan. A target is in reach if a plan of one step from the same state comes
within 0.1 mm. In the second loop the target is 2 m away for some ticks. Ipopt is stopped after
1 s."""


# --- bars --------------------------------------------------------------------------------------


def targets(part: Figures) -> list[Target]:
    """Bars of what is measured idle and busy."""
    rows = []
    for name, (p50, p99, stretch) in REPLAN_BARS.items():
        fast = part[name]["fast"]
        label = f"re-plan of {STEPS[name]} steps"
        rows += [
            Target(f"{label}, p50", fast["p50"], p50, unit="ms"),
            Target(f"{label}, p99", fast["p99"], p99, stretch, "ms"),
            Target(f"{label}: worst objective over Ipopt's", fast["worst_ratio"], 1.01, unit=""),
            Target(f"{label}: silently worse", fast["silent"], 0, unit=""),
            Target(f"{label}: largest violation of a bound", fast["violation"], 1e-6, unit=""),
        ]
    log, loop = part["lift-log"], part["loop"]
    rows += [
        Target("full re-plan with check", log["full"]["with_check"], 50, 40, "ms"),
        Target("check of a 10-step plan", log["full"]["check"], 15, unit="ms"),
        *(
            Target(f"whole plan, {name}", part["plans"][name][0], bar, 0.4)
            for name, bar in PLAN_BARS.items()
        ),
    ]
    for name, label in (("near", "loop"), ("far", "loop, target out of reach half-way")):
        rows += [
            Target(f"{label}: worst tip error in reach", loop[name]["error"], 0.1, unit="mm"),
            Target(f"{label}: latest beyond its deadline", loop[name]["late"], 5, unit="ms"),
        ]
    return rows


def others(figures: Figures) -> list[Target]:
    """Bars of what is measured once."""
    shapes, start = figures["shapes"], figures["start"]
    return [
        Target("`ShapeMap`, second process: first shape", shapes["later_process_wall_seconds"], 1),
        Target(
            "loaded shapes, two cores",
            shapes["per_second_2_threads"],
            25_000,
            100_000,
            "/s",
            at_least=True,
        ),
        Target("their largest error", shapes["error_in_L"], 1e-5, unit="L"),
        Target("`import trunk_ocp`, CPU", start["import"], 0.5),
        Target("`solve-motion --help`, CPU", start["help"], 0.6),
    ]


# --- details -----------------------------------------------------------------------------------


def in_a_row(title: str, part: Figures) -> str:
    header = (
        *("re-plans", "p50", "p99", "max", "CPU p50", "CPU p99", "iterations"),
        *("build", "check", "violation", "endings"),
    )
    rows, sentences = [], []
    for name in REPLAN_BARS:
        kinds = {
            f"under {part[name]['fast']['deadline']:.0f} ms": "fast",
            "to convergence": "full",
            "by Ipopt": "old",
        }
        for label, kind in kinds.items():
            one = part[name][kind]
            times = (one[key] for key in ("p50", "p99", "p100", "cpu_p50", "cpu_p99"))
            rows.append(
                (
                    f"{STEPS[name]} steps, {label}",
                    *(f"{value:.1f}" for value in times),
                    f"{one['iterations']:.1f}",
                    f"{one['built']:.1f}",
                    f"{one['check']:.1f}",
                    f"{one['violation']:.0e}",
                    endings(one),
                )
            )
        fast = part[name]["fast"]
        sentences.append(
            f"{STEPS[name]} steps: of {fast['sample']} re-plans, objectives over Ipopt's "
            f"{fast['median_ratio']:.4f} (median) and {fast['worst_ratio']:.4f} (worst); "
            f"{fast['worse']} more than 1 % worse, {fast['silent']} of them silently; "
            f"{fast['reference_failed']} without a reference, as Ipopt failed. "
            f"{fast['unfaultless']} of {fast['count']} fail the independent check."
        )
    body = markdown(header, rows)
    return "\n\n".join([f"{title}, times in ms:", body, *sentences])


def loops(title: str, part: Figures) -> str:
    header = (
        *("loop", "ticks", "in reach", "missed", "worst error, mm", "p50", "p99", "max"),
        *("ticks late by > 5 ms", "endings before the check"),
    )
    labels = {
        "near": "in reach",
        "far": "out of reach half-way",
        "old near": "in reach, by Ipopt",
        "old far": "out of reach half-way, by Ipopt",
    }
    rows = []
    for key, label in labels.items():
        one = part["loop"][key]
        rows.append(
            (
                label,
                *(str(one[name]) for name in ("ticks", "reachable", "missed")),
                f"{one['error']:.4f}",
                *(f"{one[name]:.1f}" for name in ("p50", "p99", "p100")),
                str(one["count_late"]),
                endings(one),
            )
        )
    return f"{title}, times in ms:\n\n{markdown(header, rows)}"


def plans(title: str, part: Figures) -> str:
    rows = [(name, f"{wall:.2f}", f"{cpu:.2f}") for name, (wall, cpu) in part["plans"].items()]
    return f"{title}, in s:\n\n{markdown(('plan', 'wall', 'CPU'), rows)}"


def endings(one: Figures) -> str:
    return ", ".join(f"{count} {name}" for name, count in one["endings"].most_common())


def markdown(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)

"""results/benchmarks.md from results/benchmarks.json: the targets, then every comparison."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

from .jobs import BUDGETS, METHODS, MOTIONS, OPTI, SEGMENTS, STEPS, WAYS, WHOLE
from .targets import ERRORS, targets

Parts = dict[str, dict[str, Any]]


def text(value: Any, digits: int = 3) -> str:
    """A figure for a table; a dash where there is none."""
    if value is None:
        return "-"
    if isinstance(value, float):
        large = abs(value) >= 1e4 or (value and abs(value) < 1e-3)
        return f"{value:.{digits - 1}e}" if large else f"{value:.{digits}g}"
    return str(value)


def table(head: list[str], rows: list[list[Any]]) -> list[str]:
    lines = ["| " + " | ".join(head) + " |", "|" + " --- |" * len(head)]
    return lines + ["| " + " | ".join(text(cell) for cell in row) + " |" for row in rows] + [""]


def times(parts: Parts, key: str, name: str, factor: float = 1.0) -> float | None:
    """A figure of a part, if it was measured."""
    value = parts.get(key, {}).get(name)
    return None if value is None else value * factor


def machine(document: dict[str, Any]) -> list[str]:
    about, versions = document["machine"], document["versions"]
    lines = ["# Benchmarks", "", "Made by `make bench`; every figure is of that one run."]
    if document["quick"]:
        lines += ["", "**A quick run: small budgets, few repeats. Not the figures to quote.**"]
    return [
        *lines,
        "",
        f"{about['processor']}, {about['cores']} cores, {about['system']}, Python "
        f"{about['python']}; load before {about['load_before']:.2f}. "
        + ", ".join(f"{name} {number}" for name, number in versions.items())
        + f". Whole run: {document['seconds']:.0f} s.",
        "",
        "Every part ran alone in a process of its own, one thread each, unless it says two cores. "
        "Seconds are wall seconds, medians of several runs; errors are the largest distance "
        "between centerlines in units of L. The .json beside this page has CPU seconds and peak "
        "memory of every part.",
        "",
    ]


def targets_met(parts: Parts) -> list[str]:
    head = ["what", "measured", "target", "met", "stretch", "met"]
    verdict = {True: "yes", False: "**no**", None: "not measured"}
    rows = [
        [
            b.what,
            b.shown,
            b.target_shown,
            verdict[b.met] if b.target else "-",
            b.stretch_shown,
            b.stretch_met,
        ]
        for b in targets(parts)
    ]
    return ["## Targets", "", *table(head, rows)]


def forward(parts: Parts) -> list[str]:
    one, slow, bvp, exu, ela = (
        parts.get(k, {}) for k in ("single", "collocation", "bvp", "exudyn", "elastica")
    )
    mesh = f"{slow.get('elements')} elements of degree {slow.get('degree')}"
    # No error is known better than the reference.
    error = max((one[name] for name in ERRORS if name in one), default=None)
    same = "the paper's Kirchhoff rod"
    shears = "shears: another theory, so this is a difference, not an error"
    head = ["code", "theory", "seconds", "error or difference / L", "remarks"]
    rows = [
        ["ours, `ShapeMap`, cold", same, one.get("cold_seconds"), error,
         failure(one) or f"{one.get('steps')} steps of order 8; a process's first call, which "
         f"compiles, took {text(one.get('compilation_seconds'))} s"],
        ["ours, `ShapeMap`, warm", same, one.get("warm_seconds"), error,
         failure(one) or "from the shape for 0.01 more in every activation and angle"],
        ["ours, `ShapeMap.jacobian`", same, one.get("jacobian_seconds"), None,
         failure(one) or "30 columns, position and tangent at every step, after the shape"],
        ["ours, `solve_statics`, cold", same, slow.get("cold_seconds"), slow.get("error_in_L"),
         failure(slow) or f"{mesh}, last Newton step below {text(slow.get('newton_tolerance'))}"],
        ["ours, `tip_jacobian`", same, slow.get("jacobian_seconds"), None,
         failure(slow) or "30 columns, position and tangent of the tip, after the shape"],
        ["scipy `solve_bvp`, segments stacked, our exact Jacobian", same,
         bvp.get("seconds_exact_jacobian"), bvp.get("error_in_L"),
         failure(bvp) or f"tol {text(bvp.get('tolerance'))}, the loosest with an error as "
         f"small as ours; {bvp.get('nodes')} nodes"],
        ["the same, differenced Jacobian", same, bvp.get("seconds_differenced"),
         bvp.get("error_in_L"), failure(bvp) or "as one would write it first"],
        ["scipy `solve_bvp`, whole trunk", same, None, None, whole(parts)],
        ["EXUDYN, static", shears, exu.get("seconds"), exu.get("difference_in_L"),
         failure(exu) or f"{exu.get('elements')} geometrically exact beams; without shear "
         f"{text(exu.get('difference_without_shear_in_L'))}"],
        ["PyElastica, damped to rest", shears, ela.get("seconds"), ela.get("difference_in_L"),
         failure(ela) or f"{ela.get('elements')} elements; the first call took "
         f"{text(ela.get('compilation_seconds'))} s, more where its code is not compiled yet"],
    ]  # fmt: skip
    lines = [
        "## Forward: one loaded shape",
        "",
        "Random contractions, weight and 8 kg at the tip, cold from the unloaded shape. Errors are "
        "against 16 elements of degree 9, from which DOP853 started at the same m(0) differs by "
        f"{text(one.get('reference_error_in_L'))} L.",
        "",
        *table(head, rows),
    ]
    return [*lines, *batches(parts)]


def batches(parts: Parts) -> list[str]:
    head = ["batch", "shapes", "per second, one core", "two cores", "error / L", "peak MB"]
    rows = [
        [kind, p.get("shapes"), whole_number(p.get("per_second_one_core")),
         whole_number(p.get("per_second_two_cores")), p.get("error_in_L"), p.get("peak_memory_mb")]
        for kind in ("loaded", "unloaded")
        for p in [parts.get(kind, {})]
    ]  # fmt: skip
    closed = whole_number(parts.get("unloaded", {}).get("per_second_numpy"))
    note = (
        f"Unloaded: tip poses, one step a segment, 20,000 at a time. Without numba "
        f"(`unloaded_states`, 1,000 at a time): {closed} per second, one core. Peak memory "
        f"includes the reference's."
    )
    return ["## Forward: batches", "", *table(head, rows), note, ""]


def whole_number(value: float | None) -> str:
    return "-" if value is None else f"{value:,.0f}"


def whole(parts: Parts) -> str:
    figures = parts.get("bvp-whole", {})
    return failure(figures) or (
        f"{figures.get('converged')} of {figures.get('shapes')} converge across the jumps "
        f"(tol {text(figures.get('tolerance'))}, {figures.get('max_nodes')} nodes)"
    )


def failure(figures: dict[str, Any]) -> str | None:
    return figures.get("failed") if figures else "not run"


def inverse(parts: Parts) -> list[str]:
    head = ["motion", "method", "J", "objective", "seconds", "set-up", "derivatives",
            "linear algebra", "iterations", "CPU s", "peak MB", "remarks"]  # fmt: skip
    rows: list[list[Any]] = []
    for motion in MOTIONS:
        names = {f"{mode} {motion}": f"ours, {mode}" for mode in ("sequential", "horizon")}
        names |= {f"{way} {motion}": NLP[way] for way in (*WAYS, *OPTI)}
        names |= {
            f"{method} {motion} {budget} s": f"{PAPER[method]}, {budget} s"
            for method in METHODS
            for budget in BUDGETS
            if f"{method} {motion} {budget} s" in parts
        }
        for key, name in names.items():
            p = parts.get(key, {})
            remark = failure(p) or p.get("status") or f"{p.get('evaluations')} loaded shapes"
            rows.append(
                [motion, name, *(p.get(n) for n in COLUMNS), p.get("peak_memory_mb"), remark]
            )
    return [
        "## Inverse: whole motions",
        "",
        "J is the paper's, un-squared, summed over the steps, and never what we minimize; "
        "`objective` is what all horizons minimize. Seconds include every start a method needs: "
        "the horizon's is the sequential plan, of a tolerance of 1e-5 in ours and of 1e-8 in the "
        "rows below, whose iterations do not count it. The NLPs given to `nlpsol` are ours, "
        "start and Ipopt options included, with or without our derivatives; their graph is ours, "
        "of mapped functions. With Opti the same horizon is written out by hand, in loops over "
        "steps, elements and Gauss points, from the same start. CPU seconds are of the whole "
        "process, repeats included. The paper's method and our sequential mode keep appendix B's "
        "sets step by step, a horizon bounds changes between steps instead. The paper's method "
        "has a budget of seconds, in equal parts for each step, a quarter of it for auxiliary "
        "problems; it takes our forward solve, and NOMAD, which evaluates in batches, goes "
        "without its quadratic models, having reached more without them.",
        "",
        *table(head, rows),
        "![J against seconds](benchmarks-inverse.png)",
        "",
        "Dots are what the paper's method ends with, one for each budget; the thin line is how "
        "the longest run got there, a step not begun counting with the passive trunk's J.",
        "",
        "## Re-planning after every target moved 1 cm",
        "",
        *table(
            ["motion", "iterations", "most", "seconds", "longest", "of it Ipopt",
             "verified, of 6 out", "converged, out and back"],
            [
                [motion, *(p.get(n) for n in REPLAN), f"{p.get('converged')} of {p.get('of')}"]
                for motion in MOTIONS
                for p in [parts.get(f"replan {motion}", {})]
            ],
        ),
    ]  # fmt: skip


NLP = {
    "ours": "the horizon's one NLP, our derivatives",
    "expand": "the same, `nlpsol`, expand on",
    "plain": "the same, `nlpsol`, expand off",
    "opti-expand": "CasADi Opti, written out by hand, expand on",
    "opti-plain": "CasADi Opti, written out by hand, expand off",
}
PAPER = {"sbplx": "paper's: Sbplx step by step", "nomad": "paper's: NOMAD step by step"}
COLUMNS = ("J", "objective", "total_seconds", "setup_seconds", "derivative_seconds",
           "linear_algebra_seconds", "iterations", "cpu_seconds")  # fmt: skip
REPLAN = ("iterations", "worst_iterations", "seconds", "worst_seconds", "solve_seconds", "verified")


def scaling(parts: Parts) -> list[str]:
    lines = ["## Scaling", "", "Lift-log's horizon, the lift or the segments cut finer.", ""]
    for kind, sizes in (("steps", STEPS), ("segments", SEGMENTS)):
        first = times(parts, f"{kind} {sizes[0]}", "seconds_per_iteration")
        rows = []
        for size in sizes:
            p = parts.get(f"{kind} {size}")
            if p is None:
                continue
            each = p.get("seconds_per_iteration")
            linear = each / (first * p["size"] / sizes[0]) if first and each else None
            mesh = f"{p.get('elements')} of degree {p.get('degree')}"
            rows.append([p.get("size"), p.get("muscles"), mesh, p.get("verification_error_m"),
                         p.get("iterations"), each, linear, failure(p) or ""])  # fmt: skip
        head = [kind, "muscles", "elements", "verification of the start, m", "iterations",
                "seconds an iteration", "over linear growth", "remarks"]  # fmt: skip
        lines += table(head, rows)
    for p in (parts.get(f"whole {size}", {}) for size in WHOLE):
        if p:
            lines += [
                f"A trunk of {p.get('segments')} segments and {p.get('muscles')} muscles, lift-log "
                f"horizon: {failure(p) or p.get('status')}; {text(p.get('total_seconds'))} s, "
                f"{p.get('iterations')} iterations, {text(p.get('peak_memory_mb'))} MB, "
                f"verification {text(p.get('verification_error_m'))} m.",
                "",
            ]
    return lines


def main() -> None:
    source = Path(sys.argv[1])
    document = json.loads(source.read_text())
    parts = document["parts"]
    lines = [*machine(document), *targets_met(parts), *forward(parts), *inverse(parts)]
    lines += scaling(parts)
    source.with_suffix(".md").write_text("\n".join(lines).rstrip() + "\n")


if __name__ == "__main__":
    main()

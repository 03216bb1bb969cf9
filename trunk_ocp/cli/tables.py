"""Tables that the command line prints."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from typing import Any

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.console import Group
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from .._support.wording import rounded
from ..analysis.diagnosis import Diagnosis
from ..analysis.lookahead_study import SUFFICIENT_EXCESS, Foresight
from ..analysis.measures import DEFINITIONS, plan_measures
from ..analysis.multistart import SAME_PLAN_TOL, Optima, distance
from ..analysis.redundancy.activation_ranges import AT_REST
from ..analysis.redundancy.report import Redundancy, cost, largest
from ..dynamics.slowing import GRAVITY, PhaseInertia
from ..errors import InputError
from ..model.anatomy import Trunk
from ..model.muscle_effects import MEASURES, ranks, signs
from ..planning.plan import Plan
from ..planning.status import Status
from ..planning.verification import BOUND_TOL
from ..problem.mirror import mirrored_controls

COLUMNS = (
    "step", "time\ns", "phase", "worst\nmm", "mean\nmm", "direct.", "J_T", "psi_Z\ndeg",
    "psi_Y\ndeg", "check\nmm",
)  # fmt: skip
WORDS = ("", "phase", "way", "status", "muscle", "measure", "unit", "version", "found from")
"""Names of columns of words."""
MAX_DETAILS = 6  # of a finding, at the end of a run
MAX_PHASE_WIDTH = 20  # characters of a phase name in a table
MAX_ROWS = 12  # time steps; of longer motions only the first and last step of each phase


def step_table(plan: Plan) -> Table:
    """One row per time step; in long motions, the first and last step of each phase.

    Errors are those of the independently integrated shape; "check" is its distance from the
    planned shape.
    """
    motion = plan.motion
    cost = f"J = {plan.objective.paper:.3g}, {plan.iterations} iterations"
    caption = f"{cost}, {plan.total_seconds:.1f} s"
    table = _table(f"{motion.name}, {plan.mode}", COLUMNS, caption, dense=True)
    table.columns[COLUMNS.index("phase")].max_width = MAX_PHASE_WIDTH
    for t in _rows(plan):
        step, errors = motion.steps[t], plan.errors[t]
        table.add_row(
            str(t + 1),
            f"{step.time:.3f}",
            escape(motion.phases[step.phase].name),
            _number(errors.position, np.max, 1e3, ".2f"),
            _number(errors.position, np.mean, 1e3, ".2f"),
            _number(errors.direction, np.max, 1.0, ".4f"),
            f"{errors.paper:.3g}",
            f"{np.degrees(plan.head[t, 0]):.1f}",
            f"{np.degrees(plan.head[t, 1]):.1f}",
            f"{1e3 * plan.verification.position_difference[t]:.4f}",
        )
    return table


def _table(
    title: str, names: Sequence[str], caption: str | None = None, dense: bool = False
) -> Table:
    """A table with words left-aligned and numbers right-aligned.

    If `dense`, its columns keep their width and have little space between them.
    """
    table = Table(title=title, caption=caption, box=SIMPLE_HEAD)
    if dense:
        table.padding, table.pad_edge = 0, False
    if caption and "\n" in caption:
        table.caption_justify = "left"
    for name in names:
        table.add_column(name, justify="left" if name in WORDS else "right", no_wrap=dense)
    return table


def _rows(plan: Plan) -> Sequence[int]:
    count = len(plan.x)
    if count <= MAX_ROWS:
        return range(count)
    phases = [step.phase for step in plan.motion.steps[:count]]
    return [
        t
        for t in range(count)
        if t in (0, count - 1) or phases[t] != phases[t - 1] or phases[t] != phases[t + 1]
    ]


def _number(values: np.ndarray, reduce: Any, scale: float, form: str) -> str:
    return format(scale * reduce(values), form) if values.size else "-"


def history_table(diagnosis: Diagnosis) -> Table:
    """About ten iterations of the solve that failed."""
    names = ("iteration", "objective", "constraint violation", "optimality error")
    table = _table("progress of the failed solve", names)
    rows = diagnosis.history
    for k in np.unique(np.linspace(0, len(rows) - 1, 10).round().astype(int)).tolist():
        number, *values = rows[k]
        table.add_row(str(number), *(f"{value:.3g}" for value in values))
    return table


def slowing_table(plan: Plan, phases: Sequence[PhaseInertia], ratio: float) -> Table:
    """How long each phase is, and how long it has to be for inertia to be `ratio` of weight."""
    spec = plan.motion.spec
    slowed = sum(spec.phases[each.phase].duration * (each.factor - 1) for each in phases)
    whole = sum(phase.duration for phase in spec.phases)
    table = _table(
        f"{plan.motion.name}, {plan.mode}: inertia, which the plan leaves out",
        ("phase", "takes\ns", "inertia\n/ weight", "at\ns", "acceler.\ng", "slower\nby",
         "takes\nthen, s"),
        f"For inertia up to {ratio:g} of the weight it takes {whole + slowed:.4g} s instead of "
        f"{whole:.4g} s.",
        dense=True,
    )  # fmt: skip
    table.columns[0].max_width = MAX_PHASE_WIDTH
    for each in phases:
        phase = spec.phases[each.phase]
        table.add_row(
            escape(phase.name),
            f"{phase.duration:.4g}",
            f"{each.ratio:.2g}",
            f"{each.time:.3f}",
            f"{each.acceleration / GRAVITY:.2g}",
            f"{each.factor:.3g}",
            f"{phase.duration * each.factor:.4g}",
        )
    return table


def finding_lines(diagnosis: Diagnosis, brief: bool = False) -> Iterator[str]:
    """The findings of a diagnosis as lines; `brief` leaves long lists to `trunk-ocp explain`."""
    colors = {"failure": "red", "warning": "yellow", "note": "cyan"}
    for finding in diagnosis.findings:
        head = f"[{colors[finding.level]}]{finding.level}[/]: {escape(finding.what)}"
        if brief and finding.level != "failure":
            yield f"{head}: {escape('; '.join(finding.details))}"
            continue
        yield head
        details = finding.details[:MAX_DETAILS] if brief else finding.details
        yield from (f"    {escape(detail)}" for detail in details)
        if len(details) < len(finding.details):
            yield f"    and {len(finding.details) - len(details)} more; see trunk-ocp explain"
        if finding.advice:
            yield f"  [bold]{escape(finding.advice)}[/]"


MILLIMETERS = ("worst_position_error", "mean_position_error")


def comparison_table(figures: dict[str, dict[str, Any]]) -> Table:
    """Measures of two plans side by side."""
    table = _table("sequential vs. horizon", ("measure", *figures, "unit"))
    for name in next(iter(figures.values())):
        millimeters = name in MILLIMETERS
        unit = "mm" if millimeters else DEFINITIONS[name][0]
        values = (plan[name] for plan in figures.values())
        cells = (
            value if isinstance(value, str) else f"{1e3 * value if millimeters else value:.5g}"
            for value in values
        )
        table.add_row(name.replace("_", " "), *cells, unit)
    return table


def foresight_table(result: Foresight) -> Group:
    """How good each way to plan a motion is, and how it uses the muscles.

    comparison.json has more measures, and their definitions.
    """
    best_cost = result.curve.best.objective.total
    quality = _table(
        f"{result.motion.name}: the value of planning ahead",
        ("way", "status", "cost\n/ best", "J", "worst\nmm", "worst\ndirection", "seconds"),
        WAYS,
        dense=True,
    )
    use = _table(
        f"{result.motion.name}: muscle use",
        ("way", "effort", "rate\n1/s", "varia-\ntion", "largest\nchange", "turns", "at bound\ns",
         "beyond\nchange"),
        dense=True,
    )  # fmt: skip
    for name, m in result.measures.items():
        way = name.replace("paper, ", "").replace("lookahead", "ahead")
        quality.add_row(
            way,
            _short_status(m.status),
            f"{m.planner_objective / best_cost:.3f}" if best_cost else "-",
            f"{m.paper_objective:.3g}",
            rounded(1e3 * m.worst_position_error, 3),
            f"{m.worst_direction_error:.3g}",
            f"{m.seconds:.1f}",
        )
        use.add_row(
            way,
            f"{m.squared_activation:.4g}",
            f"{m.squared_rate:.3g}",
            f"{m.total_variation:.3g}",
            f"{m.largest_change:.2g}",
            str(m.reversals),
            f"{m.time_at_bound:.2g}",
            f"{m.change_excess:.1g}" if m.change_excess > BOUND_TOL else "-",
        )
    return Group(quality, use, Text(_sufficient(result), justify="center"))


def _sufficient(result: Foresight) -> str:
    """How many steps suffice, in a sentence, and to come how close to which plan."""
    curve, count = result.curve, len(result.motion.steps)
    if curve.sufficient is None:
        return "No lookahead suffices."
    sentence = (
        f"A lookahead of {curve.sufficient} of {count} steps comes within "
        f"{SUFFICIENT_EXCESS:.0%} of the best horizon's objective"
    )
    status = curve.best.status
    return f"{sentence}." if status is Status.SOLVED else f"{sentence} (horizon {status.value})."


SHORT_STATUS = {
    "unverified": "unverif.",
    "iteration_limit": "max iter",
    "time_limit": "deadline",
    "not_converged": "failed",
    "interrupted": "stopped",
    "infeasible": "infeas.",
}
"""Abbreviations of statuses that are too long for a column."""


def _short_status(status: str) -> str:
    return SHORT_STATUS.get(status, status)


WAYS = """\
paper: each step alone, tracking cost only, as in appendix B
same cost: each step alone, with the cost that all others minimize
ahead H: H steps at a time; 1 does not see the next step
blind from best: ahead 1, each step started from the best horizon
cost / best: tracking + effort + rate, relative to the best horizon"""


def survey_table(data: dict[str, Any]) -> Table:
    """One row per pair of limits: blind, blind from the best horizon, the best horizon."""
    table = _table(
        f"{data['problem']}: planning ahead under limits",
        ("max\nact.", "max\nrate", "blind", "\nmm", "\n/best", "from\nbest", "\nmm", "\n/best",
         "best", "\nmm", "steps\nahead"),
        "Worst errors in mm; costs relative to the best horizon. Blind: one step at a time. If it "
        "does better when started from the best horizon, it lacked a good start, not foresight.",
        dense=True,
    )  # fmt: skip
    for cell in data["cells"]:
        best = cell["best"]
        row = ["-" if limit is None else f"{limit:g}" for limit in cell["limits"].values()]
        for plan in (cell["lookaheads"]["1"], cell["blind_from_best"], best):
            row += [_short_status(plan["status"]), rounded(1e3 * plan["worst_position_error"], 3)]
            if plan is not best:
                row.append(f"{plan['planner_objective'] / best['planner_objective']:.3f}")
        table.add_row(*row, str(cell["sufficient_lookahead"] or "-"))
    return table


def optima_table(optima: Optima) -> Table:
    """One row per distinct optimum, the best first."""
    verdict = "is the best found" if optima.reported_is_best else "is NOT the best found"
    failed = f"; {len(optima.failed)} did not converge" if optima.failed else ""
    table = _table(
        f"{optima.reported.motion.name}, {optima.reported.mode}: distinct local optima",
        ("objective", "J", "worst, mm", "distance", "status", "found from"),
        f"{len(optima.plans)} starts{failed}. The reported plan {verdict}. "
        f"Plans that differ by at most {SAME_PLAN_TOL:g} in every activation and angle (rad) count "
        "as one. distance: largest difference from the best.",
    )
    best = optima.distinct[0].plan if optima.distinct else optima.reported
    for optimum in optima.distinct:
        m = plan_measures(optimum.plan)
        starts, mirrored = optimum.starts, _mirrored_row(optimum.plan, optima)
        some = ", ".join(starts[:3]) + (f" and {len(starts) - 3} more" if len(starts) > 3 else "")
        table.add_row(
            f"{m.planner_objective:.6g}",
            f"{m.paper_objective:.4g}",
            rounded(1e3 * m.worst_position_error, 4),
            f"{distance(optimum.plan.x, best.x):.3g}",
            _short_status(m.status),
            some + (f"; mirror image of row {mirrored}" if mirrored else ""),
        )
    return table


def _mirrored_row(plan: Plan, optima: Optima) -> int:
    """Row (from 1) of the better optimum that a plan is the mirror image of; 0 if none."""
    for row, optimum in enumerate(optima.distinct, 1):
        if optimum.plan is plan:
            return 0
        with suppress(InputError):  # a trunk without left-right symmetry
            image = mirrored_controls(plan.motion.trunk, optimum.plan.x)
            if distance(image, plan.x) <= SAME_PLAN_TOL:
                return row
    return 0


LEGEND = f"""\
For the planned shapes, unchanged (without sign):
must work: needed at some step (at least {AT_REST:g})
free: could rest at any one step, but not at all
can be off: could rest throughout, one muscle at a time
determined: has no freedom at any step
range: possible activations, narrowest and widest step
at least: what the muscle must do at some step
plan, effort, fewest max: largest activation as planned,
  with least effort, and with fewest muscles"""
LEGEND_NEEDED = """
For the task, with other shapes allowed:
cost without: objective relative to the plan's
worst: largest distance to a target; !: not solved"""


def redundancy_table(result: Redundancy) -> Table:
    """How much freedom a motion leaves each muscle; activations without sign."""
    plan, free = result.plan, result.freedom
    needs = {need.muscles: need for need in result.needs}
    table = _table(
        f"{plan.motion.name}, {plan.mode}: the same motion with other muscles",
        ("muscle", "", "narrow\nrange", "wide\nrange", "at\nleast", "plan\nmax", "effort\nmax",
         "fewest\nmax", *(("cost\nwithout", "worst\nmm") if needs else ())),
        LEGEND + (LEGEND_NEEDED if needs else ""),
        dense=True,
    )  # fmt: skip
    peaks = [
        largest(result.versions[version]) for version in ("plan", "least effort", "fewest muscles")
    ]
    for i, (name, kind) in enumerate(zip(plan.motion.trunk.muscles, free.kinds, strict=True)):
        width, least = free.width[:, i], free.least_work[:, i].max()
        cells = [
            f"{width.min():.3f}",
            f"{width.max():.3f}",
            f"{least:.3g}" if least > AT_REST else "-",
        ]
        cells += [f"{peak[i]:.3f}" if peak[i] > 0 else "-" for peak in peaks]
        if (name,) in needs:
            need = needs[name,]
            worst = f"{1e3 * need.worst_position_error:.2f}"
            cells += [f"x {need.ratio:.3f}", worst + ("" if need.status == "solved" else " !")]
        table.add_row(name, kind, *cells)
    return table


def version_table(result: Redundancy) -> Table:
    """Cost of each set of activations that gives the planned shapes."""
    costs = {name: cost(version) for name, version in result.versions.items()}
    names = ("version", *(name.replace("_", "\n") for name in costs["plan"]))
    table = _table("activations that give the same shapes", names)
    for name, values in costs.items():
        table.add_row(name, *(f"{value:.5g}" for value in values.values()))
    return table


def sign_table(trunk: Trunk) -> Table:
    """The paper's Table 2."""
    table = Table(
        *("muscle", "side", *MEASURES, "isolated torsion"),
        title="Effect of a contraction (Table 2)",
        caption="zeta extension; u1, u2 bending around d1 (dorsal), d2 (right); u3 twist",
        box=SIMPLE_HEAD,
    )
    words = {-1: "< 0", 0: "= 0", 1: "> 0", 2: "differs"}
    for group, sides in signs(trunk).items():
        for side, row in sorted(sides.items(), reverse=True):
            table.add_row(group, side, *(words[sign] for sign in row))
    return table


def rank_table(trunk: Trunk) -> Table:
    """The paper's Table 3."""
    title = "Muscles from strongest to weakest (Table 3)"
    table = Table("segment", *MEASURES, title=title, box=SIMPLE_HEAD)
    for number, columns in enumerate(ranks(trunk), 1):
        cells = [
            ", ".join(strong) + (f" (none: {', '.join(zero)})" if zero else "")
            for strong, zero in (columns[measure] for measure in MEASURES)
        ]
        table.add_row(str(number), *cells)
    return table

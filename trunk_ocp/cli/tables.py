"""What the command line shows: live progress while planning, tables when done."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from types import TracebackType
from typing import Any

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.console import Console, Group
from rich.markup import escape
from rich.status import Status as Spinner
from rich.table import Table
from rich.text import Text

from ..analysis.diagnosis import Diagnosis
from ..analysis.lookahead_study import SUFFICIENT_EXCESS, Foresight
from ..analysis.measures import DEFINITIONS, plan_measures
from ..analysis.multistart import SAME_PLAN_TOL, Optima, distance
from ..analysis.redundancy import Redundancy
from ..analysis.redundancy.activation_ranges import AT_REST
from ..analysis.redundancy.report import cost, largest
from ..errors import InputError
from ..model.anatomy import Trunk
from ..model.muscle_effects import MEASURES, ranks, signs
from ..planning.plan import Plan, Status
from ..planning.verification import SLACK
from ..problem.mirror import mirrored_unknowns
from ..problem.motion import Motion
from ..reporting import Progress, Reporter

COLUMNS = (
    "step", "time\ns", "phase", "worst\nmm", "mean\nmm", "direct.", "J_T", "psi_Z\ndeg",
    "psi_Y\ndeg", "check\nmm",
)  # fmt: skip
MOST_DETAILS = 6  # of a finding, at the end of a run
LONGEST_PHASE = 20  # letters of its name in a table
LONG_MOTION = 12  # steps; beyond, a table shows the first and last of each phase only


class Screen(Reporter):
    """Progress on a console: one live line on a terminal, a line for each solve elsewhere."""

    def __init__(self, console: Console, motion: Motion) -> None:
        self.console, self.motion = console, motion
        self.began = time.perf_counter()
        self.shown = ""
        self.total = 0
        self.stopping = False  # whether this was shown
        self.spinner: Spinner | None = None

    def __enter__(self) -> Screen:
        steps, muscles = len(self.motion.steps), len(self.motion.trunk.muscles)
        title = escape(self.motion.spec.title or self.motion.name)
        self.console.print(f"[bold]{title}[/]: {steps} time steps, {muscles} muscles")
        if self.console.is_terminal:
            self.spinner = self.console.status("setting up")
            self.spinner.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._show_stopping()
        if self.spinner is not None:
            self.spinner.stop()

    def iteration(self, progress: Progress) -> None:
        """Show where the plan stands."""
        self.total += 1
        seconds = time.perf_counter() - self.began
        if self.spinner is not None:
            self.spinner.update(
                f"{progress.stage}: {progress.detail} | iteration {progress.iteration} | "
                f"worst error {1e3 * progress.worst_error:.2f} mm | infeasibility "
                f"{progress.infeasibility:.0e} | {seconds:.1f} s"
            )
        line = progress.stage if progress.first == progress.last else progress.detail
        if line != self.shown:  # a line for all single steps together, one for each window
            self.shown = line
            self.console.print(f"[dim]{seconds:6.1f} s  {line}[/]")
        self._show_stopping()

    def note(self, text: str) -> None:
        """Show a sentence."""
        self.console.print(text, markup=False)

    def _show_stopping(self) -> None:
        """Answer a request to stop; not where it comes in, which may be amid another print."""
        if self.stop and not self.stopping:
            self.stopping = True
            self.note("Stopping; the best so far will be saved.")


def step_table(plan: Plan) -> Table:
    """One row for each time step; for long motions the first and last of each phase.

    Errors are those of the independently integrated shape; "check" is how far the planned
    one is from it.
    """
    motion = plan.motion
    table = Table(
        title=f"{motion.name}, {plan.mode}",
        caption=_caption(plan),
        box=SIMPLE_HEAD,
        padding=0,
        pad_edge=False,
    )
    for name in COLUMNS:
        if name == "phase":
            table.add_column(name, no_wrap=True, max_width=LONGEST_PHASE, overflow="ellipsis")
        else:
            table.add_column(name, justify="right", no_wrap=True)
    for t in _shown(plan):
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


def _caption(plan: Plan) -> str:
    return (
        f"J = {plan.objective.paper:.3g}, {plan.iterations} iterations, {plan.total_seconds:.1f} s"
    )


def _shown(plan: Plan) -> Sequence[int]:
    count = len(plan.x)
    if count <= LONG_MOTION:
        return range(count)
    phases = [step.phase for step in plan.motion.steps[:count]]
    return [
        t
        for t in range(count)
        if t in (0, count - 1) or phases[t] != phases[t - 1] or phases[t] != phases[t + 1]
    ]


def _number(values: np.ndarray, of: Any, scale: float, form: str) -> str:
    return format(scale * of(values), form) if values.size else "-"


def history_table(diagnosis: Diagnosis) -> Table:
    """How the solve that failed went: some ten of its iterations."""
    table = Table(title="how the solve went", box=SIMPLE_HEAD)
    for name in ("iteration", "objective", "constraints off by", "slope left"):
        table.add_column(name, justify="right")
    rows = diagnosis.history
    for k in np.unique(np.linspace(0, len(rows) - 1, 10).round().astype(int)).tolist():
        number, *values = rows[k]
        table.add_row(str(number), *(f"{value:.3g}" for value in values))
    return table


def findings(diagnosis: Diagnosis, brief: bool = False) -> Iterator[str]:
    """The findings of a diagnosis as lines; `brief` leaves the long tail to `trunk-ocp explain`."""
    colors = {"failure": "red", "warning": "yellow", "note": "cyan"}
    for finding in diagnosis.findings:
        head = f"[{colors[finding.level]}]{finding.level}[/]: {escape(finding.what)}"
        if brief and finding.level != "failure":
            yield f"{head}: {escape('; '.join(finding.details))}"
            continue
        yield head
        told = finding.details[:MOST_DETAILS] if brief else finding.details
        yield from (f"    {escape(detail)}" for detail in told)
        if len(told) < len(finding.details):
            yield f"    and {len(finding.details) - len(told)} more, told by trunk-ocp explain"
        if finding.advice:
            yield f"  [bold]{escape(finding.advice)}[/]"


MILLIMETERS = ("worst_position_error", "mean_position_error")


def comparison_table(figures: dict[str, dict[str, Any]]) -> Table:
    """Measures of two plans side by side."""
    table = Table(title="sequential against horizon", box=SIMPLE_HEAD)
    table.add_column("measure")
    for mode in figures:
        table.add_column(mode, justify="right")
    table.add_column("unit")
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
    """How good each way of planning a motion is, and how it uses the muscles.

    comparison.json has more, and definitions.
    """
    least = result.curve.best.objective.total
    quality = _plain_table(
        f"{result.motion.name}: what foresight is worth",
        ("way", "status", "cost\n/ best", "J", "worst\nmm", "worst\ndirection", "seconds"),
        WAYS,
    )
    use = _plain_table(
        f"{result.motion.name}: how the muscles are used",
        ("way", "effort", "rate\n1/s", "varia-\ntion", "largest\nchange", "turns", "at bound\ns",
         "beyond\nchange"),
    )  # fmt: skip
    for name, m in result.measures.items():
        way = name.replace("paper, ", "").replace("lookahead", "ahead")
        quality.add_row(
            way,
            _ending(m.status),
            f"{m.planner_objective / least:.3f}" if least else "-",
            f"{m.paper_objective:.3g}",
            f"{1e3 * m.worst_position_error:.3g}",
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
            f"{m.change_excess:.1g}" if m.change_excess > SLACK else "-",
        )
    return Group(quality, use, Text(_sufficient(result), justify="center"))


def _sufficient(result: Foresight) -> str:
    """How many steps suffice, in a sentence, and what they suffice for."""
    curve, count = result.curve, len(result.motion.steps)
    if curve.sufficient is None:
        return "No lookahead suffices."
    told = (
        f"Knowing {curve.sufficient} of {count} steps comes within {SUFFICIENT_EXCESS:.0%} of the "
        "best horizon's objective"
    )
    ending = curve.best.status
    return (
        f"{told}." if ending is Status.SOLVED else f"{told}, which is not solved: {ending.value}."
    )


SHORTER = {
    "unverified": "unverif.",
    "iteration_limit": "stopped",
    "not_converged": "failed",
    "interrupted": "halted",
    "infeasible": "infeas.",
}
"""Words for endings that are too long for a column."""


def _ending(status: str) -> str:
    return SHORTER.get(status, status)


WAYS = """\
paper: each step alone, tracking only, as in appendix B
same cost: the paper's way, with effort and rate weighed as in all others
ahead H: H steps at a time; 1 is blind to the next step
blind from best: ahead 1, each step started from the best horizon's
cost / best: tracking + effort + rate over the best horizon's"""


def _plain_table(title: str, names: Sequence[str], caption: str | None = None) -> Table:
    """A dense table whose columns keep their width; words to the left, numbers to the right."""
    table = Table(title=title, caption=caption, box=SIMPLE_HEAD, padding=0, pad_edge=False)
    for name in names:
        left = name in ("way", "status")
        table.add_column(name, justify="left" if left else "right", no_wrap=True)
    return table


def survey_table(data: dict[str, Any]) -> Table:
    """One row for each pair of limits: blind, blind from the best horizon, the best horizon."""
    table = Table(
        title=f"{data['problem']}: foresight under limits",
        caption="Worst errors in mm; objectives over the best horizon's. A blind solve that is "
        "better once it starts from the best horizon lacked a start, not foresight.",
        box=SIMPLE_HEAD,
        padding=0,
        pad_edge=False,
    )
    for name in (
        "act.\nmost", "rate\n1/s", "blind", "\nmm", "\n/best", "from\nbest", "\nmm", "\n/best",
        "best", "\nmm", "steps\nahead",
    ):  # fmt: skip
        table.add_column(name, justify="right", no_wrap=True)
    for cell in data["cells"]:
        best = cell["best"]
        row = ["-" if limit is None else f"{limit:g}" for limit in cell["limits"].values()]
        for plan in (cell["lookaheads"]["1"], cell["blind_from_best"], best):
            row += [_ending(plan["status"]), f"{1e3 * plan['worst_position_error']:.3g}"]
            if plan is not best:
                row.append(f"{plan['planner_objective'] / best['planner_objective']:.3f}")
        table.add_row(*row, str(cell["sufficient_lookahead"] or "-"))
    return table


def optima_table(found: Optima) -> Table:
    """One row for each distinct optimum, the best first."""
    verdict = "is the best found" if found.reported_is_best else "is NOT the best found"
    failed = f"; {len(found.failed)} found nothing" if found.failed else ""
    table = Table(
        title=f"{found.reported.motion.name}, {found.reported.mode}: distinct local optima",
        caption=f"{len(found.plans)} starts{failed}. The reported plan {verdict}. "
        f"Plans within {SAME_PLAN_TOL:g} in every activation and angle (rad) count as one.",
        box=SIMPLE_HEAD,
    )
    for name in ("objective", "J", "worst, mm", "away", "status", "found from"):
        table.add_column(name, justify="left" if name == "found from" else "right")
    best = found.distinct[0].plan if found.distinct else found.reported
    for optimum in found.distinct:
        m = plan_measures(optimum.plan)
        starts, twin = optimum.starts, _mirror_of(optimum.plan, found)
        some = ", ".join(starts[:3]) + (f" and {len(starts) - 3} more" if len(starts) > 3 else "")
        table.add_row(
            f"{m.planner_objective:.6g}",
            f"{m.paper_objective:.4g}",
            f"{1e3 * m.worst_position_error:.4g}",
            f"{distance(optimum.plan.x, best.x):.3g}",
            _ending(m.status),
            some + (f"; mirror image of row {twin}" if twin else ""),
        )
    return table


def _mirror_of(plan: Plan, found: Optima) -> int:
    """Row (from 1) of a better optimum whose mirror image a plan is; 0 if there is none."""
    for row, optimum in enumerate(found.distinct, 1):
        if optimum.plan is plan:
            return 0
        with suppress(InputError):  # of a trunk that has no other side
            if (
                distance(mirrored_unknowns(plan.motion.trunk, optimum.plan.x), plan.x)
                <= SAME_PLAN_TOL
            ):
                return row
    return 0


LEGEND = f"""\
For the planned shapes, kept as they are:
must work: cannot rest at some step (below {AT_REST:g} is rest)
free: could rest at any step, not at all of them
can be off: could rest throughout; each alone, not all together
determined: has no choice at any step
range: width at the steps where it is least and most
at least: what the muscle must do at some step
most: largest activation of each version"""
LEGEND_NEEDED = """
For the task, other shapes allowed:
cost without: the objective without this muscle over the plan's
worst: largest distance to a target then; !: not solved"""


def redundancy_table(found: Redundancy) -> Table:
    """What a motion leaves each muscle free to do; activations without sign."""
    plan, free = found.plan, found.freedom
    table = Table(
        title=f"{plan.motion.name}, {plan.mode}: the same motion by other muscles",
        caption=LEGEND + (LEGEND_NEEDED if found.needs else ""),
        box=SIMPLE_HEAD,
        padding=0,
        pad_edge=False,
    )
    table.add_column("muscle", no_wrap=True)
    table.add_column("", no_wrap=True)
    needs = {need.muscles: need for need in found.needs}
    asked = ("cost\nwithout", "worst\nmm") if needs else ()
    for name in ("narrow\nrange", "wide\nrange", "at\nleast", "plan\nmost", "effort\nmost",
                 "fewest\nmost", *asked):  # fmt: skip
        table.add_column(name, justify="right", no_wrap=True)
    peaks = [
        largest(found.versions[version]) for version in ("plan", "least effort", "fewest muscles")
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


def version_table(found: Redundancy) -> Table:
    """What each version of a motion costs."""
    table = Table(title="the same shapes", box=SIMPLE_HEAD)
    table.add_column("version")
    costs = {name: cost(version) for name, version in found.versions.items()}
    for name in costs["plan"]:
        table.add_column(name.replace("_", "\n"), justify="right")
    for name, values in costs.items():
        table.add_row(name, *(f"{value:.5g}" for value in values.values()))
    return table


def sign_table(trunk: Trunk) -> Table:
    """The paper's Table 2."""
    table = Table(
        title="Effect of a contraction (Table 2)",
        caption="zeta extension; u1, u2 bending around d1 (dorsal), d2 (right); u3 twist",
        box=SIMPLE_HEAD,
    )
    for name in ("muscle", "side", *MEASURES, "isolated torsion"):
        table.add_column(name)
    words = {-1: "< 0", 0: "= 0", 1: "> 0", 2: "differs"}
    for group, sides in signs(trunk).items():
        for side, row in sorted(sides.items(), reverse=True):
            table.add_row(group, side, *(words[sign] for sign in row))
    return table


def rank_table(trunk: Trunk) -> Table:
    """The paper's Table 3."""
    table = Table(title="Muscles from strongest to weakest (Table 3)", box=SIMPLE_HEAD)
    for name in ("segment", *MEASURES):
        table.add_column(name)
    for number, columns in enumerate(ranks(trunk), 1):
        cells = [
            ", ".join(strong) + (f" (none: {', '.join(zero)})" if zero else "")
            for strong, zero in (columns[measure] for measure in MEASURES)
        ]
        table.add_row(str(number), *cells)
    return table

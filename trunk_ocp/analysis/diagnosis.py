"""Diagnosis of a plan: why it failed and what to try, or which bounds it pushes against.

Failures name and locate the constraints that do not hold and the bounds that would have to be
relaxed. A solved plan comes with its active bounds and the effect of relaxing each a little.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from .._support.arguments import check_arguments
from .._support.atomic_files import write
from .._support.blas_threads import one_thread
from .._support.wording import rounded, step_list
from ..dynamics.slowing import warnings as inertia_warnings
from ..model.anatomy import Trunk
from ..nlp.outcome import Solve
from ..nlp.violations import Violation
from ..planning.plan import Plan
from ..planning.status import Status
from ..planning.storage import finite
from ..planning.verification import BOUND_TOL, MAX_TURN
from ..problem.motion import Motion
from ..problem.plausibility import POINTED
from ..reporting import Reporter
from .bound_sensitivity import Response, responses
from .elastic_bounds import PHYSICAL, Excess, contradictions, in_words, nearest, reach
from .free_choices import held_heads, one_sided
from .reached_bounds import AT_BOUND_TOL, at_bounds, change_excess

MAX_NAMES = 6  # of muscles listed in one warning
CLOSE = 1e-3  # gap over the trunk's length up to which a body counts as touched
LOW_MARGIN = 0.2  # buckling margin below which a plan gets a warning

MEANINGS = {
    "Infeasible_Problem_Detected": "no nearby point satisfies the constraints better",
    "Maximum_Iterations_Exceeded": "the iteration limit was reached",
    "Restoration_Failed": "the search for a feasible point failed",
    "Invalid_Number_Detected": "a value overflowed; a load or a stiffness has an implausible size",
    "Search_Direction_Becomes_Too_Small": "steps became too small to make progress",
    "Diverging_Iterates": "the unknowns grew without bound",
}
"""Meaning of the optimizer's failure messages."""


@dataclass(frozen=True)
class Finding:
    """One finding about a plan, with details and advice.

    `items` are the numbers behind the details, if any: violations or excesses.
    """

    level: Literal["failure", "warning", "note"]
    what: str
    details: tuple[str, ...] = ()
    advice: str = ""
    items: tuple[Violation | Excess, ...] = ()

    def __str__(self) -> str:
        lines = [f"{self.level}: {self.what}", *(f"    {detail}" for detail in self.details)]
        return "\n".join([*lines, *([f"  {self.advice}"] if self.advice else [])])


@dataclass(frozen=True)
class Diagnosis:
    """All findings about a plan.

    Attributes
    ----------
    status : Status
    findings : tuple of Finding
        In the order failures, warnings, notes.
    history : tuple
        Of the failed solve: (iteration, objective, primal and dual infeasibility).
    responses : tuple of Response
        Effect of moving each active bound, the strongest first.
    """

    status: Status
    findings: tuple[Finding, ...]
    history: tuple[tuple[int, float, float, float], ...] = ()
    responses: tuple[Response, ...] = ()

    def __str__(self) -> str:
        return "\n".join([self.status.value, *map(str, self.findings)])

    def as_json(self) -> dict[str, Any]:
        """The diagnosis, ready for JSON."""
        return asdict(self) | {
            "status": self.status.name.lower(),
            "history": [
                dict(zip(("iteration", "objective", "infeasibility", "dual"), row, strict=True))
                for row in self.history
            ],
        }


@check_arguments
@one_thread()
def explain(plan: Plan, deep: bool = True, reporter: Reporter | None = None) -> Diagnosis:
    """Explain why a plan failed, or which bounds and choices shape it.

    Parameters
    ----------
    plan : Plan
    deep : bool
        Whether to solve for the bounds that would have to be relaxed, if a target is missed, and
        for the plan's response to its active bounds: one to a few seconds.
    reporter : Reporter, optional
        Receives the progress of these solves.

    Returns
    -------
    Diagnosis

    Raises
    ------
    InputError
        If an argument is of the wrong type.
    """
    findings = [*_failures(plan, deep, reporter), *_warnings(plan), *_choices(plan, deep, reporter)]
    history = plan.failure.history if plan.failure else ()
    rows = tuple((number, *row) for number, row in enumerate(history))
    responsive = deep and plan.verified and not plan.cut_short
    return Diagnosis(plan.check(), tuple(findings), rows, responses(plan) if responsive else ())


# --- failures ----------------------------------------------------------------------------


def _failures(plan: Plan, deep: bool, reporter: Reporter | None) -> Iterator[Finding]:
    if plan.status is Status.INTERRUPTED:
        advice = "Resume with --resume; from Python, with Checkpoint(path, resume=True)."
        yield Finding("failure", f"interrupted; {_kept(plan)}", (), advice)
        return
    if plan.status is Status.TIME_LIMIT:
        advice = "Allow more time, or continue from this plan: plan_motion(motion, start=plan)."
        yield Finding("failure", f"the deadline passed; {_kept(plan)}", (), advice)
        return
    if not plan.converged or len(plan.x) < len(plan.motion.steps):
        excesses = contradictions(plan.motion)
        if excesses:
            yield _contradicting(excesses, plan.motion)
        yield _not_converged(plan, advise=not excesses)
        return
    if plan.verification.faults:
        yield _unverified(plan)
        return  # further findings about its shapes would be unfounded
    if plan.collisions:
        yield _colliding(plan)
    if not np.all(plan.stability.stable):
        yield _unstable(plan)
    if plan.missed:
        yield _missed(plan)
        yield from _in_the_way(plan)
        if deep:
            relaxed = reach(plan, reporter)
            yield (
                _within_reach(relaxed, plan.motion)
                if relaxed is not None
                else _out_of_reach(plan, reporter)
            )


def _kept(plan: Plan) -> str:
    return f"{len(plan.x)} of {len(plan.motion.steps)} time steps are kept"


def _not_converged(plan: Plan, advise: bool) -> Finding:
    """How the failed solve ended, and advice from its residuals."""
    solve = plan.failure
    if solve is None:
        return Finding("failure", f"not converged, for an unrecorded reason; {_kept(plan)}")
    meaning = MEANINGS.get(solve.message, solve.message.replace("_", " ").lower())
    what = f"{solve.detail}: {meaning} (after {solve.iterations} iterations)"
    details = [str(violation) for violation in solve.violations]
    best = f"the point that is kept: objective {solve.objective:.3g}"
    if solve.violations:
        best += (
            f", constraints violated by {solve.infeasibility:.2g} in units of L, E I(0) / L and 1"
        )
    advice = _next_try(solve, len(plan.motion.steps)) if advise else ""
    details += [best] if solve.history else []
    return Finding("failure", what, tuple(details), advice, solve.violations)


def _next_try(solve: Solve, steps: int) -> str:
    """What to try next, judged by how the residuals fell."""
    if solve.message == "Invalid_Number_Detected":
        return "Check units: forces in N, lengths in m, moduli in Pa."
    residuals = [primal for _, primal, _ in solve.history]
    falling = len(residuals) > 10 and residuals[-1] < 0.1 * residuals[-11]
    if solve.message == "Maximum_Iterations_Exceeded" and (falling or len(residuals) < 50):
        return f"It was still converging: try --max-iterations {4 * solve.iterations}."
    if not solve.violations:
        return "All constraints hold, but the optimum is flat: try --max-iterations or --starts."
    if solve.first == solve.last and steps > 1:
        return "Plan the steps together (--mode horizon): a single step may run into a dead end."
    fewer = ", or plan fewer steps at a time (--lookahead 3)" if solve.last > 3 else ""
    return f"Try other starts (--starts 4){fewer}."


def _contradicting(excesses: tuple[Excess, ...], motion: Motion) -> Finding:
    return Finding(
        "failure",
        "the bounds contradict each other; the smallest changes that would reconcile them:",
        in_words(excesses, motion),
        "Loosen these in the problem file.",
        excesses,
    )


def _unverified(plan: Plan) -> Finding:
    advice = "Report this plan as a bug: planned and integrated shapes should agree."
    if not np.all(np.isfinite(plan.verification.position_difference)):
        return Finding(
            "failure", "the independent check failed", (_not_integrated(plan),), _cause(plan)
        )
    if plan.verification.too_coarse:
        advice = "The trunk bends too sharply for the mesh: reduce the loads, or set "
        advice += f"Options(elements=...) above {plan.mesh.elements}."
    if np.any(plan.verification.stretch <= 0):
        advice = "Reduce the loads, or check youngs_modulus and radii: a section collapses."
    if _pointed(plan.motion.trunk):
        advice += f" {_cause(plan)}"
    return Finding("failure", "the independent check failed", (*plan.verification.faults,), advice)


def _not_integrated(plan: Plan) -> str:
    bad = np.flatnonzero(~np.isfinite(plan.verification.position_difference))
    return f"{step_list((bad + 1).tolist())}: the planned shape cannot be integrated to the tip"


def _cause(plan: Plan) -> str:
    """The probable cause of shapes that are not finite, and what to do about it."""
    trunk = plan.motion.trunk
    if _pointed(trunk):
        tip = float(trunk.radius(trunk.length))
        return (
            f"The trunk ends almost in a point, of radius {rounded(tip)} m, which bends without "
            "limit: reduce taper_deg in its anatomy."
        )
    return "Loads or stiffness have an implausible size: check forces in N, moduli in Pa."


def _pointed(trunk: Trunk) -> bool:
    return float(trunk.taper(trunk.length)) < POINTED


def _unstable(plan: Plan) -> Finding:
    bad = np.flatnonzero(~plan.stability.stable)
    details = tuple(
        f"step {t + 1}: the trunk would fall in {index} direction{'s' * (index != 1)}, "
        f"margin {plan.stability.margin[t]:.3g}"
        for t, index in zip(bad.tolist(), plan.stability.index[bad].tolist(), strict=True)
    )
    return Finding(
        "failure",
        f"the trunk would not stay in its shape at {step_list((bad + 1).tolist())}",
        details,
        "Reduce the forces that push against the trunk, or hold more of its points by targets.",
    )


def _colliding(plan: Plan) -> Finding:
    return Finding(
        "failure",
        "the trunk collides with what it has to avoid",
        tuple(plan.collisions),
        "Show the way around: add a phase before it with a target there, or give the phase more "
        "time steps (steps, free_steps).",
    )


def _in_the_way(plan: Plan) -> Iterator[Finding]:
    """Bodies that the trunk touches at steps that miss a target."""
    close = CLOSE * plan.motion.trunk.length
    missed = {t for t, errors in enumerate(plan.errors) if errors.exceed(plan.motion.tolerance)}
    kept = {(t, row.body): row.least for t, rows in plan.gaps.items() for row in rows}
    touched: dict[str, set[int]] = {}
    for gap in plan.clearance.at_steps:
        least = kept.get((gap.step, gap.body))
        if gap.step in missed and least is not None and gap.gap <= least + close:
            touched.setdefault(gap.body, set()).add(gap.step + 1)
    if touched:
        details = tuple(
            f"{name}: in contact at {step_list(sorted(steps))}" for name, steps in touched.items()
        )
        yield Finding("failure", "bodies are in the way", details, "Move them or the targets.")


def _missed(plan: Plan) -> Finding:
    missed = plan.missed
    count = "a target is" if len(missed) == 1 else f"{len(missed)} targets are"
    advice = ""
    if plan.mode == "sequential" and len(plan.motion.steps) > 1:
        advice = "The horizon may reach targets that this blind plan cannot: --mode horizon."
    return Finding("failure", f"{count} missed", tuple(missed), advice)


def _out_of_reach(plan: Plan, reporter: Reporter | None) -> Finding:
    """No physically plausible bounds suffice: how near the trunk could come."""
    distance = nearest(plan, reporter)
    details: tuple[str, ...] = ()
    # Within the tolerance: a direction is missed instead, or this solve found another way.
    if distance is not None and distance > plan.motion.tolerance[0]:
        missed = f"{rounded(1e3 * distance, 4)} mm"
        details = (f"within these the worst position would still be missed by {missed}",)
    return Finding(
        "failure",
        f"no physically plausible bounds suffice ({PHYSICAL}): no motion near this plan reaches "
        "all targets within them",
        details,
        "Move the targets, or widen [tolerance].",
    )


def _within_reach(excesses: tuple[Excess, ...], motion: Motion) -> Finding:
    if not excesses:
        return Finding(
            "failure",
            "all targets can be reached within the bounds; the plan weighs them differently",
            (),
            "Give the missed targets more weight, or try other starts (--starts 4).",
        )
    what = "all targets would be reached if these bounds were relaxed:"
    advice = "Loosen these in the problem file, or move the targets."
    if sum(len(step.targets) for step in motion.steps) > 1:
        advice += (
            " A plan may still miss some in favor of others: give the missed ones more weight."
        )
    return Finding("failure", what, in_words(excesses, motion), advice, excesses)


# --- active bounds and free choices ------------------------------------------------------


def _warnings(plan: Plan) -> Iterator[Finding]:
    if not len(plan.x):
        return
    yield from _bodies_entered(plan)
    yield from _bounds_reached(plan)
    yield from _lengthened(plan)
    yield from _too_fast(plan)
    if plan.converged:
        yield from _barely_valid(plan)


def _bodies_entered(plan: Plan) -> Iterator[Finding]:
    """Bodies that the motion does not ask to avoid, and the trunk is in."""
    if not plan.collisions and (entered := plan.clearance.warnings):
        groups = {gap.group for gap in plan.clearance.all if gap.depth > 0}
        kinds = ",".join(sorted(groups | plan.motion.contact))
        advice = f"--contact {kinds} plans clear of them."
        yield Finding("warning", "the trunk passes through bodies", tuple(entered), advice)


def _bounds_reached(plan: Plan) -> Iterator[Finding]:
    """Unknowns at their bounds, those at the same steps together."""
    reached = at_bounds(plan)
    levels: tuple[tuple[str, Literal["warning", "note"], str], ...] = (
        ("contraction", "warning", "muscles at their bound of contraction"),
        ("lengthening", "warning", "muscles at their bound of lengthening"),
        ("extension", "warning", "segments at the limit of their extension"),
        ("head", "note", "head angles at their bounds"),
        ("change", "note", "changes between steps at their bounds"),
    )
    for kind, level, words in levels:
        together: dict[tuple[int, ...], list[str]] = {}
        for name, steps in reached[kind].items():
            together.setdefault(tuple(steps), []).append(name)
        details = tuple(
            f"{', '.join(names)}: {step_list(steps)}" for steps, names in together.items()
        )
        if details:
            yield Finding(level, words, details)


def _lengthened(plan: Plan) -> Iterator[Finding]:
    """Muscles that push."""
    peaks = plan.activations.max(axis=0)
    longer = [
        n for n, peak in zip(plan.motion.trunk.muscles, peaks, strict=True) if peak > AT_BOUND_TOL
    ]
    if longer:
        more = f" and {len(longer) - MAX_NAMES} more" if len(longer) > MAX_NAMES else ""
        names = ", ".join(longer[:MAX_NAMES]) + more
        details = (f"{names}: activations up to {peaks.max():.3g}; negative contracts",)
        yield Finding("warning", "muscles lengthen actively, which no muscle can do", details)


def _too_fast(plan: Plan) -> Iterator[Finding]:
    """Phases whose inertia, which the plan leaves out, is not small."""
    if fast := inertia_warnings(plan.motion, plan.inertia):
        advice = "trunk-ocp slow finds how long each phase has to be."
        yield Finding("warning", "quasi-static, but inertia is not small", tuple(fast), advice)


def _barely_valid(plan: Plan) -> Iterator[Finding]:
    """How close a converged plan is to what makes it fail."""
    margin = plan.stability.margin
    if np.all(plan.stability.stable) and margin.min() < LOW_MARGIN:
        t = int(np.argmin(margin))
        remaining = (
            f"step {t + 1}: the loads leave {100 * margin[t]:.2g} % of the trunk's stiffness"
        )
        yield Finding("warning", "the trunk is near buckling", (remaining,))
    if plan.fluttering:
        yield _growing(plan)
    check = plan.verification
    worst, turn = float(check.position_difference.max()), float(check.turn.max())
    most = check.max_position_difference
    if not check.too_coarse and (worst > most / 2 or turn > MAX_TURN / 2):
        details = (
            f"{rounded(1e3 * worst, 3)} mm from the integrated shape, {1e3 * most:.3g} allowed",
            f"directors {turn:.2g} from the integrated ones, {MAX_TURN:g} allowed",
        )
        yield Finding("warning", "the mesh is barely fine enough", details)
    if check.doubts:
        yield Finding(
            "warning",
            "the loads strain the trunk beyond the range of the model",
            tuple(check.doubts),
        )
    if plan.auxiliary and (excess := change_excess(plan)) > BOUND_TOL:
        by = f"by {excess:.3g} at most, following the unloaded solutions of appendix B"
        yield Finding("note", "the plan exceeds the horizon's bounds on change", (by,))


def _growing(plan: Plan) -> Finding:
    """Vibrations that grow."""
    logs = any(phase.loads.log is not None for phase in plan.motion.spec.phases)
    advice = "Hang the log from a lever that turns with the trunk: hung = true in loads.log."
    what = "a vibration grows, fed by the couple"
    return Finding("warning", what, tuple(plan.fluttering), advice if logs else "")


def _choices(plan: Plan, deep: bool, reporter: Reporter | None) -> Iterator[Finding]:
    """What a plan does although its task does not require it."""
    sided = one_sided(plan) if plan.converged else ""
    if sided:
        yield Finding("note", "the task is symmetric, the plan is not", (sided,))
    if not (deep and plan.mode == "horizon" and plan.check() is Status.SOLVED):
        return
    held = at_bounds(plan)["head"]
    angles = {i for i, name in enumerate(("psi_Z", "psi_Y")) if name in held or (sided and i == 0)}
    costs = tuple(held_heads(plan, angles, reporter))
    if costs:
        yield Finding("note", "the value of turning the head", costs)


def save_diagnosis(diagnosis: Diagnosis, folder: str | Path) -> None:
    """Write diagnosis.json to the folder of a plan."""
    text = json.dumps(finite(diagnosis.as_json()), indent=2)
    write(Path(folder) / "diagnosis.json", text + "\n")

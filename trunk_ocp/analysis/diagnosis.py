"""What a plan's user should know: why it failed and what to try, or what it leans on.

Failures come with the constraints that do not hold, named and located, and with the bounds that
would have to give; a solved plan with what it pushes against, and what a little more of each would
bring.
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
from .._support.wording import rounded
from ..model.activation import strains
from ..model.anatomy import Trunk
from ..nlp.ipopt import Solve
from ..nlp.violations import Violation
from ..planning.plan import Plan, Status
from ..planning.storage import finite
from ..planning.verification import LARGEST_TURN, SLACK
from ..problem.motion import Motion, allowed
from ..problem.plausibility import POINTED
from ..reporting import Reporter
from .bound_sensitivity import Response, responses
from .elastic_bounds import PHYSICAL, Excess, contradictions, in_words, nearest, reach, said
from .free_choices import held_heads, one_sided

MOST = 6  # effects that are told
NEAR = 1e-3  # share of a bound's range, within which an unknown is at the bound
LOW_MARGIN = 0.2  # of stability, below which a plan is warned of
MATTERS = 1e-6 / 1.75  # of the trunk's length; smaller effects of a bound are not reported

MEANINGS = {
    "Infeasible_Problem_Detected": "no nearby point keeps the constraints any better",
    "Maximum_Iterations_Exceeded": "the iterations that were allowed were used up",
    "Restoration_Failed": "the search for a point that keeps the constraints failed",
    "Invalid_Number_Detected": "a value overflowed; a load or a stiffness is out of all proportion",
    "Search_Direction_Becomes_Too_Small": "steps became too small to get any further",
    "Diverging_Iterates": "the unknowns grew without bound",
}
"""What the optimizer's words for a failure mean."""


@dataclass(frozen=True)
class Finding:
    """One thing worth knowing, with its details and what to do about it.

    `items` are the numbers behind the details, where there are any: violations or excesses.
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
    """All that is worth knowing of a plan.

    Attributes
    ----------
    history : of the solve that failed: (iteration, objective, primal and dual infeasibility)
    responses : what moving each bound that binds would do, the strongest first
    """

    status: Status
    findings: tuple[Finding, ...]
    history: tuple[tuple[int, float, float, float], ...] = ()
    responses: tuple[Response, ...] = ()

    def __str__(self) -> str:
        return "\n".join([self.status.value, *map(str, self.findings)])

    def as_json(self) -> dict[str, Any]:
        """The same, ready for JSON."""
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
    """Why a plan is what it is.

    Parameters
    ----------
    deep : bool
        Whether to solve for the bounds that would have to give, if a target is missed, and for
        the response of the plan to the bounds it pushes against: a second or a few.

    Returns
    -------
    Diagnosis
        Its findings in order: failures, warnings, notes.
    """
    findings = [*_failures(plan, deep, reporter), *_warnings(plan), *_choices(plan, deep, reporter)]
    history = plan.failure.history if plan.failure else ()
    rows = tuple((number, *row) for number, row in enumerate(history))
    asked = deep and plan.verified and not plan.cut_short
    return Diagnosis(plan.status, tuple(findings), rows, responses(plan) if asked else ())


# --- failures ----------------------------------------------------------------------------


def _failures(plan: Plan, deep: bool, reporter: Reporter | None) -> Iterator[Finding]:
    if plan.status is Status.INTERRUPTED:
        kept = f"{len(plan.x)} of {len(plan.motion.steps)} time steps are kept"
        advice = "Resume the run; from Python, with Checkpoint(path, resume=True)."
        yield Finding("failure", f"interrupted; {kept}", (), advice)
        return
    if plan.status is Status.TIME_LIMIT:
        kept = f"{len(plan.x)} of {len(plan.motion.steps)} time steps are kept"
        advice = "Allow more time, or go on from this plan: plan_motion(motion, start=plan)."
        yield Finding("failure", f"the deadline passed; {kept}", (), advice)
        return
    if not plan.converged or len(plan.x) < len(plan.motion.steps):
        excesses = contradictions(plan.motion)
        if excesses:
            yield _contradicting(excesses, plan.motion)
        yield _not_converged(plan, advise=not excesses)
        return
    if plan.verification.faults:
        yield _unverified(plan)
        return  # what else is said of its shapes would be no better founded
    if not np.all(plan.stability.stable):
        yield _unstable(plan)
    if plan.missed:
        yield _missed(plan)
        if deep:
            found = reach(plan, reporter)
            yield (
                _within_reach(found, plan.motion)
                if found is not None
                else _out_of_reach(plan, reporter)
            )


def _not_converged(plan: Plan, advise: bool) -> Finding:
    """What the solve that failed ended with, and what its residuals advise."""
    solve = plan.failure
    if solve is None:
        kept = f"{len(plan.x)} of {len(plan.motion.steps)} time steps are kept"
        return Finding("failure", f"not converged, and there is no record why; {kept}")
    meaning = MEANINGS.get(solve.message, solve.message.replace("_", " ").lower())
    what = f"{solve.detail}: {meaning} (after {solve.iterations} iterations)"
    told = [str(violation) for violation in solve.violations]
    best = f"the point that is kept: objective {solve.objective:.3g}"
    if solve.violations:
        best += f", constraints off by {solve.infeasibility:.2g} in units of L, E I(0) / L and 1"
    advice = _next_try(solve, len(plan.motion.steps)) if advise else ""
    told += [best] if solve.history else []
    return Finding("failure", what, tuple(told), advice, solve.violations)


def _next_try(solve: Solve, steps: int) -> str:
    """The next thing to try, by how the residuals went."""
    if solve.message == "Invalid_Number_Detected":
        return "Check units: forces in N, lengths in m, moduli in Pa."
    residuals = [primal for _, primal, _ in solve.history]
    falling = len(residuals) > 10 and residuals[-1] < 0.1 * residuals[-11]
    if solve.message == "Maximum_Iterations_Exceeded" and (falling or len(residuals) < 50):
        return f"It was still on its way: allow more, --max-iterations {4 * solve.iterations}."
    if not solve.violations:
        return "All constraints hold, the optimum is flat: --max-iterations, or another --starts."
    if solve.first == solve.last and steps > 1:
        return "Plan the steps together (--mode horizon): a step alone may run into a corner."
    fewer = ", or plan fewer steps at a time (--lookahead 3)" if solve.last > 3 else ""
    return f"Start elsewhere (--starts 4){fewer}."


def _contradicting(excesses: tuple[Excess, ...], motion: Motion) -> Finding:
    return Finding(
        "failure",
        "the bounds exclude each other, whatever is done; the least that would reconcile them:",
        in_words(excesses, motion),
        "Loosen these in the problem file.",
        excesses,
    )


def _unverified(plan: Plan) -> Finding:
    advice = "Report this plan: planned and integrated shapes should agree."
    if not np.all(np.isfinite(plan.verification.position_difference)):
        return Finding(
            "failure", "the independent check failed", (_not_integrated(plan),), _cause(plan)
        )
    if plan.verification.too_coarse:
        advice = "The trunk bends too sharply for the mesh: ease the loads, or give "
        advice += f"Options(elements=...) more than {plan.mesh.elements}."
    if np.any(plan.verification.stretch <= 0):
        advice = "Ease the loads, or check youngs_modulus and radii: nothing would be left there."
    if _pointed(plan.motion.trunk):
        advice += f" {_cause(plan)}"
    return Finding("failure", "the independent check failed", (*plan.verification.faults,), advice)


def _not_integrated(plan: Plan) -> str:
    bad = np.flatnonzero(~np.isfinite(plan.verification.position_difference))
    return f"{said((bad + 1).tolist())}: the planned shape cannot be integrated to the tip"


def _cause(plan: Plan) -> str:
    """The probable cause of shapes that are no numbers, and what to do about it."""
    trunk = plan.motion.trunk
    if _pointed(trunk):
        tip = float(trunk.radius(trunk.length))
        return (
            f"The trunk ends nearly in a point, of radius {tip:.2g} m, which bends without limit: "
            "make taper_deg smaller in its anatomy."
        )
    return "Loads or stiffness are out of all proportion: check forces in N, moduli in Pa."


def _pointed(trunk: Trunk) -> bool:
    return float(trunk.taper(trunk.length)) < POINTED


def _unstable(plan: Plan) -> Finding:
    bad = np.flatnonzero(~plan.stability.stable)
    told = tuple(
        f"step {t + 1}: the trunk would fall in {index} direction{'s' * (index != 1)}, "
        f"margin {plan.stability.margin[t]:.3g}"
        for t, index in zip(bad.tolist(), plan.stability.index[bad].tolist(), strict=True)
    )
    return Finding(
        "failure",
        f"the trunk would not stay in its shape at {said((bad + 1).tolist())}",
        told,
        "Ease what pushes against the trunk, or let targets hold more of its points.",
    )


def _missed(plan: Plan) -> Finding:
    missed = plan.missed
    count = "a target is" if len(missed) == 1 else f"{len(missed)} targets are"
    advice = ""
    if plan.mode == "sequential" and len(plan.motion.steps) > 1:
        advice = "The horizon may reach what this blind plan cannot: --mode horizon."
    return Finding("failure", f"{count} missed", tuple(missed), advice)


def _out_of_reach(plan: Plan, reporter: Reporter | None) -> Finding:
    """No bounds within physics would do: how near the trunk could come."""
    left = nearest(plan, reporter)
    told: tuple[str, ...] = ()
    # One that is within the tolerance is a matter of directions, or of another way there.
    if left is not None and left > plan.motion.tolerance[0]:
        missed = f"{rounded(1e3 * left, 4)} mm"
        told = (f"with all of that the worst position would still be missed by {missed}",)
    return Finding(
        "failure",
        f"no physically plausible bounds suffice ({PHYSICAL}): no motion near this plan reaches "
        "all targets within them",
        told,
        "Move the targets, or widen [tolerance].",
    )


def _within_reach(excesses: tuple[Excess, ...], motion: Motion) -> Finding:
    if not excesses:
        return Finding(
            "failure",
            "all targets are within reach and within the bounds; the plan weighs them differently",
            (),
            "Give the missed targets more weight, or start elsewhere (--starts 4).",
        )
    what = "all targets would be reached if these bounds were relaxed:"
    advice = "Loosen these in the problem file, or move the targets."
    if sum(len(step.targets) for step in motion.steps) > 1:
        advice += " A plan may still miss some in favor of others: give those more weight."
    return Finding("failure", what, in_words(excesses, motion), advice, excesses)


# --- what a plan leans on ----------------------------------------------------------------


def _warnings(plan: Plan) -> Iterator[Finding]:
    if not len(plan.x):
        return
    pressed = at_bounds(plan)
    levels: tuple[tuple[str, Literal["warning", "note"], str], ...] = (
        ("contraction", "warning", "muscles contracted as far as they may"),
        ("lengthening", "warning", "muscles lengthened as far as they may"),
        ("extension", "warning", "segments at the limit of their extension"),
        ("head", "note", "head angles at their bounds"),
        ("change", "note", "changes between steps at their bounds"),
    )
    for kind, level, words in levels:
        together: dict[tuple[int, ...], list[str]] = {}
        for name, steps in pressed[kind].items():
            together.setdefault(tuple(steps), []).append(name)
        told = tuple(f"{', '.join(names)}: {said(steps)}" for steps, names in together.items())
        if told:
            yield Finding(level, words, told)
    peaks = plan.activations.max(axis=0)
    longer = [n for n, peak in zip(plan.motion.trunk.muscles, peaks, strict=True) if peak > NEAR]
    if longer:
        more = f" and {len(longer) - MOST} more" if len(longer) > MOST else ""
        names = ", ".join(longer[:MOST]) + more
        told = (f"{names}: activations up to {peaks.max():.3g}; negative contracts",)
        yield Finding("warning", "muscles lengthen actively, which no muscle can do", told)
    if not plan.converged:
        return
    margin = plan.stability.margin
    if np.all(plan.stability.stable) and margin.min() < LOW_MARGIN:
        t = int(np.argmin(margin))
        left = f"step {t + 1}: the loads leave {100 * margin[t]:.2g} % of the trunk's stiffness"
        yield Finding("warning", "the trunk is near buckling", (left,))
    check = plan.verification
    worst, turn = float(check.position_difference.max()), float(check.turn.max())
    most = check.largest_difference
    if not check.too_coarse and (worst > most / 2 or turn > LARGEST_TURN / 2):
        told = (
            f"{1e3 * worst:.3g} mm from the integrated shape, {1e3 * most:.3g} pass",
            f"directors {turn:.2g} from the integrated ones, {LARGEST_TURN:g} pass",
        )
        yield Finding("warning", "the mesh is barely fine enough", told)
    if check.doubts:
        yield Finding(
            "warning", "the loads strain the trunk beyond what it is made for", tuple(check.doubts)
        )
    if plan.near and (excess := _change_excess(plan)) > SLACK:
        told = (f"by {excess:.3g} at most, following the unloaded solutions of appendix B",)
        yield Finding("note", "the plan exceeds the horizon's bounds on change", told)


def _choices(plan: Plan, deep: bool, reporter: Reporter | None) -> Iterator[Finding]:
    """What a plan does though its task does not ask for it."""
    sided = one_sided(plan) if plan.converged else ""
    if sided:
        yield Finding("note", "the task is the same to both sides, the plan is not", (sided,))
    if not (deep and plan.mode == "horizon" and plan.status is Status.SOLVED):
        return
    held = at_bounds(plan)["head"]
    angles = {i for i, name in enumerate(("psi_Z", "psi_Y")) if name in held or (sided and i == 0)}
    costs = tuple(held_heads(plan, angles, reporter))
    if costs:
        yield Finding("note", "what the head's turning is worth", costs)


def _change_excess(plan: Plan) -> float:
    x = np.concatenate([np.zeros((1, plan.x.shape[1])), plan.x])
    return max(
        float(np.maximum(step.change.lower - dx, dx - step.change.upper).max())
        for step, dx in zip(plan.motion.steps, np.diff(x, axis=0), strict=False)
    )


def at_bounds(plan: Plan) -> dict[str, dict[str, list[int]]]:
    """Steps (from 1) at which each unknown is at a bound: {kind: {name: steps}}.

    Kinds are contraction, lengthening, extension, head and change. Bounds that leave no choice, and
    the bound of a muscle at rest, which cannot push, are not told.
    """
    trunk = plan.motion.trunk
    found: dict[str, dict[str, list[int]]] = {
        kind: {} for kind in ("contraction", "lengthening", "extension", "head", "change")
    }
    names = (*trunk.muscles, "psi_Z", "psi_Y")
    extension = strains(trunk, plan.activations)[..., 0]
    before = np.zeros(plan.x.shape[1])
    for t, (step, x) in enumerate(zip(plan.motion.steps, plan.x, strict=False)):
        change, box = x - before, allowed(plan.motion, step, plan.near.get(t))
        free = t in plan.near and step.follows
        for i, name in enumerate(names):
            side = _side(x[i], box.lower[i], box.upper[i])
            kind = "head" if i >= len(trunk.muscles) else _work(side, box.lower[i], box.upper[i])
            if side and kind:
                found[kind].setdefault(name, []).append(t + 1)
            if not free and _side(change[i], step.change.lower[i], step.change.upper[i]):
                found["change"].setdefault(name, []).append(t + 1)
        for s, zeta in enumerate(extension[t].tolist()):
            if _side(zeta, *plan.motion.extension):
                found["extension"].setdefault(f"segment {s + 1}", []).append(t + 1)
        before = x
    return found


def _work(side: int, lower: float, upper: float) -> str:
    """What a muscle does at a bound: "contraction", "lengthening" or, at rest, nothing."""
    if side < 0:
        return "contraction" if lower < 0 else ""
    return "lengthening" if upper > 0 else ""


def _side(value: float, lower: float, upper: float) -> int:
    """-1 at a lower bound, +1 at an upper one, 0 at none or where they leave no choice."""
    if not upper > lower:
        return 0
    near = NEAR * (upper - lower) if np.isfinite(upper - lower) else NEAR
    return int(value >= upper - near) - int(value <= lower + near)


def effects(responses: tuple[Response, ...], length: float, most: int = MOST) -> list[str]:
    """What a little more of the strongest bounds would bring, one sentence for each bound.

    Effects that are nothing beside the trunk's length, in m, are left out.
    """
    told: dict[str, str] = {}
    for response in responses:
        if response.name in told or abs(response.worst) < MATTERS * length:
            continue
        unit = " deg" if "psi" in response.name else ""
        told[response.name] = (
            f"{response.name} ({said(response.steps)}), {response.value + 0.0:.4g}{unit} moved by "
            f"{response.moved:+.2g}: the worst point comes {_way(response.worst)}, the mean "
            f"distance {_way(response.mean)}"
        )
    return [*told.values()][:most]


def _way(change: float) -> str:
    return f"{rounded(1e3 * abs(change))} mm {'closer' if change < 0 else 'farther'}"


def save_diagnosis(diagnosis: Diagnosis, folder: str | Path) -> None:
    """Write a diagnosis beside the plan it is of."""
    text = json.dumps(finite(diagnosis.as_json()), indent=2)
    write(Path(folder) / "diagnosis.json", text + "\n")

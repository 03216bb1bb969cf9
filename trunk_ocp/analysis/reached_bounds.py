"""Which bounds a plan reaches: by control and time step."""

from __future__ import annotations

import numpy as np

from ..model.activation import strains
from ..planning.plan import Plan
from ..problem.motion import allowed

AT_BOUND_TOL = 1e-3
"""Distance to a bound, as a fraction of the range, within which a control is at the bound."""


def at_bounds(plan: Plan) -> dict[str, dict[str, list[int]]]:
    """Steps (from 1) at which each control is at a bound: {kind: {name: steps}}.

    Kinds are contraction, lengthening, extension, head and change. Bounds that leave no choice are
    left out, and so is the bound of a muscle at rest, since muscles cannot push.
    """
    trunk = plan.motion.trunk
    steps_at: dict[str, dict[str, list[int]]] = {
        kind: {} for kind in ("contraction", "lengthening", "extension", "head", "change")
    }
    names = (*trunk.muscles, "psi_Z", "psi_Y")
    extension = strains(trunk, plan.activations)[..., 0]
    previous = plan.motion.start
    for t, (step, x) in enumerate(zip(plan.motion.steps, plan.x, strict=False)):
        change, box = x - previous, allowed(plan.motion, step, plan.auxiliary.get(t))
        free = t in plan.auxiliary and step.follows
        for i, name in enumerate(names):
            side = _side(x[i], box.lower[i], box.upper[i])
            kind = (
                "head"
                if i >= len(trunk.muscles)
                else _muscle_kind(side, box.lower[i], box.upper[i])
            )
            if side and kind:
                steps_at[kind].setdefault(name, []).append(t + 1)
            if not free and _side(change[i], step.change.lower[i], step.change.upper[i]):
                steps_at["change"].setdefault(name, []).append(t + 1)
        for s, zeta in enumerate(extension[t].tolist()):
            if _side(zeta, *plan.motion.extension):
                steps_at["extension"].setdefault(f"segment {s + 1}", []).append(t + 1)
        previous = x
    return steps_at


def _muscle_kind(side: int, lower: float, upper: float) -> str:
    """What a muscle does at a bound: "contraction", "lengthening", or "" at rest."""
    if side < 0:
        return "contraction" if lower < 0 else ""
    return "lengthening" if upper > 0 else ""


def _side(value: float, lower: float, upper: float) -> int:
    """-1 at the lower bound, +1 at the upper one, 0 at neither or if they leave no choice."""
    if not upper > lower:
        return 0
    near = AT_BOUND_TOL * (upper - lower) if np.isfinite(upper - lower) else AT_BOUND_TOL
    return int(value >= upper - near) - int(value <= lower + near)


def change_excess(plan: Plan) -> float:
    """Largest excess over the horizon's bounds on change; negative if all hold by a margin."""
    changes = zip(plan.motion.steps, np.diff(plan.trajectory, axis=0), strict=False)
    excesses = (np.maximum(s.change.lower - dx, dx - s.change.upper).max() for s, dx in changes)
    return float(max(excesses, default=0.0))

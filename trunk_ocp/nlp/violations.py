"""Violated constraints of a window: which one, at which step, where on the trunk, by how much."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .nlp_builder import Block
from .window import Window

MAX_VIOLATIONS = 12  # in a list
MIN_EXCESS = 1e-6
"""Excess in the NLP's units up to which a constraint counts as satisfied."""


@dataclass(frozen=True)
class Violation:
    """One violated constraint.

    Attributes
    ----------
    step : int
        Time step, from 1.
    what : str
        Name of the constraint, such as "balance of moments about d2".
    Z : float or None
        Point of the trunk, in m.
    value, lower, upper : float
        Value and bounds, in `unit`; the bounds of an equation are equal.
    excess : float
        Distance from the bounds in the NLP's units (L, E I(0) / L, 1), which ranks violations of
        different kinds.
    others : int
        Number of other places and steps with a smaller violation of the same kind.
    """

    step: int
    what: str
    Z: float | None
    value: float
    lower: float
    upper: float
    unit: str
    excess: float = 0.0
    others: int = 0

    def __str__(self) -> str:
        where = "" if self.Z is None else f" at Z = {self.Z:.3f} m"
        unit = f" {self.unit}" if self.unit else ""
        if self.lower == self.upper:
            allowed = f"off by {self.value - self.lower:.3g}{unit}"
        else:
            allowed = f"is {self.value:.4g}{unit}, allowed {self.lower:g} to {self.upper:g}"
        places = f"{self.others} other place{'s' * (self.others > 1)}"
        more = f" (and less at {places})" if self.others else ""
        return f"step {self.step}: {self.what}{where} {allowed}{more}"


def violations(window: Window, full: np.ndarray, g: np.ndarray) -> tuple[Violation, ...]:
    """Violated constraints of a window at a point, each kind where it is worst, worst first.

    full, g : the decision vector, and the values of the constraints there.
    """
    lower, upper = window.bounds["lbg"], window.bounds["ubg"]
    excess = np.maximum(np.maximum(lower - g, g - upper), 0.0)
    excess[np.isnan(g)] = np.inf
    kinds: dict[str, list[Violation]] = {}
    for block in window.blocks:
        # The worst component of a place stands for all of them, which fail together; controls
        # are independent of each other. Row 0 of F is the objective.
        width = block.rows.shape[-1] if block.controls is None else 1
        rows = block.rows.reshape(-1, width) - 1
        worst = np.argmax(excess[rows], axis=1)
        for place in np.flatnonzero(excess[rows].max(axis=1) > MIN_EXCESS).tolist():
            row = rows[place, worst[place]]
            bounds = (float(lower[row]), float(upper[row]))
            at = place * width + int(worst[place])
            violation = _violation(window, full, block, at, float(g[row]), bounds)
            violation = replace(violation, excess=float(excess[row]))
            kinds.setdefault(violation.what, []).append(violation)
    worst_of_kinds = [
        replace(max(same, key=lambda one: one.excess), others=len(same) - 1)
        for same in kinds.values()
    ]
    return tuple(sorted(worst_of_kinds, key=lambda one: -one.excess)[:MAX_VIOLATIONS])


def _violation(
    window: Window,
    full: np.ndarray,
    block: Block,
    at: int,
    value: float,
    bounds: tuple[float, float],
) -> Violation:
    """Violation of one entry of a block's rows, counted row by row, given its value and bounds."""
    place, last = divmod(at, block.rows.shape[-1])
    meaning, i = block.meaning, block.component(last)
    what = meaning.labels[i] if meaning.labels else f"the {meaning.name}"
    if meaning.place:
        what += f" of {meaning.place} {place + 1}"
    if block.variables is not None:
        # The variable keeps its bounds while the solver runs; what the rest of its equation
        # gives may leave them, which says more than the equation's residual.
        variable = block.variables.ravel()[at]
        rest = float(full[variable]) - (value - bounds[0])
        limits = (float(window.bounds["lbx"][variable]), float(window.bounds["ubx"][variable]))
        if rest < limits[0] or rest > limits[1]:
            value, bounds = rest, limits
    component = meaning.quantity.components[i]
    scale, unit = component.scale, component.unit
    if unit == "rad":
        scale, unit = float(np.degrees(scale)), "deg"
    Z = None if block.Z is None else float(block.Z.ravel()[place])
    lower, upper = (scale * bound for bound in bounds)
    return Violation(
        block.step + 1, what, Z, scale * value, lower, upper, "" if unit == "1" else unit
    )

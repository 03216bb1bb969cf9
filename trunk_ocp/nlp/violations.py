"""Violated constraints of a window, named and located: which, at which step, where, by how much."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .nlp_builder import Block
from .window import Window

MOST = 12
SMALLEST = 1e-6
"""Excess, in the transcription's units, below which a constraint counts as kept."""


@dataclass(frozen=True)
class Violation:
    """One constraint that does not hold.

    Attributes
    ----------
    step : int
        Time step, from 1.
    what : str
        Name of the constraint, such as "balance of moments about d2".
    Z : float or None
        Where along the trunk, in m.
    value, lower, upper : float
        What it is and what is allowed, in `unit`. Equations have a value of 0.
    excess : float
        Distance from what is allowed in the transcription's units (L, E I(0) / L, 1), by which
        violations of different kinds are ranked.
    others : int
        Other places and steps at which the same does not hold, by less.
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
        more = f" (and less so at {places})" if self.others else ""
        return f"step {self.step}: {self.what}{where} {allowed}{more}"


def violations(window: Window, full: np.ndarray, g: np.ndarray) -> tuple[Violation, ...]:
    """Violated constraints of a window at a point, each kind where it is worst, worst first.

    full, g : all unknowns, and the constraints' values there.
    """
    lower, upper = window.bounds["lbg"], window.bounds["ubg"]
    excess = np.maximum(np.maximum(lower - g, g - upper), 0.0)
    excess[np.isnan(g)] = np.inf
    found: dict[str, list[Violation]] = {}
    for block in window.blocks:
        # Of the components of one place, the worst; the others say the same again. But each
        # change is of another muscle. Row 0 of F is the objective.
        components = 1 if block.name == "change" else block.rows.shape[-1]
        rows = block.rows.reshape(-1, components) - 1
        worst = np.argmax(excess[rows], axis=1)
        for place in np.flatnonzero(excess[rows].max(axis=1) > SMALLEST).tolist():
            component = int(worst[place])
            row = rows[place, component]
            bounds = (float(lower[row]), float(upper[row]))
            one = _violation(window, full, block, (place, component), float(g[row]), bounds)
            found.setdefault(one.what, []).append(replace(one, excess=float(excess[row])))
    kinds = [
        replace(max(same, key=lambda one: one.excess), others=len(same) - 1)
        for same in found.values()
    ]
    return tuple(sorted(kinds, key=lambda one: -one.excess)[:MOST])


def _violation(
    window: Window,
    full: np.ndarray,
    block: Block,
    at: tuple[int, int],
    value: float,
    bounds: tuple[float, float],
) -> Violation:
    """Violation of the row at (place, component) of a block, given its value and bounds."""
    step = window.offset if block.step is None else block.step
    what, scale, unit = _meaning(window, block, *at)
    Z = None if block.Z is None else float(block.Z.ravel()[at[0]])
    if block.name == "strain" and at[1] == 0:
        # The variable keeps its bounds; what its muscles make may be elsewhere.
        variable = full[window.unknowns[step - window.offset].strain[at[0], 0]]
        made, (low, high) = float(variable) - (value - bounds[0]), window.motion.extension
        if not low <= made <= high:
            value, bounds = made, (low, high)
    lower, upper = (scale * bound for bound in bounds)
    return Violation(step + 1, what, Z, scale * value, lower, upper, unit)


def _meaning(window: Window, block: Block, place: int, component: int) -> tuple[str, float, str]:
    """Name of a constraint, its scale to SI (angles in degrees), and its unit."""
    degrees = float(np.degrees(1.0))
    if block.name == "strain":
        kind = f"curvature u_{component}, times L," if component else "extension"
        return f"{kind} of segment {place + 1}, made by its muscles,", 1.0, ""
    if block.name in ("rod", "continuity") and component < 4:
        return f"the frame's {'equation' if block.name == 'rod' else 'continuity'}", 1.0, ""
    if block.name == "rod":
        return f"balance of moments about d{component - 3}", window.moment, "N m"
    if block.name == "continuity":
        return f"continuity of the moment about d{component - 3}", window.moment, "N m"
    if block.name in ("centerline", "position at a target"):
        return f"the {block.name}, coordinate {'XYZ'[component]},", window.length, "m"
    if block.name == "base":
        return (
            ("position of the base", window.length, "m")
            if component < 3
            else ("orientation of the base", 1.0, "")
        )
    if block.name == "pull":
        return f"the pull along a held direction, {'XYZ'[component]},", window.force, "N"
    if block.name == "change":
        limited = window.steps[(block.step or 0) - window.offset].change.limited
        names = (*window.motion.trunk.muscles, "psi_Z", "psi_Y")
        name = names[limited[place]]
        angle = name.startswith("psi")
        return f"change of {name}", degrees if angle else 1.0, "deg" if angle else ""
    return f"the {block.name}", 1.0, ""

"""Layout of an exported NLP: the meaning of each unknown, constraint row and parameter.

A layout consists of ranges of consecutive indices, with a name, a time step, points Z and
components, each with the factor that converts it to SI units.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from itertools import groupby
from typing import Any

import numpy as np

from ..nlp.nlp_builder import Block
from ..nlp.point_functions import (
    squared_direction,
    squared_direction_in_head,
    squared_held_direction,
)
from ..nlp.quantities import AXES, quantities
from ..nlp.separable_nlp import SeparableNLP
from ..nlp.window import Window

ABOUT = (
    "Minimize f(x) subject to lower <= x <= upper and lower <= g(x) <= upper. Ranges of x, g and p "
    "start at index `first`, from 0; their last axis is that of the `components`. An unknown or a "
    "row times the `scale` of its component is in the component's `unit`. Steps count from 1; "
    "step 0 is the known trunk before the motion. Bounds and the start of x are in unknowns.csv "
    "(lower, upper, start) and rows.csv (lower, upper), one per line. The argument p of the "
    "functions is a change of the parameters, 0 by default; the parameters themselves, in SI "
    "units unless stated otherwise, are in parameters.csv."
)


@dataclass(frozen=True)
class Range:
    """Consecutive indices; `shape` has the axes before that of the components."""

    name: str
    step: int
    first: int
    components: str | tuple[str, ...]
    shape: tuple[int, ...] = ()
    Z: str | float | None = None

    def entry(self) -> dict[str, Any]:
        """Entry of the file, without keys that do not apply."""
        entry: dict[str, Any] = {"name": self.name, "step": self.step, "first": self.first}
        if self.shape:
            entry["shape"] = list(self.shape)
        if self.Z is not None:
            entry["Z"] = self.Z
        named = self.components if isinstance(self.components, str) else list(self.components)
        return entry | {"components": named}


def layout(window: Window, name: str) -> dict[str, Any]:
    """Layout of a window's NLP, as JSON has it."""
    variables, rows = window.nlp.size
    return {
        "about": ABOUT,
        "motion": name,
        "steps": [step.time for step in window.steps],
        "units": {
            "length, m": window.length,
            "moment, N m": window.moment,
            "force, N": window.force,
        },
        "sizes": {"x": variables, "g": rows, "p": window.parameters.size},
        "components": {
            name: [asdict(component) for component in quantity.components]
            for name, quantity in quantities(window.motion.trunk).items()
            if name != "controls"
        },
        "Z": {
            "element edges": list(window.mesh.edges),
            "ends of elements": list(window.mesh.edges[1:]),
            "Gauss points": window.mesh.points.ravel().tolist(),
        },
        "x": [part.entry() for part in unknown_ranges(window)],
        "g": [part.entry() for part in row_ranges(window)],
        "p": list(_parameters(window)),
    }


def unknown_ranges(window: Window) -> list[Range]:
    """Every unknown, once, in order."""
    muscles = len(window.motion.trunk.muscles)
    before = int(window.previous[0])
    parts = [
        Range("known activations before", window.offset, before, "activations"),
        Range("known head angles before", window.offset, before + muscles, "head angles"),
    ]
    E, d = window.mesh.elements, window.mesh.degree
    for step, u in enumerate(window.unknowns, window.offset + 1):
        x = int(u.x[0])
        parts += [
            Range("activation", step, x, "activations"),
            Range("head angle", step, x + muscles, "head angles"),
            Range("strain of a segment", step, int(u.strain[0, 0]), "strains", (len(u.strain),)),
            Range("mean extension", step, int(u.mean[0]), "extension"),
            Range("tip force", step, int(u.tip_force[0]), "force"),
            Range("rod", step, int(u.edges[0, 0]), "state", (E + 1,), "element edges"),
            Range("rod", step, int(u.inner[0, 0, 0]), "state", (E * d,), "Gauss points"),
            Range("centerline", step, int(u.line[0, 0]), "position", (E + 1,), "element edges"),
        ]
        edges = set(u.line[:, 0].tolist())
        for Z, (q, r) in u.points.items():
            if int(r[0]) not in edges:
                parts.append(Range("frame at a target", step, int(q[0]), "orientation", (), Z))
                parts.append(Range("position at a target", step, int(r[0]), "position", (), Z))
    for held, D in window.held.items():
        name = f"held director d{held.director + 1}"
        parts.append(Range(name, held.step + 1, int(D[0]), "direction", (), held.Z))
    return sorted(parts, key=lambda part: part.first)


def row_ranges(window: Window) -> list[Range]:
    """Every constraint row, once, in order."""
    return sorted((_row_range(b) for b in window.blocks), key=lambda part: part.first)


def _row_range(block: Block) -> Range:
    quantity = block.meaning.quantity
    named: str | tuple[str, ...] = quantity.name
    if block.controls is not None:
        named = tuple(quantity.components[i].name for i in block.controls)
    Z: str | float | None = None
    if block.Z is not None:
        Z = {0: None, 1: "ends of elements", 2: "Gauss points"}[block.Z.ndim] or float(block.Z)
    count = int(np.prod(block.rows.shape[:-1]))
    shape = (count,) if block.rows.ndim > 1 else ()
    return Range(block.meaning.name, block.step + 1, int(block.rows.min()) - 1, named, shape, Z)


GOAL = ["X", "Y", "Z", "weight"]
RATES_PARAMETERS = [
    "taper f",
    *(f"stiffness K{i} (N, N m^2)" for i in range(4)),
    *(f"force on the section except the tip force, {axis}, N" for axis in AXES),
    *(f"couple density, {axis}, N" for axis in AXES),
]
PARAMETERS = {
    "rates": RATES_PARAMETERS,
    "hung_rates": [
        *RATES_PARAMETERS,
        *(f"lever times density of the contact force, {axis}, N" for axis in AXES),
    ],
    "scaled_vector": ["minus the pull, in units of force"],
    "squared_distance": [f"target position {name}" for name in GOAL[:3]] + GOAL[3:],
    "squared_direction": [f"target direction {name}" for name in GOAL[:3]] + GOAL[3:],
    "squared_distance_in_head": [*(f"target position {a}, in the head" for a in AXES), "weight"],
    "squared_direction_in_head": [*(f"target direction {a}, in the head" for a in AXES), "weight"],
    "squared_held_direction": ["weight"],
    "square": ["weight of effort"],
    "squared_change": ["weight of rate, over the step's duration in s"],
}
"""Parameters of one place of each term that has some."""


def _parameters(window: Window) -> Iterator[dict[str, Any]]:
    """Ranges of the parameters of each term, place by place."""
    nlp, first = window.nlp, 0
    step, Z = _steps_and_points(window)
    for term, steps in zip(nlp.terms, _steps(nlp, window, step), strict=True):
        count = term.parameters.shape[0]
        if count == 0:
            continue
        name = term.function.name()
        entry: dict[str, Any] = {"name": name, "first": first, "shape": [term.places]}
        director = _director(term.function)
        if director is not None:
            entry["director"] = director
        if name.startswith(("squared_distance", "squared_direction", "squared_held_direction")):
            entry["Z"] = Z[term.variables[0]].tolist()
        if name in ("rates", "hung_rates"):
            entry["Z"] = "Gauss points, step by step"
        runs = ((int(number), len(list(run))) for number, run in groupby(steps.tolist()))
        entry["steps"] = [{"step": number, "places": length} for number, length in runs]
        yield entry | {"components": PARAMETERS[name]}
        first += term.parameters.size


def _director(function: Any) -> int | None:
    """Director, from 1, of a term about directions; None for other terms."""
    for make in (squared_direction, squared_direction_in_head, squared_held_direction):
        for j in range(3):
            if function.__hash__() == make(j).__hash__():
                return j + 1
    return None


def _steps_and_points(window: Window) -> tuple[np.ndarray, np.ndarray]:
    """Time step, from 1, and Z of each unknown; NaN where it has no Z."""
    count, kinds = window.nlp.size[0], quantities(window.motion.trunk)
    step, Z = np.zeros(count, int), np.full(count, np.nan)
    lists = {
        "element edges": np.array(window.mesh.edges),
        "Gauss points": window.mesh.points.ravel(),
    }
    for part in unknown_ranges(window):
        width = len(kinds[str(part.components)].components)
        where = slice(part.first, part.first + width * int(np.prod(part.shape)))
        step[where] = part.step
        if part.Z is not None:
            Z[where] = np.repeat(lists[part.Z] if isinstance(part.Z, str) else part.Z, width)
    return step, Z


def _steps(nlp: SeparableNLP, window: Window, step: np.ndarray) -> Iterator[np.ndarray]:
    """Time step of each place of each term: the last one of its unknowns and rows."""
    of_row = np.zeros(1 + nlp.size[1], int)  # row 0 is the objective
    for block in window.blocks:
        of_row[block.rows] = 1 + block.step
    for term in nlp.terms:
        scatter = term.scatter.tocoo()
        last = step[term.variables].max(axis=0)
        np.maximum.at(last, scatter.col // term.function.size1_out(0), of_row[scatter.row])
        yield last

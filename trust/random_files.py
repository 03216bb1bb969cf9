"""Hypothesis strategies for well-formed problem and anatomy files.

Their motions are short and often feasible.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

from hypothesis import strategies as st

Table = dict[str, Any]
ELEPHANT_LENGTH = 1.75
"""Of the shipped anatomy, m."""


def numbers(low: float, high: float) -> st.SearchStrategy[float]:
    """Numbers within a range, rounded as people write them."""
    tiny = 1e-9 * max(abs(low), abs(high))  # smaller values are rounded zeros

    def number(k: int) -> float:
        value = low + (high - low) * k / 1000
        return float(f"{value:.6g}") if abs(value) > tiny else 0.0

    return st.integers(0, 1000).map(number)


def pairs(low: float, high: float) -> st.SearchStrategy[list[float]]:
    """Lower and upper bound within a range, sometimes equal."""
    return st.tuples(numbers(low, high), numbers(low, high)).map(sorted)


def vectors(size: float) -> st.SearchStrategy[list[float]]:
    """Three numbers up to a size."""
    return st.lists(numbers(-size, size), min_size=3, max_size=3)


# --- anatomies ---------------------------------------------------------------------------


@st.composite
def muscles(draw: st.DrawFn, outer: float) -> list[Table]:
    """Zero to six muscles of a segment; `outer` is the trunk's radius over its length."""
    found = []
    for number in range(draw(st.integers(0, 6))):
        inner, second = draw(pairs(0.0, 1.0).filter(lambda p: p[0] < p[1]))
        low, high = draw(pairs(0.0, math.pi).filter(lambda p: p[0] < p[1]))
        kind = draw(st.sampled_from(["longitudinal", "helical", "radial"]))
        muscle = {
            "group": f"m{number}",
            "architecture": kind,
            "radii_over_length": [inner * outer, second * outer],
            "sector": [low, high],
        }
        if kind == "helical":
            muscle["helix_deg"] = draw(st.sampled_from([-89.0, -30.0, 5.0, 30.0, 60.0]))
        if draw(st.booleans()):
            muscle["sides"] = draw(st.sampled_from([["R"], ["L"], ["L", "R"]]))
        found.append(muscle)
    return found


@st.composite
def anatomies(draw: st.DrawFn) -> Table:
    """A well-formed anatomy of 1 to 4 segments; one in four has an extreme size or stiffness."""
    extreme = draw(st.integers(0, 3)) == 0
    outer = draw(numbers(0.01, 0.15))
    inner = draw(st.lists(numbers(0.01, 0.99), max_size=3, unique=True))
    edges = [0.0, *sorted(inner), 1.0]
    taper = math.degrees(math.atan(outer)) * draw(st.sampled_from([0.0, 0.3, 0.7, 0.999]))
    return {
        "name": "arm",
        "length": draw(st.sampled_from([1e-9, 1e-3, 50.0, 1e9]) if extreme else numbers(0.2, 3.0)),
        "base_radius_over_length": outer,
        "taper_deg": taper,
        "material": {
            "youngs_modulus": draw(st.sampled_from([1e-6, 1.0, 1e3, 1e12] if extreme else [1e6])),
            "poisson_ratio": draw(st.sampled_from([-0.9, 0.0, 0.3, 0.5])),
            "density": draw(st.sampled_from([0.0, 1000.0, 1e6] if extreme else [0.0, 1000.0])),
        },
        "head": {
            "pivot_radius": draw(numbers(0.0, 0.5)),
            "xi_y_deg": draw(numbers(-180.0, 180.0)),
            "xi_d_deg": draw(numbers(-180.0, 180.0)),
        },
        "segments": [
            {"Z_over_length": [start, end], "muscles": draw(muscles(outer))}
            for start, end in pairwise(edges)
        ],
    }


# --- problems ----------------------------------------------------------------------------


@st.composite
def directions(draw: st.DrawFn, step: int) -> list[float] | Table:
    """A vector, or the direction reached by a step before number `step` (from 1)."""
    if step > 1 and draw(st.booleans()):
        return {"held_from_step": draw(st.integers(1, step - 1))}
    return draw(vectors(1.0).filter(lambda v: any(abs(x) > 1e-3 for x in v)))


@st.composite
def targets(draw: st.DrawFn, L: float, step: int) -> Table:
    """One target of a phase that starts with step `step`."""
    target: Table = {"Z": draw(st.sampled_from([L, L, 0.5 * L, 0.83 * L, 0.0]))}
    origin = draw(st.sampled_from(["base", "base", "passive-tip"]))
    size = 0.3 * L
    middle = [0.0, 0.0, 0.0] if origin == "passive-tip" else [0.3 * L, 0.0, 0.8 * target["Z"]]

    def near() -> list[float]:
        return [m + x for m, x in zip(middle, draw(vectors(size)), strict=True)]

    kind = draw(st.sampled_from(["position", "position", "path", "direction", "both"]))
    if kind in ("position", "both"):
        target["position"] = near()
    if kind == "path":
        target["path"] = [near() for _ in range(draw(st.integers(2, 4)))]
    if kind in ("direction", "both"):
        which = draw(st.sampled_from(["d1", "d2", "d3"]))
        target[which] = draw(directions(step))
        target[f"{which}_weight"] = draw(st.sampled_from([0.0, 0.1, 1.0]))
    target["origin"] = origin
    target["position_weight"] = draw(st.sampled_from([0.0, 1.0, 8.0]))
    return target


@st.composite
def wraps(draw: st.DrawFn, L: float) -> Table:
    """A wrap of the last part of the trunk."""
    count = draw(st.integers(2, 5))
    weights = st.lists(st.sampled_from([0.0, 1.0, 7.0]), min_size=count, max_size=count)
    return {
        "Z": [draw(numbers(0.5, 0.8)) * L, L],
        "points": count,
        "log_radius": draw(numbers(0.01, 0.2)) * L,
        "angles_deg": [draw(numbers(10.0, 120.0)), draw(numbers(-90.0, 0.0))],
        "center": draw(vectors(0.4 * L)),
        "origin": draw(st.sampled_from(["base", "passive-tip"])),
        "position_weights": draw(weights),
        "d3_weights": draw(weights),
    }


@st.composite
def loads(draw: st.DrawFn, L: float, contact: float, step: int) -> Table:
    """Loads of a phase; `contact` is where contact starts, if there is any."""
    found: Table = {}
    for kind in draw(st.lists(st.sampled_from(["tip", "mass", "pull"]), unique=True)):
        if kind == "tip":
            found["tip_force"] = draw(vectors(50.0))
        elif kind == "mass":
            found["tip_mass"] = draw(numbers(0.0, 10.0))
        elif step > 1:
            found["pull"] = {
                "force": draw(numbers(-100.0, 100.0)),
                "along": draw(st.sampled_from(["d1", "d2", "d3"])),
                "held_from_step": draw(st.integers(1, step - 1)),
                "ramp": draw(st.booleans()),
            }
    touch = draw(st.sampled_from(["no", "no", "log", "force"]))
    if touch == "log":
        found["log"] = {
            "contact_from": contact,
            "radius": draw(numbers(0.01, 0.05)) * L,
            "length": draw(numbers(0.1, 1.0)) * L,
            "density": 1000.0,
            "offset": draw(numbers(-0.3, 0.3)) * L,
        }
    elif touch == "force":
        found["contact_from"] = contact
        found["contact_force"] = draw(vectors(50.0))
        found["contact_couple"] = draw(vectors(10.0))
    names = st.sampled_from(["tip_force", "tip_mass", "pull", "contact"])
    if jump := draw(st.dictionaries(names, st.booleans())):
        found["jump"] = jump
    return found


@st.composite
def limits(draw: st.DrawFn, names: list[str]) -> Table:
    """Bounds of a phase or a motion; all contain the passive trunk."""
    found: Table = {}
    if draw(st.booleans()):
        found["activation"] = draw(pairs(-3.0, 0.0).map(lambda p: [p[0], 0.0]))
    if bool(names) and draw(st.booleans()):
        patterns = st.sampled_from([*names, "*", "R*", "*1-*"])
        fitting = patterns.filter(lambda p: p != "R*" or any(n[0] == "R" for n in names))
        fitting = fitting.filter(lambda p: p != "*1-*" or any(n[1] == "1" for n in names))
        found["muscles"] = {draw(fitting): draw(st.sampled_from([[0.0, 0.0], [-1.0, 0.5]]))}
    for angle in ("head_z_deg", "head_y_deg"):
        if draw(st.booleans()):
            found[angle] = draw(st.sampled_from([[0.0, 0.0], [-10.0, 10.0], [-40.0, 5.0]]))
    return found


@st.composite
def starts(draw: st.DrawFn, names: list[str]) -> Table:
    """A state near rest, of some muscles and the head; within most bounds."""
    found: Table = {angle: draw(numbers(-5.0, 5.0)) for angle in ("head_z_deg", "head_y_deg")}
    if names:
        found["activation"] = {draw(st.sampled_from([*names, "*"])): draw(numbers(-0.3, 0.05))}
    return found


@st.composite
def problems(draw: st.DrawFn, anatomy: Table | None) -> Table:
    """A well-formed problem of 1 to 4 steps, for an anatomy or, with None, the elephant."""
    L = ELEPHANT_LENGTH if anatomy is None else anatomy["length"]
    names = ["R1-dl", "L3-vr"] if anatomy is None else muscle_names(anatomy)
    extension = draw(st.sampled_from([[0.67, 1.35], [1.0, 2.0]]))
    bounds: Table = {"activation": [-3.0, 0.0], "extension": extension}
    contact = draw(st.sampled_from([0.0, 0.5, 0.8, 0.99])) * L
    phases: list[Table] = []
    step = 1
    while step <= 4 and (not phases or draw(st.booleans())):
        steps = draw(st.integers(1, 5 - step))
        phase: Table = {
            "name": f"phase {len(phases) + 1}",
            "duration": draw(st.sampled_from([1e-6, 0.5, 2.0, 1e4])),
            "steps": steps,
            "interpolation": draw(st.sampled_from(["cosine", "hermite", "none"])),
            "loads": draw(loads(L, contact, step)),
            "bounds": draw(limits(names)),
        }
        if draw(st.integers(0, 3)) == 0:
            phase["wrap"] = draw(wraps(L))
        else:
            phase["targets"] = draw(st.lists(targets(L, step), min_size=1, max_size=2))
        if draw(st.booleans()):
            phase["change"] = [
                {"steps": [1, steps], "activation": draw(st.sampled_from([0.0, 0.1, 1.0]))},
                {"head_z_deg": [-2.0, 2.0]},
            ]
        if draw(st.integers(0, 2)) == 0:
            phase["auxiliary"] = draw(
                st.sampled_from(
                    [
                        {},
                        {"activation_deviation": 0.0, "head_deviation_deg": 0.0},
                        {"activation_deviation": 0.3},
                    ]
                )
            )
        phases.append(phase)
        step += steps
    start = draw(starts(names)) if draw(st.integers(0, 3)) == 0 else None
    return {
        "name": "study",
        "gravity": draw(st.sampled_from([9.8, 9.8, 0.0, -9.8])),
        "bounds": bounds | draw(limits(names)),
        "tolerance": draw(
            st.sampled_from([{}, {"position": 0.1 * L, "direction": 0.5}, {"position": 1e-9}])
        ),
        "phases": phases,
        **({} if start is None else {"start": start}),
        **({} if anatomy is None else {"anatomy": "arm.toml"}),
    }


def muscle_names(anatomy: Table) -> list[str]:
    """Names of the muscles of an anatomy, as a problem file may use them."""
    return [
        f"{side}{number}-{muscle['group']}"
        for number, segment in enumerate(anatomy["segments"], 1)
        for muscle in segment["muscles"]
        for side in muscle.get("sides", ["R", "L"])
    ]

"""The statements of section 6 of the paper about each motion, and the numbers that test them.

The statements are paraphrased; the paper gives curves and few numbers, so a rule of ours decides
each. "Mean" is the mean |activation| over muscles and time steps.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from trunk_ocp.analysis.measures import REVERSAL, reversals

from . import data

WAYS = ("paper", "horizon")
OBLIQUE, RADIAL = ("ovo", "ivo"), ("dr", "vr")
GROUPS = ("dl", "ovo", "ivo", "dr", "vr")


class Seen:
    """One plan of one motion, with means and curves of its muscles."""

    def __init__(self, plans: Mapping[str, Any], way: str) -> None:
        plan = plans["ways"][way]
        self.size = np.abs(plan["activations"])
        self.head = np.array(plan["head_deg"])
        self.at_bound = plan["at_bound"]
        self.muscles = plans["muscles"]
        self.phases = np.array(plans["phases"])

    def mean(
        self,
        *groups: str,
        segment: int | None = None,
        side: str | None = None,
        phases: tuple[str, ...] = (),
    ) -> float:
        """Mean |activation| of some muscles in some phases; by default of all in all."""
        chosen = [
            (not groups or m["group"] in groups)
            and (segment is None or m["segment"] == segment)
            and (side is None or m["side"] == side)
            for m in self.muscles
        ]
        rows = np.isin(self.phases, phases) if phases else slice(None)
        return float(self.size[rows][:, chosen].mean())

    def curve(self, name: str) -> np.ndarray:
        """|activation| of one muscle at all time steps."""
        return self.size[:, [m["name"] for m in self.muscles].index(name)]

    def level(self, name: str, *phases: str) -> float:
        """Mean |activation| of one muscle in some phases."""
        return float(self.curve(name)[np.isin(self.phases, phases)].mean())

    def changes(self, first: int, last: int) -> float:
        """Largest change of an activation between two steps, from `first` to `last` (from 0)."""
        return float(np.abs(np.diff(self.size[first : last + 1], axis=0)).max())

    @property
    def head_travel(self) -> float:
        """Sum of the magnitudes of all changes of both head angles, degrees, starting from rest."""
        return float(np.abs(np.diff(np.vstack([np.zeros(2), self.head]), axis=0)).sum())


Trio = Mapping[str, Seen]
"""All three motions, planned in one way."""


@dataclass(frozen=True)
class Observation:
    """A statement of the paper, how it is tested, and the numbers of the test.

    Attributes
    ----------
    rule : str
        The condition on the numbers, in words.
    numbers : callable
        Takes the three motions; returns the numbers to show and whether the rule holds.
    """

    motion: str
    section: str
    says: str
    rule: str
    numbers: Callable[[Trio], tuple[dict[str, float], bool]]


def _pick(trio: Trio) -> Seen:
    return trio["pick-fruit"]


def _lift(trio: Trio) -> Seen:
    return trio["lift-log"]


def _tilt(trio: Trio) -> Seen:
    return trio["lift-log-asymmetric"]


def _by_group(seen: Seen, segment: int | None = None, *phases: str) -> dict[str, float]:
    """Means by group, for the groups of a segment."""
    have = {m["group"] for m in seen.muscles if segment is None or m["segment"] == segment}
    return {g: seen.mean(g, segment=segment, phases=phases) for g in GROUPS if g in have}


def _reach_longitudinal(trio: Trio) -> tuple[dict[str, float], bool]:
    means = _by_group(_pick(trio), 1, "reach")
    return means, max(means, key=means.__getitem__) == "dl"


def _reach_twist(trio: Trio) -> tuple[dict[str, float], bool]:
    means = {g: _pick(trio).mean(g, segment=2, phases=("reach",)) for g in ("ivo", "dl")}
    return means, means["ivo"] >= 2 * means["dl"]


def _pull(trio: Trio) -> tuple[dict[str, float], bool]:
    seen = _pick(trio)
    rows = np.flatnonzero(seen.phases != "eat")
    change = float(np.abs(seen.size[rows[-1]] - seen.size[0]).max())
    return {"change": change}, change < 0.1


def _mouth_balanced(trio: Trio) -> tuple[dict[str, float], bool]:
    names = ("R1-ovo", "L1-ovo", "R1-ivo", "L1-ivo")
    levels = {name: _pick(trio).level(name, "eat") for name in names}
    return levels, all(
        uneven(levels[f"R1-{g}"], levels[f"L1-{g}"]) < 0.2 and levels[f"R1-{g}"] > 0.5
        for g in OBLIQUE
    )


def uneven(right: float, left: float) -> float:
    """0 if both sides contract equally, 1 if only one does."""
    return abs(right - left) / max(right + left, 1e-9)


def _mouth_radial(trio: Trio) -> tuple[dict[str, float], bool]:
    means = {f"segment {s}": _pick(trio).mean(*RADIAL, segment=s, phases=("eat",)) for s in (1, 2)}
    return means, means["segment 2"] >= 2 * means["segment 1"]


def _mouth_left(trio: Trio) -> tuple[dict[str, float], bool]:
    means = {
        side: _pick(trio).mean(*OBLIQUE, segment=2, side=side, phases=("eat",)) for side in "LR"
    }
    return means, means["L"] > means["R"] + 0.01


def _mouth_longitudinal(trio: Trio) -> tuple[dict[str, float], bool]:
    mean = _pick(trio).mean("dl", segment=2, phases=("eat",))
    return {"dl": mean}, mean < 0.1


def _mouth_third(trio: Trio) -> tuple[dict[str, float], bool]:
    means = _by_group(_pick(trio), 3, "eat")
    return means, max(means, key=means.__getitem__) == "dl"


def _head_lift(trio: Trio) -> tuple[dict[str, float], bool]:
    travel = {"fruit": _pick(trio).head_travel, "log": _lift(trio).head_travel}
    return travel, travel["log"] > travel["fruit"]


def _least_longitudinal(trio: Trio) -> tuple[dict[str, float], bool]:
    means = _by_group(_lift(trio))
    return means, min(means, key=means.__getitem__) == "dl"


def _longitudinal_first(trio: Trio) -> tuple[dict[str, float], bool]:
    means = {f"segment {s}": _lift(trio).mean("dl", segment=s) for s in (1, 2, 3)}
    return means, means["segment 1"] > 0.1 and max(means.values()) == means["segment 1"]


def _radial_highest(trio: Trio) -> tuple[dict[str, float], bool]:
    seen = _lift(trio)
    means = {"radial": seen.mean(*RADIAL), "oblique": seen.mean(*OBLIQUE), "dl": seen.mean("dl")}
    return means, means["radial"] == max(means.values())


def _radial_each_segment(trio: Trio) -> tuple[dict[str, float], bool]:
    means = {f"segment {s}": _lift(trio).mean(*RADIAL, segment=s) for s in (1, 2, 3)}
    return means, min(means.values()) > 0.5


def _radial_third(trio: Trio) -> tuple[dict[str, float], bool]:
    means = {f"segment {s}": _lift(trio).mean(*RADIAL, segment=s) for s in (1, 2, 3)}
    return means, max(means.values()) == means["segment 3"]


def _outer_third(trio: Trio) -> tuple[dict[str, float], bool]:
    seen = _lift(trio)
    means = {f"ovo {s}": seen.mean("ovo", segment=s) for s in (1, 2, 3)}
    means |= {f"ivo {s}": seen.mean("ivo", segment=s) for s in (1, 2)}
    return means, max(means.values()) == means["ovo 3"]


def _third_even(trio: Trio) -> tuple[dict[str, float], bool]:
    seen = _lift(trio)
    numbers = {
        g: uneven(*(seen.mean(g, segment=3, side=side) for side in "RL")) for g in ("ovo", *RADIAL)
    }
    return numbers, max(numbers.values()) < 0.2


def _left_inner(trio: Trio) -> tuple[dict[str, float], bool]:
    seen = _lift(trio)
    means = {n: float(seen.curve(n).mean()) for n in ("L1-ivo", "R1-ivo", "L2-ivo", "R2-ivo")}
    return means, max(means.values()) == means["L1-ivo"]


def _right_ventral(trio: Trio) -> tuple[dict[str, float], bool]:
    levels = {name: float(_lift(trio).curve(name).mean()) for name in ("R2-vr", "L2-vr")}
    return levels, levels["R2-vr"] >= 2 * levels["L2-vr"] and levels["R2-vr"] > 0.1


def _left_ventral(trio: Trio) -> tuple[dict[str, float], bool]:
    early = ("wrap", "take the weight")
    levels = {name: _lift(trio).level(name, *early) for name in ("L1-vr", "R1-vr")}
    return levels, levels["L1-vr"] >= 2 * levels["R1-vr"] and levels["L1-vr"] > 0.1


DORSAL = ("R3-dr", "L3-dr")


def _saturated(trio: Trio) -> tuple[dict[str, float], bool]:
    seen = _lift(trio)
    start = seen.at_bound[1]
    steps = sum(any(name in row for name in DORSAL) for row in seen.at_bound)
    return {"steps at the bound": steps}, any(name in start for name in DORSAL)


def _returns(trio: Trio) -> tuple[dict[str, float], bool]:
    seen = _lift(trio)
    turns = {name: reversals(seen.curve(name)[1:]) for name in DORSAL}
    drop = max(float(-np.diff(seen.curve(name)[1:]).min()) for name in DORSAL)
    return {"turns": sum(turns.values()), "largest drop": max(drop, 0.0)}, any(turns.values())


def _turning(trio: Trio) -> tuple[dict[str, float], bool]:
    seen = _lift(trio)
    turning = sum(reversals(curve[1:]) > 0 for curve in seen.size.T)
    return {"muscles that turn": turning}, turning >= len(seen.muscles) / 4


def _angle(trio: Trio) -> tuple[dict[str, float], bool]:
    angle = _tilt(trio).head[:, 1]
    numbers = {"largest psi_Y": float(np.abs(angle).max()), "range": float(np.ptp(angle))}
    return numbers, abs(numbers["largest psi_Y"] - 30.5) <= 3


def _most_head(trio: Trio) -> tuple[dict[str, float], bool]:
    travel = {name: seen.head_travel for name, seen in trio.items()}
    named = {"fruit": travel["pick-fruit"], "log": travel["lift-log"]}
    named["asymmetric"] = travel["lift-log-asymmetric"]
    return named, named["asymmetric"] == max(named.values())


def _same_first(trio: Trio) -> tuple[dict[str, float], bool]:
    difference = float(np.abs(_tilt(trio).size[0] - _lift(trio).size[0]).max())
    return {"difference": difference}, difference < 0.01


def _couple(trio: Trio) -> tuple[dict[str, float], bool]:
    numbers = {"asymmetric": _tilt(trio).changes(0, 1), "symmetric": _lift(trio).changes(0, 1)}
    return numbers, numbers["asymmetric"] >= 2 * numbers["symmetric"]


def _lower(segment: int, group: str) -> Callable[[Trio], tuple[dict[str, float], bool]]:
    def numbers(trio: Trio) -> tuple[dict[str, float], bool]:
        names = [f"{side}{segment}-{group}" for side in "RL"]
        right, left = (_tilt(trio).level(name, "lift") for name in names)
        return dict(zip(names, (right, left), strict=True)), left > 0.1 and right <= 2 * left / 3

    return numbers


def _uneven(segment: int, group: str) -> Callable[[Trio], tuple[dict[str, float], bool]]:
    def numbers(trio: Trio) -> tuple[dict[str, float], bool]:
        names = [f"{side}{segment}-{group}" for side in "RL"]
        right, left = (_tilt(trio).level(name, "lift") for name in names)
        return dict(zip(names, (right, left), strict=True)), uneven(right, left) > 0.2

    return numbers


def _larger_changes(trio: Trio) -> tuple[dict[str, float], bool]:
    numbers = {"asymmetric": _tilt(trio).changes(1, 9), "symmetric": _lift(trio).changes(1, 9)}
    return numbers, numbers["asymmetric"] > numbers["symmetric"]


def _returns_tilted(trio: Trio) -> tuple[dict[str, float], bool]:
    turns = sum(reversals(_tilt(trio).curve(name)[1:]) for name in DORSAL)
    return {"turns": turns}, turns > 0


WEAKER = ("R1-ovo", "R3-ovo", "L1-ivo", "L2-dr", "R2-vr", "R3-vr")


def _weaker(trio: Trio) -> tuple[dict[str, float], bool]:
    lower = sum(_tilt(trio).level(n, "lift") < _lift(trio).level(n, "lift") for n in WEAKER)
    return {"lower": lower}, lower == len(WEAKER)


PICK, LIFT, TILT = data.MOTIONS
OBSERVATIONS = (
    Observation(PICK, "6.1", "Reaching: longitudinal muscles bend segment 1 toward the fruit.",
                "dl has the largest mean in segment 1", _reach_longitudinal),
    Observation(PICK, "6.1", "Reaching: segment 2 twists by its inner ventral obliques, with "
                "little longitudinal contraction.", "mean of ivo at least twice that of dl",
                _reach_twist),
    Observation(PICK, "6.1", "Pulling at the fruit hardly changes any activation.",
                "largest change from start to end of the pull below 0.1", _pull),
    Observation(PICK, "6.1", "To the mouth: segment 1 curls by strong obliques, right and left in "
                "balance.", "each above 0.5, sides uneven by less than 20 %", _mouth_balanced),
    Observation(PICK, "6.1", "To the mouth: radial muscles work little in segment 1, much more in "
                "segment 2.", "mean in segment 2 at least twice that in segment 1", _mouth_radial),
    Observation(PICK, "6.1", "To the mouth: in segment 2 left obliques work more than right ones.",
                "larger mean on the left", _mouth_left),
    Observation(PICK, "6.1", "To the mouth: the longitudinal muscles of segment 2 are almost idle.",
                "mean below 0.1", _mouth_longitudinal),
    Observation(PICK, "6.1", "To the mouth: longitudinal muscles bend segment 3.",
                "dl has the largest mean in segment 3", _mouth_third),
    Observation(LIFT, "6.2", "The head turns more than for the fruit.",
                "longer path of both head angles together (degrees)", _head_lift),
    Observation(LIFT, "6.2", "Of all groups the longitudinal muscles are used least.",
                "dl has the smallest mean", _least_longitudinal),
    Observation(LIFT, "6.2", "Where they are used at all, it is in segment 1.",
                "mean above 0.1 there, and largest", _longitudinal_first),
    Observation(LIFT, "6.2", "Radial muscles are activated most.",
                "largest mean of the three architectures", _radial_highest),
    Observation(LIFT, "6.2", "Radial activations are large in every segment.",
                "mean above 0.5 in each", _radial_each_segment),
    Observation(LIFT, "6.2", "They are largest in segment 3.", "largest mean", _radial_third),
    Observation(LIFT, "6.2", "Of the obliques the outer ones of segment 3 contract most.",
                "largest mean of obliques", _outer_third),
    Observation(LIFT, "6.2", "Segment 3 contracts almost equally on both sides.",
                "each group uneven by less than 20 %", _third_even),
    Observation(LIFT, "6.2", "The left inner ventral oblique of segment 1 works hard, and twists.",
                "largest mean of the inner obliques", _left_inner),
    Observation(LIFT, "6.2", "In segment 2 the right ventral radial muscle works, the left hardly.",
                "right at least twice left, above 0.1", _right_ventral),
    Observation(LIFT, "6.2", "Before lifting, the left ventral radial muscle of segment 1 works "
                "without the right.", "left at least twice right, above 0.1", _left_ventral),
    Observation(LIFT, "6.2", "Dorsal radial muscles of segment 3 are at their bound when lifting "
                "begins.", "at the bound at step 2", _saturated),
    Observation(LIFT, "6.2", "They leave it and reach it again in mid-lift: the "
                "reorganization.", f"a reversal of more than {REVERSAL:g}", _returns),
    Observation(LIFT, "6.2", "Activations go up and down during the lift.",
                "at least a quarter of the muscles reverse", _turning),
    Observation(TILT, "6.3", "psi_Y reaches about 30.5 degrees.", "within 3 degrees", _angle),
    Observation(TILT, "6.3", "The head turns most of the three motions.",
                "longest path of both head angles together (degrees)", _most_head),
    Observation(TILT, "6.3", "The first phase is that of the symmetric lift.",
                "no activation at step 1 differs by 0.01", _same_first),
    Observation(TILT, "6.3", "Activations change a lot when the couple sets in.",
                "largest change from step 1 to 2 at least twice the symmetric lift's", _couple),
    *(
        Observation(TILT, "6.3", f"Lifting: {muscle}, the right contracts much less than the left.",
                    "right at most two thirds of left", _lower(segment, group))
        for muscle, segment, group in (
            ("outer ventral oblique of segment 1", 1, "ovo"),
            ("outer ventral oblique of segment 3", 3, "ovo"),
            ("inner ventral oblique of segment 1", 1, "ivo"),
            ("ventral radial of segment 1", 1, "vr"),
        )
    ),
    Observation(TILT, "6.3", "Lifting: dorsal radial muscles of segment 2 differ between sides.",
                "uneven by more than 20 %", _uneven(2, "dr")),
    Observation(TILT, "6.3", "Lifting: so do ventral radial muscles of segment 3.",
                "uneven by more than 20 %", _uneven(3, "vr")),
    Observation(TILT, "6.3", "Lifting: changes from step to step are larger than in the symmetric "
                "lift.", "a larger maximum change", _larger_changes),
    Observation(TILT, "6.3", "Dorsal radial muscles of segment 3 reorganize here as well.",
                f"a reversal of more than {REVERSAL:g}", _returns_tilted),
    Observation(TILT, "6.3", f"Lifting: {', '.join(WEAKER)} contract less than in the symmetric "
                "lift.", "all six have a smaller mean", _weaker),
)  # fmt: skip
"""In the order of the paper."""


def observed() -> list[dict[str, Any]]:
    """Every statement with its numbers and verdicts, from the stored plans."""
    plans = {name: data.read(f"plans-{name}") for name in data.MOTIONS}
    trios = {way: {name: Seen(plans[name], way) for name in plans} for way in WAYS}
    entries = []
    for o in OBSERVATIONS:
        entry: dict[str, Any] = {
            "motion": o.motion, "section": o.section, "says": o.says, "rule": o.rule
        }  # fmt: skip
        for way in WAYS:
            numbers, agrees = o.numbers(trios[way])
            entry[way] = {"numbers": numbers, "agrees": bool(agrees)}
        entries.append(entry)
    return entries

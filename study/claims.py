"""The claims of page.md, each a condition on the data."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from trunk_ocp.problem.build import load_motion

from .page import Fields, less

LIFTS = ("lift", "tilt")


def _least(*conditions: Callable[[Fields], bool]) -> Callable[[Fields], bool]:
    return lambda facts: all(holds(facts) for holds in conditions)


def _tracks_better(facts: Fields) -> bool:
    fronts = [facts[short]["front"] for short in LIFTS]
    return all(
        horizon["tracking"] < blind["tracking"]
        for front in fronts
        for blind, horizon in zip(front["blind"], front["horizon"], strict=True)
    )


def _mirrored(facts: Fields) -> bool:
    optima = facts["lift"]["optima"]["horizon"]["optima"]
    return (
        len(optima) == 2
        and "mirror image" in optima[1]["found_from"]
        and abs(optima[1]["planner_objective"] / optima[0]["planner_objective"] - 1) < 2e-6
    )


def _wrap_costs_more(facts: Fields) -> bool:
    """The wrap with foresight costs more than the blind one, which is the best wrap by itself."""
    return facts["lift"]["first_J"]["horizon"] > facts["lift"]["first_J"]["blind"]


def _verdict(words: str, way: str) -> Callable[[Fields], bool]:
    return lambda facts: (
        all(o[way]["agrees"] for o in facts["observations"] if words in o["says"])
        and any(words in o["says"] for o in facts["observations"])
    )


def _not(holds: Callable[[Fields], bool]) -> Callable[[Fields], bool]:
    return lambda facts: not holds(facts)


def _both(words: str) -> Callable[[Fields], bool]:
    return _least(_verdict(words, "paper"), _verdict(words, "horizon"))


def _reachable(facts: Fields) -> bool:
    """The bounds on psi_Y and its changes add up to more than the paper's angle."""
    steps = load_motion("lift-log-asymmetric").steps
    highest = steps[1].box.upper[-1] + sum(step.change.upper[-1] for step in steps[2:])
    return bool(np.degrees(highest) > 30.5)


def _needed_third(facts: Fields) -> bool:
    return bool(facts["least_loss"] > 2 and facts["vr_loss"] < 0.1)


def _crossed(facts: Fields) -> bool:
    """The horizon eats by R1-ovo and L1-ivo."""
    (balance,) = (o for o in facts["observations"] if "in balance" in o["says"])
    level = balance["horizon"]["numbers"]
    kinds = {m["name"]: m["kind"] for m in facts["pick"]["redundancy"]["muscles"]}
    return all(
        level[busy] > 0.5 and level[idle] < 0.1 and kinds[busy] == "must work"
        for busy, idle in (("R1-ovo", "L1-ovo"), ("L1-ivo", "R1-ivo"))
    )


CLAIMS: dict[str, Callable[[Fields], bool]] = {
    "running cost, then foresight, lessen the turns": _least(
        *(
            less(*(f"{short}/moving/{way}/turns" for way in ("horizon", "costed", "paper")))
            for short in LIFTS
        )
    ),
    "no turn is left in segment 3": lambda f: all(
        f[short]["moving"]["horizon"]["third"] == 0 for short in LIFTS
    ),
    "the paper's way does turn in segment 3": lambda f: all(
        f[short]["moving"]["paper"]["third"] > 0 for short in LIFTS
    ),
    "foresight tracks better in both lifts": lambda f: all(
        f[s]["J_saved"] > 0.1 and f[s]["J_paper"] > 0.1 for s in LIFTS
    ),
    "for the fruit it changes next to nothing": lambda f: f["pick"]["saved"] < 0.01,
    "the blind fruit suffices": lambda f: f["pick"]["sufficient"] == 1,
    "a sufficient lookahead is known": lambda f: all(f[s]["sufficient"] for s in LIFTS),
    "the largest change falls": _least(
        *(
            less(*(f"{short}/moving/{way}/largest" for way in ("horizon", "blind", "paper")))
            for short in LIFTS
        )
    ),
    "the horizon tracks better at every weight": _tracks_better,
    "the smooth blind lift turns less, and tracks worse": lambda f: (
        f["lift"]["front"]["blind"][4]["reversals"] < f["lift"]["front"]["horizon"][4]["reversals"]
        and f["lift"]["front"]["blind"][4]["tracking"]
        > 2 * f["lift"]["front"]["horizon"][4]["tracking"]
    ),
    "blindness hurts less under the tightest limits": lambda f: all(
        f[s]["survey"]["cells"][8]["blind_excess"]
        < 0.1 * f[s]["survey"]["cells"][0]["blind_excess"]
        for s in LIFTS
    ),
    "one cell is reached by foresight alone, the slow fruit": lambda f: (
        f["reached"] == 1
        and f["pick"]["survey"]["cells"][2]["best"]["status"] == "solved"
        and f["pick"]["survey"]["cells"][2]["lookaheads"]["3"]["status"] == "solved"
        and f["pick"]["survey"]["cells"][2]["lookaheads"]["22"]["status"] == "missed"
    ),
    "some cells are lost, the slow symmetric lift among them": lambda f: (
        f["lost"] > 0
        and f["lift"]["survey"]["cells"][1]["best"]["status"] == "missed"
        and f["lift"]["survey"]["cells"][1]["lookaheads"]["1"]["status"] == "solved"
    ),
    "no start found anything better": lambda f: all(
        own["reported_is_best"] and not own["failed"]
        for s in ("pick", *LIFTS)
        for own in f[s]["optima"].values()
    ),
    "the lifts of the tightest limits are all missed": lambda f: all(
        own["status"] == "missed"
        for s in LIFTS
        for own in f[s]["survey"]["cells"][8]["lookaheads"].values()
    ),
    "other thresholds of a turn keep the order": _least(
        *(
            less(*(f"lift/moving/{way}/{which}" for way in ("horizon", "blind", "paper")))
            for which in ("fine", "coarse")
        )
    ),
    "no muscle is determined": lambda f: all(
        f[s]["kinds"]["determined"] == 0 for s in ("pick", *LIFTS)
    ),
    "segment 3's outer obliques and dorsal radials are needed": _needed_third,
    "appendix B lets psi_Y get there": _reachable,
    "the horizon eats by R1-ovo and L1-ivo": _crossed,
    "the left inner oblique works more": _both("left inner ventral oblique"),
    "a weaker trunk lifts as well": lambda f: (
        f["lift"]["survey"]["cells"][3]["best"]["status"] == "solved"
    ),
    "over the whole symmetric lift turns fall by little": lambda f: (
        0
        <= f["lift"]["ways"]["blind"]["reversals"] - f["lift"]["ways"]["horizon"]["reversals"]
        <= 3
    ),
    "two mirrored optima of the symmetric lift": _mirrored,
    "foresight pays in the wrap": _wrap_costs_more,
    "the symmetric lift varies more with 2 to 4 steps, and costs less": lambda f: all(
        f["lift"]["measures"][f"lookahead {H}"]["total_variation"]
        > f["lift"]["measures"]["lookahead 1"]["total_variation"]
        and f["lift"]["measures"][f"lookahead {H}"]["planner_objective"]
        < f["lift"]["measures"]["lookahead 1"]["planner_objective"]
        for H in (2, 3, 4)
    ),
    "no target is missed without a muscle for the fruit": lambda f: (
        f["pick"]["missed_without"] == "none"
    ),
    "psi_Y disagrees, psi_Z turns more": lambda f: all(
        f["tilt"]["psi"][way]["largest"] + 3 < 30.5 < f["tilt"]["psi"][way]["other"]
        for way in ("paper", "horizon")
    ),
    "no return to the bound in the symmetric lift": _least(
        *(_not(_verdict("They leave it", way)) for way in ("paper", "horizon"))
    ),
    "balanced obliques: the paper's way does, the horizon not": _least(
        _verdict("in balance", "paper"), _not(_verdict("in balance", "horizon"))
    ),
    "another first phase with foresight only": _least(
        _verdict("The first phase is", "paper"), _not(_verdict("The first phase is", "horizon"))
    ),
    "what holds in both": _least(
        _both("longitudinal muscles are used least"),
        _both("Radial muscles are activated most"),
        _both("largest in segment 3"),
        _both("turns most of the three"),
    ),
}
"""By the sentence that each represents."""

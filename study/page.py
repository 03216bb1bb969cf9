"""docs/foresight.md from the stored data: text with fields, tables, and a check of its claims.

    python -m study.page

Every number on the page is a field of `page.md`, looked up in the data. `CLAIMS` are its
statements as conditions on the same data; if one of them does not hold, the page is not written.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from trunk_ocp.analysis.lookahead_study import TRACKING_ONLY
from trunk_ocp.analysis.measures import REVERSAL, reversals
from trunk_ocp.analysis.multistart import SAME_PLAN_TOL
from trunk_ocp.analysis.redundancy.activation_ranges import AT_REST
from trunk_ocp.problem.build import load_motion

from . import data

TEMPLATE = Path(__file__).with_name("page.md")
SHORT = {"pick-fruit": "pick", "lift-log": "lift", "lift-log-asymmetric": "tilt"}
WAYS = {"paper": "paper", "paper, same cost": "costed", "blind": "blind", "horizon": "horizon"}
FINE, COARSE = REVERSAL / 2, 2 * REVERSAL
"""Other thresholds of a reversal, to see whether it matters."""
Fields = dict[str, Any]


def fields() -> Fields:
    """All data and derived numbers, by the short name of each motion."""
    facts: Fields = {"times": data.read("times")}
    for name in data.MOTIONS:
        facts[SHORT[name]] = motion_fields(name)
    facts["observations"] = observed = data.read("observations")
    for way in ("paper", "horizon"):
        facts[f"agree_{way}"] = sum(o[way]["agrees"] for o in observed)
    facts["statements"] = len(observed)
    losses = {
        (short, need["muscles"][0]): need["ratio"]
        for short in ("lift", "tilt")
        for need in facts[short]["redundancy"]["without"]
    }
    facts["least_loss"] = min(v for (_, m), v in losses.items() if m[1:] in ("3-ovo", "3-dr"))
    facts["vr_loss"] = max(v for (_, m), v in losses.items() if m[1:] == "3-vr") - 1
    facts["agree_both"] = sum(o["paper"]["agrees"] and o["horizon"]["agrees"] for o in observed)
    facts["agree_neither"] = sum(
        not o["paper"]["agrees"] and not o["horizon"]["agrees"] for o in observed
    )
    facts["minutes"] = sum(part["seconds"] for part in facts["times"]["parts"].values()) / 60
    facts["load"] = max(part["load_before"] for part in facts["times"]["parts"].values())
    facts |= constants(facts) | counted(facts)
    for short in SHORT.values():
        facts[f"{short}_ways"] = ways_table(facts[short])
        facts[f"{short}_front"] = front_table(facts[short]["front"])
        facts[f"{short}_survey"] = survey_table(facts[short]["survey"])
    facts["said"] = observations_table(observed)
    facts["optima"] = optima_table(facts)
    facts["muscles"] = muscles_table(facts)
    facts["strongest"] = strongest_table()
    facts["lifting"] = lifting_table(facts)
    return facts


def constants(facts: Fields) -> Fields:
    """Constants of the study."""
    starts = facts["lift"]["optima"]["horizon"]["optima"]
    random = sum(name.startswith("random") for o in starts for name in o["found_from"])
    return {
        "starts_random": random,
        "same": SAME_PLAN_TOL,
        "turn": REVERSAL,
        "tracking_only": TRACKING_ONLY.effort,
        "muscle_count": len(facts["lift"]["redundancy"]["muscles"]),
        "fine": FINE,
        "coarse": COARSE,
        "at_rest": AT_REST,
        "tolerance": load_motion("lift-log").tolerance[1],
    }


def counted(facts: Fields) -> Fields:
    """Numbers of cells of all surveys by what happens in them."""
    cells = [cell for short in SHORT.values() for cell in facts[short]["survey"]["cells"]]
    solved = [
        (cell["best"]["status"] == "solved", cell["lookaheads"]["1"]["status"] == "solved")
        for cell in cells
    ]
    horizons = [list(cell["lookaheads"].values())[-1] for cell in cells]
    return {
        "cells": len(cells),
        "reached": solved.count((True, False)),
        "lost": solved.count((False, True)),
        "worse_cells": sum(bool(cell["worse_than_blind"]) for cell in cells),
        "stuck": sum(cell["best"] != own for cell, own in zip(cells, horizons, strict=True)),
    }


def motion_fields(name: str) -> Fields:
    """All data of one motion, and derived numbers."""
    compared = data.read(f"compare-{name}")
    measures = compared["measures"]
    plans = data.read(f"plans-{name}")
    ways = {short: measures[long] for long, short in WAYS.items() if long in measures}
    count = len(plans["times"])
    ways |= {"blind": measures["lookahead 1"], "horizon": measures[f"lookahead {count}"]}
    ways["best"] = measures.get("best horizon", ways["horizon"])
    facts: Fields = {
        "steps": count,
        "measures": measures,
        "ways": ways,
        "sufficient": compared["sufficient_lookahead"],
        "worse": compared["worse_than_blind"],
        "weights": compared["weights"],
        "moving": {short: moving(plans, long) for long, short in WAYS.items()},
        "survey": data.read(f"survey-{name}"),
        "front": data.read(f"front-{name}"),
        "redundancy": data.read(f"redundancy-{name}"),
        "optima": {mode: data.read(f"optima-{name}-{mode}") for mode in ("horizon", "sequential")},
    }
    for cell in facts["survey"]["cells"]:
        blind = cell["lookaheads"]["1"]["planner_objective"]
        cell["blind_excess"] = blind / cell["best"]["planner_objective"] - 1
    facts["pulls"] = plans["phases"].count("pull")
    facts["psi"] = {short: turned(plans, long) for long, short in WAYS.items()}
    costs = [o["planner_objective"] for o in facts["optima"]["horizon"]["optima"]]
    facts["worst_optimum"] = costs[-1] / costs[0]
    facts["first_J"] = {short: plans["ways"][long]["J"][0] for long, short in WAYS.items()}
    facts["saved"] = 1 - ways["best"]["planner_objective"] / ways["blind"]["planner_objective"]
    facts["J_saved"] = 1 - ways["best"]["paper_objective"] / ways["blind"]["paper_objective"]
    facts["J_paper"] = 1 - ways["best"]["paper_objective"] / ways["paper"]["paper_objective"]
    kinds = [muscle["kind"] for muscle in facts["redundancy"]["muscles"]]
    facts["kinds"] = {kind.replace(" ", "_"): kinds.count(kind) for kind in sorted(set(kinds))}
    facts["kinds"].setdefault("determined", 0)
    facts["missed_without"] = ", ".join(
        need["muscles"][0]
        for need in facts["redundancy"]["without"]
        if need["status"] != "solved"
    ) or "none"  # fmt: skip
    facts["costly"] = max(facts["redundancy"]["without"], key=lambda need: need["ratio"])
    return facts


def turned(plans: Fields, way: str) -> Fields:
    """How far the head turns, degrees."""
    other, angle = np.array(plans["ways"][way]["head_deg"]).T
    return {
        "largest": float(np.abs(angle).max()),
        "range": float(np.ptp(angle)),
        "other": float(np.abs(other).max()),
    }


def moving(plans: Fields, way: str) -> Fields:
    """How much activations move from step 2 on.

    In the lifts this is the lift itself, where the paper sees the reorganization.
    """
    size = np.abs(np.array(plans["ways"][way]["activations"]))[1:]
    third = np.array([muscle["segment"] == 3 for muscle in plans["muscles"]])
    change = np.abs(np.diff(size, axis=0))
    net = float(np.abs(size[-1] - size[0]).sum())
    turns = np.array([reversals(curve) for curve in size.T])
    return {
        "turns": int(turns.sum()),
        "turning": int((turns > 0).sum()),
        "third": int(turns[third].sum()),
        "fine": sum(reversals(curve, FINE) for curve in size.T),
        "coarse": sum(reversals(curve, COARSE) for curve in size.T),
        "largest": float(change.max()),
        "path": float(change.sum()),
        "net": net,
        "detour": float(change.sum()) / net,
    }


def table(head: list[str], rows: list[list[str]]) -> str:
    """A Markdown table."""
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    return "\n".join([*lines, *("| " + " | ".join(row) + " |" for row in rows)])


def number(value: float | int | None, digits: int = 3) -> str:
    """A number in readable form, or a dash for None."""
    if value is None:
        return "-"
    if isinstance(value, int):
        return str(value)
    text = f"{value:.{digits}g}"
    return f"{value:.0f}" if "e+" in text else text


MEASURED = (
    ("J", "paper_objective", 1.0),
    ("objective, 1e-3", "planner_objective", 1e3),
    ("worst, mm", "worst_position_error", 1e3),
    ("effort", "squared_activation", 1.0),
    ("rate, 1/s", "squared_rate", 1.0),
    ("variation", "total_variation", 1.0),
    ("largest change", "largest_change", 1.0),
    ("reversals", "reversals", 1),
    ("at bound, s", "time_at_bound", 1.0),
    ("muscles at bound", "saturated_muscles", 1),
    ("head, rad", "head_travel", 1.0),
    ("s", "seconds", 1.0),
)


def ways_table(motion: Fields) -> str:
    """Measures of a motion planned by each method."""
    count, measures = motion["steps"], motion["measures"]
    shown = [f"lookahead {H}" for H in range(1, count + 1) if count <= 10 or H in (1, 2, 3, 5, 10)]
    if count > 10:
        shown.append(f"lookahead {count}")
    names = {"lookahead 1": "1, blind", f"lookahead {count}": f"{count}, horizon"}
    rows = []
    for name in ["paper", "paper, same cost", *shown, "best horizon"]:
        if name in measures:
            own = measures[name]
            label = names.get(name, name.removeprefix("lookahead "))
            label += "" if own["status"] == "solved" else f" ({own['status']})"
            rows.append([label, *(number(own[key] * unit) for _, key, unit in MEASURED)])
    return table(["method, or steps ahead", *(head for head, _, _ in MEASURED)], rows)


def lifting_table(facts: Fields) -> str:
    """How activations move during the two lifts."""
    rows = []
    for short, title in (("lift", "symmetric"), ("tilt", "asymmetric")):
        for way in WAYS.values():
            m = facts[short]["moving"][way]
            rows.append(
                [title, way]
                + [number(m[key]) for key in ("turns", "turning", "third", "largest", "path")]
                + [number(m["detour"])]
            )
    head = [
        "lift",
        "method",
        "reversals",
        "muscles that reverse",
        "reversals in segment 3",
        "largest change",
    ]
    return table([*head, "path", "path / net change"], rows)


def survey_table(survey: Fields) -> str:
    """Excess over the best horizon at every pair of limits, and missed targets."""
    ahead = list(survey["cells"][0]["lookaheads"])
    rows = []
    for cell in survey["cells"]:
        least = cell["best"]["planner_objective"]
        row = [number(cell["limits"]["activation"]), number(cell["limits"]["rate"])]
        for own in cell["lookaheads"].values():
            text = f"{100 * (own['planner_objective'] / least - 1):.1f}"
            row.append(text if own["status"] == "solved" else f"{text} ({own['status']})")
        best = cell["best"]
        row.append(number(1e3 * best["worst_position_error"]) + _but(best))
        row.append(number(cell["sufficient_lookahead"]))
        rows.append(row)
    titles = [f"{H} ahead, %" for H in ahead]
    return table(
        ["largest activation", "largest rate, 1/s", *titles, "best: worst, mm", "sufficient"], rows
    )


def _but(own: Fields) -> str:
    return "" if own["status"] == "solved" else f" ({own['status']})"


def front_table(front: Fields) -> str:
    """Tracking against smoothness."""
    rows = []
    for weight, blind, horizon in zip(
        front["rate_weight"], front["blind"], front["horizon"], strict=True
    ):
        row = [f"{weight:.0e}"]
        for own in (blind, horizon):
            row += [number(own["tracking"]) + _but(own), number(own["squared_rate"])]
            row.append(number(own["reversals"]))
        rows.append(row)
    head = [f"{way}: {what}" for way in ("blind", "horizon") for what in ("tracking", "rate, 1/s",
                                                                       "reversals")]  # fmt: skip
    return table(["weight of rates", *head], rows)


def optima_table(facts: Fields) -> str:
    """Local optima by motion and mode."""
    rows = []
    for name, short in SHORT.items():
        for mode, own in facts[short]["optima"].items():
            best = own["optima"][0]["planner_objective"]
            rows.append([
                name, mode, number(own["starts"]), number(len(own["failed"])),
                number(len(own["optima"])),
                number(max(o["distance"] for o in own["optima"])),
                number(max(o["planner_objective"] for o in own["optima"]) / best),
                number(sum(o["status"] != "solved" for o in own["optima"])),
                f"{len(own['optima'][0]['found_from'])}",
                "yes" if own["reported_is_best"] else "**no**",
            ])  # fmt: skip
    return table(
        ["motion", "mode", "starts", "failed", "distinct", "largest distance", "worst / best",
         "miss a target", "plans at the best", "reported is best"], rows
    )  # fmt: skip


def muscles_table(facts: Fields) -> str:
    """What each motion leaves undetermined, and the best choices."""
    rows = []
    for name, short in SHORT.items():
        own, versions = facts[short], facts[short]["redundancy"]["versions"]
        must = [m["name"] for m in own["redundancy"]["muscles"] if m["kind"] == "must work"]
        rows.append([
            name,
            number(own["kinds"]["determined"]),
            ", ".join(must),
            number(own["kinds"].get("free", 0)),
            number(own["kinds"].get("can_be_off", 0)),
            *(
                f"{number(versions['plan'][key])} / {number(versions[which][key])}"
                for which, key in (
                    ("least effort", "squared_activation"),
                    ("least peak", "largest_activation"),
                    ("fewest muscles", "working_muscles"),
                )
            ),
            own["missed_without"],
        ])  # fmt: skip
    return table(
        ["motion", "determined", "must work", "free", "can be off", "effort: plan / least",
         "peak: plan / least", "muscles: plan / fewest", "a target is missed without"], rows
    )  # fmt: skip


def strongest_table(count: int = 4) -> str:
    """The muscles that contract most in each phase, with their mean |activation|."""
    rows = []
    for name in SHORT:
        plans = data.read(f"plans-{name}")
        names = [muscle["name"] for muscle in plans["muscles"]]
        for phase in dict.fromkeys(plans["phases"]):
            at = np.array(plans["phases"]) == phase
            row = [name, phase]
            for way in ("paper", "horizon"):
                own = plans["ways"][way]
                level = np.abs(np.array(own["activations"]))[at].mean(axis=0)
                most = np.argsort(-level, kind="stable")[:count]
                row.append(", ".join(f"{names[i]} {level[i]:.2f}" for i in most))
                psi = np.array(own["head_deg"])[at][-1]
                row.append(f"{psi[0]:.1f}, {psi[1]:.1f}")
            rows.append(row)
    head = "psi_Z, psi_Y at its end"
    return table(["motion", "phase", "paper's method", head, "horizon", head], rows)


def observations_table(observed: list[Fields]) -> str:
    """The statements of section 6 and both plans."""
    rows = []
    for o in observed:
        row = [o["section"], o["says"], o["rule"]]
        for way in ("paper", "horizon"):
            verdict = "agrees" if o[way]["agrees"] else "**disagrees**"
            numbers = ", ".join(f"{k} {v:.2f}" if isinstance(v, float) else f"{k} {v}"
                             for k, v in o[way]["numbers"].items())  # fmt: skip
            row.append(f"{verdict}: {numbers}")
        rows.append(row)
    return table(["§", "the paper says", "our rule", "paper's method", "horizon"], rows)


def filled(template: str, facts: Fields) -> str:
    """A text with every {path/to/a/field:format} replaced; mm and % are scaled."""

    def value(match: re.Match[str]) -> str:
        path, _, kind = match[1].partition(":")
        entry: Any = facts
        for key in path.split("/"):
            entry = entry[int(key)] if isinstance(entry, list) else entry[key]
        if kind == "mm":
            return number(1e3 * entry)
        if kind == "%":
            return f"{100 * entry:.0f} %"
        if isinstance(entry, str):
            return entry
        return format(entry, kind) if kind else number(entry)

    return re.sub(r"\{([^{}\n]+)\}", value, template)


def less(first: str, *others: str) -> Callable[[Fields], bool]:
    """A condition: the values at these paths increase."""

    def holds(facts: Fields) -> bool:
        values = []
        for path in (first, *others):
            entry: Any = facts
            for key in path.split("/"):
                entry = entry[key]
            values.append(entry)
        return all(a < b for a, b in itertools.pairwise(values))

    return holds


def broken(facts: Fields) -> list[str]:
    """Claims of the page that the data do not support."""
    from .claims import CLAIMS

    return [sentence for sentence, holds in CLAIMS.items() if not holds(facts)]


def page() -> str:
    """The whole page.

    Raises
    ------
    ValueError
        If the data do not support a claim of the page.
    """
    facts = fields()
    wrong = broken(facts)
    if wrong:
        raise ValueError("no longer true, rewrite study/page.md and study/claims.py: "
                         + "; ".join(wrong))  # fmt: skip
    return filled(TEMPLATE.read_text(), facts)


def write_page() -> None:
    """Write docs/foresight.md and the verdicts it shows."""
    from .observations import observed

    data.write("observations", observed())
    data.PAGE.write_text(page())


if __name__ == "__main__":
    write_page()

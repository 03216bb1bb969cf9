"""The jobs of a run; each is one part of a script, in its own process."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

MOTIONS = ("lift-log", "lift-log-asymmetric", "pick-fruit")
METHODS = ("sbplx", "nomad")
WAYS = ("ours", "expand", "plain")
OPTI = {"opti-expand": True, "opti-plain": False}  # key: expand
BUDGETS = (5, 15, 45)  # s, for the paper's method
STEPS, SEGMENTS = (10, 20, 40, 80), (3, 6, 12, 24)
WHOLE = (24, 99)  # segments of trunks planned without a given start


@dataclass(frozen=True)
class Job:
    """One part with its arguments; figures are medians over `processes` runs of `limit` s each."""

    key: str
    module: str
    part: str
    arguments: dict[str, Any] = field(default_factory=dict)
    processes: int = 1
    limit: float = 120.0


def jobs(quick: bool) -> list[Job]:
    """All jobs, with small budgets if quick."""
    few, budgets = (1, BUDGETS[:1]) if quick else (3, BUDGETS)
    ipopt = 10.0 if quick else 60.0
    result = [
        Job("single", "forward", "single", {"shapes": 20 if quick else 60}, few),
        Job("collocation", "forward", "collocation", {"shapes": 20 if quick else 60}, few),
        Job("loaded", "forward", "loaded", {"shapes": 5000 if quick else 20_000}),
        Job("unloaded", "forward", "unloaded", {"shapes": 100_000 if quick else 500_000}),
        Job("bvp", "bvp", "stacked", {"shapes": 4 if quick else 12}),
        Job("bvp-whole", "bvp", "whole", {"shapes": 1 if quick else 2}),
        Job("exudyn", "rods", "exudyn", {"shapes": 2 if quick else 8}),
        Job("elastica", "rods", "elastica", {"shapes": 1 if quick else 5}),
    ]
    for motion in MOTIONS:
        for mode in ("sequential", "horizon"):
            arguments = {"motion": motion, "mode": mode, "repeats": 1 if quick else 5}
            result.append(Job(f"{mode} {motion}", "inverse", "ours", arguments))
        result.append(Job(f"replan {motion}", "inverse", "replan", {"motion": motion}))
        for way in WAYS:
            arguments = {"motion": motion, "way": way, "budget": ipopt}
            result.append(
                Job(f"{way} {motion}", "inverse", "horizon_nlp", arguments, few, 2 * ipopt + 60)
            )
        for way, expand in OPTI.items():
            arguments = {"motion": motion, "expand": expand, "budget": ipopt}
            result.append(Job(f"{way} {motion}", "opti", "horizon", arguments, few, 2 * ipopt + 60))
        for method in METHODS:
            for budget in budgets:
                arguments = {"motion": motion, "method": method, "budget": budget}
                key = f"{method} {motion} {budget} s"
                result.append(Job(key, "paper", "sequential", arguments, 1, 2 * budget + 60))
    for kind, sizes in (("steps", STEPS), ("segments", SEGMENTS)):
        for size in sizes[:: len(sizes) - 1] if quick else sizes:
            arguments = {"kind": kind, "size": size, "repeats": few}
            result.append(Job(f"{kind} {size}", "scaling", "iteration", arguments))
    for size in WHOLE[:1] if quick else WHOLE:
        result.append(Job(f"whole {size}", "scaling", "whole", {"segments": size}))
    return result

"""Time of an Ipopt iteration vs. number of time steps and segments; trunks of many segments."""

from __future__ import annotations

import json
import re
import tomllib
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

import trunk_ocp as to
from trunk_ocp.model.anatomy import AnatomySpec, read_anatomy
from trunk_ocp.problem.build import build_motion, problems_folder
from trunk_ocp.problem.problem_file import ProblemSpec

from .common import median, run_part
from .inverse import figures_of

ITERATIONS = 60


def lift_log() -> dict[str, Any]:
    return tomllib.loads((problems_folder() / "lift-log.toml").read_text())


def problem(data: dict[str, Any]) -> ProblemSpec:
    return ProblemSpec.model_validate_json(json.dumps(data))


def with_steps(steps: int) -> to.Motion:
    """Lift-log with a lift of more steps: the same rates, so smaller changes per step."""
    data = lift_log()
    lift = data["phases"][-1]
    share = lift["steps"] / (steps - 2)
    lift["steps"] = steps - 2
    lift["change"] = [
        {key: np.multiply(value, share).tolist() for key, value in change.items()}
        for change in lift["change"]
    ]
    return build_motion(problem(data), read_anatomy("asian-elephant"))


def cut_anatomy(parts: int) -> AnatomySpec:
    """The elephant with each segment divided into equal parts with the same muscles."""
    data = read_anatomy("asian-elephant").model_dump()
    segments = []
    for segment in data["segments"]:
        edges = np.linspace(*segment["Z_over_length"], parts + 1).tolist()
        for start, end in pairwise(edges):
            segments.append(segment | {"Z_over_length": (start, end)})
    return AnatomySpec.model_validate_json(json.dumps(data | {"segments": segments}))


def with_segments(segments: int) -> to.Motion:
    """Lift-log for the trunk of `cut_anatomy`; bounds on muscles apply to every part."""
    parts, data = segments // 3, lift_log()
    for phase in data["phases"]:
        muscles = phase.get("bounds", {}).get("muscles")
        if muscles:
            phase["bounds"]["muscles"] = {
                f"[RL]{number}-{group}": pair
                for pattern, pair in muscles.items()
                for number, group in _numbers(pattern, parts)
            }
    return build_motion(problem(data), cut_anatomy(parts))


def _numbers(pattern: str, parts: int) -> list[tuple[int, str]]:
    """`*3-dl` as the numbers of segment 3's parts and `dl`."""
    found = re.fullmatch(r"\*(\d)-(.+)", pattern)
    if found is None:
        raise ValueError(f"{pattern}: unknown kind of pattern")
    last = int(found[1]) * parts
    return [(number, found[2]) for number in range(last - parts + 1, last + 1)]


def iteration(kind: str, size: int, repeats: int = 3) -> dict[str, Any]:
    """Seconds per Ipopt iteration of the horizon, from the sequential plan."""
    motion = with_steps(size) if kind == "steps" else with_segments(size)
    options = to.Options()
    start = to.plan_motion(motion, lookahead=1, options=options)
    options = replace(options, max_iterations=ITERATIONS)
    durations, iterations = [], 0
    for _ in range(repeats):
        plan = to.plan_motion(motion, options=options, start=start)
        iterations = plan.iterations - start.iterations
        durations.append((plan.solve_seconds - start.solve_seconds) / max(iterations, 1))
    return {
        "size": size,
        "muscles": len(motion.trunk.muscles),
        "elements": plan.mesh.elements,
        "degree": plan.mesh.degree,
        "verification_error_m": float(start.verification.position_difference.max()),
        "iterations": iterations,
        "seconds_per_iteration": median(durations),
    }


def whole(segments: int) -> dict[str, Any]:
    """A complete lift-log horizon for a trunk with many segments, without a given start."""
    motion = with_segments(segments)
    plan = to.plan_motion(motion)
    return figures_of(plan) | {
        "segments": motion.trunk.segments,
        "muscles": len(motion.trunk.muscles),
    }


if __name__ == "__main__":
    run_part({"iteration": iteration, "whole": whole})

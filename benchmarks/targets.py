"""Performance targets, and whether a run met them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from .jobs import MOTIONS, SEGMENTS, STEPS, WHOLE

Parts = dict[str, dict[str, Any]]
PLAN = {"lift-log": (2.4, 0.8), "lift-log-asymmetric": (2.4, 0.8), "pick-fruit": (4.2, 1.5)}  # s

ERRORS = ("error_in_L", "reference_error_in_L")  # no error is known better than the reference


@dataclass(frozen=True)
class Target:
    """A measured value and its target: at most `target`, or at least if `least`."""

    what: str
    value: float | None
    target: float | None
    stretch: float | None = None
    unit: str = "s"
    least: bool = False

    def _met(self, limit: float | None) -> bool | None:
        if self.value is None or limit is None:
            return None
        return self.value >= limit if self.least else self.value <= limit

    def _shown(self, limit: float | None) -> str:
        sign = ">=" if self.least else "<="
        return "-" if limit is None else f"{sign} {_number(limit)} {self.unit}".rstrip()

    @property
    def met(self) -> bool | None:
        return self._met(self.target)

    @property
    def stretch_met(self) -> str:
        return {True: "yes", False: "no", None: "-"}[self._met(self.stretch)]

    @property
    def shown(self) -> str:
        return "-" if self.value is None else f"{_number(self.value)} {self.unit}".rstrip()

    @property
    def target_shown(self) -> str:
        return self._shown(self.target)

    @property
    def stretch_shown(self) -> str:
        return self._shown(self.stretch)


def _number(value: float) -> str:
    return f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.3g}"


def targets(parts: Parts) -> list[Target]:
    """Every target; `value` is None where it was not measured or the part failed."""
    return [*planning(parts), *replanning(parts), *shapes(parts), *growth(parts), checked(parts)]


def get(parts: Parts, key: str, name: str, factor: float = 1.0) -> float | None:
    """A figure of a part, if it was measured."""
    value = parts.get(key, {}).get(name)
    return None if value is None else value * factor


def planning(parts: Parts) -> list[Target]:
    result = []
    for motion in MOTIONS:
        key = f"horizon {motion}"
        solved = str(get_text(parts, key)).startswith("solved")
        value = get(parts, key, "total_seconds") if solved else None
        result.append(Target(f"horizon plan, {motion}", value, *PLAN[motion]))
    for motion in MOTIONS:
        plan = get(parts, f"horizon {motion}", "total_seconds", 2.0)
        limit = None if plan is None else plan + 2
        value = get(parts, f"command {motion}", "wall_seconds")
        result.append(Target(f"`solve-motion {motion}`: 2 x the plan above + 2 s", value, limit))
    result.append(
        Target(
            "peak memory of `solve-motion`, the worst of three",
            worst(get(parts, f"command {motion}", "peak_memory_mb") for motion in MOTIONS),
            300,
            unit="MB",
        )
    )
    return result


def replanning(parts: Parts) -> list[Target]:
    result = []
    for motion in MOTIONS:
        key = f"replan {motion}"
        result += [
            Target(
                f"re-plan, {motion}: iterations, worst",
                get(parts, key, "worst_iterations"),
                5,
                unit="",
            ),
            Target(f"re-plan, {motion}: median", get(parts, key, "seconds", 1e3), 150, 40, "ms"),
        ]
    return result


def shapes(parts: Parts) -> list[Target]:
    return [
        Target("one loaded shape, cold", get(parts, "single", "cold_seconds", 1e3), 1, 0.85, "ms"),
        Target("one loaded shape, warm", get(parts, "single", "warm_seconds", 1e3), 0.3, unit="ms"),
        Target("its error", worst([get(parts, "single", name) for name in ERRORS]), 1e-6, unit="L"),
        Target(
            "loaded shapes, two cores",
            get(parts, "loaded", "per_second_two_cores"),
            5e3,
            2e4,
            "/s",
            True,
        ),
        Target(
            "their error",
            worst([get(parts, "loaded", ERRORS[0]), get(parts, "single", ERRORS[1])]),
            1e-5,
            unit="L",
        ),
        Target(
            "unloaded shapes, two cores",
            get(parts, "unloaded", "per_second_two_cores"),
            1e6,
            unit="/s",
            least=True,
        ),
        Target(
            "tip Jacobian over the shape", get(parts, "single", "jacobian_over_shape"), 3, unit="x"
        ),
    ]


def growth(parts: Parts) -> list[Target]:
    linear = {
        kind: ratio(get(parts, f"{kind} {a}", each), get(parts, f"{kind} {b}", each), b / a)
        for each in ["seconds_per_iteration"]
        for kind, a, b in (
            ("steps", STEPS[0], STEPS[-1]),
            ("segments", SEGMENTS[0], SEGMENTS[-1]),
        )
    }
    solved = {n: str(get_text(parts, f"whole {n}")).startswith("solved") for n in WHOLE}
    return [
        Target("one iteration, 10 -> 80 steps, of linear growth", linear["steps"], 1.25, unit="x"),
        Target("the same, 3 -> 24 segments", linear["segments"], 1.25, unit="x"),
        Target(
            "24 segments, lift-log horizon, solved and verified",
            get(parts, "whole 24", "total_seconds") if solved[24] else None,
            60,
        ),
        Target(
            "99 segments, the same (100 are the stretch)",
            get(parts, "whole 99", "total_seconds") if solved[99] else None,
            None,
            60,
        ),
    ]


def checked(parts: Parts) -> Target:
    return Target(
        "verification difference, the worst of three motions",
        worst(get(parts, f"horizon {motion}", "verification_error_m", 1e3) for motion in MOTIONS),
        0.1,
        unit="mm",
    )


def get_text(parts: Parts, key: str) -> Any:
    return parts.get(key, {}).get("status")


def worst(values: Any) -> float | None:
    every = list(values)
    return None if None in every else max(every)


def ratio(small: float | None, large: float | None, growth: float) -> float | None:
    return None if small is None or large is None else large / small / growth

"""Performance targets, and whether a run met them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from .jobs import MOTIONS, SEGMENTS, STEPS, WHOLE

Parts = dict[str, dict[str, Any]]
PLAN_SECONDS = {
    "lift-log": (2.4, 0.8),
    "lift-log-asymmetric": (2.4, 0.8),
    "pick-fruit": (4.2, 1.5),
}
"""Target and stretch target of a horizon plan."""

ERRORS = ("error_in_L", "reference_error_in_L")  # an error is known only to within the latter


@dataclass(frozen=True)
class Target:
    """A measured value and its limit: at most `limit`, or at least if `at_least`."""

    name: str
    value: float | None
    limit: float | None
    stretch: float | None = None
    unit: str = "s"
    at_least: bool = False

    def _met(self, limit: float | None) -> bool | None:
        if self.value is None or limit is None:
            return None
        return self.value >= limit if self.at_least else self.value <= limit

    def _format(self, limit: float | None) -> str:
        sign = ">=" if self.at_least else "<="
        return "-" if limit is None else f"{sign} {_number(limit)} {self.unit}".rstrip()

    @property
    def met(self) -> bool | None:
        return self._met(self.limit)

    @property
    def stretch_met(self) -> str:
        return {True: "yes", False: "no", None: "-"}[self._met(self.stretch)]

    @property
    def value_text(self) -> str:
        return "-" if self.value is None else f"{_number(self.value)} {self.unit}".rstrip()

    @property
    def limit_text(self) -> str:
        return self._format(self.limit)

    @property
    def stretch_text(self) -> str:
        return self._format(self.stretch)


def _number(value: float) -> str:
    return f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.3g}"


def targets(parts: Parts) -> list[Target]:
    """All targets; `value` is None if it was not measured or failed."""
    return [*planning(parts), *replanning(parts), *shapes(parts), *growth(parts), accuracy(parts)]


def get(parts: Parts, key: str, name: str, factor: float = 1.0) -> float | None:
    """A figure of a part, if it was measured."""
    value = parts.get(key, {}).get(name)
    return None if value is None else value * factor


def planning(parts: Parts) -> list[Target]:
    result = []
    for motion in MOTIONS:
        key = f"horizon {motion}"
        value = get(parts, key, "total_seconds") if solved(parts, key) else None
        result.append(Target(f"horizon plan, {motion}", value, *PLAN_SECONDS[motion]))
    for motion in MOTIONS:
        plan = get(parts, f"horizon {motion}", "total_seconds", 2.0)
        limit = None if plan is None else plan + 2
        value = get(parts, f"command {motion}", "wall_seconds")
        result.append(Target(f"`solve-motion {motion}` in total: 2 x its plan + 2 s", value, limit))
    result.append(
        Target(
            "peak memory of `solve-motion`, largest of three",
            largest(get(parts, f"command {motion}", "peak_memory_mb") for motion in MOTIONS),
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
                f"re-plan, {motion}: most iterations",
                get(parts, key, "worst_iterations"),
                5,
                unit="",
            ),
            Target(
                f"re-plan, {motion}: median time", get(parts, key, "seconds", 1e3), 150, 40, "ms"
            ),
        ]
    return result


def shapes(parts: Parts) -> list[Target]:
    return [
        Target(
            "one loaded shape, cold start", get(parts, "single", "cold_seconds", 1e3), 1, 0.85, "ms"
        ),
        Target(
            "one loaded shape, warm start",
            get(parts, "single", "warm_seconds", 1e3),
            0.3,
            unit="ms",
        ),
        Target(
            "error of one loaded shape",
            largest([get(parts, "single", name) for name in ERRORS]),
            1e-6,
            unit="L",
        ),
        Target(
            "loaded shapes, two cores",
            get(parts, "loaded", "per_second_two_cores"),
            5e3,
            2e4,
            "/s",
            True,
        ),
        Target(
            "error of a batch of loaded shapes",
            largest([get(parts, "loaded", ERRORS[0]), get(parts, "single", ERRORS[1])]),
            1e-5,
            unit="L",
        ),
        Target(
            "unloaded shapes, two cores",
            get(parts, "unloaded", "per_second_two_cores"),
            1e6,
            unit="/s",
            at_least=True,
        ),
        Target(
            "time of the tip Jacobian relative to the shape",
            get(parts, "single", "jacobian_over_shape"),
            3,
            unit="x",
        ),
    ]


def growth(parts: Parts) -> list[Target]:
    def relative(kind: str, first: int, last: int) -> float | None:
        """Time per iteration of the largest size relative to linear growth from the smallest."""
        small, large = (
            get(parts, f"{kind} {size}", "seconds_per_iteration") for size in (first, last)
        )
        return None if small is None or large is None else large / small / (last / first)

    seconds = {
        n: get(parts, f"whole {n}", "total_seconds") if solved(parts, f"whole {n}") else None
        for n in WHOLE
    }
    return [
        Target(
            "time of one iteration, 10 -> 80 steps, relative to linear growth",
            relative("steps", STEPS[0], STEPS[-1]),
            1.25,
            unit="x",
        ),
        Target(
            "time of one iteration, 3 -> 24 segments, relative to linear growth",
            relative("segments", SEGMENTS[0], SEGMENTS[-1]),
            1.25,
            unit="x",
        ),
        Target(
            "24 segments, lift-log horizon, solved and verified",
            seconds[24],
            60,
        ),
        Target(
            "99 segments, lift-log horizon, solved and verified",
            seconds[99],
            None,
            60,
        ),
    ]


def accuracy(parts: Parts) -> Target:
    return Target(
        "verification difference, largest of three motions",
        largest(get(parts, f"horizon {motion}", "verification_error_m", 1e3) for motion in MOTIONS),
        0.1,
        unit="mm",
    )


def solved(parts: Parts, key: str) -> bool:
    """Whether the plan of a part is solved."""
    return str(parts.get(key, {}).get("status")).startswith("solved")


def largest(values: Iterable[float | None]) -> float | None:
    """The largest value, or None if one is missing."""
    known = list(values)
    return None if None in known else max(value for value in known if value is not None)

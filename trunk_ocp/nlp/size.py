"""Size of a plan's NLP: unknowns, equations, and estimates of memory and time."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from ..errors import InputError
from ..problem.motion import Motion
from ..rod.collocation import Mesh
from .rod_block import rod_equations, step_points

# Measured with 30 to 2,500 muscles and 10 to 1,000 time steps, MUMPS, one thread: beyond the first
# few thousand equations, each takes 7 to 9 kB, and 20 to 40 us an iteration. Ipopt needs more
# memory in its restoration phase.
EQUATION_BYTES = 10e3
EQUATION_SECONDS = 30e-6
COLD_ITERATIONS, WARM_ITERATIONS = 100, 40
"""Iterations of a solve far from its solution, and of one near it or of a single step."""
LARGE_BYTES = 2e9
LARGE_SECONDS = 300.0
"""Memory and time above which the user is warned."""
CGROUP = Path("/sys/fs/cgroup")


@dataclass(frozen=True)
class Size:
    """Size of the largest NLP of a plan, and the resources that the plan needs.

    Attributes
    ----------
    unknowns, equations : int
        Numbers of the largest window.
    memory : float
        Estimate in bytes, within a factor of about 1.5.
    seconds : float
        Estimate within a factor of about 3 for tens of muscles, and 10 for thousands.
    """

    unknowns: int
    equations: int
    memory: float
    seconds: float

    @property
    def large(self) -> bool:
        """Whether to warn the user before the solve starts."""
        return self.memory > LARGE_BYTES or self.seconds > LARGE_SECONDS

    def __str__(self) -> str:
        return (
            f"{self.unknowns:,} unknowns and {self.equations:,} equations at a time, about "
            f"{self.memory / 1e9:.1f} GB of memory and {_duration(self.seconds)}"
        )


def size_of(motion: Motion, mesh: Mesh, lookahead: int) -> Size:
    """Size of a plan that solves `lookahead` time steps at a time on a mesh."""
    unknowns, equations = [], []
    for number, step in enumerate(motion.steps):
        points = step_points(motion, step, number)
        columns, rows = rod_equations(motion.trunk, mesh, motion.extension, points).builder.size
        unknowns.append(columns)
        equations.append(rows + step.change.limited.size)
    largest, count = max(equations), len(motion.steps)
    windows = count - lookahead + 1
    # The first window starts from the plan of single steps, later ones from the window before.
    iterations = WARM_ITERATIONS * count
    if lookahead > 1:
        iterations += COLD_ITERATIONS * lookahead
        iterations += WARM_ITERATIONS * lookahead * (windows - 1)
    return Size(
        max(unknowns) * lookahead,
        largest * lookahead,
        EQUATION_BYTES * largest * lookahead,
        EQUATION_SECONDS * largest * iterations,
    )


def check_size(motion: Motion, mesh: Mesh, lookahead: int) -> str:
    """Warning about a large plan; empty if it is not large.

    Raises
    ------
    InputError
        If it needs more memory than is available.
    """
    size = size_of(motion, mesh, lookahead)
    plan = (
        f"{motion.name}: {len(motion.steps):,} time steps of {len(motion.trunk.muscles):,} muscles"
    )
    available = available_memory()
    if available is not None and size.memory > available:
        raise InputError(
            f"{plan}, {lookahead:,} at a time: needs {size}; expected at most the "
            f"{available / 1e9:.1f} GB that are free here. Plan fewer steps at a time "
            "(--lookahead 5, or --mode sequential), or use fewer steps or segments."
        )
    return f"{plan}: {size}; Ctrl-C saves the best so far." if size.large else ""


def available_memory() -> float | None:
    """Bytes that this process may still allocate; None if the system does not report it."""
    return min(_limits(), default=None)


def _limits() -> Iterator[float]:
    """Bytes left under the limits of the machine, the container and the process."""
    with suppress(OSError, ValueError, StopIteration):
        lines = Path("/proc/meminfo").read_text().splitlines()
        line = next(line for line in lines if line.startswith("MemAvailable:"))
        yield 1024.0 * int(line.split()[1])
    with suppress(OSError, ValueError):
        limit = int((CGROUP / "memory.max").read_text())
        yield limit - float((CGROUP / "memory.current").read_text())
    with suppress(ImportError, OSError, ValueError):
        import resource

        limit, _ = resource.getrlimit(resource.RLIMIT_AS)
        if limit != resource.RLIM_INFINITY:
            pages = int(Path("/proc/self/statm").read_text().split()[0])
            yield float(limit - pages * os.sysconf("SC_PAGE_SIZE"))


def _duration(seconds: float) -> str:
    for name, unit in (("hours", 3600.0), ("minutes", 60.0)):
        if seconds > 2 * unit:
            return f"{seconds / unit:.0f} {name}"
    return f"{seconds:.0f} seconds"

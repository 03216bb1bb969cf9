"""How large a plan's NLP is: its unknowns, and about how much memory and time it will take."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from ..errors import InputError
from ..problem.motion import Motion
from ..rod.collocation import Mesh
from .rod_block import rod_equations

# Measured with 30 to 2,500 muscles and 10 to 1,000 time steps, MUMPS, one thread: 7 to 9 kB and 20
# to 40 us an iteration for each equation beyond the first few thousand. More is held while Ipopt
# looks for a feasible point.
EQUATION_BYTES = 10e3
EQUATION_SECONDS = 30e-6
ITERATIONS, FEW = 100, 40
"""Of a solve from elsewhere, and of one that starts near its solution or has one step only."""
LARGE_BYTES = 2e9
LARGE_SECONDS = 300.0
"""What a plan may take without a word."""
CGROUP = Path("/sys/fs/cgroup")


@dataclass(frozen=True)
class Size:
    """Size of the largest NLP of a plan, and what all of it will take.

    Attributes
    ----------
    unknowns, equations : int
        Of the window with the most.
    memory : float
        Bytes, within a factor of about 1.5.
    seconds : float
        A guess: within a factor of about 3 for trunks of tens of muscles, 10 for thousands.
    """

    unknowns: int
    equations: int
    memory: float
    seconds: float

    @property
    def large(self) -> bool:
        """Whether a user should know before it begins."""
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
        asked = {target.Z for target in step.targets}
        asked |= {held.Z for held in motion.held if held.step == number}
        rod = rod_equations(motion.trunk, mesh, motion.extension, tuple(sorted(asked)))
        columns, rows = rod.assembly.size
        unknowns.append(columns)
        equations.append(rows + step.change.limited.size)
    each, count = max(equations), len(motion.steps)
    windows = count - lookahead + 1
    # More steps at a time start from the plan of single steps; later windows from those before.
    iterations = FEW * count
    if lookahead > 1:
        iterations += ITERATIONS * lookahead + FEW * lookahead * (windows - 1)
    return Size(
        max(unknowns) * lookahead,
        each * lookahead,
        EQUATION_BYTES * each * lookahead,
        EQUATION_SECONDS * each * iterations,
    )


def check_size(motion: Motion, mesh: Mesh, lookahead: int) -> str:
    """A sentence about a plan that is large; empty if it is not.

    Raises
    ------
    InputError
        If it needs more memory than there is.
    """
    size = size_of(motion, mesh, lookahead)
    told = (
        f"{motion.name}: {len(motion.steps):,} time steps of {len(motion.trunk.muscles):,} muscles"
    )
    there = available_memory()
    if there is not None and size.memory > there:
        raise InputError(
            f"{told}, {lookahead:,} at a time: needs {size}; expected at most the "
            f"{there / 1e9:.1f} GB that are free here. Plan fewer steps at a time "
            "(--lookahead 5, or --mode sequential), or use fewer steps or segments."
        )
    return f"{told}: {size}; Ctrl-C saves the best so far." if size.large else ""


def available_memory() -> float | None:
    """Bytes that this process may still take; None if the system does not say."""
    return min(_free(), default=None)


def _free() -> Iterator[float]:
    """What each limit leaves: the machine's, the container's, the process's own."""
    with suppress(OSError, ValueError, StopIteration):
        lines = Path("/proc/meminfo").read_text().splitlines()
        line = next(line for line in lines if line.startswith("MemAvailable:"))
        yield 1024.0 * int(line.split()[1])
    with suppress(OSError, ValueError):
        most = int((CGROUP / "memory.max").read_text())
        yield most - float((CGROUP / "memory.current").read_text())
    with suppress(ImportError, OSError, ValueError):
        import resource

        most, _ = resource.getrlimit(resource.RLIMIT_AS)
        if most != resource.RLIM_INFINITY:
            pages = int(Path("/proc/self/statm").read_text().split()[0])
            yield float(most - pages * os.sysconf("SC_PAGE_SIZE"))


def _duration(seconds: float) -> str:
    for name, unit in (("hours", 3600.0), ("minutes", 60.0)):
        if seconds > 2 * unit:
            return f"{seconds / unit:.0f} {name}"
    return f"{seconds:.0f} seconds"

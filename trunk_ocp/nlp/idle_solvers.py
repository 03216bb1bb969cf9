"""Solvers kept for later NLPs of the same structure, in the whole process.

The set-up of a solver takes a tenth of a plan or more. A solver serves one solve at a time, in any
thread.
"""

from __future__ import annotations

import atexit
import threading
from collections.abc import Callable, Hashable, Iterator
from contextlib import contextmanager
from typing import Any

MAX_IDLE_SOLVERS = 12
"""A plan uses three to five; each takes some 3 MB with 10 time steps."""
_idle: list[tuple[Hashable, Any]] = []  # the least recently used first
_lock = threading.Lock()


@contextmanager
def borrowed(key: Hashable, make: Callable[[], Any]) -> Iterator[Any]:
    """An idle solver of this key, or else a new one, for use inside the block only.

    One whose solve raises is not kept.
    """
    with _lock:
        number = next((i for i, (other, _) in enumerate(_idle) if other == key), None)
        solver = None if number is None else _idle.pop(number)[1]
    solver = solver or make()
    yield solver
    with _lock:
        _idle.append((key, solver))
        dropped = _idle[:-MAX_IDLE_SOLVERS]
        del _idle[:-MAX_IDLE_SOLVERS]
    del dropped  # outside the lock: it may run other code


# Their callbacks are Python's, which must not outlive the interpreter.
atexit.register(_idle.clear)

"""Independent computations side by side, in processes of one thread each.

Results do not depend on the number of processes: every task is computed from its arguments alone.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from contextlib import contextmanager
from multiprocessing.synchronize import Event
from typing import Any, TypeVar

from .reporting import Progress, Reporter

T = TypeVar("T")
Done = Callable[[int, int], object]
"""Told how many tasks are done, and of how many."""
POLL = 0.2  # s between two looks at whether the user wants to stop
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")


def run(
    function: Callable[..., T],
    tasks: Sequence[tuple[Any, ...]],
    processes: int | None = None,
    reporter: Reporter | None = None,
    done: Done | None = None,
) -> list[T]:
    """Call a function with the arguments of each task, and a reporter behind them.

    Parameters
    ----------
    function : of a module, for processes to find it
    processes : int, optional
        1 computes here, one task after the other; by default one for each core. A script that
        asks for more needs `if __name__ == "__main__"`, as every use of `multiprocessing` does.
    reporter : Reporter, optional
        Its `stop` ends all tasks after their current iterations.

    Returns
    -------
    The results, in the order of the tasks.

    Raises
    ------
    KeyboardInterrupt
        If the reporter asks to stop before all is done.
    """
    reporter, done = reporter or Reporter(), done or (lambda _, __: None)
    count = min(processes or os.cpu_count() or 1, len(tasks))
    done(0, len(tasks))
    if count > 1:
        return _side_by_side(function, tasks, count, reporter, done)
    results = []
    for task in tasks:
        results.append(function(*task, reporter))
        _check(reporter)
        done(len(results), len(tasks))
    return results


def _side_by_side(
    function: Callable[..., T],
    tasks: Sequence[tuple[Any, ...]],
    count: int,
    reporter: Reporter,
    done: Done,
) -> list[T]:
    # New processes: what is forked from one with solver threads may hang.
    context = multiprocessing.get_context("spawn")
    stop = context.Event()
    with _one_thread(), ProcessPoolExecutor(count, context, _begin, (stop,)) as pool:
        try:
            futures = [pool.submit(_call, function, task) for task in tasks]
            waiting = set(futures)
            while waiting:
                finished, waiting = wait(waiting, POLL, FIRST_COMPLETED)
                for future in finished:
                    future.result()  # raises at once what a task raised
                _check(reporter)
                done(len(tasks) - len(waiting), len(tasks))
            return [future.result() for future in futures]
        finally:
            stop.set()
            pool.shutdown(cancel_futures=True)


def _check(reporter: Reporter) -> None:
    if reporter.stop:
        raise KeyboardInterrupt


class _Listener(Reporter):
    """Stops a task when the process that started it says so."""

    def __init__(self, stop: Event) -> None:
        self._event = stop
        self.stop = stop.is_set()

    def iteration(self, progress: Progress) -> None:
        self.stop = self._event.is_set()


_stops: list[Event] = []  # of a worker process, one


def _begin(stop: Event) -> None:
    """Ctrl-C reaches every process at once; the first one answers for all."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _stops.append(stop)


def _call(function: Callable[..., T], task: tuple[Any, ...]) -> T:
    return function(*task, _Listener(_stops[-1]))


@contextmanager
def _one_thread() -> Iterator[None]:
    """Processes that start meanwhile use one thread each."""
    before = {name: os.environ.get(name) for name in THREADS}
    os.environ.update(dict.fromkeys(THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value

"""Independent computations side by side, in processes of one thread each.

The only place that starts processes. Results do not depend on how many there are: every task is
computed from its arguments alone. Where no process can be started (no shared memory, no room for
more processes, a daemon process) the tasks are computed here, one after the other.
"""

from __future__ import annotations

import logging
import math
import multiprocessing
import os
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing, contextmanager, suppress
from multiprocessing.connection import Connection
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar

from ..errors import TrunkError
from ..reporting import Reporter
from .atomic_files import discard_unfinished
from .blas_threads import one_thread
from .deferred_signals import deferred_interrupts
from .ranges import check

T = TypeVar("T")
Job = tuple[Callable[..., T], tuple[Any, ...]]
"""A function of a module, for processes to find it, and its arguments."""
Done = Callable[[int, int], object]
"""Told how many tasks are done, and of how many."""
POLL = 0.2  # s between two looks at whether the user wants to stop
CGROUP = Path("/sys/fs/cgroup")


def cores() -> int:
    """Number of processors that this process may use: its affinity and its container's quota."""
    affinity = getattr(os, "sched_getaffinity", None)  # not on every system
    count = len(affinity(0)) if affinity else os.cpu_count() or 1
    with suppress(OSError, ValueError):
        quota, period = (CGROUP / "cpu.max").read_text().split()
        if quota != "max":
            count = min(count, math.ceil(int(quota) / int(period)))
    return max(count, 1)


def run(
    function: Callable[..., T],
    tasks: Sequence[tuple[Any, ...]],
    processes: int | None = None,
    reporter: Reporter | None = None,
    done: Done | None = None,
    found: Callable[[int, T], object] | None = None,
) -> list[T]:
    """Call a function with the arguments of each task, and a reporter behind them.

    Parameters
    ----------
    function : of a module, for processes to find it
    processes : int, optional
        1 computes here, one task after the other; by default one for each core that this process
        may use.
    reporter : Reporter, optional
        Its `stop` ends all tasks: at once in other processes, after the current iteration here.
    found : callable, optional
        Called with (number of the task, its result) as soon as there is one.

    Returns
    -------
    The results, in the order of the tasks.

    Raises
    ------
    KeyboardInterrupt
        If the reporter asks to stop before all is done.
    TrunkError
        If a process was ended from outside.
    """
    if processes is not None:
        check(processes, "processes")
    reporter, done = reporter or Reporter(), done or (lambda _, __: None)
    count = min(processes or cores(), len(tasks))
    here = count <= 1 or not may_start()
    told = (reporter,) if here else (Reporter(),)
    jobs: list[Job[T]] = [(function, (*task, *told)) for task in tasks]
    results: dict[int, T] = {}
    done(0, len(tasks))
    with closing(finished(jobs, 1 if here else count, lambda: _check(reporter))) as ended:
        for number, future in ended:
            result = results[number] = future.result()  # raises what the task raised
            _check(reporter)
            if found is not None:
                found(number, result)
            done(len(results), len(tasks))
    return [results[number] for number in range(len(tasks))]


def _check(reporter: Reporter) -> None:
    if reporter.stop:
        raise KeyboardInterrupt


def finished(
    jobs: Sequence[Job[T]], processes: int, poll: Callable[[], object] = lambda: None
) -> Generator[tuple[int, Future[T]]]:
    """Number and future of each job as it ends; a job that failed has its error in its future.

    Parameters
    ----------
    poll : callable
        Called a few times a second; what it raises ends all jobs.

    Raises
    ------
    TrunkError
        If a process was ended from outside.
    """
    if processes <= 1 or not may_start():
        for number, (function, arguments) in enumerate(jobs):
            yield number, _computed(function, arguments)
        return
    with _pool(min(processes, len(jobs))) as pool:
        waiting = _submitted(pool, jobs)
        while waiting:
            ended, _ = wait(waiting, POLL, FIRST_COMPLETED)
            poll()
            for future in ended:
                _raise_if_broken(future)
                yield waiting.pop(future), future
        if waiting is not None:
            return
    yield from finished(jobs, 1)


def _submitted(pool: ProcessPoolExecutor, jobs: Sequence[Job[T]]) -> dict[Future[T], int] | None:
    """Futures of jobs and their numbers; None if there is no room for a process or a thread."""
    with deferred_interrupts(), _main_left_alone(jobs), _interrupts_kept():
        try:
            return {pool.submit(function, *given): n for n, (function, given) in enumerate(jobs)}
        except (OSError, RuntimeError):
            return None


def _computed(function: Callable[..., T], arguments: tuple[Any, ...]) -> Future[T]:
    """A future that is over: the function called here."""
    future: Future[T] = Future()
    try:
        future.set_result(function(*arguments))
    except Exception as error:
        future.set_exception(error)
    return future


def _raise_if_broken(future: Future[Any]) -> None:
    if isinstance(future.exception(), BrokenProcessPool):
        raise TrunkError(
            "A process that works beside this one was ended from outside, perhaps for want of "
            "memory. With processes=1 (--processes 1) all is computed in this one; a script that "
            "passes functions of its own needs if __name__ == '__main__': around what it runs."
        ) from None


def may_start() -> bool:
    """Whether processes of our own can be started and spoken with here."""
    if multiprocessing.current_process().daemon:  # of a pool of the user's
        return False
    try:
        # Needs shared memory, which locked containers lack, and semaphores.
        multiprocessing.get_context("spawn").Lock()
    except (OSError, ImportError, NotImplementedError):
        return False
    return True


@contextmanager
def _pool(count: int) -> Iterator[ProcessPoolExecutor]:
    """Processes that end with the block, and with this process however it ends."""
    # New processes: what is forked from one with solver threads may hang.
    context = multiprocessing.get_context("spawn")
    reader, writer = context.Pipe(duplex=False)
    pool = ProcessPoolExecutor(count, context, _begin, (reader,))
    try:
        yield pool
        pool.shutdown()
    finally:
        writer.close()  # whoever still works ends here
        pool.shutdown(cancel_futures=True)
        reader.close()


_main = threading.RLock()  # held while sys.modules may have no script, for threads overlap


@contextmanager
def _main_left_alone(jobs: Sequence[Job[Any]]) -> Iterator[None]:
    """Processes that start meanwhile do not run the user's script again.

    By default they do, to find functions that it defines. Of ours they need none, and a script
    without `if __name__ == "__main__":`, or one that came by standard input, would break them.
    """
    needed = any(getattr(function, "__module__", "") == "__main__" for function, _ in jobs)
    with _main:
        main = sys.modules["__main__"]
        if not needed:
            sys.modules["__main__"] = ModuleType("__main__")
        try:
            yield
        finally:
            sys.modules["__main__"] = main


@contextmanager
def _interrupts_kept() -> Iterator[None]:
    """Processes that start meanwhile never see Ctrl-C, not even amid their imports.

    It reaches every process of a terminal at once; this one answers for all, after the block.
    """
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


_threads: list[Any] = []  # of a process that works: keeps it at one thread until it ends


def _begin(lifeline: Connection) -> None:
    """Begin a process that works: Ctrl-C reaches all at once, and the first one answers for all."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, lambda number, frame: _leave())
    logging.getLogger("matplotlib").setLevel(logging.ERROR)  # as in a command
    if not sys.warnoptions:
        warnings.simplefilter("ignore")
    threading.Thread(target=_follow, args=(lifeline,), daemon=True).start()
    _threads.append(one_thread())
    _threads[-1].__enter__()


def _follow(lifeline: Connection) -> None:
    """Wait until the process that started this one closes the line, or ends, however it ends."""
    with suppress(EOFError, OSError):
        lifeline.recv()
    _leave()


def _leave() -> None:
    discard_unfinished()
    os._exit(1)

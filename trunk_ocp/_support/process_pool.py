"""Independent computations in parallel, in processes of one thread each.

The only module that starts worker processes. Results do not depend on their number: every task is
computed from its arguments alone. Where no process can be started (no shared memory, process limit
reached, a daemon process) the tasks run in this process, in order.
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
from typing import Any, TypeVar, cast

from ..errors import TrunkError
from ..reporting import Reporter
from .atomic_files import discard_unfinished
from .blas_threads import one_thread
from .deferred_signals import deferred_interrupts
from .ranges import check

T = TypeVar("T")
Job = tuple[Callable[..., T], tuple[Any, ...]]
"""A module-level function, which workers can import, and its arguments."""
DoneCallback = Callable[[int, int], object]
"""Called with the number of finished tasks and of all tasks."""
POLL_INTERVAL = 0.2  # s between checks whether the user wants to stop
EXIT_TIMEOUT = 5.0  # s for workers to exit after an interrupt; they take milliseconds
WORKER_KILLED = (
    "A worker process was killed, perhaps because memory ran out. With processes=1 "
    "(--processes 1) everything runs in this process; a script that passes its own "
    "functions needs if __name__ == '__main__': around its main code."
)
CGROUP = Path("/sys/fs/cgroup")


def cores() -> int:
    """Number of cores that this process may use, by its affinity and its container's quota."""
    affinity = getattr(os, "sched_getaffinity", None)  # absent on some systems
    count = len(affinity(0)) if affinity else os.cpu_count() or 1
    with suppress(OSError, ValueError):
        quota, period = (CGROUP / "cpu.max").read_text().split()
        if quota != "max":
            count = min(count, math.ceil(int(quota) / int(period)))
    return max(count, 1)


def run_tasks(
    function: Callable[..., T],
    tasks: Sequence[tuple[Any, ...]],
    processes: int | None = None,
    reporter: Reporter | None = None,
    done: DoneCallback | None = None,
    on_result: Callable[[int, T], object] | None = None,
) -> list[T]:
    """Call a function with the arguments of each task, followed by a reporter.

    Parameters
    ----------
    function : callable
        Defined in a module, so that workers can import it.
    processes : int, optional
        By default one for each core that this process may use; 1 runs the tasks in this process.
    reporter : Reporter, optional
        Its `stop` ends all tasks: immediately in workers, after the current iteration in this
        process.
    done : callable, optional
        Called with (finished tasks, all tasks) at the start and after each task.
    on_result : callable, optional
        Called with (index of the task, its result) as each task finishes.

    Returns
    -------
    The results, in the order of the tasks.

    Raises
    ------
    KeyboardInterrupt
        If the reporter asks to stop before all tasks are finished.
    TrunkError
        If a worker process was killed.
    """
    if processes is not None:
        check(processes, "processes")
    reporter, done = reporter or Reporter(), done or (lambda _, __: None)
    count = min(processes or cores(), len(tasks))
    here = count <= 1 or not may_start()
    listener = reporter if here else Reporter()  # workers cannot report back
    jobs: list[Job[T]] = [(function, (*task, listener)) for task in tasks]
    results: dict[int, T] = {}
    done(0, len(tasks))
    with closing(iter_finished(jobs, 1 if here else count, lambda: _check(reporter))) as futures:
        for number, future in futures:
            result = results[number] = future.result()  # raises what the task raised
            _check(reporter)
            if on_result is not None:
                on_result(number, result)
            done(len(results), len(tasks))
    return [results[number] for number in range(len(tasks))]


def _check(reporter: Reporter) -> None:
    if reporter.stop:
        raise KeyboardInterrupt


def iter_finished(
    jobs: Sequence[Job[T]], processes: int, poll: Callable[[], object] = lambda: None
) -> Generator[tuple[int, Future[T]]]:
    """Index and future of each job as it finishes; a failed job has its error in its future.

    Parameters
    ----------
    poll : callable
        Called a few times a second; an exception from it ends all jobs.

    Raises
    ------
    TrunkError
        If a worker process was killed.
    """
    if processes <= 1 or not may_start():
        for number, (function, arguments) in enumerate(jobs):
            yield number, _computed(function, arguments)
        return
    with _pool(min(processes, len(jobs))) as pool:
        pending = _submitted(pool, jobs)
        while pending:
            completed, _ = wait(pending, POLL_INTERVAL, FIRST_COMPLETED)
            poll()
            for future in completed:
                if isinstance(future.exception(), BrokenProcessPool):
                    raise TrunkError(WORKER_KILLED) from None
                yield pending.pop(future), future
            if not completed and any(not worker.is_alive() for worker in _workers(pool)):
                raise TrunkError(WORKER_KILLED)  # the pool does not notice if it sent a result
        if pending is not None:
            return
    yield from iter_finished(jobs, 1)


def _submitted(pool: ProcessPoolExecutor, jobs: Sequence[Job[T]]) -> dict[Future[T], int] | None:
    """Futures of jobs and their indices; None if no process or thread can be started."""
    with deferred_interrupts(), _script_hidden(jobs), _interrupts_blocked():
        try:
            futures = {pool.submit(function, *args): n for n, (function, args) in enumerate(jobs)}
        except (OSError, RuntimeError):
            return None
        # All workers have started. If one is killed while it sends a result, the pool's thread
        # waits until no process can send the rest; and Python, at its end, waits for the thread.
        with suppress(AttributeError):  # of another Python
            cast(Any, pool)._result_queue._writer.close()
        return futures


def _computed(function: Callable[..., T], arguments: tuple[Any, ...]) -> Future[T]:
    """A completed future: the function called in this process."""
    future: Future[T] = Future()
    try:
        future.set_result(function(*arguments))
    except Exception as error:
        future.set_exception(error)
    return future


def _workers(pool: ProcessPoolExecutor) -> list[Any]:
    """Processes of a pool."""
    return list((getattr(pool, "_processes", None) or {}).values())


def may_start() -> bool:
    """Whether worker processes can be started here."""
    if multiprocessing.current_process().daemon:  # such as a worker of the user's own pool
        return False
    try:
        # Needs semaphores and shared memory, which locked-down containers lack.
        multiprocessing.get_context("spawn").Lock()
    except (OSError, ImportError, NotImplementedError):
        return False
    return True


@contextmanager
def _pool(count: int) -> Iterator[ProcessPoolExecutor]:
    """Worker processes that end with the block, and with this process however it ends."""
    # Spawn: a process forked from one with solver threads may hang.
    context = multiprocessing.get_context("spawn")
    reader, writer = context.Pipe(duplex=False)
    pool = ProcessPoolExecutor(count, context, _start_worker, (reader,))
    try:
        yield pool
        pool.shutdown()
    finally:
        writer.close()  # workers that are still busy exit
        workers, thread = _workers(pool), getattr(pool, "_executor_manager_thread", None)
        pool.shutdown(wait=False, cancel_futures=True)
        # Python waits for all of these without a limit when it ends.
        for worker in workers:
            worker.join(EXIT_TIMEOUT)
            worker.kill()  # does nothing if it is gone
        if thread is not None:
            thread.join(EXIT_TIMEOUT)
        reader.close()


_main_lock = threading.RLock()  # held while sys.modules lacks the script, as threads may overlap


@contextmanager
def _script_hidden(jobs: Sequence[Job[Any]]) -> Iterator[None]:
    """Workers that start in this block do not run the user's script again.

    By default they do, to find functions that it defines. Our tasks need none of these, and a
    script without `if __name__ == "__main__":`, or one read from standard input, would break them.
    """
    needed = any(getattr(function, "__module__", "") == "__main__" for function, _ in jobs)
    with _main_lock:
        main = sys.modules["__main__"]
        if not needed:
            sys.modules["__main__"] = ModuleType("__main__")
        try:
            yield
        finally:
            sys.modules["__main__"] = main


@contextmanager
def _interrupts_blocked() -> Iterator[None]:
    """Workers that start in this block never see Ctrl-C, not even during their imports.

    Ctrl-C reaches every process of a terminal; this process handles it for all, after the block.
    """
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


_thread_limits: list[Any] = []  # of a worker: keeps it at one BLAS thread until it ends


def _start_worker(lifeline: Connection) -> None:
    """Set up a worker: it ignores Ctrl-C, which its parent handles for all workers."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, lambda number, frame: _exit())
    logging.getLogger("matplotlib").setLevel(logging.ERROR)  # as the commands do
    if not sys.warnoptions:
        warnings.simplefilter("ignore")
    threading.Thread(target=_exit_with_parent, args=(lifeline,), daemon=True).start()
    _thread_limits.append(one_thread())
    _thread_limits[-1].__enter__()


def _exit_with_parent(lifeline: Connection) -> None:
    """Wait until the parent closes the pipe or ends, however it ends; then exit."""
    with suppress(EOFError, OSError):
        lifeline.recv()
    _exit()


def _exit() -> None:
    discard_unfinished()
    os._exit(1)

"""Ctrl-C: the first ends a command cleanly and keeps the best plan; the second ends it in a second.

The second may arrive while native code runs (Ipopt, a factorization), when Python's own signal
handlers have to wait. So a thread counts signals as well; the native code used here lets it run.
Imports little, as it must be ready before anything large is imported.
"""

from __future__ import annotations

import _thread
import atexit
import contextlib
import functools
import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from types import FrameType
from typing import TYPE_CHECKING, Any

from .exit_codes import INTERRUPTED

if TYPE_CHECKING:
    from ..reporting import Reporter

SHOW_CURSOR = b"\x1b[?25h"  # undoes what a progress line does to a terminal
STOP_SIGNALS = [getattr(signal, n) for n in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, n)]
EXIT_SIGNALS = [getattr(signal, n) for n in ("SIGQUIT",) if hasattr(signal, n)]
RAISE_AGAIN = b"\0"  # in the wakeup pipe; no signal has this number
RAISE_DELAY = 0.01  # s


class Interrupts:
    """Handles Ctrl-C, and other signals that ask a process to end, during a `with` block.

    The first raises KeyboardInterrupt or, within `graceful_stop`, asks a reporter to stop. The
    second ends the process immediately.

    Attributes
    ----------
    received : bool
        Whether there was one.
    hint : str
        Sentence printed when the process ends immediately.
    """

    current: Interrupts | None = None  # of this process

    def __init__(self) -> None:
        self.received = False
        self.hint = ""
        self._reporter: Reporter | None = None
        self._ignore_next = False
        self._swallowed = False  # whether the last KeyboardInterrupt reached no handler
        self._exiting = threading.Lock()
        self._before: dict[int, Any] = {}

    def __enter__(self) -> Interrupts:
        Interrupts.current = self
        if threading.current_thread() is not threading.main_thread():
            return self  # Python allows handlers in the main thread only
        handled = [*STOP_SIGNALS, *EXIT_SIGNALS]
        # A process started with a signal ignored, as by nohup, keeps ignoring it.
        handled = [
            n for n in handled if n == signal.SIGINT or signal.getsignal(n) != signal.SIG_IGN
        ]
        reader, self._writer = os.pipe()
        with contextlib.suppress(AttributeError, OSError):  # not on every system
            os.set_blocking(self._writer, False)
        self._wakeup = signal.set_wakeup_fd(self._writer, warn_on_full_buffer=False)
        threading.Thread(target=self._count_signals, args=(reader,), daemon=True).start()
        self._before = {n: signal.signal(n, self._handle) for n in handled}
        self._unraisable, sys.unraisablehook = sys.unraisablehook, self._raise_again
        return self

    def __exit__(self, *_: object) -> None:
        Interrupts.current = None
        if self._before:
            for number, handler in self._before.items():
                signal.signal(number, handler)
            sys.unraisablehook = self._unraisable
            signal.set_wakeup_fd(self._wakeup)
            os.close(self._writer)

    @contextlib.contextmanager
    def graceful_stop(self, reporter: Reporter) -> Iterator[None]:
        """Block in which a first Ctrl-C only sets `reporter.stop`, so that work can wind down."""
        self._reporter = reporter
        reporter.stop |= self.received
        try:
            yield
        finally:
            self._reporter = None

    def ignore_next(self) -> None:
        """Ignore a first Ctrl-C from now on: the command is done, and nothing is left to stop."""
        self._ignore_next = True

    def _handle(self, number: int, frame: FrameType | None) -> None:
        if self._swallowed:
            self._swallowed = False
        elif self.received or number in EXIT_SIGNALS:
            self._exit_now()
        self.received = True
        if self._ignore_next:
            return
        if self._reporter is None:
            raise KeyboardInterrupt
        self._reporter.stop = True

    def _count_signals(self, reader: int) -> None:
        """Count signals until the pipe is closed; the second one ends the process."""
        count = repeats = 0
        while byte := os.read(reader, 1):
            if byte == RAISE_AGAIN:
                time.sleep(RAISE_DELAY)
                self._swallowed, repeats = True, repeats + 1
                _thread.interrupt_main()  # arrives here again, as a signal
            elif repeats and byte[0] == signal.SIGINT:
                repeats -= 1
            elif byte[0] in self._before:
                count += 1
                if count > 1 or byte[0] in EXIT_SIGNALS:
                    self._exit_now()
        os.close(reader)

    def _raise_again(self, report: sys.UnraisableHookArgs) -> None:
        """Raise a KeyboardInterrupt again that Python swallowed because a destructor was running.

        The thread does so a moment later: raised in here, it would be swallowed as well.
        """
        if issubclass(report.exc_type, KeyboardInterrupt):
            os.write(self._writer, RAISE_AGAIN)
        else:
            self._unraisable(report)

    def _exit_now(self) -> None:
        """End the process without running any `finally`, as one of them may take long."""
        if not self._exiting.acquire(blocking=False):
            return  # the other thread is doing it
        files = sys.modules.get("trunk_ocp._support.atomic_files")
        with contextlib.suppress(Exception):
            if files is not None:
                files.discard_unfinished()
        with contextlib.suppress(OSError):
            os.write(2, f"Stopped immediately.{self.hint and ' '}{self.hint}\n".encode())
        show_cursor()
        os._exit(INTERRUPTED)


def show_cursor() -> None:
    """Show the cursor of the terminal again, if there is one."""
    for descriptor in (1, 2):
        with contextlib.suppress(OSError):
            if os.isatty(descriptor):
                os.write(descriptor, SHOW_CURSOR)
                return


@functools.cache
def ignore_signals_at_exit() -> None:
    """Ignore Ctrl-C while the interpreter shuts down, when there is nothing left to stop."""
    if threading.current_thread() is threading.main_thread():
        atexit.register(_ignore_signals)


def _ignore_signals() -> None:
    for number in STOP_SIGNALS:
        signal.signal(number, signal.SIG_IGN)

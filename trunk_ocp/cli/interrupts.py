"""What Ctrl-C does: once, an orderly end with the best so far; twice, the end within a second.

The second one may come while native code runs (Ipopt, a factorization), in which Python's own
signal handlers wait for their turn. So signals are counted by a thread as well, which the native
code used here lets run. Imports little, for it must be ready before anything large is imported.
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
from types import FrameType, TracebackType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ..reporting import Reporter

INTERRUPTED = 4  # exit code
SHOW_CURSOR = b"\x1b[?25h"  # which a live line on a terminal has hidden
ORDERLY = [getattr(signal, n) for n in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, n)]
AGAIN = b"\0"  # no signal
MOMENT = 0.01  # s
AT_ONCE = [getattr(signal, n) for n in ("SIGQUIT",) if hasattr(signal, n)]


class Interrupts:
    """Answers Ctrl-C, and signals that ask to end, for a whole command, in a `with` block.

    The first one raises KeyboardInterrupt, within `patience` it asks a reporter to stop. The
    second one ends the process at once.

    Attributes
    ----------
    came : bool
        Whether there was one.
    hint : str
        Said if the process ends at once.
    """

    current: Interrupts | None = None  # of this process

    def __init__(self) -> None:
        self.came = False
        self.hint = ""
        self._reporter: Reporter | None = None
        self._finishing = False
        self._lost = False  # whether the last KeyboardInterrupt reached nobody
        self._ending = threading.Lock()
        self._before: dict[int, Any] = {}

    def __enter__(self) -> Interrupts:
        Interrupts.current = self
        if threading.current_thread() is not threading.main_thread():
            return self  # elsewhere Python allows no handlers
        ours = [*ORDERLY, *AT_ONCE]
        # Who starts us with a signal ignored, as nohup does, means it.
        heeded = [n for n in ours if n == signal.SIGINT or signal.getsignal(n) != signal.SIG_IGN]
        reader, self._writer = os.pipe()
        with contextlib.suppress(AttributeError, OSError):  # not on every system
            os.set_blocking(self._writer, False)
        self._wakeup = signal.set_wakeup_fd(self._writer, warn_on_full_buffer=False)
        threading.Thread(target=self._watch, args=(reader,), daemon=True).start()
        self._before = {n: signal.signal(n, self._answer) for n in heeded}
        self._unraisable, sys.unraisablehook = sys.unraisablehook, self._raise_again
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        Interrupts.current = None
        if self._before:
            for number, handler in self._before.items():
                signal.signal(number, handler)
            sys.unraisablehook = self._unraisable
            signal.set_wakeup_fd(self._wakeup)
            os.close(self._writer)

    @contextlib.contextmanager
    def patience(self, reporter: Reporter) -> Iterator[None]:
        """Block that a first Ctrl-C does not end: `reporter.stop` does, when it can."""
        self._reporter = reporter
        reporter.stop |= self.came
        try:
            yield
        finally:
            self._reporter = None

    def finish(self) -> None:
        """From now on nothing is left to stop in good order: one more Ctrl-C changes nothing."""
        self._finishing = True

    def _answer(self, number: int, frame: FrameType | None) -> None:
        if self._lost:
            self._lost = False
        elif self.came or number in AT_ONCE:
            self._end()
        self.came = True
        if self._finishing:
            return
        if self._reporter is None:
            raise KeyboardInterrupt
        self._reporter.stop = True

    def _watch(self, reader: int) -> None:
        """Count signals, until the other end is closed; the second one ends the process."""
        count = own = 0
        while byte := os.read(reader, 1):
            if byte == AGAIN:
                time.sleep(MOMENT)
                self._lost, own = True, own + 1
                _thread.interrupt_main()  # comes back here as a signal
            elif own and byte[0] == signal.SIGINT:
                own -= 1
            elif byte[0] in self._before:
                count += 1
                if count > 1 or byte[0] in AT_ONCE:
                    self._end()
        os.close(reader)

    def _raise_again(self, report: sys.UnraisableHookArgs) -> None:
        """Raise a KeyboardInterrupt again that came in a destructor, where it is lost.

        By the thread, a moment later: what is raised in here would be lost as well.
        """
        if issubclass(report.exc_type, KeyboardInterrupt):
            os.write(self._writer, AGAIN)
        else:
            self._unraisable(report)

    def _end(self) -> None:
        """End the process here and now, past every `finally`: one of them may take long."""
        if not self._ending.acquire(blocking=False):
            return  # the other thread is at it
        files = sys.modules.get("trunk_ocp._support.atomic_files")
        with contextlib.suppress(Exception):
            if files is not None:
                files.discard_unfinished()
        with contextlib.suppress(OSError):
            os.write(2, f"Stopped at once.{self.hint and ' '}{self.hint}\n".encode())
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
def ignore_at_exit() -> None:
    """While the interpreter takes itself down there is nothing left to stop."""
    if threading.current_thread() is threading.main_thread():
        atexit.register(_ignore)


def _ignore() -> None:
    for number in ORDERLY:
        signal.signal(number, signal.SIG_IGN)

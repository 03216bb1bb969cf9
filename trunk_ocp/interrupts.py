"""What Ctrl-C does: once, an orderly end with the best so far; twice, the end."""

from __future__ import annotations

import atexit
import contextlib
import os
import signal
import sys
from collections.abc import Iterator
from types import FrameType, TracebackType

from .files import discard_unfinished
from .reporting import Reporter

INTERRUPTED = 4  # exit code
SHOW_CURSOR = b"\x1b[?25h"  # which a live line on a terminal has hidden


class Interrupts:
    """Answers Ctrl-C for a whole command, in a `with` block around it.

    The first one raises KeyboardInterrupt, within `patience` it asks a reporter to stop. The
    second one ends the process at once.

    Attributes
    ----------
    came : bool
        Whether there was one.
    """

    def __init__(self) -> None:
        self.came = False
        self._reporter: Reporter | None = None

    def __enter__(self) -> Interrupts:
        self._before = signal.signal(signal.SIGINT, self._answer)
        # While the interpreter takes itself down there is nothing left to stop.
        atexit.register(signal.signal, signal.SIGINT, signal.SIG_IGN)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        signal.signal(signal.SIGINT, self._before)

    @contextlib.contextmanager
    def patience(self, reporter: Reporter) -> Iterator[None]:
        """Block that a first Ctrl-C does not end: `reporter.stop` does, when it can."""
        self._reporter = reporter
        try:
            yield
        finally:
            self._reporter = None

    def _answer(self, number: int, frame: FrameType | None) -> None:
        if self.came:
            _end()
        self.came = True
        if self._reporter is None:
            raise KeyboardInterrupt
        self._reporter.stop = True


def _end() -> None:
    """End the process here and now, past every `finally`: one of them may be what takes long."""
    discard_unfinished()
    with contextlib.suppress(OSError, ValueError, AttributeError):
        if sys.stdout.isatty():
            os.write(sys.stdout.fileno(), SHOW_CURSOR)
    with contextlib.suppress(OSError):
        os.write(2, b"Stopped at once. solve-motion --resume goes on from the last window.\n")
    os._exit(INTERRUPTED)

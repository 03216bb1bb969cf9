"""Standard streams that never stop a run: closed, full, read by nobody, or of few letters."""

from __future__ import annotations

import contextlib
import errno
import os
import sys
from collections.abc import Iterator
from typing import Any, TextIO

from ..errors import InputError


class Steady:
    """A text stream that falls silent when it cannot be written to any more.

    What it cannot spell it writes as a question mark.

    Attributes
    ----------
    error : OSError or None
        Why it fell silent.
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self.error: OSError | None = None
        reconfigure = getattr(stream, "reconfigure", None)
        if reconfigure is not None:
            reconfigure(errors="replace")

    @property
    def lost(self) -> str:
        """Why something was not written; empty if all was, or if a reader wanted no more."""
        unwanted = self.error is None or self.error.errno in (errno.EPIPE, errno.EINVAL)
        return "" if unwanted else str((self.error and self.error.strerror) or self.error)

    def write(self, text: str) -> int:
        """Write, or do nothing."""
        try:
            return self._stream.write(text)
        except OSError as error:
            self._silence(error)
            return len(text)

    def flush(self) -> None:
        """Flush, or do nothing."""
        try:
            self._stream.flush()
        except OSError as error:
            self._silence(error)

    def check(self) -> None:
        """Raise InputError if something was lost, for a command that does nothing but print."""
        self.flush()
        if self.lost:
            lost, self.error = self.lost, None
            raise InputError(f"standard output cannot be written ({lost}).")

    def _silence(self, error: OSError) -> None:
        """Nowhere takes what is still to be written, the interpreter's own last flush included."""
        self.error = self.error or error
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, self._stream.fileno())
        os.close(nowhere)

    def __getattr__(self, name: str) -> Any:
        if name == "buffer":  # past which click would write, where letters are few
            raise AttributeError(name)
        return getattr(self._stream, name)


@contextlib.contextmanager
def steady_streams() -> Iterator[Steady]:
    """Block in which standard output, which is returned, and error output are steady."""
    for descriptor in range(3):
        try:
            os.fstat(descriptor)
        except OSError:  # else the next file to be opened would be taken for it
            os.open(os.devnull, os.O_RDWR)
    before = sys.stdout, sys.stderr
    output, errors = (Steady(stream or _nowhere()) for stream in before)
    sys.stdout, sys.stderr = output, errors
    try:
        yield output
    finally:
        output.flush()
        errors.flush()
        sys.stdout, sys.stderr = before


def _nowhere() -> TextIO:
    """A stream for a process that was started without one."""
    return open(os.devnull, "w", encoding="utf-8")


def standard_output() -> Any:
    """Standard output of a command, steady."""
    return sys.stdout if isinstance(sys.stdout, Steady) else Steady(sys.stdout or _nowhere())

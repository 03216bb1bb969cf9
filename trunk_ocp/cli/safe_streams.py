"""Standard streams that never stop a run: closed, on a full disk, without reader, or ASCII only."""

from __future__ import annotations

import contextlib
import errno
import os
import sys
from collections.abc import Iterator
from typing import Any, TextIO

from ..errors import InputError


class SafeStream:
    """A text stream that discards its output once writing has failed, instead of raising.

    Characters that its encoding lacks become question marks.

    Attributes
    ----------
    error : OSError or None
        Why writing failed.
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self.error: OSError | None = None
        reconfigure = getattr(stream, "reconfigure", None)
        if reconfigure is not None:
            reconfigure(errors="replace")

    @property
    def lost(self) -> str:
        """Why output was lost; empty if none was, or if the reader closed the pipe."""
        harmless = self.error is None or self.error.errno in (errno.EPIPE, errno.EINVAL)
        return "" if harmless else str((self.error and self.error.strerror) or self.error)

    def write(self, text: str) -> int:
        """Write, or do nothing."""
        try:
            return self._stream.write(text)
        except OSError as error:
            self._discard(error)
            return len(text)

    def flush(self) -> None:
        """Flush, or do nothing."""
        try:
            self._stream.flush()
        except OSError as error:
            self._discard(error)

    def check(self) -> None:
        """Raise InputError if output was lost, for a command that only prints."""
        self.flush()
        if self.lost:
            lost, self.error = self.lost, None
            raise InputError(f"standard output cannot be written ({lost}).")

    def _discard(self, error: OSError) -> None:
        """Send all further output to the null device, the interpreter's own last flush included."""
        self.error = self.error or error
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, self._stream.fileno())
        os.close(null)

    def __getattr__(self, name: str) -> Any:
        if name == "buffer":  # click would write to it directly where the encoding is ASCII
            raise AttributeError(name)
        return getattr(self._stream, name)


@contextlib.contextmanager
def safe_streams() -> Iterator[SafeStream]:
    """Block in which standard output, which is returned, and standard error are safe."""
    for descriptor in range(3):
        try:
            os.fstat(descriptor)
        except OSError:  # else the next file opened would get this number and all that is printed
            os.open(os.devnull, os.O_RDWR)
    before = sys.stdout, sys.stderr
    output, errors = (SafeStream(stream or _null_stream()) for stream in before)
    sys.stdout, sys.stderr = output, errors
    try:
        yield output
    finally:
        output.flush()
        errors.flush()
        sys.stdout, sys.stderr = before


def _null_stream() -> TextIO:
    """A stream for a process that was started without one."""
    return open(os.devnull, "w", encoding="utf-8")


def standard_output() -> Any:
    """Standard output of a command, as a SafeStream."""
    is_safe = isinstance(sys.stdout, SafeStream)
    return sys.stdout if is_safe else SafeStream(sys.stdout or _null_stream())

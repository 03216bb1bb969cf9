"""Standard output that never stops a run: closed, full, read by nobody, or of few letters."""

from __future__ import annotations

import os
import sys
from typing import Any, TextIO


class Steady:
    """A text stream that falls silent when it cannot be written to any more.

    What it cannot spell it writes as a question mark.
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        reconfigure = getattr(stream, "reconfigure", None)
        if reconfigure is not None:
            reconfigure(errors="replace")

    def write(self, text: str) -> int:
        """Write, or do nothing."""
        try:
            return self._stream.write(text)
        except OSError:
            self._silence()
            return len(text)

    def flush(self) -> None:
        """Flush, or do nothing."""
        try:
            self._stream.flush()
        except OSError:
            self._silence()

    def _silence(self) -> None:
        """Nowhere takes what is still to be written, the interpreter's own last flush included."""
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, self._stream.fileno())
        os.close(nowhere)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


def standard_output() -> Any:
    """A steady stdout; None if it was closed from the start."""
    for descriptor in range(3):
        try:
            os.fstat(descriptor)
        except OSError:  # else the next file to be opened would be taken for it
            os.open(os.devnull, os.O_RDWR)
    return None if sys.stdout is None else Steady(sys.stdout)

"""Ctrl-C while native code calls Python back.

A signal handler runs as soon as Python code runs. Where that code is called by CasADi - a callback
of Ipopt, but also a property such as `shape` that a conversion looks up - an exception from the
handler is lost: the solve ends with `NonIpopt_Exception_Thrown`, as if the numbers were at fault,
or goes on as if nothing had come. No `try` in the code that is called can prevent it, since a
handler may run before its first line.
"""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from types import FrameType


@dataclass
class Deferred:
    """What is to be raised at the end of the block; native code should end soon if there is any."""

    error: BaseException | None = None


_active: list[Deferred] = []  # of the main thread, the only one in which handlers run


@contextlib.contextmanager
def deferred_interrupts() -> Iterator[Deferred]:
    """Block, or function, in which no handler of Ctrl-C raises.

    What it would have raised is raised at the end of the block, or of a block inside it, whichever
    comes first. Handlers that do not raise work as ever. In other threads than the main one a
    block only raises what is put into `Deferred.error`.
    """
    in_main = threading.current_thread() is threading.main_thread()
    outer = _active[0] if in_main and _active else None
    deferred = outer or Deferred()
    with contextlib.nullcontext() if outer or not in_main else _holding(deferred):
        yield deferred
    if deferred.error is not None:
        raise deferred.error


@contextlib.contextmanager
def _holding(deferred: Deferred) -> Iterator[None]:
    """Block in which what the present handler raises goes to `deferred`, and is raised if need be.

    An error of the block itself gives way to it: it may be what CasADi has made of it.
    """
    before = signal.getsignal(signal.SIGINT)
    if not callable(before):  # ignored, or left to the system
        yield
        return

    def answer(number: int, frame: FrameType | None) -> None:
        try:
            before(number, frame)
        except BaseException as error:
            deferred.error = deferred.error or error

    _active.append(deferred)
    signal.signal(signal.SIGINT, answer)
    try:
        yield
    finally:
        if signal.getsignal(signal.SIGINT) is answer:  # else `before` has set another
            signal.signal(signal.SIGINT, before)
        _active.clear()
        if deferred.error is not None:
            raise deferred.error

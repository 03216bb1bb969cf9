"""Ctrl-C while native code calls Python back.

A signal handler runs as soon as Python code runs. Where that code is called by CasADi - a callback
of Ipopt, but also a property such as `shape` that a conversion looks up - an exception from the
handler is lost: the solve ends with `NonIpopt_Exception_Thrown`, as if the numbers were at fault,
or goes on as if nothing had come. No `try` in the code that is called can prevent it, since a
handler may run before its first line.
"""

from __future__ import annotations

import functools
import signal
import threading
from collections.abc import Callable
from dataclasses import dataclass
from types import FrameType, TracebackType
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")
Handler = Callable[[int, FrameType | None], Any]
SIGNALS = sorted(signal.valid_signals())


@dataclass
class _Shared:
    """What the blocks around one another share; handlers act as ever unless it is active."""

    active: bool = False
    error: BaseException | None = None


class _Answer:
    """A signal handler in place of another, whose exceptions it keeps while a block is active."""

    def __init__(self, number: int, before: Handler, shared: _Shared) -> None:
        self.number, self.before, self.shared = number, before, shared

    def __call__(self, number: int, frame: FrameType | None) -> None:
        if not self.shared.active:  # left over from a block that a signal kept from its end
            self.before(number, frame)
            return
        try:
            self.before(number, frame)
        except BaseException as error:
            self.shared.error = self.shared.error or error
        own = signal.getsignal(number)
        if own is not self and callable(own):  # as "press again to quit" does
            self.before = own
            signal.signal(number, self)


class deferred_interrupts:  # noqa: N801 - used like contextlib's
    """Block, or function, in which no signal handler raises.

    What one would have raised is raised at the end of the block, or of a block inside it, whichever
    comes first. Handlers that do not raise work as ever. In threads other than the main one, where
    no handler runs, a block only raises what is put into its `error`.

    Attributes
    ----------
    error : BaseException or None
        Of the block's own code, such as a callback: raised at its end as well.
    """

    def __init__(self) -> None:
        self.error: BaseException | None = None
        self._shared = _Shared()
        self._answers: list[_Answer] = []

    @property
    def pending(self) -> bool:
        """Whether something is to be raised; native code should come to its end."""
        return self.error is not None or self._shared.error is not None

    def __enter__(self) -> deferred_interrupts:
        if threading.current_thread() is not threading.main_thread():
            return self
        handlers = [(number, signal.getsignal(number)) for number in SIGNALS]
        for _, handler in handlers:
            if isinstance(handler, _Answer) and handler.shared.active:
                self._shared = handler.shared  # a block around this one has seen to it
                return self
        for number, handler in handlers:
            while isinstance(handler, _Answer):  # left over
                handler = handler.before
            if callable(handler):
                answer = _Answer(number, handler, self._shared)
                self._answers.append(answer)
                signal.signal(number, answer)
        self._shared.active = True
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._answers:
            self._shared.active = False
        for answer in self._answers:
            installed: Any = signal.getsignal(answer.number)
            if installed is answer:  # else its handler has set another
                signal.signal(answer.number, answer.before)
        own, shared, self._shared.error = self.error, self._shared.error, None
        # An error of the block itself gives way: it may be what CasADi has made of it.
        for found in (shared, own):
            if found is not None:
                raise found

    def __call__(self, function: Callable[P, T]) -> Callable[P, T]:
        """The function in a block of its own at each call."""

        @functools.wraps(function)
        def guarded(*args: P.args, **extra: P.kwargs) -> T:
            with deferred_interrupts():
                return function(*args, **extra)

        return guarded

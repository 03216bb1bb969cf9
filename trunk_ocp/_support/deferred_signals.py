"""Ctrl-C while native code calls back into Python.

A signal handler runs as soon as Python code runs. If that code was called by CasADi - a callback
of Ipopt, but also a property such as `shape` that a conversion looks up - an exception from the
handler is lost: the solve ends with `NonIpopt_Exception_Thrown`, as if the numbers were at fault,
or continues as if nothing had happened. No `try` in the called code can prevent this, since a
handler may run before its first line.
"""

from __future__ import annotations

import functools
import signal
import threading
from collections.abc import Callable
from dataclasses import dataclass
from types import FrameType
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")
Handler = Callable[[int, FrameType | None], Any]
SIGNALS = sorted(signal.valid_signals())


@dataclass
class _Shared:
    """State shared by nested blocks; handlers act as usual unless it is active."""

    active: bool = False
    error: BaseException | None = None


class _KeepingHandler:
    """Replaces a signal handler and keeps its exceptions while a block is active."""

    def __init__(self, number: int, before: Handler, shared: _Shared) -> None:
        self.number, self.before, self.shared = number, before, shared

    def __call__(self, number: int, frame: FrameType | None) -> None:
        if not self.shared.active:  # left over from a block that a signal interrupted
            self.before(number, frame)
            return
        try:
            self.before(number, frame)
        except BaseException as error:
            self.shared.error = self.shared.error or error
        installed = signal.getsignal(number)
        if installed is not self and callable(installed):  # as "press again to quit" does
            self.before = installed
            signal.signal(number, self)


class deferred_interrupts:  # noqa: N801 - used like contextlib's
    """Context manager and decorator: no signal handler raises within the block.

    An exception from a handler is raised at the end of the block, or of a nested block, whichever
    comes first. Handlers that do not raise work as usual. Outside the main thread, where no handler
    runs, a block only raises its `error`.

    Attributes
    ----------
    error : BaseException or None
        Set by code in the block, such as a callback; raised at its end as well.
    """

    def __init__(self) -> None:
        self.error: BaseException | None = None
        self._shared = _Shared()
        self._handlers: list[_KeepingHandler] = []

    @property
    def pending(self) -> bool:
        """Whether an exception is waiting; native code should return."""
        return self.error is not None or self._shared.error is not None

    def __enter__(self) -> deferred_interrupts:
        if threading.current_thread() is not threading.main_thread():
            return self
        handlers = [(number, signal.getsignal(number)) for number in SIGNALS]
        for _, handler in handlers:
            if isinstance(handler, _KeepingHandler) and handler.shared.active:
                self._shared = handler.shared  # the enclosing block has replaced them
                return self
        for number, handler in handlers:
            while isinstance(handler, _KeepingHandler):  # left over from an interrupted block
                handler = handler.before
            if callable(handler):
                keeping = _KeepingHandler(number, handler, self._shared)
                self._handlers.append(keeping)
                signal.signal(number, keeping)
        self._shared.active = True
        return self

    def __exit__(self, *_: object) -> None:
        if self._handlers:
            self._shared.active = False
        for handler in self._handlers:
            installed: Any = signal.getsignal(handler.number)
            if installed is handler:  # otherwise the original handler has installed another
                signal.signal(handler.number, handler.before)
        from_block, from_handler, self._shared.error = self.error, self._shared.error, None
        # These take precedence over an error of the block, which may be CasADi's version of them.
        for exception in (from_handler, from_block):
            if exception is not None:
                raise exception

    def __call__(self, function: Callable[P, T]) -> Callable[P, T]:
        """The function, with each call in its own block."""

        @functools.wraps(function)
        def guarded(*args: P.args, **kwargs: P.kwargs) -> T:
            with deferred_interrupts():
                return function(*args, **kwargs)

        return guarded

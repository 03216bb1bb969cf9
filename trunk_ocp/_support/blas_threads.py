"""One thread in linear algebra, so that a result does not depend on how many there are.

BLAS adds in another order with another number of threads. The matrices here are small: more
threads gain nothing, and often cost.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cache

import casadi as ca
from threadpoolctl import OpenBLASController, ThreadpoolController, register


class _CasadiBlas(OpenBLASController):
    """OpenBLAS as CasADi's wheels bring it for Ipopt's linear solver."""

    filename_prefixes = ("libcasadi-tp-openblas",)


register(_CasadiBlas)


@dataclass
class _Limit:
    """What is in force while any block of `one_thread` runs, in whatever thread."""

    lock: threading.Lock = field(default_factory=threading.Lock)
    blocks: int = 0
    restore: Callable[[], None] = lambda: None


_limit = _Limit()


@contextlib.contextmanager
def one_thread() -> Iterator[None]:
    """Block, or function, in which BLAS has one thread, whatever the environment says.

    The number of threads belongs to the process: blocks may overlap in several threads, and the
    last one to end restores what the first one found.
    """
    with _limit.lock:
        if not _limit.blocks:
            _limit.restore = _libraries().limit(limits=1, user_api="blas").restore_original_limits
        _limit.blocks += 1
    try:
        yield
    finally:
        with _limit.lock:
            _limit.blocks -= 1
            if not _limit.blocks:
                _limit.restore()


@cache
def _libraries() -> ThreadpoolController:
    ca.has_nlpsol("ipopt")  # loads it: a library that is not there yet cannot be told
    return ThreadpoolController()

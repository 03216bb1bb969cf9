"""One BLAS thread, so that results do not depend on the number of threads.

The order in which BLAS adds numbers depends on the number of threads. The matrices here are small:
more threads gain nothing and often cost time.
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
    """OpenBLAS as bundled with CasADi for the linear solver of Ipopt."""

    filename_prefixes = ("libcasadi-tp-openblas",)


register(_CasadiBlas)


@dataclass
class _Limit:
    """The limit in force while any block of `one_thread` runs, in any thread."""

    lock: threading.Lock = field(default_factory=threading.Lock)
    blocks: int = 0
    restore: Callable[[], None] = lambda: None


_limit = _Limit()


@contextlib.contextmanager
def one_thread() -> Iterator[None]:
    """Context manager and decorator: BLAS uses one thread, whatever the environment says.

    The number of BLAS threads belongs to the process. Blocks may overlap in several threads; the
    last one to end restores the number that the first one found.
    """
    with _limit.lock:
        if not _limit.blocks:
            _release()
            _limit.restore = _libraries().limit(limits=1, user_api="blas").restore_original_limits
        _limit.blocks += 1
    try:
        yield
    finally:
        with _limit.lock:
            _limit.blocks -= 1
            if not _limit.blocks:
                _release()
                _limit.restore()
                _release()


def _release() -> None:
    """Let this thread set the limit, and others after it.

    By threadpoolctl 3.8, OpenBLAS obeys only the first thread that ever limited it, while that
    thread lives. Here the first block may start in one thread and the last one end in another.
    """
    release = getattr(OpenBLASController, "clear_controlling_thread", None)
    if release is not None:
        release(force=True)


@cache
def _libraries() -> ThreadpoolController:
    ca.has_nlpsol("ipopt")  # loads its libraries, which must be present to be limited
    return ThreadpoolController()

"""One thread in linear algebra, so that a result does not depend on how many there are.

BLAS adds in another order with another number of threads. The matrices here are small: more
threads gain nothing, and often cost.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from functools import cache

import casadi as ca
from threadpoolctl import OpenBLASController, ThreadpoolController, register


class _CasadiBlas(OpenBLASController):
    """OpenBLAS as CasADi's wheels bring it for Ipopt's linear solver."""

    filename_prefixes = ("libcasadi-tp-openblas",)


register(_CasadiBlas)


@contextlib.contextmanager
def one_thread() -> Iterator[None]:
    """Block, or function, in which BLAS has one thread, whatever the environment says."""
    with _libraries().limit(limits=1, user_api="blas"):
        yield


@cache
def _libraries() -> ThreadpoolController:
    ca.has_nlpsol("ipopt")  # loads it: a library that is not there yet cannot be told
    return ThreadpoolController()

"""A motion to look at: one self-contained HTML page with the moving trunk and its muscles.

`payload` says what the page is told, `objects` where fruit, log and targets are, `bundle` puts
data, viewer and three.js into one file. What happens in the browser is in `viewer/*.js`.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from .._support.atomic_files import write
from ..errors import InputError
from ..planning.plan import Plan
from .bundle import page
from .payload import payload

__all__ = ["write_page"]


def write_page(plans: Sequence[Plan], path: Path) -> Path:
    """Write a page that shows a motion, and needs neither server nor network.

    Parameters
    ----------
    plans : one or two plans
        Two, such as the sequential and the horizon plan of a motion, move side by side in step.
    path : Path
        File to write; its folder is made if need be.

    Raises
    ------
    InputError
        If there are no plans or more than two, or one without a single time step; or if the
        page cannot be written there.
    """
    if not 1 <= len(plans) <= 2:
        raise InputError(f"plans: expected one plan or two to compare, got {len(plans)}.")
    for plan in plans:
        if not len(plan.x):
            raise InputError(f"plans: the {plan.mode} plan has no time steps; nothing to show.")
    return write(path, page(payload(plans)))

"""A motion in the browser: one self-contained HTML page with the moving trunk and its muscles.

`payload` collects the data, `bundle` puts data, viewer and three.js into one file. The code that
runs in the browser is in `viewer/*.js`.
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
    """Write a page that shows a motion; it needs neither server nor network.

    Parameters
    ----------
    plans : one or two plans
        Two, such as the sequential and the horizon plan of a motion, move side by side in step.
    path : Path
        File to write; its folder is created if necessary.

    Raises
    ------
    InputError
        If there are no plans or more than two, if one has no time steps, or if the page cannot be
        written.
    """
    if not 1 <= len(plans) <= 2:
        raise InputError(f"plans: expected one or two, got {len(plans)}.")
    for plan in plans:
        if not len(plan.x):
            raise InputError(
                f"plans: the {plan.mode} plan has no time steps, so there is nothing to show."
            )
    return write(path, page(payload(plans)))

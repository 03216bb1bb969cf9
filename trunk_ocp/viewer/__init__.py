"""A trunk in the browser: one self-contained HTML page with its muscles, still or in motion.

`payload` and `still` collect the data, `bundle` puts data, viewer and three.js into one file. The
code that runs in the browser is in `viewer/*.js`.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from .._support.atomic_files import write
from ..errors import InputError
from ..model.anatomy import Trunk
from ..planning.plan import Plan
from .bundle import bundled
from .payload import payload
from .still import still_payload

__all__ = ["page", "write_page"]


def page(subject: Plan | Sequence[Plan] | Trunk) -> str:
    """Text of a page that shows a motion, or a trunk; it needs neither server nor network.

    Parameters
    ----------
    subject : Plan, one or two plans, or Trunk
        Two plans, such as the sequential and the horizon plan of a motion, move side by side in
        step. A trunk is shown at rest. In either case muscles and head can be moved, and the trunk
        be dragged, on the page.

    Raises
    ------
    InputError
        If there are no plans or more than two, if one has no time steps, or if it is none of these.
    """
    if isinstance(subject, Trunk):
        return bundled(still_payload(subject))
    plans = [subject] if isinstance(subject, Plan) else subject
    if not isinstance(plans, Sequence) or not all(isinstance(plan, Plan) for plan in plans):
        raise InputError(f"subject = {subject!r}: expected a plan, two plans or a trunk.")
    if not 1 <= len(plans) <= 2:
        raise InputError(f"plans: expected one or two, got {len(plans)}.")
    for plan in plans:
        if not len(plan.x):
            raise InputError(
                f"plans: the {plan.mode} plan has no time steps, so there is nothing to show."
            )
    return bundled(payload(plans))


def write_page(subject: Plan | Sequence[Plan] | Trunk, path: Path) -> Path:
    """Write a page that shows a motion, or a trunk; see `page`.

    Parameters
    ----------
    path : Path
        File to write; its folder is created if necessary.

    Raises
    ------
    InputError
        If `page` refuses the subject, or if the page cannot be written.
    """
    return write(path, page(subject))

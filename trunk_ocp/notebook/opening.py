"""Opening the page of a plan or a trunk as a widget."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..errors import InputError, TrunkError
from ..model.anatomy import Trunk
from ..planning.plan import Plan
from ..viewer.bundle import page
from ..viewer.payload import payload

if TYPE_CHECKING:
    from .widget import View

HEIGHTS = range(100, 5001)
"""Pixels that a widget may be high."""


def opened(shown: Plan | Trunk, height: int) -> View:
    """The page of a plan or a trunk as a widget, `height` pixels high.

    Raises
    ------
    TrunkError
        If anywidget is not installed.
    InputError
        If the plan has no time steps, or for an impossible height.
    """
    try:
        from .widget import View
    except ImportError:
        raise TrunkError(
            "view: the page in a notebook needs the package anywidget; "
            "pip install 'trunk_ocp[notebook]'."
        ) from None
    if height not in HEIGHTS:
        raise InputError(
            f"height = {height!r}: expected a whole number of pixels, "
            f"{HEIGHTS[0]} to {HEIGHTS[-1]}."
        )
    if isinstance(shown, Plan):
        return View(page(payload([shown])), height, shown.motion.start)
    return View(page(shown), height, np.zeros(len(shown.muscles) + 2))

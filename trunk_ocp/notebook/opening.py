"""Opening the page of a plan or a trunk as a widget."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..errors import InputError, TrunkError
from ..model.anatomy import Trunk
from ..planning.plan import Plan
from ..viewer import page

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
    start = shown.motion.start if isinstance(shown, Plan) else np.zeros(len(shown.muscles) + 2)
    return View(page(shown), height, start)

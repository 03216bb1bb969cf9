"""The page as a widget: an iframe in the cell, and its time and controls as traits in Python."""

from __future__ import annotations

from importlib.resources import files
from typing import Any

import anywidget
import numpy as np
import traitlets

from .._support.arguments import real_array
from ..errors import InputError
from ..planning.plan import Plan
from ..viewer.payload import payload


class Numbers(traitlets.List[float]):
    """A list of numbers; arrays are welcome."""

    def validate(self, obj: Any, value: Any) -> list[float]:
        """The value as a list of finite numbers; InputError if it is none."""
        array = real_array(value, self.name or "value")
        if array.ndim != 1 or not np.isfinite(array).all():
            raise InputError(f"{self.name} = {value!r}: expected a list of finite numbers.")
        numbers: list[float] = array.tolist()
        return numbers


class View(anywidget.AnyWidget):
    """The page of a plan or a trunk.

    Attributes
    ----------
    time : float
        Instant in s that the page shows.
    activation : list
        Of the muscles, as last set on the page or here; at first those of the start.
    head : list
        psi_Z and psi_Y in rad, likewise.
    dragged : dict or None
        What was last pulled on the page: `what`, "target" or "trunk"; its `name`, such as
        "phases[1].targets[1]" of the problem file, or "Z = 1.75"; the `position` (3,) in m that it
        was pulled to; and whether it was let go, `done`.
    """

    _esm = (files(__package__) / "view.js").read_text(encoding="utf-8")
    page = traitlets.Unicode().tag(sync=True)
    height = traitlets.Int().tag(sync=True)
    moved = traitlets.Bool(False).tag(sync=True)
    """Whether activation or head were set since the start."""
    time = traitlets.Float(0.0).tag(sync=True)
    activation = Numbers().tag(sync=True)
    head = Numbers().tag(sync=True)
    dragged = traitlets.Dict(default_value=None, allow_none=True).tag(sync=True)
    plan = traitlets.Dict(default_value=None, allow_none=True).tag(sync=True)
    """What `show` put in place of the first plan, as the page gets it."""

    def __init__(self, page: str, height: int, start: np.ndarray) -> None:
        super().__init__(
            page=page, height=height, activation=start[:-2].tolist(), head=start[-2:].tolist()
        )
        self.observe(self._mark_moved, ["activation", "head"])

    def show(self, plan: Plan) -> None:
        """Show another plan instead, at the same instant and from the same side.

        Raises
        ------
        InputError
            If it has no time steps.
        """
        if not len(plan.x):
            raise InputError(f"{plan.motion.name}: the plan has no time steps; nothing to show.")
        self.plan = payload([plan])

    def _mark_moved(self, change: object) -> None:
        self.moved = True

    @traitlets.validate("activation", "head")
    def _same_length(self, proposal: Any) -> list[float]:
        """The proposed numbers; InputError if they are more or fewer than before."""
        name, value = proposal["trait"].name, proposal["value"]
        count = len(getattr(self, name))
        if count and len(value) != count:
            raise InputError(f"{name}: expected {count} numbers, got {len(value)}.")
        return list(value)

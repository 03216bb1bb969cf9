"""What plans, motions, trunks and shapes show in notebooks, although what draws is above them.

`plan.plot`, `trunk.view()` and the pictures under a cell need figures and the page, which these
classes may not import: a layer only knows those below. So they ask for `outputs()`. Its interface
is here; its code is the package `trunk_ocp.notebook`, above them all, imported at the first call.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any, Protocol, cast

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from anywidget import AnyWidget
    from matplotlib.figure import Figure


class Outputs(Protocol):
    """What `trunk_ocp.notebook` does for an object of the layers below it."""

    def html(self, shown: Any) -> str:
        """A plan, motion, trunk or shape as a small picture with key facts."""

    def view(self, shown: Any, height: int) -> AnyWidget:
        """The page of a plan or a trunk as a widget, `height` pixels high."""

    def figure(self, plan: Any, name: str, **options: Any) -> Figure:
        """A figure of a plan by its name, such as "shapes"."""

    def labeled(self, plan: Any) -> xr.Dataset:
        """A plan as labeled arrays."""

    def table(self, plan: Any) -> pd.DataFrame:
        """A plan as a table with a row for each time step."""


def outputs() -> Outputs:
    """The package that implements `Outputs`."""
    return cast(Outputs, import_module("trunk_ocp.notebook"))


class Displayed:
    """A class whose objects notebooks show as a small picture with key facts."""

    def _repr_html_(self) -> str:
        return outputs().html(self)

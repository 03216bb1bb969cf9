"""Plans, motions, trunks and shapes in notebooks: tables, figures, small pictures, the page.

The functions here are what `_support.outputs` asks for. Each imports what it needs when it is
called, so that a picture under a cell does not wait for matplotlib.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from matplotlib.figure import Figure

    from ..planning.plan import Plan
    from .widget import View


def html(shown: Any) -> str:
    """A plan, motion, trunk or shape as a small picture with key facts."""
    from .summaries import summary_html

    return summary_html(shown)


def view(shown: Any, height: int) -> View:
    """The page of a plan or a trunk as a widget, `height` pixels high; see `widget.View`."""
    from .opening import opened

    return opened(shown, height)


def figure(plan: Plan, name: str, **options: Any) -> Figure:
    """A figure of a plan by its name; see `planning.plots.Plots`."""
    from .plots import drawn

    return drawn(plan, name, **options)


def labeled(plan: Plan) -> xr.Dataset:
    """A plan as labeled arrays; see `planning.labeled`."""
    from ..planning.labeled import dataset

    return dataset(plan)


def table(plan: Plan) -> pd.DataFrame:
    """A plan as a table with a row for each time step; see `planning.tables`."""
    from ..planning.tables import plan_table

    return plan_table(plan)

"""The paper's figures 3 to 9 for any plan, as vector PDF and PNG.

Matplotlib is imported only in this package; it needs no screen, and its settings stay unchanged.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ..analysis.lookahead_study import Foresight
from ..model.anatomy import Trunk
from ..planning.plan import Plan
from .activations import draw_activations
from .anatomy import draw_anatomy as _draw_anatomy
from .comparison import draw_two_plans
from .errors import draw_errors
from .film import write_film
from .lookahead import draw_foresight as _draw_foresight
from .lookahead import draw_front, draw_survey
from .muscles import draw_muscles
from .shapes import draw_shapes

__all__ = [
    "draw",
    "draw_anatomy",
    "draw_comparison",
    "draw_foresight",
    "draw_front",
    "draw_survey",
    "write_film",
]

FORMATS = ("pdf", "png")
PARTS = (draw_muscles, draw_shapes, draw_activations, draw_errors)  # slowest first


def draw(plan: Plan, folder: str | Path, formats: Sequence[str] = FORMATS) -> list[Path]:
    """Draw one plan: shapes (m), activations (no unit), muscles and errors (mm).

    The paper's figures 4, 6, 8 (shapes, activations and head angles) and 5, 7, 9 (muscles); the
    paper has no figure of errors. Returns the files written. Of a plan that was interrupted or did
    not converge, the planned steps are drawn.
    """
    return [file for part in PARTS for file in part(plan, Path(folder), formats)]


def draw_comparison(
    sequential: Plan, horizon: Plan, folder: str | Path, formats: Sequence[str] = FORMATS
) -> list[Path]:
    """Draw two plans of one motion over each other; activations and J_T (eq. 42) have no unit.

    In addition to the paper's figures 4d, 6c and 8f: the largest change between steps, and the
    number of muscles at their bound. Returns the files written.
    """
    return draw_two_plans(sequential, horizon, Path(folder), formats)


def draw_anatomy(trunk: Trunk, folder: str | Path, formats: Sequence[str] = FORMATS) -> list[Path]:
    """Draw the muscles of a trunk: cross-sections in cm, bodies in m (figs. 3b-d).

    Returns the files written.
    """
    return _draw_anatomy(trunk, Path(folder), formats)


def draw_foresight(
    result: Foresight, folder: str | Path, formats: Sequence[str] = FORMATS
) -> list[Path]:
    """Draw the result of `foresight`: costs against lookahead, and each planning method over time.

    Returns the files written.
    """
    return _draw_foresight(result, Path(folder), formats)

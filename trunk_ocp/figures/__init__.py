"""The paper's figures 3 to 9 from our own plans, for print: vector PDF and PNG.

Matplotlib is imported here and nowhere else; without a screen and without touching its settings.
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
PARTS = (draw_muscles, draw_shapes, draw_activations, draw_errors)  # what takes longest first


def draw(plan: Plan, folder: str | Path, formats: Sequence[str] = FORMATS) -> list[Path]:
    """Draw one plan: shapes (m), activations (no unit), muscles and errors (mm).

    The paper's figures 4, 6, 8 (shapes, activations and head angles) and 5, 7, 9 (muscles);
    the paper has none of errors. Returns the files written. A plan that was cut short or did
    not converge is drawn as far as it goes.
    """
    return [file for part in PARTS for file in part(plan, Path(folder), formats)]


def draw_comparison(
    sequential: Plan, horizon: Plan, folder: str | Path, formats: Sequence[str] = FORMATS
) -> list[Path]:
    """Draw two plans of one motion over each other; activations and J_T (eq. 42) have no unit.

    Beyond the paper's figures 4d, 6c and 8f: largest change from step to step, and how many
    muscles are at their bound. Returns the files written.
    """
    return draw_two_plans(sequential, horizon, Path(folder), formats)


def draw_anatomy(trunk: Trunk, folder: str | Path, formats: Sequence[str] = FORMATS) -> list[Path]:
    """Draw where a trunk's muscles are: cross-sections in cm, bodies in m (figs. 3b-d).

    Returns the files written.
    """
    return _draw_anatomy(trunk, Path(folder), formats)


def draw_foresight(
    result: Foresight, folder: str | Path, formats: Sequence[str] = FORMATS
) -> list[Path]:
    """Draw what `foresight` found: costs against lookahead, and each way of planning over time.

    Returns the files written.
    """
    return _draw_foresight(result, Path(folder), formats)

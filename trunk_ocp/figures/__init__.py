"""The paper's figures 3 to 9 for any plan, as vector PDF and PNG.

Matplotlib is imported only in this package; it needs no screen, and its settings stay unchanged.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ..planning.plan import Plan
from .activations import draw_activations
from .anatomy import draw_anatomy
from .comparison import draw_comparison
from .errors import draw_errors
from .film import write_film
from .lookahead import draw_foresight, draw_front, draw_survey
from .muscles import draw_muscles
from .shapes import draw_shapes
from .style import FORMATS

__all__ = [
    "FORMATS",
    "draw",
    "draw_anatomy",
    "draw_comparison",
    "draw_foresight",
    "draw_front",
    "draw_survey",
    "write_film",
]

PARTS = (draw_muscles, draw_shapes, draw_activations, draw_errors)  # slowest first
MAIN_PARTS = (draw_shapes, draw_activations, draw_errors)
MAIN_FORMATS = ("png",)
"""What `solve-motion` draws by default: enough to judge a plan, in about a second."""


def draw(plan: Plan, folder: str | Path, formats: Sequence[str] = FORMATS) -> list[Path]:
    """Draw one plan: shapes (m), activations (no unit), muscles and errors (mm).

    The paper's figures 4, 6, 8 (shapes, activations and head angles) and 5, 7, 9 (muscles); the
    paper has no figure of errors. Returns the files written. Of a plan that was interrupted or did
    not converge, the planned steps are drawn.
    """
    return [file for part in PARTS for file in part(plan, Path(folder), formats)]

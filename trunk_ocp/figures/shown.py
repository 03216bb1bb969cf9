"""The figures that we draw: notebooks show them as they are, without pyplot."""

from __future__ import annotations

import io

from matplotlib.figure import Figure

SCREEN_DPI = 120.0


class ShownFigure(Figure):
    """A figure that a notebook shows under its cell."""

    def _repr_png_(self) -> bytes:
        picture = io.BytesIO()
        self.savefig(picture, format="png", dpi=SCREEN_DPI)
        return picture.getvalue()

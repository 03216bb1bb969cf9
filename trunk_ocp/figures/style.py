"""The look of every figure: sizes for print, names, files without dates."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import matplotlib
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.font_manager import fontManager
from matplotlib.patches import Patch

from .._support.atomic_files import replacing
from ..errors import TrunkError
from ..model.anatomy import Muscle, Trunk
from ..planning.plan import Plan
from ..planning.status import Status
from ..problem.motion import Motion
from .shown import ShownFigure

NAMES = {
    "dl": "dorsal longitudinal",
    "ovo": "outer ventral oblique",
    "ivo": "inner ventral oblique",
    "dr": "dorsal radial",
    "vr": "ventral radial",
}
SIDES = {"R": ("right", "-"), "L": ("left", ":")}  # the paper's: right solid, left dotted
PHASES = ("#DCEBF7", "#FBE8D3", "#ECECEC")  # the paper's: light blue, light orange, gray
INK = "#222222"
FAINT = "#8A8A8A"
BOUND: dict[str, Any] = {"color": INK, "linewidth": 0.6, "linestyle": (0, (7, 2))}

FORMATS = ("pdf", "png")
FONT = "DejaVu Sans"  # ships with matplotlib: the same everywhere
MM = 1 / 25.4
MAX_PIXELS = 30_000  # on either side of an image; the renderer's limit is 65,535
MAX_LEGEND_PHASES = 6
LEGEND_LETTERS = 70  # in a line of a legend
MAX_TITLE = 80  # letters
WIDTH = 180.0  # mm, two columns
LOOK: Any = {
    "font.family": "sans-serif",
    "font.sans-serif": [FONT],
    "font.size": 7.0,
    "axes.titlesize": 7.5,
    "axes.labelsize": 7.0,
    "axes.linewidth": 0.6,
    "axes.edgecolor": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlepad": 3.0,
    "axes.labelpad": 2.0,
    "xtick.labelsize": 6.5,
    "ytick.labelsize": 6.5,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.major.size": 2.5,
    "ytick.major.size": 2.5,
    "legend.fontsize": 6.5,
    "legend.frameon": False,
    "lines.linewidth": 1.1,
    "text.usetex": False,
    "pdf.fonttype": 42,  # letters stay letters, for publishers and for search
    "savefig.dpi": 220.0,
}


def styled() -> AbstractContextManager[None]:
    """Context with the look of our figures; the caller's settings are restored after it.

    Raises
    ------
    TrunkError
        If matplotlib does not find the font that is part of it.
    """
    if FONT not in fontManager.get_font_names():
        raise TrunkError(
            f"matplotlib does not find its own font {FONT!r}, so no figures can be drawn; "
            "reinstall matplotlib, or use solve-motion --no-figures."
        )
    return matplotlib.rc_context(LOOK)


def new_figure(height: float, width: float = WIDTH) -> Figure:
    """An empty figure of a size in mm."""
    return ShownFigure(figsize=(width * MM, height * MM))


def save(figure: Figure, folder: str | Path, name: str, formats: Sequence[str]) -> list[Path]:
    """Write a figure in every format; the same figure always gives the same bytes."""
    undated = {"pdf": {"CreationDate": None}, "svg": {"Date": None}}
    paths = []
    for kind in formats:
        path = Path(folder) / f"{name}.{kind}"
        with replacing(path) as unfinished:
            dots = min(LOOK["savefig.dpi"], MAX_PIXELS / max(figure.get_size_inches()))
            figure.savefig(unfinished, format=kind, dpi=dots, metadata=undated.get(kind))
        paths.append(path)
    return paths


def full_name(group: str) -> str:
    """Full name of a muscle group, if it is known."""
    return NAMES.get(group, group)


def muscles_of(trunk: Trunk, group: str, segment: int) -> list[tuple[int, Muscle]]:
    """Muscles of a group in a segment, each with its index in an activation vector."""
    return [
        (index, muscle)
        for index, muscle in enumerate(trunk.subdomains)
        if muscle.group == group and muscle.segment == segment
    ]


def note_if_empty(axes: Axes, trunk: Trunk, group: str, segment: int) -> None:
    """Write a note in the panel of a segment that has no muscle of a group."""
    if not muscles_of(trunk, group, segment):
        axes.text(
            0.5, 0.5, "no such muscle", color=FAINT, transform=axes.transAxes,
            ha="center", va="center",
        )  # fmt: skip


def shade_phases(axes: Axes, motion: Motion, end: float) -> None:
    """Shade the phases behind curves over time, from 0 to `end` in s."""
    start = 0.0
    for number, phase in enumerate(motion.phases):
        if start < end:
            axes.axvspan(
                start,
                min(phase.end, end),
                color=PHASES[number % len(PHASES)],
                linewidth=0,
                zorder=0,
            )
        start = phase.end
    if end > 0:
        axes.set_xlim(0, end)


def phase_patches(motion: Motion) -> list[Patch]:
    """Legend entries for the shading of phases; if there are many, for the first ones."""
    shown = motion.phases[:MAX_LEGEND_PHASES]
    more = len(motion.phases) - len(shown)
    keys = [
        Patch(
            color=PHASES[n % len(PHASES)],
            label=escaped(shortened(phase.name, LEGEND_LETTERS // len(shown))),
        )
        for n, phase in enumerate(shown)
    ]
    return [*keys, Patch(alpha=0, label=f"and {more} more phases")] if more else keys


def shortened(text: str, most: int) -> str:
    """A text, shortened to a number of letters."""
    return text if len(text) <= most else text[: most - 3].rstrip() + "..."


def escaped(text: str) -> str:
    """Text that matplotlib shows unchanged.

    It would take dollars for formulas, and leave out labels with a leading underscore.
    """
    return (" " if text.startswith("_") else "") + text.replace("$", r"\$")


def title(motion: Motion) -> str:
    """Title of a motion."""
    return escaped(shortened(motion.spec.title or motion.name, MAX_TITLE))


def unsolved_note(plan: Plan) -> str:
    """Addition to the title of a plan that is not solved; empty if it is."""
    solved = plan.check() is Status.SOLVED
    return "" if solved else f", NOT SOLVED: {plan.status.name.lower().replace('_', ' ')}"


def headline(figure: Figure, text: str) -> None:
    """Write a title at the top of a figure."""
    height = figure.get_figheight() / MM
    figure.suptitle(text, fontsize=8.5, y=1 - 1.5 / height)


def legend_below_title(figure: Figure, *rows: Sequence[Artist]) -> None:
    """Put a figure's legend under its title, in rows; empty rows take no space."""
    height = figure.get_figheight() / MM
    for row, entries in enumerate([entries for entries in rows if entries]):
        figure.legend(
            handles=entries,
            loc="upper center",
            bbox_to_anchor=(0.5, 1 - (4.5 + 4.0 * row) / height),
            ncols=len(entries),
            columnspacing=1.4,
            borderaxespad=0.2,
        )

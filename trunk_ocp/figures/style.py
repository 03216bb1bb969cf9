"""The look of every figure: sizes for print, names, files without dates."""

from __future__ import annotations

import textwrap
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import wraps
from pathlib import Path
from typing import Any, ParamSpec

import matplotlib
import numpy as np
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
BANDS = ("#FFFFFF", "#ECECEC")  # of more phases, which are numbered
INK = "#222222"
FAINT = "#8A8A8A"
BOUND: dict[str, Any] = {"color": INK, "linewidth": 0.6, "linestyle": (0, (7, 2))}

FORMATS = ("pdf", "png")
FONT = "DejaVu Sans"  # ships with matplotlib: the same everywhere
MM = 1 / 25.4
MAX_PIXELS = 30_000  # on either side of an image; the renderer's limit is 65,535
LEGEND_LETTERS = 70  # in a line of a legend, for the names of all phases
KEY_LINE = 150  # letters in a line of numbered phases
MAX_KEY_LINES = 3
NUMBER_WIDTH = 3.2  # mm, for the number of a phase
SMALL_LETTER = 1.2  # mm
NUMBERS_PAD = 10.0  # points, between a panel with numbers above it and its heading
MAX_TITLE = 80  # letters
MAX_SEGMENTS = 6  # panels side by side
COMPRESSION = 3  # of PNG files, 0 to 9; more takes as long as drawing, for a tenth of the bytes
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


_SETTINGS = threading.RLock()  # matplotlib's settings are one set for all threads


@contextmanager
def styled() -> Iterator[None]:
    """Block with the look of our figures; the caller's settings are restored after it.

    Threads that draw take turns.

    Raises
    ------
    TrunkError
        If matplotlib does not find the font that is part of it.
    """
    if FONT not in fontManager.get_font_names():
        raise TrunkError(
            f"matplotlib does not find its own font {FONT!r}, so no figures can be drawn; "
            "reinstall matplotlib, or use solve-motion --figures none."
        )
    with _SETTINGS, matplotlib.rc_context(LOOK):
        yield


P = ParamSpec("P")


def self_contained(make: Callable[P, Figure]) -> Callable[P, Figure]:
    """Give a function that makes a figure our look, and let the figure keep it anywhere.

    Matplotlib creates ticks as it draws, with the settings of that moment.
    """

    @wraps(make)
    def figure_of(*arguments: P.args, **options: P.kwargs) -> Figure:
        with styled():
            figure = make(*arguments, **options)
            for axes in figure.axes:
                axes.tick_params(
                    labelsize=LOOK["xtick.labelsize"], width=LOOK["xtick.major.width"],
                    length=LOOK["xtick.major.size"],
                )  # fmt: skip
        return figure

    return figure_of


def new_figure(height: float, width: float = WIDTH) -> Figure:
    """An empty figure of a size in mm."""
    return ShownFigure(figsize=(width * MM, height * MM))


def save(figure: Figure, folder: str | Path, name: str, formats: Sequence[str]) -> list[Path]:
    """Write a figure in every format; the same figure always gives the same bytes."""
    of_kind: dict[str, dict[str, Any]] = {
        "pdf": {"metadata": {"CreationDate": None}},
        "png": {"pil_kwargs": {"compress_level": COMPRESSION}},
        "svg": {"metadata": {"Date": None}},
    }
    paths = []
    for kind in formats:
        path = Path(folder) / f"{name}.{kind}"
        with replacing(path) as unfinished:
            dots = min(LOOK["savefig.dpi"], MAX_PIXELS / max(figure.get_size_inches()))
            figure.savefig(unfinished, format=kind, dpi=dots, **of_kind.get(kind, {}))
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


def shown_segments(trunk: Trunk) -> list[int]:
    """Segments that get a panel: all, or if there are many the first, the last and some between."""
    count = min(trunk.segments, MAX_SEGMENTS)
    return np.linspace(0, trunk.segments - 1, count).round().astype(int).tolist()


def segment_title(trunk: Trunk, segment: int) -> str:
    """Heading of the panel of a segment."""
    more = f" of {trunk.segments}" if trunk.segments > MAX_SEGMENTS else ""
    return f"segment {segment + 1}{more}"


def head_segment(axes: Axes, motion: Motion, segment: int, end: float) -> None:
    """Write the heading of a segment's column, and the numbers of phases, above a panel."""
    number_phases(axes, motion, end)
    axes.set_title(
        segment_title(motion.trunk, segment), pad=NUMBERS_PAD if numbered(motion) else None
    )


def note_if_empty(axes: Axes, trunk: Trunk, group: str, segment: int) -> None:
    """Write a note in the panel of a segment that has no muscle of a group."""
    if not muscles_of(trunk, group, segment):
        axes.text(
            0.5, 0.5, "no such muscle", color=FAINT, transform=axes.transAxes,
            ha="center", va="center",
        )  # fmt: skip


# --- phases -------------------------------------------------------------------------------------


def numbered(motion: Motion) -> bool:
    """Whether phases are numbered: there are more of them than colors to tell them apart."""
    return len(motion.phases) > len(PHASES)


def shade_phases(axes: Axes, motion: Motion, end: float) -> None:
    """Shade the phases behind curves over time, from 0 to `end` in s."""
    colors = BANDS if numbered(motion) else PHASES
    start = 0.0
    for number, phase in enumerate(motion.phases):
        color, until = colors[number % len(colors)], min(phase.end, end)
        if start < end and color != BANDS[0]:
            axes.axvspan(start, until, color=color, linewidth=0, zorder=0)
        start = phase.end
    if end > 0:
        axes.set_xlim(0, end)


def number_phases(axes: Axes, motion: Motion, end: float, named: bool = False) -> None:
    """Write the numbers of phases above a panel over time, as many as there is room for.

    Phases that colors tell apart need none; with `named` they get their names.
    """
    if end <= 0 or not (named or numbered(motion)):
        return
    width = axes.get_window_extent().width / axes.figure.dpi / MM
    start, last = 0.0, -np.inf
    for number, phase in enumerate(motion.phases, 1):
        middle = width * (start + min(phase.end, end)) / 2 / end
        letters = int(width * (min(phase.end, end) - start) / end / SMALL_LETTER)
        text = f"{number}" if numbered(motion) else escaped(shortened(phase.name, max(letters, 4)))
        if start < end and middle - last >= NUMBER_WIDTH:
            axes.annotate(
                text, (middle / width, 1.0), (0, 1), xycoords="axes fraction",
                textcoords="offset points", ha="center", va="bottom", fontsize=5.5, color=FAINT,
                gid="phase number",
            )  # fmt: skip
            last = middle
        start = phase.end


def phase_patches(motion: Motion) -> list[Patch]:
    """Legend entries for the shading of phases; none if they are numbered."""
    if numbered(motion):
        return []
    most = LEGEND_LETTERS // len(motion.phases)
    return [
        Patch(color=PHASES[n], label=escaped(shortened(phase.name, most)))
        for n, phase in enumerate(motion.phases)
    ]


def phase_lines(motion: Motion) -> list[str]:
    """Names of numbered phases, in lines below the title; names are shortened until they fit."""
    if not numbered(motion):
        return []
    for most in (40, 30, 20, 14, 10, 7):
        names = [f"{n} {shortened(p.name, most)}" for n, p in enumerate(motion.phases, 1)]
        joined = "    ".join(name.replace(" ", "\0") for name in names)
        lines = textwrap.wrap(joined, KEY_LINE, break_long_words=False, break_on_hyphens=False)
        if len(lines) <= MAX_KEY_LINES:
            break
    else:
        lines = [*lines[: MAX_KEY_LINES - 1], f"and so on to phase {len(motion.phases)}"]
    return [escaped(line.replace("\0", " ")) for line in lines]


# --- titles and legends -------------------------------------------------------------------------


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


ROW, KEY_ROW = 4.0, 2.9  # mm, of a legend and of a line of numbered phases


def header(motion: Motion, rows: int) -> float:
    """Height in mm of a figure's title, a number of legend rows and the names of phases."""
    named = KEY_ROW * len(phase_lines(motion)) + 2.0 if numbered(motion) else ROW
    return 4.5 + ROW * rows + named


def legend_below_title(
    figure: Figure, *rows: Sequence[Artist], motion: Motion | None = None
) -> None:
    """Put a figure's legend under its title, in rows; of a motion also the names of its phases."""
    height = figure.get_figheight() / MM
    down = 4.5
    for entries in (*rows, phase_patches(motion) if motion else ()):
        if entries:
            figure.legend(
                handles=entries, loc="upper center", bbox_to_anchor=(0.5, 1 - down / height),
                ncols=len(entries), columnspacing=1.4, borderaxespad=0.2,
            )  # fmt: skip
            down += ROW
    for line in phase_lines(motion) if motion else ():
        figure.text(0.5, 1 - (down + 0.4) / height, line, fontsize=6.0, ha="center", va="top")
        down += KEY_ROW

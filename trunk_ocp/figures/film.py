"""A motion as a film: the trunk with its muscles at work, from the right and from the left."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.animation import AbstractMovieWriter, FFMpegWriter, PillowWriter
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import Normalize
from matplotlib.transforms import Bbox

from .._support.atomic_files import replacing
from ..errors import InputError, TrunkError
from ..planning.plan import Plan
from ..problem.interpolation import with_marks
from ..scene.body import core_body, core_radius
from ..scene.colors import WOOD
from ..scene.moments import Moment, end_of, moments_at, phase_at
from ..scene.surfaces import coarse_body
from ..scene.surroundings import logs, tip_mass
from . import style
from .activation_colors import activation_color, color_bar, strongest
from .bodies import joined_with_head, mass_surfaces, solid_surfaces
from .muscles import DARKEST, MARGIN, VIEWS, sections_of
from .projection import Surface, View, cylinder, extent, facets_of, frame, measure, paint

FRAME_RATE = 15  # per second of film
SLOWDOWN = 2  # a film takes twice as long as the motion, which takes two to four seconds
MAX_FRAMES = 150
SIZE = 150.0, 95.0  # mm
DPI = 130
STREAMABLE = ["-movflags", "+faststart"]  # browsers play it while they load it
CORE = "#CFC6BD"  # as on the page

Progress = Callable[[int, int], Any]


def frame_times(plan: Plan) -> np.ndarray:
    """Times in s of the film's frames, from the start to the end, with the jumps of the loads."""
    end = end_of(plan)
    count = min(int(np.ceil(end * FRAME_RATE * SLOWDOWN)), MAX_FRAMES) + 1
    times = np.linspace(0.0, end, max(count, 2))
    return with_marks(times, plan.jumps, times[1] / 2)


def write_film(plan: Plan, folder: str | Path, progress: Progress | None = None) -> list[Path]:
    """Write `film.mp4` where the program ffmpeg is installed, and `film.gif` where it is not.

    Muscles are colored by |activation|; seen from both sides, at half the speed.

    Parameters
    ----------
    progress : callable, optional
        Called with (frames done, frames) after each frame.

    Raises
    ------
    InputError
        If the plan has no time steps, or a film cannot be written there.
    TrunkError
        If ffmpeg fails.
    """
    if not len(plan.x):
        raise InputError(f"{plan.motion.name}: the plan has no time steps, so there is no film.")
    moments = moments_at(plan, frame_times(plan))
    rate = max(1, round((len(moments) - 1) / (SLOWDOWN * end_of(plan))))
    with_ffmpeg = bool(shutil.which("ffmpeg"))
    path = Path(folder) / ("film.mp4" if with_ffmpeg else "film.gif")
    with replacing(path) as unfinished, style.styled():
        stage = Stage(plan, moments)
        writer: AbstractMovieWriter = PillowWriter(fps=rate)
        if with_ffmpeg:
            writer = FFMpegWriter(fps=rate, bitrate=2500, extra_args=STREAMABLE)
        try:
            writer.setup(stage.figure, str(unfinished), DPI)
            for number, moment in enumerate(moments, 1):
                stage.show(moment)
                writer.grab_frame()
                if progress is not None:
                    progress(number, len(moments))
            writer.finish()
        except (subprocess.CalledProcessError, BrokenPipeError) as error:
            raise TrunkError(
                f"{path}: the program ffmpeg failed ({error}). Where ffmpeg is not on the path, "
                "the film is a GIF."
            ) from None
    return [path]


class Stage:
    """The figure of a film, drawn again for each moment; every moment has room in it."""

    def __init__(self, plan: Plan, moments: list[Moment]) -> None:
        self.plan, self.figure = plan, style.new_figure(SIZE[1], SIZE[0])
        FigureCanvasAgg(self.figure)
        self.scale = Normalize(0.0, strongest(plan))
        self.logs, self.mass = logs(plan), tip_mass(plan)
        self.boxes = {side: self._box(view, moments) for side, view in VIEWS.items()}
        self.panels: dict[str, Axes] = {}

    def _box(self, view: View, moments: list[Moment]) -> Bbox:
        trunk = self.plan.motion.trunk
        Z, margin = np.linspace(0, trunk.length, 40), MARGIN * trunk.length
        line = np.concatenate([moment.shape.position(Z)[0] for moment in moments])
        boxes = [extent(view, line, trunk.base_radius + margin)]
        for moment in moments:
            for surface in self.objects(moment) + solid_surfaces(self.plan, moment, bounded=True):
                boxes.append(extent(view, surface.facets.reshape(-1, 3), margin))
        return Bbox.union(boxes)

    def show(self, moment: Moment) -> None:
        """Draw a moment; what does not move stays from the moment before."""
        for side, view in VIEWS.items():
            if side not in self.panels:
                self.panels[side] = self._empty_panel(side, view)
            for drawn in list(self.panels[side].collections):
                drawn.remove()
        motion, note = style.title(self.plan.motion), style.unsolved_note(self.plan)
        phase = self.plan.motion.phases[phase_at(self.plan.motion, moment.time, moment.after)]
        after = " (just after)" if moment.after else ""
        name = style.escaped(style.shortened(phase.name, 30))
        style.headline(self.figure, f"{motion}{note}: {name}, t = {moment.time:.2f} s{after}")
        surfaces = self.surfaces(moment)
        for side, view in VIEWS.items():
            paint(self.panels[side], view, surfaces, darkest=DARKEST)

    def _empty_panel(self, side: str, view: View) -> Axes:
        first = not self.panels
        axes = self.figure.add_axes((0.01 if first else 0.51, 0.17, 0.48, 0.7))
        frame(axes, view, self.boxes[side])
        axes.set_title(f"from the {style.SIDES[side][0]}", color=style.FAINT, fontsize=7)
        if first:
            measure(axes, self.boxes[side])
            color_bar(self.figure, self.scale)
        return axes

    def panel(self, axes: Axes, view: View, moment: Moment) -> None:
        """Draw head, muscles, the tissue inside them, and objects at a moment in one view."""
        paint(axes, view, self.surfaces(moment), darkest=DARKEST)

    def surfaces(self, moment: Moment) -> list[Surface]:
        """Muscles and the tissue inside them, head, obstacles, and objects at a moment."""
        trunk = self.plan.motion.trunk
        sections = sections_of(trunk)
        bodies = [coarse_body(trunk, part, moment.shape, sections) for part in trunk.subdomains]
        colors = [activation_color(self.scale, value) for value in moment.activation]
        surfaces = [
            Surface(facets_of(body, sections), color)
            for body, color in zip(bodies, colors, strict=True)
        ]
        cores = [
            core_body(trunk, segment, moment.shape, sections)
            for segment in range(trunk.segments)
            if core_radius(trunk, segment) > 0
        ]
        surfaces += [Surface(facets_of(core, sections), CORE) for core in cores]
        return joined_with_head(self.plan, moment, surfaces) + self.objects(moment)

    def objects(self, moment: Moment) -> list[Surface]:
        """Logs and the tip mass at a moment."""
        cylinders = [
            cylinder(log.center(self.plan, moment.time), log.radius, log.length)
            for log in self.logs
        ]
        surfaces = [Surface(facets, WOOD) for facets in cylinders]
        return surfaces + mass_surfaces(self.plan, self.mass, moment)

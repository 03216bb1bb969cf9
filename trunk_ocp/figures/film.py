"""The motion as a film: the trunk with its muscles at work, seen three-quarter from both sides."""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.animation import AbstractMovieWriter, FFMpegWriter, PillowWriter
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from matplotlib.transforms import Bbox

from .._support.atomic_files import replacing
from ..errors import InputError
from ..planning.plan import Plan
from ..problem.interpolation import with_marks
from ..scene.body import muscle_body
from ..scene.moments import SAME, Instant, end_of, instants
from ..scene.surroundings import Log, head_sphere, log_at
from . import style
from .muscles import ACTIVATION, DARKEST, MARGIN, SECTIONS, VIEWS, strongest
from .scene import Surface, View, cylinder, extent, facets_of, frame, measure, paint
from .shapes import WOOD, cargo

RATE = 15  # frames per second of film
SLOWER = 2  # times as long as the motion, which takes two to four seconds
MOST = 150  # frames
SIZE = 150.0, 95.0  # mm
DOTS = 130  # per inch

Told = Callable[[int, int], Any]


def frame_times(plan: Plan) -> np.ndarray:
    """Times in s of the film's frames, from rest to the end; jumps of the loads among them."""
    end = end_of(plan)
    count = min(int(np.ceil(end * RATE * SLOWER)), MOST) + 1
    times = np.linspace(0.0, end, max(count, 2))
    return with_marks(times, plan.jumps, times[1] / 2)


def write_film(plan: Plan, folder: str | Path, told: Told | None = None) -> list[Path]:
    """Write `film.gif` and, where the program ffmpeg is installed, `film.mp4`.

    Muscles are colored by |activation|; the right side and the left, at half the speed.

    Parameters
    ----------
    told : callable
        Called with (frames done, frames) after each frame.

    Raises
    ------
    InputError
        If the plan has no time steps, or a film cannot be written there.
    """
    folder = Path(folder)
    if not len(plan.x):
        raise InputError(f"{plan.motion.name}: the plan has no time steps, so there is no film.")
    moments = instants(plan, frame_times(plan))
    rate = max(1, round((len(moments) - 1) / (SLOWER * end_of(plan))))
    writers: list[tuple[AbstractMovieWriter, Path]] = [
        (PillowWriter(fps=rate), folder / "film.gif")
    ]
    if shutil.which("ffmpeg"):
        writers.append((FFMpegWriter(fps=rate, bitrate=2500), folder / "film.mp4"))
    with contextlib.ExitStack() as files, style.styled():
        stage = Stage(plan, moments)
        for writer, path in writers:
            writer.setup(stage.figure, str(files.enter_context(replacing(path))), DOTS)
        for number, moment in enumerate(moments, 1):
            stage.show(moment)
            for writer, _ in writers:
                writer.grab_frame()
            if told is not None:
                told(number, len(moments))
        for writer, _ in writers:
            writer.finish()
    return [path for _, path in writers]


class Stage:
    """The figure of a film, drawn anew for each moment."""

    def __init__(self, plan: Plan, moments: list[Instant]) -> None:
        self.plan, self.figure = plan, style.new_figure(SIZE[1], SIZE[0])
        FigureCanvasAgg(self.figure)
        self.scale = Normalize(0.0, strongest(plan))
        self.boxes = {side: self._box(view, moments) for side, view in VIEWS.items()}

    def _box(self, view: View, moments: list[Instant]) -> Bbox:
        """Room for every moment, so that nothing jumps."""
        trunk = self.plan.motion.trunk
        Z = np.linspace(0, trunk.length, 40)
        points = [moment.shape.position(Z)[0] for moment in moments]
        for moment in moments:
            hung = cargo(self.plan, self._phase(moment), moment)
            points += [surface.facets.reshape(-1, 3) for surface in hung]
        for step in range(len(self.plan.x)):
            log = log_at(self.plan.motion, step)
            if log is not None:
                points.append(cylinder(log.center, log.radius, log.length).reshape(-1, 3))
        return extent(view, np.concatenate(points), trunk.base_radius + MARGIN * trunk.length)

    def show(self, moment: Instant) -> None:
        """Draw a moment."""
        figure, trunk = self.figure, self.plan.motion.trunk
        figure.clear()
        motion, mark = style.title(self.plan.motion), style.mark(self.plan)
        after = " (just after)" if moment.after else ""
        style.headline(figure, f"{motion}{mark}, t = {moment.time:.2f} s{after}")
        bodies = [muscle_body(trunk, muscle, moment.shape, SECTIONS) for muscle in trunk.subdomains]
        surfaces = [
            Surface(facets_of(body, SECTIONS), self._color(moment.activation[index]))
            for index, body in enumerate(bodies)
        ]
        surfaces += cargo(self.plan, self._phase(moment), moment)
        log = self._log(moment.time)
        if log is not None:
            surfaces.append(Surface(cylinder(log.center, log.radius, log.length), WOOD))
        for place, (side, view) in enumerate(VIEWS.items()):
            axes = figure.add_axes((0.01 + 0.5 * place, 0.14, 0.48, 0.76))
            sphere = head_sphere(trunk)
            if sphere is not None:
                center = tuple(view.flat(sphere[0]))
                axes.add_patch(Circle(center, sphere[1], color="#E4E4E4", linewidth=0, zorder=1))
            paint(axes, view, surfaces, darkest=DARKEST)
            frame(axes, view, self.boxes[side])
            axes.set_title(f"from the {style.SIDES[side][0]}", color=style.FAINT, fontsize=7)
            if place == 0:
                measure(axes, self.boxes[side])
        _bar(figure, self.scale)

    def _color(self, activation: float) -> tuple[float, float, float]:
        red, green, blue, _ = matplotlib.colormaps[ACTIVATION](float(self.scale(abs(activation))))
        return (red, green, blue)

    def _phase(self, moment: Instant) -> int:
        return self.plan.motion.steps[self._step(moment.time, moment.after)].phase

    def _step(self, time: float, after: bool = False) -> int:
        """Number, from 0, of the time step that a time leads to; `after` at one, the next."""
        planned = len(self.plan.x)
        times = self.plan.motion.times[:planned]
        return min(int(np.searchsorted(times, time + (SAME if after else -SAME))), planned - 1)

    def _log(self, time: float) -> Log | None:
        """The log at a time: where the time steps around it have it, and on a line between."""
        motion, after = self.plan.motion, self._step(time)
        log = log_at(motion, after)
        before = log_at(motion, after - 1) if after else None
        if log is None or before is None or motion.steps[after].phase == 0:
            return log
        start, end = motion.times[after - 1], motion.times[after]
        share = (time - start) / (end - start)
        return Log(before.center + share * (log.center - before.center), log.radius, log.length)


def _bar(figure: Figure, scale: Normalize) -> None:
    axes = figure.add_axes((0.3, 0.1, 0.4, 0.02))
    mapped = ScalarMappable(scale, matplotlib.colormaps[ACTIVATION])
    figure.colorbar(mapped, cax=axes, orientation="horizontal", label="|activation| (no unit)")

"""Pictures of the documentation: `python docs/pictures.py` writes them to docs/figures."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path

import numpy as np
from contact_pictures import draw_contact
from conventions import draw_conventions
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure
from PIL import Image

import trunk_ocp as to
from trunk_ocp.figures import style
from trunk_ocp.figures.activation_colors import ACTIVATION
from trunk_ocp.figures.film import Stage
from trunk_ocp.figures.muscles import VIEWS
from trunk_ocp.figures.projection import frame
from trunk_ocp.scene.moments import Moment, moments_at, phase_at

FOLDER = Path(__file__).parent / "figures"
PHASES = ("1  reach for the fruit", "2  pull it off", "3  bring it to the mouth")
FRAMES, FRAME_RATE, PAUSE = 60, 10, 1.5  # FRAME_RATE in 1/s, PAUSE in s
SIZE, DPI, COLORS = (118.0, 84.0), 130, 200  # SIZE in mm
MOUTH = np.array([-0.2, 0.0, 0.16])  # m, the target of the last phase


def main() -> None:
    """Write all pictures."""
    draw_conventions(to.load_anatomy("asian-elephant"), FOLDER, ("png",))
    draw_contact(FOLDER)
    write_fruit(to.plan_motion(to.load_motion("pick-fruit")), FOLDER / "pick-fruit.gif")


def write_fruit(plan: to.Plan, path: Path) -> None:
    """A film of the fruit motion, short and small enough for the first page."""
    times = np.linspace(0.0, plan.motion.phases[-1].end, FRAMES)
    with style.styled():
        moments = moments_at(plan, times)
        stage = Stage(plan, moments)
        images = [_image(stage, moment) for moment in moments]
    # One palette for all frames: what does not move keeps its color, and the file stays small.
    sample = Image.fromarray(np.concatenate(images[::8]))
    palette = sample.quantize(COLORS, dither=Image.Dither.NONE)
    palette.putpalette([255 if c > 250 else c for c in palette.getpalette() or []])  # white paper
    frames = [
        Image.fromarray(image).quantize(palette=palette, dither=Image.Dither.NONE)
        for image in images
    ]
    shown = [1000 // FRAME_RATE] * (len(frames) - 1) + [int(1000 * PAUSE)]
    frames[0].save(path, save_all=True, append_images=frames[1:], duration=shown, loop=0)


def _image(stage: Stage, moment: Moment) -> np.ndarray:
    """A frame, (height, width, 3)."""
    figure = style.new_figure(SIZE[1], SIZE[0])
    axes = figure.add_axes((0.0, 0.0, 0.7, 1.0))
    view = VIEWS["R"]
    stage.panel(axes, view, moment)
    frame(axes, view, stage.boxes["R"])
    fruit = view.flat(stage.objects(moment)[0].facets.mean(axis=(0, 1)))
    axes.annotate("fruit\n8 kg", tuple(fruit), color="white", ha="center", va="center", fontsize=6,
                  zorder=5)  # fmt: skip
    mouth = view.flat(MOUTH)
    axes.plot(*mouth, "x", color=style.INK, markersize=5, zorder=5)
    axes.annotate("mouth", tuple(mouth), (-24, -20), textcoords="offset points", zorder=5,
                  ha="right", va="center", fontsize=8, arrowprops={"arrowstyle": "-"})  # fmt: skip
    _explain(figure, stage, moment)
    file = BytesIO()
    figure.savefig(file, format="png", dpi=DPI)
    return np.asarray(Image.open(file).convert("RGB"))


def _explain(figure: Figure, stage: Stage, moment: Moment) -> None:
    """Phases, time and the meaning of the colors, to the right of the trunk."""
    now = phase_at(stage.plan.motion, moment.time, moment.after)
    for number, name in enumerate(PHASES):
        color, weight = (style.INK, "bold") if number == now else (style.FAINT, "normal")
        figure.text(0.66, 0.92 - 0.06 * number, name, color=color, fontweight=weight, fontsize=8)
    figure.text(0.66, 0.72, f"t = {moment.time:.1f} s", fontsize=8)
    axes = figure.add_axes((0.7, 0.14, 0.22, 0.03))
    figure.colorbar(ScalarMappable(stage.scale, ACTIVATION), cax=axes, orientation="horizontal")
    axes.set_title("contraction of a muscle, $-\\gamma$", fontsize=7)
    axes.set_xticks([0.0, float(stage.scale.vmax or 1.0)], ["relaxed", "strongest"])


if __name__ == "__main__":
    main()

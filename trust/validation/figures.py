"""Figures of docs/validation.md: beams, orders of convergence, limits of the anatomy."""

from __future__ import annotations

import io
import math
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from PIL import Image

from trunk_ocp.figures.style import FAINT, INK, new_figure, styled
from trunk_ocp.scene.colors import EXTRA_COLORS, GROUP_COLORS

from . import beams, convergence, elastica, limits
from .rods import elephant, rod, untapered

DOTS: dict[str, Any] = {
    "linestyle": "none",
    "marker": "o",
    "markersize": 3.0,
    "color": INK,
    "zorder": 3,
}
BLUES = ("#9CC7E4", "#56A0D3", "#0072B2", "#003E63")
FINE = np.linspace(0, 1, 121)


def draw_all(folder: Path) -> list[Path]:
    """Write every figure of the page as PNG."""
    with styled():
        drawn = {
            "validation-beams": draw_beams(),
            "validation-convergence": draw_convergence(),
            "validation-limits": draw_limits(),
        }
        return [write(figure, folder / f"{name}.png") for name, figure in drawn.items()]


def write(figure: Figure, path: Path) -> Path:
    """Write a figure as a PNG with a reduced palette: a quarter of the size, no visible change."""
    path.parent.mkdir(parents=True, exist_ok=True)
    whole = io.BytesIO()
    figure.savefig(whole, format="png", dpi=150)
    with Image.open(whole) as image:
        image.convert("RGB").quantize(160, dither=Image.Dither.NONE).save(path, optimize=True)
    return path


def panels(height: float, *titles: str) -> tuple[Figure, list[Axes]]:
    """A figure with a row of panels."""
    figure = new_figure(height)
    figure.set_layout_engine("constrained")
    axes = list(figure.subplots(1, len(titles)))
    for axis, title in zip(axes, titles, strict=True):
        axis.set_title(title)
    return figure, axes


def draw_beams() -> Figure:
    """Large deflections: lines are computed shapes, dots are references."""
    figure, (tip, weight, couple) = panels(
        62, "tip load, $PL^2/EI$ = 1, 2, 5, 10", "own weight, $wL^3/EI$", "couple of one turn, over"
    )
    for load, color in zip((1.0, 2.0, 5.0, 10.0), BLUES, strict=True):
        r = elastica.loaded(load).position(FINE)
        tip.plot(r[:, 2], -r[:, 0], color=color)
    printed = elastica.MATTIASSON[[0, 1, 4, 9]]
    tip.plot(1 - printed[:, 2], -printed[:, 1], label="Mattiasson 1981", **DOTS)
    tip.legend(loc="lower left")
    tip.set_xlabel("along the clamp / L")
    tip.set_ylabel("deflection / L")

    every = [*elastica.HEAVY, (elastica.RAISED, 50.0)]
    tips = [elastica.heavy(load, clamp) for clamp, load in elastica.HEAVY]
    tips.append(elastica.other_branch()[1])
    for (clamp, load), (x, z, _) in zip(every, tips, strict=True):
        r = elastica.sagging(load, clamp).position(FINE)
        name, color = ("level", "#0072B2") if clamp == elastica.LEVEL else ("raised", "#D55E00")
        weight.plot(r[:, 0], -r[:, 2], color=color)
        weight.plot(x, -z, **DOTS)
        weight.annotate(
            f"{name}, {load:g}",
            (x, -z),
            (0, 4) if x < 0 else (4, -2),
            textcoords="offset points",
            fontsize=6.5,
            color=color,
        )
    weight.margins(x=0.3)
    weight.set_xlabel("horizontal / L")
    weight.set_ylabel("up / L")

    for Z_w, color in zip((0.6, 0.9, 0.999), BLUES[1:], strict=True):
        r = beams.rolled(2 * math.pi, Z_w).position(FINE)
        couple.plot(r[:, 2], r[:, 0], color=color, label=f"[{Z_w:g} L, L]")
    ends = beams.roll_up()[1][[0, 1, 3]]
    couple.plot(ends[:, 1], ends[:, 0], **DOTS)
    couple.legend(loc="center")
    couple.set_xlabel("along the clamp / L")
    couple.set_ylabel("across / L")
    for axis in (tip, weight, couple):
        axis.set_aspect("equal", adjustable="datalim")
    return figure


def draw_convergence() -> Figure:
    """Errors vs. number of elements, one line per degree, with measured orders."""
    figure, axes = panels(78, "at element edges: order 2 d", "anywhere: order d + 1")
    colors = [*GROUP_COLORS.values(), *EXTRA_COLORS]
    for axis, place in zip(axes, convergence.PLACES, strict=True):
        for degree in convergence.DEGREES:
            errors = [convergence.error(n, degree, place) for n in convergence.ELEMENTS]
            last = next((i for i, e in enumerate(errors) if e <= convergence.FLOOR), len(errors))
            measured = convergence.order(degree, place)
            axis.loglog(
                convergence.ELEMENTS[:last],
                errors[:last],
                color=colors[degree - 1],
                marker="o",
                markersize=2.0,
                label=f"d = {degree}: {measured:.2f}",
            )
        axis.axhline(convergence.FLOOR, color=FAINT, linewidth=0.6, linestyle=(0, (4, 3)))
        axis.set_xlim(0.9, 110)
        axis.set_ylim(3e-13, 8)
        axis.set_xticks([1, 2, 4, 8, 16, 32, 64], labels=["1", "2", "4", "8", "16", "32", "64"])
        axis.minorticks_off()
        axis.set_xlabel("elements")
        axis.legend(loc="upper left", bbox_to_anchor=(1, 1), title="measured", title_fontsize=6.5)
    axes[0].set_ylabel("largest error of r (m), d (1), m (5 N m)")
    return figure


def draw_limits() -> Figure:
    """Critical helix angle vs. thickness, and round-off errors of eq. (A.4)."""
    figure, (angle, taper, helix) = panels(
        66,
        "critical helix angle of a layer",
        "eq. (A.4) as printed: small taper",
        "eq. (A.4) as printed: small helix",
    )
    thickness = np.linspace(1e-3, 0.6, 40)
    lines = ((0.0, 0, "-", INK), (0.0, 1, "--", INK), (10.0, 0, "-", FAINT), (10.0, 1, "--", FAINT))
    for degrees, measure, dash, color in lines:
        trunk = untapered(rod(), math.radians(degrees))
        angles = [
            limits.critical_angle(trunk, limits.layer(t, 0.5, trunk), measure) for t in thickness
        ]
        what = ("extension", "bending")[measure]
        angle.plot(
            thickness, np.degrees(angles), dash, color=color, label=f"{what}, taper {degrees:g}°"
        )
    trunk = elephant()
    for muscle, (name, extension, bending) in zip(
        [m for m in trunk.subdomains if m.architecture == "helical" and m.side == "R"],
        limits.oblique_angles(),
        strict=True,
    ):
        color, at = GROUP_COLORS[muscle.group], 1 - muscle.radii[0] / muscle.radii[1]
        angle.plot([at, at], [extension, bending], "o", markersize=3, color=color)
        if name == "2-ivo":
            angle.annotate(name, (at, bending), (at + 0.02, bending - 0.7), color=color)
    angle.axhline(math.degrees(limits.SPECIAL), color=FAINT, linewidth=0.6, linestyle=(0, (4, 3)))
    angle.set_xlabel("thickness / outer radius")
    angle.set_ylabel("degrees")
    angle.legend(loc="upper left", labelspacing=0.25)
    sweep = np.logspace(-6, -0.25, 24)
    for axis, losses in (
        (taper, [limits.printed_loss(x, math.pi / 6) for x in sweep]),
        (helix, [limits.printed_loss(math.radians(4.81), x) for x in sweep]),
    ):
        for column, color in enumerate(("#0072B2", "#E69F00", "#D55E00")):
            errors = np.maximum(np.array(losses)[:, column], 1e-16)
            label = rf"$\delta_{(0, 1, 3)[column]}$"
            axis.loglog(np.degrees(sweep), errors, color=color, label=label)
        axis.set_ylim(5e-17, 10)
        axis.legend(loc="upper center")
    taper.axvline(4.81, color=FAINT, linewidth=0.6, linestyle=(0, (4, 3)))
    helix.axvline(30.0, color=FAINT, linewidth=0.6, linestyle=(0, (4, 3)))
    taper.set_xlabel("taper, degrees")
    helix.set_xlabel("helix, degrees")
    taper.set_ylabel("relative error, double precision")
    return figure

"""Pictures of docs/contact.md: outlines of planned trunks without and with contact."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle

import trunk_ocp as to
from trunk_ocp.figures import style
from trunk_ocp.model.quaternions import director_rows
from trunk_ocp.rod.equations import ORIENTATION
from trunk_ocp.rod.volume import section_scale

WITHOUT, WITH = "#c1272d", "#1f5f8b"
SIDE, ABOVE = (0, 2), (0, 1)  # axes of space to the right and down, and to the right and up
SIZE, DPI = (180.0, 66.0), 130  # mm
POINTS = 400


def draw_contact(folder: Path) -> None:
    """Write contact.png."""
    with style.styled():
        figure = style.new_figure(SIZE[1], SIZE[0])
        figure.subplots_adjust(left=0.08, right=0.99, bottom=0.16, top=0.82, wspace=0.35)
        log, curl, posts = figure.subplots(1, 3)
        for name, axes, step, view in (
            ("lift-log", log, 1, SIDE),
            ("tight-curl", curl, -1, SIDE),
            ("fruit-behind-posts", posts, -1, ABOVE),
        ):
            for contact, color in (("none", WITHOUT), ("all", WITH)):
                plan = to.plan_motion(to.load_motion(name).with_contact(contact))
                _outline(axes, plan, step, view, color)
            for solid in plan.motion.steps[step].solids:
                if solid.group != "head":
                    center = np.asarray(solid.center)[list(view)]
                    axes.add_patch(
                        Circle(center, solid.sizes[0], fc="#d9c29c", ec="#5a4520", lw=0.8)
                    )
            axes.set_aspect("equal")
            axes.set_title(plan.motion.spec.title, fontsize=8)
        for axes, (x, y), labels in (
            (log, ((0.0, 0.7), (1.5, 0.8)), ("X, forward (m)", "Z, down (m)")),
            (curl, ((0.0, 0.7), (1.4, 0.7)), ("X, forward (m)", "Z, down (m)")),
            (posts, ((0.4, 1.4), (-0.5, 0.5)), ("X, forward (m)", "Y, to the right (m)")),
        ):
            axes.set(xlim=x, ylim=y, xlabel=labels[0], ylabel=labels[1])
        log.plot([], [], color=WITHOUT, label="without contact")
        log.plot([], [], color=WITH, label="with contact")
        figure.legend(loc="upper center", ncols=2, fontsize=8)
        figure.savefig(folder / "contact.png", dpi=DPI)


def _outline(axes: Axes, plan: to.Plan, step: int, view: tuple[int, int], color: str) -> None:
    """Both edges of the trunk as seen along a coordinate axis, and its tip."""
    trunk = plan.motion.trunk
    Z = np.linspace(0.0, trunk.length, POINTS)
    center = plan.shape.position(Z)[step][:, view]
    tangent = director_rows(plan.shape.state(Z)[step][:, ORIENTATION])[:, 2][:, view]
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    radius = section_scale(trunk, plan.shape)[step] * trunk.radius(Z)
    across = radius[:, None] * tangent[:, ::-1] * (1.0, -1.0)
    edge = np.concatenate([center + across, (center - across)[::-1]])
    axes.plot(*edge.T, color=color, lw=1.1)


if __name__ == "__main__":
    draw_contact(Path(__file__).parent / "figures")

"""Figures of small arms, many phases and many segments: whole, legible and without warnings."""

import warnings
from itertools import combinations
from threading import Thread

import matplotlib
import numpy as np
import pytest
from extreme_plans import CASES, extreme
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.text import Annotation

from trunk_ocp.figures import activations, anatomy, comparison, errors, film, muscles, shapes, style
from trunk_ocp.figures.projection import three_quarter
from trunk_ocp.scene.moments import moments_at, times_of_motion

DPI = 100.0
LEAST_PANEL, LEAST_AREA = 35, 5000  # px at 100 dpi: 9 mm, and 9 by 36 mm
ROUND_OFF = 0.5  # px
TOUCHING = 1.5  # px by which boxes of texts may overlap: their letters do not


def figures_of(case):
    """Every figure of a plan, by name."""
    plan = extreme(case)
    moments = moments_at(plan, times_of_motion(plan))
    trunk = plan.motion.trunk
    return {
        "shapes": shapes.shapes_figure(plan, shapes.rows_of(plan)),
        "activations": activations.activations_figure(plan),
        "errors": errors.errors_figure(plan),
        "muscles": muscles.muscles_figure(plan, moments, "R"),
        "comparison": comparison.comparison_figure(plan, plan),
        "sections": anatomy.sections_figure(trunk),
        "exploded": anatomy.bodies_figure(trunk),
    }


@pytest.fixture(scope="module", params=CASES)
def drawn(request):
    """Figures of a plan, drawn once with warnings as errors."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        figures = figures_of(request.param)
        for figure in figures.values():
            figure.set_dpi(DPI)
            FigureCanvasAgg(figure).draw()
    return figures


def panels(figure):
    """Axes that are not color bars."""
    return [axes for axes in figure.axes if axes.get_label() != "color bar"]


def boxes_of_texts(figure):
    """Texts that are seen, with their boxes in px."""
    seen = [*figure.texts, *(text for legend in figure.legends for text in legend.get_texts())]
    for axes in figure.axes:
        seen += [*axes.texts, axes.title, axes._left_title, axes._right_title]
        if axes.get_legend():
            seen += axes.get_legend().get_texts()
        for axis in (axes.xaxis, axes.yaxis) if axes.axison else ():
            seen += [axis.label, *(tick.label1 for tick in axis._update_ticks())]
    shown = [text for text in seen if text.get_text().strip() and text.get_visible()]
    return [
        (text.get_text(), super(Annotation, text).get_window_extent())
        if isinstance(text, Annotation)
        else (text.get_text(), text.get_window_extent())
        for text in shown
    ]


def test_panels_are_large_enough_to_be_read(drawn):
    for name, figure in drawn.items():
        for axes in panels(figure):
            box = axes.get_window_extent()
            assert min(box.width, box.height) >= LEAST_PANEL, name
            assert box.width * box.height >= LEAST_AREA, name


def test_texts_are_inside_the_figure_and_do_not_overlap(drawn):
    for name, figure in drawn.items():
        page = figure.bbox
        boxes = boxes_of_texts(figure)
        assert boxes
        for text, box in boxes:
            assert page.x0 - ROUND_OFF <= box.x0, (name, text)
            assert box.x1 <= page.x1 + ROUND_OFF, (name, text)
            assert page.y0 - ROUND_OFF <= box.y0, (name, text)
            assert box.y1 <= page.y1 + ROUND_OFF, (name, text)
        for (one, a), (other, b) in combinations(boxes, 2):
            across = min(a.x1, b.x1) - max(a.x0, b.x0)
            along = min(a.y1, b.y1) - max(a.y0, b.y0)
            assert min(across, along) <= TOUCHING, (name, one, other)


def inside(axes, points):
    """Whether points (n, 2) are within the limits of axes."""
    (left, right), (bottom, top) = sorted(axes.get_xlim()), sorted(axes.get_ylim())
    x, y = np.asarray(points).T
    return np.all((x >= left) & (x <= right) & (y >= bottom) & (y <= top))


def test_bodies_paths_and_targets_are_inside_their_axes_to_one_scale(drawn):
    for name in ("shapes", "muscles"):
        figure = drawn[name]
        scales = set()
        for axes in panels(figure):
            box = axes.get_window_extent()
            scales.add(round(box.width / np.ptp(axes.get_xlim()), 3))
            scales.add(round(box.height / np.ptp(axes.get_ylim()), 3))
            for line in axes.lines:
                assert line.get_clip_on() is False or inside(axes, line.get_xydata())
            bodies = [body for body in axes.findobj(PolyCollection) if body.get_paths()]
            assert bodies
            for body in bodies:
                for path in body.get_paths():
                    assert inside(axes, path.vertices)
        assert max(scales) / min(scales) - 1 < 1e-3


def test_phases_are_numbered_where_colors_would_repeat(drawn, request):
    case = request.node.callspec.params["drawn"]
    motion = extreme(case).motion
    count = len(motion.phases)
    for name in ("activations", "errors", "comparison"):
        figure = drawn[name]
        legends = {text.get_text() for legend in figure.legends for text in legend.get_texts()}
        names = {phase.name for phase in motion.phases}
        numbers = figure.findobj(lambda artist: artist.get_gid() == "phase number")
        if count > len(style.PHASES):
            assert not names & legends
            assert {"1", f"{count}"} <= {text.get_text() for text in numbers}
            key = " ".join(text.get_text() for text in figure.texts)
            assert all(f"{n} {p.name}" in key for n, p in enumerate(motion.phases, 1))
        elif case == "99 segments" and name == "activations":  # a map has no shading behind it
            assert not names & legends
            assert [text.get_text()[:4] for text in numbers] == ["reach"[:4], "grasp"[:4]] * 2
        else:
            assert names <= legends
            assert not numbers


def test_every_segment_of_many_is_on_the_map():
    plan = extreme("99 segments")
    with style.styled():
        figure = activations.activations_figure(plan)
    for group in ("upper", "oblique"):
        for side in ("R", "L"):
            (mesh,) = figure.findobj(lambda artist, gid=f"{group} {side}": artist.get_gid() == gid)
            values = mesh.get_array().reshape(99, -1)
            index = [plan.motion.trunk.muscles.index(f"{side}{n + 1}-{group}") for n in range(99)]
            np.testing.assert_allclose(values[:, -1], np.abs(plan.activations[-1, index]))


def test_a_direction_alone_is_drawn_and_explained():
    plan = extreme("one phase")
    rows = shapes.rows_of(plan)
    with style.styled():
        figure = shapes.shapes_figure(plan, rows)
    labels = {text.get_text() for legend in figure.legends for text in legend.get_texts()}
    assert "direction asked for" in labels
    assert not any(label.startswith("target") for label in labels)
    drawn = figure.findobj(lambda artist: artist.get_gid() in ("direction", "pointed at"))
    assert len(drawn) == 2 * 3  # in each view


def test_an_arrow_toward_the_reader_becomes_a_symbol():
    plan = extreme("one phase")
    (row,) = shapes.rows_of(plan)
    (mark,) = row.marks
    with style.styled():
        figure = style.new_figure(50.0)
        axes = figure.add_subplot()
        for way in (1.0, -1.0):
            shapes._direction(axes, shapes.SIDE, mark.target, np.array([0.0, 0.1 * way, 0.0]))
        assert [line.get_marker() for line in axes.lines] == ["o", ".", "o", "x"]
        shapes._direction(axes, shapes.SIDE, mark.target, np.array([0.1, 0.0, 0.0]))
    assert len(axes.lines) == 4
    assert len(axes.texts) == 1


@pytest.mark.parametrize("azimuth", np.radians([0.0, 25.0, 41.6, 60.0, 90.0, 130.0, 155.0]))
def test_the_plane_of_bending_is_not_seen_edge_on(azimuth):
    """A quarter circle in an upright plane: its area is at least half as large as it can be."""
    angle = np.linspace(0.0, np.pi / 2, 30)
    across = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    line = np.sin(angle)[:, None] * across + np.cos(angle)[:, None] * np.array([0.0, 0.0, 1.0])
    view = three_quarter(line[None])
    normal = np.cross(across, (0.0, 0.0, 1.0))
    assert abs(normal @ view.out) >= 0.45
    assert 20.0 <= abs(np.degrees(np.arctan2(view.out[1], view.out[0]))) <= 70.0


def test_the_film_has_room_for_the_head():
    plan = extreme("20 phases")
    moments = moments_at(plan, np.linspace(0.0, plan.motion.times[-1], 5))
    with style.styled():
        stage = film.Stage(plan, moments)
        for moment in moments:
            stage.show(moment)
            for axes in stage.panels.values():
                for body in axes.collections:
                    assert all(inside(axes, path.vertices) for path in body.get_paths())


def test_threads_that_draw_leave_the_settings_alone():
    plan, before = extreme("one phase"), {key: matplotlib.rcParams[key] for key in style.LOOK}

    def draw():
        with style.styled():
            FigureCanvasAgg(errors.errors_figure(plan)).draw()

    threads = [Thread(target=draw) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert {key: matplotlib.rcParams[key] for key in style.LOOK} == before

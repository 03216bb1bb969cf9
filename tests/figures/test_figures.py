"""Figures show the values of the plan; how they look is for people to judge."""

import subprocess
import sys
import tempfile
from dataclasses import replace
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from extreme_plans import extreme
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_hex
from matplotlib.image import imread
from matplotlib.patches import StepPatch
from PIL import Image
from plans import MOTIONS, POINT, REACH, ROD, TOUCH, arm, first_steps, planned, written

from docs import conventions
from trunk_ocp._support.wording import rounded
from trunk_ocp.errors import TrunkError
from trunk_ocp.figures import (
    activations,
    anatomy,
    comparison,
    draw,
    draw_anatomy,
    draw_comparison,
    errors,
    film,
    muscles,
    shapes,
    style,
)
from trunk_ocp.figures.projection import ABOVE, FRONT, SIDE, ball, cylinder, three_quarter
from trunk_ocp.model.solids import in_head_frame, signed_distance
from trunk_ocp.planning.active_bounds import limits, touching
from trunk_ocp.planning.planner import plan_motion
from trunk_ocp.planning.results_folder import OF_PLAN
from trunk_ocp.planning.status import Status
from trunk_ocp.problem.build import build_motion, load_motion
from trunk_ocp.problem.step_solids import head_solids
from trunk_ocp.rod.statics import solve_statics
from trunk_ocp.scene import colors
from trunk_ocp.scene.moments import curve_times, curves, moments_at, times_of_motion
from trunk_ocp.scene.surroundings import logs, tip_mass

pytestmark = pytest.mark.slow


def views_of(plan, rows):
    """The views that are drawn."""
    return SIDE, FRONT, three_quarter(shapes._centerlines(plan, rows))


def with_gid(figure, gid):
    return [artist for artist in figure.findobj() if artist.get_gid() == gid]


def rows_of(plan):
    """A row for each phase, none merged."""
    return [shapes.row_of(plan, number) for number in range(len(plan.motion.phases))]


@cache
def curves_of(name):
    with style.styled():
        return activations.activations_figure(planned(name, "horizon"))


def texts(figure):
    return [text.get_text() for text in figure.findobj(lambda a: hasattr(a, "get_text"))]


def empty(plan):
    return replace(plan, x=plan.x[:0], tip_forces=plan.tip_forces[:0], shape=plan.part(0, 0))


def cut(plan, count):
    return replace(
        plan, x=plan.x[:count], tip_forces=plan.tip_forces[:count], shape=plan.part(0, count)
    )


def test_importing_the_package_does_not_import_matplotlib():
    code = "import sys, trunk_ocp, trunk_ocp.cli.solve; sys.exit('matplotlib' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_every_figure_is_written_in_every_format_and_is_not_blank(tmp_path):
    files = draw(plan_motion(arm(tmp_path, "position = [0.2, 0.1, 0.9]")), tmp_path)
    names = {"shapes", "activations", "muscles-right", "muscles-left", "errors"}
    assert {(file.stem, file.suffix) for file in files} == {
        (name, suffix) for name in names for suffix in (".pdf", ".png")
    }
    for file in files:
        if file.suffix == ".png":
            picture = imread(file)[..., :3]
            assert 0.01 <= np.mean(picture.min(axis=-1) < 0.95) <= 0.9
        else:
            assert file.read_bytes().startswith(b"%PDF")


def test_the_same_plan_gives_the_same_bytes(tmp_path):
    plan = planned("lift-log", "horizon")
    first, second = (
        errors.draw_errors(plan, tmp_path / name, ("pdf", "png")) for name in ("first", "second")
    )
    for one, other in zip(first, second, strict=True):
        assert one.read_bytes() == other.read_bytes()


def test_settings_of_matplotlib_are_left_alone(tmp_path, monkeypatch):
    import matplotlib

    monkeypatch.delitem(sys.modules, "matplotlib.pyplot", raising=False)  # of an earlier test
    before = {key: matplotlib.rcParams[key] for key in style.LOOK}
    errors.draw_errors(planned("lift-log", "horizon"), tmp_path, ("png",))
    assert {key: matplotlib.rcParams[key] for key in style.LOOK} == before
    assert "matplotlib.pyplot" not in sys.modules


@pytest.mark.parametrize("name", MOTIONS)
def test_every_muscle_has_one_curve_through_its_activations(name):
    plan = planned(name, "horizon")
    figure = curves_of(plan.motion.name)
    steps = plan.motion.times
    for index, muscle in enumerate(plan.motion.trunk.subdomains):
        (line,) = with_gid(figure, muscle.name)
        at = np.searchsorted(line.get_xdata(), steps)
        np.testing.assert_array_equal(line.get_ydata()[at], plan.activations[:, index])
        assert line.get_color() == colors.GROUP_COLORS[muscle.group]
        assert line.get_linestyle() == {"R": "-", "L": ":"}[muscle.side]
    for index in range(2):
        (line,) = with_gid(figure, f"head {index}")
        at = np.searchsorted(line.get_xdata(), steps)
        np.testing.assert_array_equal(line.get_ydata()[at], np.degrees(plan.head[:, index]))


def test_curves_between_steps_follow_the_interpolation():
    plan = planned("pick-fruit", "horizon")
    times = np.array([0.75, 1.51])  # halfway on a cosine; after step 1, which holds
    np.testing.assert_allclose(curves(plan, times)[0], plan.x[0] / 2, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(curves(plan, times)[1], plan.x[0])
    times = curve_times(plan)
    before = times[np.searchsorted(times, plan.motion.times[1]) - 1]
    np.testing.assert_array_equal(curves(plan, np.array([before]))[0], plan.x[0])


def test_bounds_drawn_are_those_of_the_motion():
    plan = planned("lift-log", "horizon")
    figure = curves_of(plan.motion.name)
    stairs = [artist for artist in with_gid(figure, "bound") if isinstance(artist, StepPatch)]
    drawn = {}
    for artist in stairs:
        drawn.setdefault(artist.axes.get_ylabel(), []).append(artist.get_data().values)
    (line,) = with_gid(figure, "R3-dr")
    of_axes = [a.get_data().values for a in stairs if a.axes is line.axes]
    index = plan.motion.trunk.muscles.index("R3-dr")
    lower = [step.box.lower[index] for step in plan.motion.steps]
    assert any(np.array_equal(values, lower) for values in of_axes)
    head = np.concatenate([v for key, values in drawn.items() if "ψ" in key for v in values])
    assert np.nanmin(head) == pytest.approx(-15.0)  # pi/12; free angles have no bound
    assert np.isnan(head).any()


def test_a_sequential_plan_keeps_the_bounds_that_are_drawn():
    for name in MOTIONS:
        plan = planned(name, "sequential")
        lower, upper = limits(plan)
        assert np.all(plan.x >= lower - 1e-6)
        assert np.all(plan.x <= upper + 1e-6)


def test_a_muscle_at_its_bound_is_marked():
    plan = planned("lift-log", "horizon")
    figure = curves_of(plan.motion.name)
    below, above = touching(plan)
    count = len(plan.motion.trunk.muscles)
    assert below[:, :count].any()
    for gid, touch in (("at lower bound", below), ("at upper bound", above)):
        drawn = sum(len(line.get_xdata()) for line in with_gid(figure, gid))
        assert drawn == touch[:, :count].sum()
    index = plan.motion.trunk.muscles.index("R3-dr")
    (curve,) = with_gid(figure, "R3-dr")
    marked = [a for a in with_gid(figure, "at lower bound") if a.axes is curve.axes]
    times = {time for line in marked for time in line.get_xdata()}
    assert times >= set(plan.motion.times[below[:, index]])


def test_a_muscle_that_may_not_move_is_not_saturated():
    plan = planned("lift-log", "horizon")
    index = plan.motion.trunk.muscles.index("R3-dl")  # fixed during the first phase
    below, above = touching(plan)
    assert not below[0, index]
    assert not above[0, index]


def test_muscle_groups_have_the_same_color_everywhere():
    plan = planned("lift-log", "horizon")
    trunk = plan.motion.trunk
    assert colors.group_colors(trunk) == colors.GROUP_COLORS
    with style.styled():
        section = anatomy.sections_figure(trunk)
        both = comparison.comparison_figure(planned("lift-log", "sequential"), plan)
    for muscle in trunk.subdomains:
        color = colors.GROUP_COLORS[muscle.group].lower()
        (patch,) = with_gid(section, muscle.name)
        assert to_hex(patch.get_facecolor()) == color
        (line,) = with_gid(both, f"horizon {muscle.name}")
        assert to_hex(line.get_color()) == color
        assert len(with_gid(both, f"sequential {muscle.name}")) == 1


def test_every_label_of_an_axis_has_a_unit():
    plan = planned("lift-log", "horizon")
    with style.styled():
        pictures = [
            shapes.shapes_figure(plan, rows_of(plan)),
            curves_of("lift-log"),
            errors.errors_figure(plan),
            comparison.comparison_figure(planned("lift-log", "sequential"), plan),
            anatomy.sections_figure(plan.motion.trunk),
        ]
    units = ("(m)", "(cm)", "(mm)", "(s)", "(°)", "(no unit)", "(count)")
    for figure in pictures:
        labels = [label for a in figure.axes for label in (a.get_xlabel(), a.get_ylabel())]
        labels = [label for label in labels if label]
        assert labels
        for label in labels:
            assert label.endswith(units), label


def test_log_path_head_and_targets_are_drawn():
    plan = planned("lift-log", "horizon")
    rows = rows_of(plan)
    with style.styled():
        figure = shapes.shapes_figure(plan, rows)
    assert len(with_gid(figure, "target")) == 3 * 3 * 6  # phases, views, points of the wrap
    assert len(with_gid(figure, "log path")) == 3  # only in the phase in which it moves
    side = with_gid(figure, "log path")[0].get_xydata()
    (log,) = logs(plan)
    np.testing.assert_allclose(side, log.centers[2:, [0, 2]], rtol=0, atol=1e-12)


def test_the_fruit_is_drawn_where_the_motion_says():
    plan = planned("pick-fruit", "horizon")
    rows = rows_of(plan)
    np.testing.assert_array_equal(rows[0].marks[0].target, (0.7, 0.3, -0.2))  # the fruit
    np.testing.assert_array_equal(rows[2].marks[0].target, (-0.2, 0.0, 0.16))  # the mouth
    with style.styled():
        figure = shapes.shapes_figure(plan, rows)
    assert any("8 kg at the tip" in text for text in texts(figure))


@cache
def carrying(position="[0.3, 0.0, 1.7]"):
    """A plan of a trunk that hangs down, carries a mass and releases it."""
    third = "\n[[phases]]\nname = 'away'\nduration = 1.0\n[[phases.targets]]\nZ = 1.75\n"
    text = TOUCH.replace("[0.6, 0.1, 1.2]", position).replace('name = "touch"', 'name = "drop"')
    held = third.replace("away", "hold").replace("[[phases.t", "loads.tip_mass = 5.0\n[[phases.t")
    folder = Path(tempfile.mkdtemp())
    rest = f"position = {position}\n"
    return plan_motion(load_motion(written(folder, text + held + rest + third + rest)))


def test_a_mass_below_everything_else_is_drawn_completely():
    plan = carrying()
    rows = rows_of(plan)
    with style.styled():
        figure = shapes.shapes_figure(plan, rows)
    seen = 0
    for number, row in enumerate(rows):
        for place, view in enumerate(views_of(plan, rows)):
            axes = figure.axes[3 * number + place]
            (low, high), (bottom, top) = sorted(axes.get_xlim()), sorted(axes.get_ylim())
            for trunk in row.trunks:
                for surface in shapes.mass_surfaces(plan, row.mass, trunk):
                    flat = view.flat(surface.facets.reshape(-1, 3))
                    assert low <= flat[:, 0].min()
                    assert flat[:, 0].max() <= high
                    assert bottom <= flat[:, 1].min()
                    assert flat[:, 1].max() <= top
                    seen += 1
    assert seen
    moments = moments_at(plan, film.frame_times(plan))
    with style.styled():
        stage = film.Stage(plan, moments)
    for moment in moments:
        for surface in shapes.mass_surfaces(plan, tip_mass(plan), moment):
            for side, view in muscles.VIEWS.items():
                flat, box = view.flat(surface.facets.reshape(-1, 3)), stage.boxes[side]
                assert np.all(flat >= box.min)
                assert np.all(flat <= box.max)


def test_a_long_distance_has_no_power_of_ten():
    assert [rounded(x) for x in (180.2, 0.0123, 4.56, 99999.0)] == ["180", "0.012", "4.6", "100000"]


POSTS = """
[[obstacles]]
name = "post"
shape = "capsule"
from = [0.9, 0.5, 1.7]
to = [0.9, 0.5, -0.5]
radius = 0.06

[[obstacles]]
name = "ground"
shape = "half-space"
point = [0.0, 0.0, 2.5]
normal = [0.0, 0.0, -1.0]
"""


def colored(surfaces, color):
    return [surface for surface in surfaces if surface.color == color]


def test_head_and_obstacles_are_drawn_once_a_row_and_have_a_legend(tmp_path):
    plan = plan_motion(load_motion(written(tmp_path, TOUCH + POSTS)))
    (row,) = rows_of(plan)
    layers = [shapes.layer(plan, row, index) for index in range(len(row.trunks))]
    parts = len(plan.motion.trunk.head.body)
    assert [len(colored(layer, colors.HEAD)) for layer in layers] == [0, 0, 0, parts]
    assert [len(colored(layer, colors.OBSTACLE)) for layer in layers] == [0, 0, 0, 2]
    with style.styled():
        figure = shapes.shapes_figure(plan, [row])
    assert {"head", "obstacle"} <= set(texts(figure))
    for axes in figure.axes:  # the ground has no end, and no room of its own
        assert max(axes.get_ylim()) < 2.3


def test_the_head_is_drawn_as_it_is_turned():
    plan = planned("lift-log", "horizon")
    moment = moments_at(plan, plan.motion.times[-1:])[0]
    drawn = colored(shapes.solid_surfaces(plan, moment), colors.HEAD)
    for surface, solid in zip(drawn, head_solids(plan.motion.trunk), strict=True):
        there = in_head_frame(plan.motion.trunk, surface.facets, moment.head)
        np.testing.assert_allclose(signed_distance(solid, there)[0], 0, atol=1e-12)
        assert np.abs(signed_distance(solid, surface.facets)[0]).max() > 0.01


def test_space_is_drawn_with_equal_scales_and_down_is_down():
    plan = planned("lift-log-asymmetric", "horizon")
    with style.styled():
        figure = shapes.shapes_figure(plan, rows_of(plan))
    assert len(figure.axes) == 9
    width, height = figure.get_size_inches()
    scales = set()
    for axes in figure.axes:
        place = axes.get_position()
        (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
        assert bottom > top
        scales.add(round(place.width * width / abs(right - left), 6))
        scales.add(round(place.height * height / abs(bottom - top), 6))
        assert 0 <= place.x0 < place.x1 <= 1
        assert 0 <= place.y0 < place.y1 <= 1
    assert len(scales) == 1


def test_views_are_right_handed_and_bodies_closed():
    lines = np.random.default_rng(0).normal(size=(2, 9, 3))
    for view in (SIDE, FRONT, three_quarter(lines), ABOVE):
        right = -view.across if view.mirrored else view.across
        np.testing.assert_allclose(np.cross(right, -view.down), view.out, rtol=0, atol=1e-12)
    for facets in (cylinder(np.ones(3), 0.1, 0.5), ball(np.ones(3), 0.2)):
        normals = np.cross(facets[:, 2] - facets[:, 0], facets[:, 3] - facets[:, 1])
        np.testing.assert_allclose(normals.sum(axis=0), 0, rtol=0, atol=1e-12)
        assert np.all(np.sum(normals * (facets.mean(axis=1) - 1), axis=1) >= 0)  # outward


def test_muscles_are_colored_by_the_strength_of_their_activation():
    plan = planned("lift-log", "horizon")
    moments = moments_at(plan, times_of_motion(plan))
    assert len(moments) == 5
    np.testing.assert_array_equal(moments[-1].activation, plan.activations[-1])
    with style.styled():
        figure = muscles.muscles_figure(plan, moments, "R")
    bodies = figure.findobj(PolyCollection)
    groups = len(colors.groups(plan.motion.trunk))
    alike = muscles._different(plan, moments)
    assert [moment.time for moment in alike[1]] == [1.0, 1.4]  # the others are on their own
    assert len(alike) == 4
    drawn = [b for b in bodies if b.get_gid() != "silhouette" and len(b.get_paths()) > 20]
    assert len(drawn) == 4 * groups
    assert muscles.strongest(plan) == 3.5


def test_errors_drawn_are_the_plans_in_mm():
    plan = planned("lift-log", "horizon")
    with style.styled():
        figure = errors.errors_figure(plan)
    (worst, direction) = with_gid(figure, "worst")
    np.testing.assert_allclose(
        worst.get_ydata(), [1e3 * e.position.max() for e in plan.errors], rtol=1e-12
    )
    np.testing.assert_allclose(
        direction.get_ydata(), [e.direction.max() for e in plan.errors], rtol=1e-12
    )
    labels = [line.get_label() for line in figure.axes[0].lines]
    assert sum(label.startswith("Z = ") for label in labels) == 6


def test_a_comparison_shows_cost_change_and_bounds_of_both():
    plans = planned("lift-log", "sequential"), planned("lift-log", "horizon")
    with style.styled():
        figure = comparison.comparison_figure(*plans)
    for plan in plans:
        cost, change, at_bound = with_gid(figure, plan.mode)
        np.testing.assert_allclose(cost.get_ydata(), [e.paper for e in plan.errors])
        steps = np.abs(np.diff(plan.activations, axis=0)).max(axis=1)
        np.testing.assert_array_equal(change.get_ydata(), steps)
        np.testing.assert_array_equal(at_bound.get_ydata(), touching(plan)[0][:, :-2].sum(axis=1))
        assert any(f"J = {plan.objective.paper:.3g}" in text for text in texts(figure))


def drawn(plan, folder):
    """Every figure of a plan, as PNG."""
    draw_comparison(plan, plan, folder, ("png",))
    return {file.stem for file in draw(plan, folder, ("png",))}


def test_another_trunk_has_colors_of_its_own_and_no_head(tmp_path):
    plan = plan_motion(arm(tmp_path, "position = [0.2, 0.1, 0.9]\nd3 = [0.0, 0.0, 1.0]"))
    assert len(set(colors.group_colors(plan.motion.trunk).values())) == 2
    (row,) = rows_of(plan)
    assert not colored(shapes.layer(plan, row, -1), colors.HEAD)
    assert "muscles-left" in drawn(plan, tmp_path)
    assert len(draw_anatomy(plan.motion.trunk, tmp_path, ("png",))) == 2


def test_the_conventions_say_what_the_model_does(trunk):
    """Signs that the figure states in words; and one panel for each muscle view."""
    tip = np.array([trunk.length])

    def moved(activation, head):
        return (solve_statics(trunk, activation, head).position(tip) - rest)[0]

    relaxed, contracted = np.zeros(28), np.zeros(28)
    contracted[0] = conventions.CONTRACTION
    rest = solve_statics(trunk, relaxed).position(tip)
    assert moved(relaxed, (0.0, conventions.HEAD_ANGLE))[2] < -0.1  # the head turns up
    assert moved(relaxed, (conventions.HEAD_ANGLE, 0.0))[1] > 0.1  # the head turns right
    assert moved(contracted, (0.0, 0.0))[1] > 0.1  # bends right,
    assert moved(contracted, (0.0, 0.0))[2] < -0.1  # and up
    with style.styled():
        figure = conventions.conventions_figure(trunk)
    shown = " ".join(texts(figure))
    for words in ("X, forward", "Z, down", "head turns up", "Muscle R1-dl contracts", "segment 3"):
        assert words in shown


def test_conventions_of_a_trunk_without_head_or_muscles(tmp_path):
    motion = arm(tmp_path, "position = [0.0, 0.0, 1.0]", ROD[: ROD.index("muscles")])
    (file,) = conventions.draw_conventions(motion.trunk, tmp_path, ("png",))
    assert 0.01 <= np.mean(imread(file)[..., :3].min(axis=-1) < 0.95) <= 0.9


def test_names_are_not_taken_for_formulae(tmp_path):
    motion = arm(tmp_path, "position = [0.2, 0.1, 0.9]")
    phases = (replace(motion.phases[0], name="for $5, or $^"),)
    plan = plan_motion(replace(motion, phases=phases))
    assert len(errors.draw_errors(plan, tmp_path, ("png",))) == 1


def test_a_trunk_without_muscles_is_drawn(tmp_path):
    plan = plan_motion(arm(tmp_path, "position = [0.0, 0.0, 1.0]", ROD[: ROD.index("muscles")]))
    assert drawn(plan, tmp_path) == {"shapes", "activations", "errors"}
    assert len(draw_anatomy(plan.motion.trunk, tmp_path, ("png",))) == 1


def test_a_motion_of_directions_only_is_drawn(tmp_path):
    plan = plan_motion(arm(tmp_path, "d1 = [0.95, 0.0, -0.3]\nd2 = [0.0, 1.0, 0.0]"))
    assert "errors" in drawn(plan, tmp_path)


def test_wanted_directions_are_drawn_where_the_point_is(tmp_path):
    target = "d1 = [0.95, 0.0, -0.3]\nd2 = [0.0, 1.0, 0.0]"
    plan = plan_motion(arm(tmp_path, target))
    (row,) = rows_of(plan)
    (mark,) = row.marks
    assert not mark.placed
    np.testing.assert_array_equal(mark.target, plan.verification.trajectory.position[0, -1])
    np.testing.assert_allclose(mark.directions[0], np.divide([0.95, 0, -0.3], np.hypot(0.95, 0.3)))
    with style.styled():
        figure = shapes.shapes_figure(plan, [row])
    assert len(with_gid(figure, "direction")) == 2 * 3
    assert not with_gid(figure, "target")


def phases_of(folder, count, name="p"):
    """A plan of many phases, each of one step to the same place."""
    motion = arm(folder, "position = [0.2, 0.1, 0.9]")
    spec = motion.spec
    many = tuple(spec.phases[0].model_copy(update={"name": f"{name}{n}"}) for n in range(count))
    return plan_motion(build_motion(spec.model_copy(update={"phases": many}), motion.anatomy))


@pytest.mark.parametrize("count", [1, 5, 6, 23])
def test_any_number_of_phases_fits_on_a_page(tmp_path, count):
    plan = phases_of(tmp_path, count)
    rows = shapes.rows_of(plan)
    with style.styled():
        figure = shapes.shapes_figure(plan, rows)
    assert len(rows) == min(count, shapes.MAX_ROWS)
    assert len(with_gid(figure, "target")) == count * 3  # none is left out
    header = shapes.HEADER + style.ROW
    assert figure.get_figheight() / style.MM <= shapes.MAX_HEIGHT + header + 1e-6
    drawn = [axes.get_position() for axes in figure.axes]
    # A trunk of 1 m is to be seen: two centimeters at least.
    assert min(box.height for box in drawn) * figure.get_figheight() / style.MM >= 20
    assert all(shapes.layer(plan, row, 0) for row in rows)


def test_the_smallest_and_the_largest_trunk_are_drawn_alike(tmp_path):
    sizes = []
    for scale in (0.01, 1.0, 100.0):
        text = ROD.replace("length = 1.0", f"length = {scale}")
        text = text.replace("density = 1000.0", "density = 0.0")
        target = f"Z = {scale}\nposition = [0.0, 0.0, {scale}]"
        written(tmp_path, text, "arm.toml")
        motion = load_motion(written(tmp_path, REACH.replace("Z = 1.0", target)))
        plan = plan_motion(motion, throw=False)
        with style.styled():
            figure = shapes.shapes_figure(plan, rows_of(plan))
        sizes.append([*figure.get_size_inches(), *figure.axes[0].get_position().bounds])
        (bar,) = with_gid(figure, "measure")
        assert 0.05 * scale <= float(bar.get_text().split()[0]) <= scale
    np.testing.assert_allclose(sizes[0], sizes[1], rtol=0.01)
    np.testing.assert_allclose(sizes[2], sizes[1], rtol=0.01)


def test_long_names_stay_within_the_picture(tmp_path):
    plan = phases_of(tmp_path, 9, "a phase with a very long name that goes on and on ")
    plan = replace(plan, motion=replace(plan.motion, spec=plan.motion.spec.model_copy(
        update={"title": "long " * 39})))  # fmt: skip
    with style.styled():
        figure = activations.activations_figure(plan)
        FigureCanvasAgg(figure).draw()
    page = figure.bbox
    for artist in (*figure.legends, *figure.texts, figure._suptitle):
        box = artist.get_window_extent()
        assert page.x0 <= box.x0
        assert box.x1 <= page.x1
    (key,) = {line for line in texts(figure) if line.startswith("1 ")} - {"1"}
    assert key.startswith("1 a phase")
    named = " ".join(style.phase_lines(plan.motion))
    assert all(f"{n} a phase" in named for n in range(1, 10))


def test_a_picture_of_very_many_rows_is_written(tmp_path):
    with style.styled():
        (path,) = style.save(style.new_figure(9000.0, 20.0), tmp_path, "tall", ("png",))
    assert imread(path).shape[0] <= style.MAX_PIXELS


def test_a_plan_cut_short_or_empty_is_drawn(tmp_path):
    plan = plan_motion(load_motion(written(tmp_path, POINT)))
    assert "activations" in drawn(empty(plan), tmp_path)
    with style.styled():
        figure = activations.activations_figure(cut(plan, 3))
    (line,) = with_gid(figure, "R1-dl")
    assert line.get_xdata()[-1] == plan.motion.times[2]


def test_a_plan_that_did_not_converge_is_drawn(tmp_path):
    motion = arm(tmp_path, "position = [0.2, 0.1, 0.9]")
    plan = plan_motion(
        replace(motion, extension=(1.4, 1.5)), throw=False
    )  # contraction can do no such thing
    assert plan.status is Status.INFEASIBLE
    assert "shapes" in drawn(plan, tmp_path)


def titles(plan):
    """Titles of every figure of a plan, and of one of it beside a solved plan."""
    solved = planned("lift-log", "sequential")
    for figure, *arguments in (
        (activations.activations_figure, plan),
        (errors.errors_figure, plan),
        (shapes.shapes_figure, plan, rows_of(plan)),
        (muscles.muscles_figure, plan, moments_at(plan, np.array([0.5])), "R"),
        (comparison.comparison_figure, solved, plan),
    ):
        with style.styled():
            yield figure(*arguments).get_suptitle()


def test_every_figure_of_a_plan_that_is_not_solved_says_so():
    solved = planned("lift-log", "horizon")
    assert not any("NOT SOLVED" in title for title in titles(solved))
    failed = replace(solved, converged=False)
    assert failed.status is Status.NOT_CONVERGED
    for title in titles(failed):
        assert "horizon, NOT SOLVED: not converged" in title
        assert "sequential, NOT" not in title
    assert "NOT SOLVED: interrupted" in next(titles(replace(solved, interrupted=True)))


def test_moments_without_an_equilibrium_are_left_out():
    plan = plan_motion(first_steps("lift-log", 2), lookahead=1)
    lost = replace(plan, x=np.full_like(plan.x, np.nan))
    assert moments_at(lost, np.array([0.5])) == []


def with_groups(folder, names):
    """A plan of an arm with these groups of muscles side by side."""
    edges = np.linspace(0.0, 3.1, len(names) + 1)
    groups = "".join(
        f'{{ group = "{name}", architecture = "longitudinal", radii_over_length = [0.02, 0.05], '
        f"sector = [{low}, {high}] }},\n"
        for name, (low, high) in zip(names, pairwise(edges), strict=True)
    )
    text = ROD[: ROD.index("muscles")] + f"muscles = [\n{groups}]\n"
    return plan_motion(arm(folder, "position = [0.0, 0.0, 1.0]", text), throw=False)


def test_headings_of_many_muscle_groups_do_not_overlap(tmp_path):
    plan = with_groups(tmp_path, [f"group{n}" for n in range(14)])
    with style.styled():
        figure = muscles.muscles_figure(plan, moments_at(plan, np.array([1.0])), "R")
        FigureCanvasAgg(figure).draw()
        drawn = [heading.get_window_extent() for heading in with_gid(figure, "heading")]
    assert len(drawn) == 14
    assert all(one.x1 <= two.x0 for one, two in pairwise(drawn))


PROGRAM = """#!/bin/sh
for argument; do file=$argument; done
{content}
"""


def ffmpeg(folder, monkeypatch, content):
    """Put a program of this name on the path."""
    folder.mkdir()
    program = folder / "ffmpeg"
    program.write_text(PROGRAM.format(content=content))
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{folder}:/usr/bin:/bin")


@pytest.fixture
def short_film(monkeypatch):
    monkeypatch.setattr(film, "MAX_FRAMES", 2)
    monkeypatch.setattr(film, "DPI", 20)
    return extreme("no head")


def test_the_film_is_mp4_where_ffmpeg_is(tmp_path, monkeypatch, short_film):
    ffmpeg(tmp_path / "bin", monkeypatch, 'cat > "$file"')
    (path,) = film.write_film(short_film, tmp_path / "out")
    assert path.name == "film.mp4"
    width, height = (int(mm * style.MM * 20) // 2 * 2 for mm in film.SIZE)  # even, for h264
    assert path.stat().st_size == 4 * width * height * 3  # frames as they came
    assert [file.name for file in (tmp_path / "out").iterdir()] == ["film.mp4"]


@pytest.mark.parametrize("content", ["cat > /dev/null; exit 1", "exit 1"])
def test_an_ffmpeg_that_fails_is_a_sentence(tmp_path, monkeypatch, short_film, content):
    ffmpeg(tmp_path / "bin", monkeypatch, content)
    with pytest.raises(TrunkError, match="ffmpeg failed"):
        film.write_film(short_film, tmp_path / "out")
    assert not list((tmp_path / "out").iterdir())


def test_the_film_is_a_gif_where_ffmpeg_is_not(tmp_path, monkeypatch, short_film):
    monkeypatch.setenv("PATH", str(tmp_path))
    (path,) = film.write_film(short_film, tmp_path)
    assert path.name == "film.gif"
    with Image.open(path) as picture:
        assert picture.n_frames == 3


def test_many_groups_are_drawn_on_several_pages(tmp_path):
    plan = with_groups(tmp_path, [f"g{n}" for n in range(9)])
    files = [*activations.draw_activations(plan, tmp_path, ("png",)),
             *muscles.draw_muscles(plan, tmp_path, ("png",))]  # fmt: skip
    names = ["activations", "activations-2", "muscles-right", "muscles-right-2", "muscles-left"]
    assert [file.stem for file in files] == [*names, "muscles-left-2"]
    assert all(OF_PLAN["figures"].fullmatch(file.name) for file in files)

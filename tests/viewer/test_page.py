"""The page of a motion, in a real browser."""

import base64
import json
import re
from dataclasses import replace

import numpy as np
import pytest
from pages import PHONE, picture, settled, until
from plans import POINT, TOUCH, planned, soft_rod, written

from trunk_ocp.errors import InputError
from trunk_ocp.model.solids import in_head_frame, signed_distance
from trunk_ocp.planning.planner import plan_motion
from trunk_ocp.problem.build import build_motion, load_motion
from trunk_ocp.problem.step_solids import head_solids
from trunk_ocp.scene.body import muscle_body
from trunk_ocp.scene.colors import MASS
from trunk_ocp.viewer import write_page
from trunk_ocp.viewer.bundle import embedded
from trunk_ocp.viewer.payload import MAX_SAMPLES, payload, sample_times

pytestmark = pytest.mark.slow

LARGEST = 1_500_000  # bytes of a page

# A trunk of two segments with its own muscle group, on one side, that reaches the center.
OTHER_TRUNK = soft_rod("other", ("[0.0, 0.5]", "[0.5, 1.0]"), radius="0.1")
OTHER_MUSCLE = """
muscles = [
  { group = "core_1", architecture = "longitudinal", radii_over_length = [0.0, 0.08], \
sector = [0.2, 1.5], sides = ["R"] },
]
"""
FAR = "tolerance = { position = 1.0 }\n[bounds]"
EVIL = "</script><script>window.evil = 1</script><img src=x onerror='window.evil = 2'>&amp;{{data}}"


def curve(tab, name, plot=0):
    return tab.locator(f".curve[data-muscle={name}]").nth(plot)


def plan_of(folder, anatomy):
    """A plan of the smallest motion for another trunk."""
    (folder / "other.toml").write_text(anatomy)
    text = TOUCH.replace('name = "touch"', 'name = "touch"\nanatomy = "other.toml"', 1)
    text = text.replace("1.75", "1.0").replace("[0.6, 0.1, 1.2]", "[0.05, 0.02, 0.98]")
    return plan_motion(load_motion(written(folder, text)), lookahead=1, throw=False)


def test_a_page_is_one_file_without_a_link_elsewhere(pages):
    for path in pages.values():
        text = path.read_text(encoding="utf-8")
        assert path.stat().st_size <= LARGEST
        assert not re.search(r"<(script|img|link|iframe)[^>]+(src|href)=", text)
        assert "Permission is hereby granted" in text  # three.js travels with its license
        assert not re.search(r"^(import|export) ", text, re.MULTILINE)


def test_the_animation_advances_and_ends(visit, pages, record_property):
    tab = visit(pages["fruit"])
    first = picture(tab)
    tab.get_by_role("button", name="Play").click()
    until(tab, "trunkPage.clock.time > 0.3")
    before = tab.evaluate("trunkPage.clock.frames")
    tab.wait_for_timeout(1000)
    rate = tab.evaluate("trunkPage.clock.frames") - before
    record_property("frames_per_second", rate)
    print(f"{rate} frames a second, drawn in software")
    tab.get_by_role("button", name="Pause").click()
    assert picture(tab) != first
    tab.evaluate("trunkPage.seek(trunkPage.clock.duration - 0.05); trunkPage.clock.play()")
    until(tab, "!trunkPage.clock.playing")
    assert tab.evaluate("trunkPage.clock.time === trunkPage.clock.duration")


def test_nothing_is_drawn_while_nothing_changes(visit, pages):
    tab = visit(pages["fruit"])
    picture(tab)
    before = tab.evaluate("trunkPage.clock.frames")
    tab.wait_for_timeout(300)
    assert tab.evaluate("trunkPage.clock.frames") == before


def test_scrubbing_changes_what_is_drawn(visit, pages):
    tab = visit(pages["fruit"])
    start = picture(tab)
    assert picture(tab) == start
    tab.get_by_role("slider", name="Time").fill("2.5")
    assert picture(tab) != start
    assert tab.locator("#now").inner_text() == "2.50 of 4.17 s"
    assert tab.locator("#phase").inner_text() == "eat"
    panel = tab.locator("#plots svg").first.bounding_box()
    tab.mouse.click(panel["x"] + panel["width"] / 2, panel["y"] + panel["height"] - 8)
    assert 1 < tab.evaluate("trunkPage.clock.time") < 3.2


def test_groups_and_sides_are_shown_and_hidden(visit, pages):
    tab = visit(pages["both"])
    everything = picture(tab)
    for box, muscle in (("dl", "R1-dl"), ("left (dotted)", "L2-vr")):
        choice = tab.get_by_role("checkbox", name=box, exact=True)
        choice.uncheck()
        assert picture(tab) != everything
        assert not curve(tab, muscle).is_visible()
        choice.check()
        assert picture(tab) == everything
        assert curve(tab, muscle).is_visible()


def test_colors_by_group_or_activation(visit, pages):
    tab = visit(pages["both"])
    by_activation = picture(tab)
    tab.get_by_label("Color of the muscles", exact=True).select_option("group")
    assert picture(tab) != by_activation
    assert not tab.locator("#legend").is_visible()
    colors = tab.evaluate("[...trunkPage.look.colors]")
    assert ["dl", "#0072B2"] in colors
    assert ["vr", "#CC79A7"] in colors


def test_a_clicked_muscle_is_highlighted_in_the_plots(visit, pages):
    tab = visit(pages["both"])
    box = tab.locator("#canvas").bounding_box()
    at = tab.evaluate(
        """() => {
          const { stage } = trunkPage;
          const mesh = stage.scenes[1].muscles.find((one) => one.userData.muscle.name === "R1-dl");
          const points = mesh.geometry.attributes.position.array;
          const middle = 3 * (12 * mesh.userData.tube.corners.count + 5);
          return stage.pointAt(1, points.slice(middle, middle + 3));
        }"""
    )
    tab.mouse.click(box["x"] + at[0], box["y"] + at[1])
    settled(tab)
    assert tab.evaluate("trunkPage.look.selected") == "R1-dl"
    for plot in (0, 1):
        chosen = curve(tab, "R1-dl", plot).evaluate("one => getComputedStyle(one).strokeWidth")
        other = curve(tab, "R1-ovo", plot).evaluate("one => getComputedStyle(one).strokeWidth")
        assert float(chosen[:-2]) > 2 * float(other[:-2])
    assert "Horizon" in tab.locator("#selected").inner_text()
    tab.mouse.click(box["x"] + 3, box["y"] + box["height"] / 2)  # beside it
    assert tab.evaluate("trunkPage.look.selected") is None


def test_a_clicked_curve_highlights_its_muscle(visit, pages):
    tab = visit(pages["both"])
    before = picture(tab)
    name = "R3-dr"
    x, y = curve(tab, name).evaluate(
        """(one) => {
          const point = one.points[Math.round(0.2 * one.points.length)];
          const box = one.ownerSVGElement.getBoundingClientRect();
          return [box.x + point.x, box.y + point.y];
        }"""
    )
    tab.mouse.click(x, y)
    selected = tab.evaluate("trunkPage.look.selected")
    assert selected in (name, "L3-dr")  # they coincide where both are at their bound
    assert picture(tab) != before
    opaque = tab.evaluate(
        """trunkPage.stage.scenes[0].muscles
          .filter((mesh) => !mesh.material.transparent).map((mesh) => mesh.userData.muscle.name)"""
    )
    assert opaque == [selected]
    tab.keyboard.press("Escape")
    assert picture(tab) == before


def test_a_plan_that_is_not_solved_says_so(visit, folder):
    solved = planned("lift-log", "sequential")
    failed = replace(solved, converged=False)
    outcomes = [(plan["solved"], plan["status"]) for plan in payload([solved, failed])["plans"]]
    assert outcomes == [(True, solved.status.value), (False, failed.status.value)]
    tab = visit(write_page([solved, failed], folder / "failed" / "motion.html"))
    assert tab.locator("#labels .unsolved").all_inner_texts() == [
        f"NOT SOLVED: {failed.status.value}"
    ]
    headings = tab.locator("#plots h2").all_inner_texts()
    assert ["NOT SOLVED" in heading for heading in headings] == [False, True]


def test_two_plans_move_side_by_side_in_step(visit, pages):
    tab = visit(pages["both"])
    views = tab.evaluate("trunkPage.stage.views")
    assert len(views) == 2
    assert views[0] != views[1]  # side by side, or one above the other
    assert tab.locator("#labels strong").all_inner_texts() == ["Sequential", "Horizon"]
    tab.evaluate("trunkPage.seek(2)")
    settled(tab)
    tips = tab.evaluate(
        "trunkPage.stage.scenes.map((scene) => [...scene.sections.position.slice(-3)])"
    )
    for tip, mode in zip(tips, ("sequential", "horizon"), strict=True):
        expected = planned("lift-log", mode).sample(2.0).shape.position([1.75])[0]
        assert tip == pytest.approx(expected, abs=2e-3)  # between samples


def tip_and_fruit(tab):
    """Where the page has the tip and the middle of the fruit, in the model's axes."""
    settled(tab)
    return np.array(
        tab.evaluate(
            """() => {
              const scene = trunkPage.stage.scenes[0];
              const fruit = scene.objects[0];
              return [[...scene.sections.position.slice(-3)], fruit.position.toArray()];
            }"""
        )
    )


def test_the_page_shows_both_sides_of_a_jump_and_nothing_in_between(visit, pages):
    tab, plan = visit(pages["fruit"]), planned("pick-fruit", "sequential")
    (jump,) = plan.jumps
    before, after = (
        plan.sample(jump, after=side).shape.position([1.75])[0] for side in (False, True)
    )
    waiting = np.add(before, (0, 0, -fruit_radius(plan)))  # up, where the tip points
    for t in (jump - 0.03, jump - 1e-4, jump):
        tab.evaluate("t => trunkPage.seek(t)", t)
        tip, fruit = tip_and_fruit(tab)
        assert tip == pytest.approx(before, abs=1e-4)  # as at every step of the pull
        assert fruit == pytest.approx(waiting, abs=2e-3)
    assert tab.locator("#phase").inner_text() == "pull"
    tab.keyboard.press("Shift+ArrowRight")
    tip, fruit = tip_and_fruit(tab)
    assert tab.locator("#phase").inner_text() == "eat"
    assert tip == pytest.approx(after, abs=1e-4)
    assert np.linalg.norm(fruit - tip) == pytest.approx(fruit_radius(plan), abs=1e-4)
    tab.keyboard.press("Shift+ArrowLeft")
    assert tab.evaluate("trunkPage.clock.time") == jump
    assert tip_and_fruit(tab)[0] == pytest.approx(before, abs=1e-4)


DROP = """
[[phases]]
name = "hold"
duration = 0.5
loads.tip_mass = 5.0
targets = [{ Z = 1.75, position = [0.6, 0.1, 1.2] }]

[[phases]]
name = "drop"
duration = 0.5
targets = [{ Z = 1.75, position = [0.6, 0.1, 1.2] }]
"""


def test_a_released_mass_is_gone_and_the_later_side_says_so(visit, tmp_path):
    plan = plan_motion(load_motion(written(tmp_path, TOUCH + DROP)), lookahead=1)
    assert plan.jumps == (1.0, 1.5)
    tab = visit(write_page([plan], tmp_path / "drop.html"))
    seen = "trunkPage.stage.scenes[0].objects[0].visible"
    for t, there, later in (
        (0.5, True, False), (1.0, True, False), (1.001, True, True), (1.5, True, False),
        (1.501, False, True), (1.8, False, False), (2.0, False, False), (1.2, True, False),
    ):  # fmt: skip
        tab.evaluate("t => trunkPage.seek(t)", t)
        settled(tab)
        assert tab.evaluate(seen) is there
        assert ("just after" in tab.locator("#now").inner_text()) is later
    tab.get_by_label("objects").uncheck()
    settled(tab)
    assert not tab.evaluate(seen)


def test_no_label_of_a_chart_is_cut_off(visit, tmp_path):
    text = TOUCH.replace("[-3.0, 0.0]", "[-0.019, 0.0]").replace("[bounds]", FAR)
    plan = plan_motion(load_motion(written(tmp_path, text)), lookahead=1, throw=False)
    tab = visit(write_page([plan], tmp_path / "small.html"))
    elements = "[...document.querySelectorAll('#plots svg text')]"
    labels = tab.evaluate(f"{elements}.map((label) => [label.textContent, label.getBBox().x])")
    assert any(len(label) >= 6 for label, _ in labels)  # such as -0.005
    assert all(x >= 0 for _, x in labels)


def fruit_radius(plan):
    return payload([plan])["plans"][0]["objects"][0]["radius"]


def test_the_page_holds_what_a_phase_holds(visit, pages):
    tab, plan = visit(pages["fruit"]), planned("pick-fruit", "sequential")
    changes = np.abs(np.diff(plan.activations[:21], axis=0))
    step, muscle = np.unravel_index(changes.argmax(), changes.shape)
    assert changes[step, muscle] > 3e-3  # the page writes three decimals
    start, end = plan.motion.times[step : step + 2]
    tab.evaluate("name => trunkPage.select(name)", plan.motion.trunk.muscles[muscle])
    for t, at in ((start, step), ((start + end) / 2, step), (end - 1e-5, step), (end, step + 1)):
        tab.evaluate("t => trunkPage.seek(t)", float(t))
        settled(tab)
        shown = tab.locator("#selected").inner_text().split()[-1].replace("\u2212", "-")
        assert float(shown) == pytest.approx(plan.activations[at, muscle], abs=6e-4)


def test_vertices_agree_with_geometry(visit, pages):
    tab = visit(pages["both"])
    plan = planned("lift-log", "horizon")
    for number in (0, 20, -1):
        t = float(sample_times(plan)[number])
        tab.evaluate("t => trunkPage.seek(t)", t)
        settled(tab)
        shape = plan.sample(t).shape
        shape = replace(
            shape, **{k: getattr(shape, k)[None] for k in ("states", "edges", "slopes")}
        )
        for i in (0, 1, 8, 13, 20, 27):
            rings, points = tab.evaluate(
                """(i) => {
                  const mesh = trunkPage.stage.scenes[1].muscles[i];
                  const { first, last } = mesh.userData.tube;
                  return [last - first + 1, [...mesh.geometry.attributes.position.array]];
                }""",
                i,
            )
            muscle = plan.motion.trunk.subdomains[i]
            exact = muscle_body(plan.motion.trunk, muscle, shape, rings).vertices[0]
            found = np.reshape(points, (-1, 3))
            off = np.linalg.norm(found[:, None] - exact, axis=-1).min(axis=1)
            assert off.max() < 1e-4
            assert np.ptp(found, axis=0) == pytest.approx(np.ptp(exact, axis=0), abs=3e-3)


def test_keys(visit, pages):
    tab = visit(pages["both"])
    time = "trunkPage.clock.time"
    tab.keyboard.press("Space")
    assert tab.evaluate("trunkPage.clock.playing")
    tab.keyboard.press("Space")
    assert not tab.evaluate("trunkPage.clock.playing")
    tab.keyboard.press("End")
    assert tab.evaluate(time) == pytest.approx(2.4)
    tab.keyboard.press("ArrowLeft")
    assert tab.evaluate(time) == pytest.approx(2.36)
    tab.keyboard.press("Home")
    assert tab.evaluate(time) == 0
    tab.keyboard.press("Shift+ArrowRight")
    assert tab.evaluate(time) == pytest.approx(1.0)  # the first time step
    before = picture(tab)
    for key in "dw+":
        tab.keyboard.press(key)
    assert picture(tab) != before
    tab.keyboard.press("r")
    assert picture(tab) == before
    tab.keyboard.press("?")
    assert tab.get_by_role("dialog").is_visible()
    tab.keyboard.press("Escape")
    assert not tab.locator("#help").is_visible()


def test_every_control_has_a_name(visit, pages):
    tab = visit(pages["both"])
    nameless = tab.evaluate(
        """[...document.querySelectorAll("button, input, select, canvas, svg")].filter((one) =>
          !one.getAttribute("aria-label") && !one.labels?.length && !one.textContent.trim()
        ).map((one) => one.outerHTML)"""
    )
    assert nameless == []


def test_orbit_and_zoom(visit, pages):
    tab = visit(pages["fruit"])
    before = picture(tab)
    box = tab.locator("#canvas").bounding_box()
    tab.mouse.move(box["x"] + 300, box["y"] + 200)
    tab.mouse.down()
    tab.mouse.move(box["x"] + 420, box["y"] + 160, steps=4)
    tab.mouse.up()
    turned = picture(tab)
    assert turned != before
    assert tab.evaluate("trunkPage.look.selected") is None  # a drag is no click
    tab.mouse.wheel(0, -300)
    assert picture(tab) != turned
    tab.get_by_role("button", name="Reset view").click()
    assert picture(tab) == before


@pytest.mark.parametrize("name", ["both", "fruit"])
def test_a_phone_needs_no_sideways_scrolling(visit, pages, name):
    tab = visit(pages[name], PHONE, has_touch=True, is_mobile=True)
    tab.evaluate("trunkPage.seek(2)")
    settled(tab)
    assert tab.evaluate("document.documentElement.scrollWidth") <= PHONE["width"]
    for control in ("#canvas", "#play", "#time", "#help-button"):
        box = tab.locator(control).bounding_box()
        assert box["x"] >= 0
        assert box["x"] + box["width"] <= PHONE["width"]
        assert box["y"] + box["height"] <= PHONE["height"]
    assert min(view["width"] for view in tab.evaluate("trunkPage.stage.views")) >= 180


def test_a_title_cannot_inject_anything(visit, tmp_path):
    motion = load_motion(written(tmp_path, TOUCH))
    spec = motion.spec.model_copy(update={"title": EVIL})
    plan = plan_motion(build_motion(spec, motion.anatomy), lookahead=1)
    tab = visit(write_page([plan], tmp_path / "evil.html"))
    assert tab.evaluate("window.evil === undefined")
    assert tab.title() == EVIL
    assert tab.locator("h1").inner_text() == EVIL


@pytest.mark.parametrize("muscle", ["", OTHER_MUSCLE], ids=["no muscles", "one muscle"])
def test_other_trunks(visit, tmp_path, muscle):
    plan = plan_of(tmp_path, OTHER_TRUNK + muscle)
    tab = visit(write_page([plan], tmp_path / "other.html"))
    start = picture(tab)
    tab.keyboard.press("End")
    assert picture(tab) != start
    assert tab.locator(".curve").count() == bool(muscle)
    assert tab.locator("#legend").is_visible() == bool(muscle)
    assert tab.locator("#plots").inner_text().count("no muscles") == (not muscle)


def test_a_motion_without_log_or_fruit(visit, tmp_path):
    plan = plan_motion(load_motion(written(tmp_path, POINT)), lookahead=1)
    tab = visit(write_page([plan], tmp_path / "point.html"))
    assert tab.evaluate("trunkPage.plans[0].objects") == []
    assert tab.get_by_label("objects").count() == 0
    assert tab.evaluate("trunkPage.plans[0].targets.length") == 3


def test_log_and_fruit_are_where_the_motion_has_them():
    (log,) = payload([planned("lift-log", "sequential")])["plans"][0]["objects"]
    assert (log["kind"], log["length"]) == ("log", 0.875)
    plan = planned("pick-fruit", "sequential")
    (fruit,) = payload([plan])["plans"][0]["objects"]
    assert fruit["mass"] == 8.0
    assert fruit["color"] == MASS  # as in the figures
    assert all(fruit["shown"])
    tip = plan.sample(sample_times(plan)[-1]).shape
    reach = np.array([1.75])
    expected = tip.position(reach) + fruit["radius"] * tip.directors(reach)[:, 2]
    assert decoded(fruit["center"])[-1] == pytest.approx(expected[0], abs=1e-5)
    assert decoded(fruit["center"])[0] == pytest.approx(
        [0.7, 0.3, -0.2 - fruit["radius"]], abs=2e-3
    )


POST = """
[[obstacles]]
name = "post"
shape = "capsule"
from = [0.9, 0.5, 1.7]
to = [0.9, 0.5, -0.5]
radius = 0.06
phases = ["leave"]
[[phases]]
name = "leave"
duration = 1.0
[[phases.targets]]
Z = 1.75
position = [0.6, 0.1, 1.2]
"""


def visible(tab, t):
    tab.evaluate("t => trunkPage.seek(t)", t)
    settled(tab)
    return tab.evaluate(
        """trunkPage.stage.scenes[0].solids
          .filter((mesh) => mesh.visible).map((mesh) => mesh.userData.group)"""
    )


def test_head_and_obstacles_are_shown_in_their_phases_and_hidden(visit, tmp_path):
    plan = plan_motion(load_motion(written(tmp_path, TOUCH + POST)), lookahead=1)
    parts = ["head"] * len(plan.motion.trunk.head.body)
    tab = visit(write_page([plan], tmp_path / "post.html"))
    assert visible(tab, 0.5) == parts
    assert visible(tab, 1.5) == [*parts, "obstacles"]
    tab.get_by_role("checkbox", name="head", exact=True).uncheck()
    assert visible(tab, 1.5) == ["obstacles"]
    tab.get_by_role("checkbox", name="obstacles", exact=True).uncheck()
    assert visible(tab, 1.5) == []


def test_the_head_turns_about_its_pivot(visit, pages):
    tab, plan = visit(pages["both"]), planned("lift-log", "sequential")
    tab.evaluate("trunkPage.seek(trunkPage.clock.duration)")
    until(tab, "Math.abs(trunkPage.stage.scenes[0].head.rotation.z) > 0.1")
    points = np.array(
        tab.evaluate(
            """() => {
              const { head, solids } = trunkPage.stage.scenes[0];
              head.updateMatrix();
              const points = solids[0].geometry.attributes.position.clone();
              return [...points.applyMatrix4(head.matrix).array];
            }"""
        )
    ).reshape(-1, 3)
    trunk = plan.motion.trunk
    skull = head_solids(trunk)[0]
    distance, _ = signed_distance(skull, in_head_frame(trunk, points, plan.x[-1, -2:]))
    np.testing.assert_allclose(distance, 0, rtol=0, atol=1e-6)


def test_directions_that_are_asked_for_are_shown_at_the_point(tmp_path):
    text = TOUCH.replace("position = [0.6, 0.1, 1.2]", "d3 = [1.0, 0.0, 1.0]")
    plan = plan_motion(load_motion(written(tmp_path, text)), lookahead=1)
    (shown,) = payload([plan])["plans"]
    (arrow,) = shown["arrows"]
    assert arrow["direction"] == pytest.approx([2**-0.5, 0, 2**-0.5])
    tip = plan.shape.position(np.array([1.75]))[0, 0]
    assert arrow["position"] == pytest.approx(tip, abs=1e-4)  # the check's tolerance
    assert (arrow["from"], arrow["to"]) == (0.0, 1.0)
    assert shown["targets"] == []


def test_log_hangs_where_its_couple_says():
    plan = planned("lift-log-asymmetric", "sequential")
    (log,) = payload([plan])["plans"][0]["objects"]
    load = plan.loads[-1]
    arm = decoded(log["center"])[-1] - grip(plan)
    turn = np.cross(arm, load.contact_force)
    assert turn == pytest.approx(load.contact_couple, abs=1e-3)


def grip(plan):
    """Center of the arc of the last step, from the motion's own numbers: p(t = 1) of its path."""
    rest = plan.sample(0.0).shape.position([1.75])[0]
    return rest + plan.motion.spec.phases[-1].wrap.path[-1]


def decoded(text):
    return np.frombuffer(base64.b64decode(text), "<f4").reshape(-1, 3)


def test_a_plan_cut_short_is_shown_as_far_as_it_goes(visit, tmp_path):
    whole = planned("lift-log", "sequential")
    short = replace(whole, x=whole.x[:3], tip_forces=whole.tip_forces[:3], shape=whole.part(0, 3))
    tab = visit(write_page([short, whole], tmp_path / "short.html"))
    tab.keyboard.press("End")
    settled(tab)
    assert tab.evaluate("trunkPage.plans.map((plan) => plan.duration)") == pytest.approx(
        [whole.motion.times[2], 2.4]
    )


def test_samples_are_few_and_include_the_steps():
    plan = planned("pick-fruit", "sequential")
    times = sample_times(plan)
    assert len(times) <= MAX_SAMPLES
    assert np.isin(plan.motion.times, times).all()


def test_embedded_json_keeps_its_value_and_ends_no_script():
    data = {"title": EVIL, "sep": "\u2028"}
    text = embedded(data)
    assert json.loads(text) == data
    assert not set("<>&") & set(text)


def test_wrong_plans_are_refused(tmp_path):
    plan = planned("lift-log", "sequential")
    empty = replace(plan, x=plan.x[:0], tip_forces=plan.tip_forces[:0], shape=plan.part(0, 0))
    for plans in ([], [plan] * 3, [empty]):
        with pytest.raises(InputError, match="plans"):
            write_page(plans, tmp_path / "never.html")
    assert not list(tmp_path.iterdir())

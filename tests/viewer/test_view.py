"""What the page shows of a motion and from where, without WebGL, and what it says to others."""

import json

import numpy as np
import pytest
from pages import ARGS, LAPTOP, PHONE, picture, settled, until
from plans import REACH, planned, written
from programs import CHROMIUM

from trunk_ocp.planning.planner import plan_motion
from trunk_ocp.problem.build import load_motion
from trunk_ocp.scene.surroundings import marks
from trunk_ocp.viewer import page, write_page
from trunk_ocp.viewer.payload import payload

pytestmark = pytest.mark.slow

SMALL = """
name = "small-arm"
length = 0.2
base_radius_over_length = 0.06
taper_deg = 2.9
material = { youngs_modulus = 2e5, poisson_ratio = 0.5, density = 1050.0 }

[[segments]]
Z_over_length = [0.0, 1.0]
muscles = [
  { group = "out", architecture = "longitudinal", radii_over_length = [0.03, 0.06], sector = [0.0, 3.1] },
  { group = "in", architecture = "longitudinal", radii_over_length = [0.01, 0.03], sector = [0.0, 3.1] },
]
"""  # noqa: E501  # TOML inline tables stand on one line


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """The page of an arm of 0.2 m that reaches for a point."""
    folder = tmp_path_factory.mktemp("small")
    written(folder, SMALL, "arm.toml")
    asked = "position = [0.03, 0.0, 0.19]\nd3 = [0.2, 0.0, 1.0]"
    motion = load_motion(written(folder, REACH.replace("Z = 1.0", "Z = 0.2") + asked))
    return write_page(plan_motion(motion, lookahead=1, throw=False), folder / "small.html")


# Where on the canvas, in px, the trunk's surface and the targets are at a time, for each plan.
SEEN = """(t) => {
  trunkPage.seek(t);
  const { stage } = trunkPage;
  stage.show(t);
  return stage.scenes.map((scene, i) => {
    const skin = scene.skin.geometry.attributes.position.array;
    const places = [];
    for (let k = 0; k < skin.length; k += 300) places.push([...skin.subarray(k, k + 3)]);
    places.push(...scene.plan.targets.map(({ position }) => position));
    return places.map((place) => stage.pointAt(i, place));
  });
}"""


@pytest.mark.parametrize("size", [LAPTOP, PHONE], ids=["laptop", "phone"])
@pytest.mark.parametrize("name", ["both", "fruit", "small"])
def test_all_that_the_trunk_sweeps_is_in_view_and_fills_it(visit, pages, small, name, size):
    tab = visit({**pages, "small": small}[name], size)
    tab.get_by_role("checkbox", name="skin").check()
    views = tab.evaluate("trunkPage.stage.views")
    end = tab.evaluate("trunkPage.clock.duration")
    seen = [tab.evaluate(SEEN, t) for t in np.linspace(0, end, 6).tolist()]
    for i, view in enumerate(views):
        x, y = np.concatenate([each[i] for each in seen]).T
        x, y = (x - view["x"]) / view["width"], (y - view["y"]) / view["height"]
        assert x.min() >= 0
        assert x.max() <= 1
        assert y.min() >= 0
        assert y.max() <= 1
        if name == "small":  # nothing else is shown: head, log and fruit take room as well
            assert max(np.ptp(x), np.ptp(y)) > 0.75


def test_the_view_stays_when_the_window_changes_only_if_it_was_turned(visit, pages):
    tab = visit(pages["fruit"])
    place = "trunkPage.stage.camera.position.toArray()"
    first = tab.evaluate(place)
    tab.set_viewport_size(PHONE)
    until(tab, "trunkPage.stage.views[0].width < 500")
    fitted = tab.evaluate(place)
    assert fitted != first
    tab.keyboard.press("d")
    turned = tab.evaluate(place)
    tab.set_viewport_size(LAPTOP)
    until(tab, "trunkPage.stage.views[0].width > 500")
    assert tab.evaluate(place) == turned


def test_the_motion_plays_once_from_its_start(visit, pages):
    tab = visit(pages["fruit"], reduced_motion="no-preference")
    assert tab.evaluate("trunkPage.clock.playing")
    assert tab.evaluate("trunkPage.clock.time") < 2
    tab.evaluate("trunkPage.clock.speed = 50")
    until(tab, "!trunkPage.clock.playing")
    assert tab.evaluate("trunkPage.clock.time === trunkPage.clock.duration")


# Places of the symbols that are visible, of one kind.
SHOWN = """(kind) => {
  const mesh = trunkPage.stage.scenes[0].symbols[kind];
  const places = [];
  for (let i = 0; i < mesh.count; i++) {
    const matrix = mesh.instanceMatrix.array.subarray(16 * i, 16 * i + 16);
    if (Math.hypot(matrix[4], matrix[5], matrix[6]) > 0) places.push([...matrix]);
  }
  return places;
}"""


def test_targets_are_what_is_asked_at_the_instant_with_directions(visit, pages):
    tab, plan = visit(pages["both"]), planned("lift-log", "sequential")
    for number in (0, 3, len(plan.x) - 1):
        tab.evaluate("t => trunkPage.seek(t)", float(plan.motion.times[number]) - 1e-3)
        settled(tab)
        dots, arrows = (np.array(tab.evaluate(SHOWN, kind)) for kind in ("dots", "arrows"))
        asked = marks(plan, number)
        expected = np.array([mark.target for mark in asked if mark.placed])
        np.testing.assert_allclose(dots[:, 12:15], expected, atol=1e-6)
        directions = [direction for mark in asked for direction in mark.directions]
        along = arrows[:, 4:7] / np.linalg.norm(arrows[:, 4:7], axis=1)[:, None]
        assert np.einsum("ni,ni->n", along, directions) == pytest.approx(1)
    assert tab.locator("#symbols").inner_text().split("\n")[-1].endswith("asked d3 (tangent)")


def test_symbols_do_not_hide_the_tip_of_a_small_arm(visit, small):
    tab = visit(small)
    tab.keyboard.press("End")
    settled(tab)
    (dot,) = tab.evaluate(SHOWN, "dots")
    tip_radius = 0.2 * (0.06 - np.tan(np.radians(2.9)))
    assert dot[0] < tip_radius
    assert dot[0] > 0.005 * 0.2  # and it can be seen


def test_outer_muscles_become_translucent_on_request(visit, small):
    tab = visit(small)
    clear = """trunkPage.stage.scenes[0].muscles.filter((mesh) => mesh.material.transparent)
      .map((mesh) => mesh.userData.muscle.group)"""
    before = picture(tab)
    assert tab.evaluate(clear) == []
    box = tab.get_by_role("checkbox", name="outer muscles translucent")
    box.check()
    assert picture(tab) != before
    assert tab.evaluate(clear) == ["out", "out"]
    box.uncheck()
    assert picture(tab) == before


def test_axes_turn_with_the_view(visit, pages):
    tab = visit(pages["fruit"])
    ends = """[...document.querySelectorAll("#axes line")].map((line) =>
      [line.x2.baseVal.value, line.y2.baseVal.value])"""
    x, _, z = tab.evaluate(ends)
    assert z[1] > 30  # down on the screen
    assert abs(z[0]) < 1
    assert x[0] > 10  # the trunk faces right
    for _ in range(16):
        tab.keyboard.press("d")
    settled(tab)
    turned = tab.evaluate(ends)
    assert turned[2] == pytest.approx(z, abs=0.1)
    assert turned[0] != pytest.approx(x, abs=5)
    labels = tab.locator("#axes text").all_text_contents()
    assert labels == ["X forward", "Y right", "Z down"]


@pytest.fixture
def browser_without_webgl(browser):
    arguments = [*ARGS, "--disable-3d-apis"]
    chromium = browser.browser_type.launch(executable_path=CHROMIUM, args=arguments)
    yield chromium
    chromium.close()


def test_without_webgl_it_says_so_and_shows_the_plots(browser_without_webgl, visit, pages):
    tab = visit(pages["fruit"], browser=browser_without_webgl)
    assert "no WebGL" in tab.locator("#no-webgl").inner_text()
    assert not tab.locator("#canvas").is_visible()
    assert not tab.get_by_role("button", name="Try it").is_visible()
    assert tab.locator(".curve").count() == 28
    tab.keyboard.press("Shift+ArrowRight")
    until(tab, 'document.querySelector("#now").textContent === "1.50 of 4.17 s"')


def test_another_plan_takes_the_place_of_the_first(visit, pages):
    tab, plan = visit(pages["fruit"]), planned("lift-log", "sequential")
    tab.evaluate("trunkPage.seek(1.5)")
    for key in "dw":
        tab.keyboard.press(key)
    camera = tab.evaluate("trunkPage.stage.camera.position.toArray()")
    new = payload([plan])
    new["plans"][0]["trunk"] = None  # that of before
    tab.evaluate("data => trunkPage.showPlan(data)", json.loads(json.dumps(new)))
    settled(tab)
    assert tab.evaluate("trunkPage.stage.camera.position.toArray()") == camera
    assert tab.evaluate("trunkPage.clock.time") == 1.5
    tip = tab.evaluate("[...trunkPage.stage.scenes[0].sections.position.slice(-3)]")
    expected = plan.sample(1.5).shape.position([1.75])[0]
    assert tip == pytest.approx(expected, abs=2e-3)  # between samples
    assert tab.title() == new["title"]
    assert tab.locator("#phase").inner_text() == "lift"
    assert tab.evaluate("trunkPage.stage.scenes[0].objects.length") == 1


def test_a_page_in_a_frame_talks_to_the_window_around_it(visit, tmp_path):
    inner = page(planned("pick-fruit", "sequential")).replace("&", "&amp;").replace('"', "&quot;")
    outer = tmp_path / "outer.html"
    outer.write_text(f"""<body data-ready="yes"><iframe srcdoc="{inner}"></iframe><script>
      window.heard = [];
      addEventListener("message", ({{ data }}) => heard.push(data));
      window.say = (data) => document.querySelector("iframe").contentWindow.postMessage(data, "*");
    </script></body>""")
    tab = visit(outer)
    until(tab, 'heard.some(({ trunkPage }) => trunkPage === "ready")')
    tab.evaluate("say({ trunkPage: 'time', detail: { time: 2.5 } })")
    until(tab, 'heard.some(({ trunkPage, detail }) => trunkPage === "time" && detail.time === 2.5)')
    tab.evaluate("say({ trunkPage: 'constructor', detail: {} }); say('nonsense'); say(null)")
    tab.evaluate("say({ trunkPage: 'time', detail: { time: 1 } })")
    until(tab, 'heard.some(({ trunkPage, detail }) => trunkPage === "time" && detail.time === 1)')
    assert tab.evaluate("heard.every(({ trunkPage }) => typeof trunkPage === 'string')")

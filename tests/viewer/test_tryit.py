"""Trying muscles, head and loads on the page: exact shapes, refusals, pulls within limits."""

import numpy as np
import pytest
from pages import LAPTOP, PHONE, picture, settled, until
from plans import planned, soft_rod, written

from trunk_ocp.errors import InputError, StaticsError
from trunk_ocp.model.activation import strains
from trunk_ocp.model.anatomy import load_anatomy
from trunk_ocp.model.loads import Loads
from trunk_ocp.rod.collocation import mesh_for
from trunk_ocp.rod.shape import Shape
from trunk_ocp.rod.statics import solve_statics
from trunk_ocp.scene.body import muscle_body
from trunk_ocp.viewer import write_page

pytestmark = pytest.mark.slow

SETTINGS = 100  # random ones, of each of two trunks
MOVED = 4  # sliders from one to the next
UPRIGHT = (
    soft_rod("post", radius="0.0715")
    + """
muscles = [
  { group = "a", architecture = "longitudinal", radii_over_length = [0, 0.07], sector = [0, 3.1] },
]
[head]
xi_d_deg = 180.0
"""
)
LOADS = ("gravity", "tip_force", "contact_from", "contact_force", "contact_couple")


@pytest.fixture(scope="module")
def elephant(folder, trunk):
    """The page of the elephant's trunk without a plan."""
    return write_page(trunk, folder / "elephant.html")


def trying(tab):
    """Start to try, if the page has not."""
    if tab.evaluate("trunkPage.trial === null"):
        tab.get_by_role("button", name="Try it").click()
    until(tab, "trunkPage.trial")
    settled(tab)


def separate(tab):
    """A slider for each muscle, not for both sides."""
    if tab.locator("#try-link-label").is_visible():
        tab.get_by_role("checkbox", name="both sides alike").uncheck()


# Moves sliders, by their numbers, to fractions of their ranges; returns what is tried and drawn.
MOVE = """(moves) => {
  const sliders = [...document.querySelectorAll("#try-panel input[type=range]:not(:disabled)")];
  for (const [i, share] of moves) {
    const slider = sliders[i % sliders.length];
    slider.value = Number(slider.min) + share * (slider.max - slider.min);
    slider.dispatchEvent(new Event("input"));
  }
  trunkPage.stage.show(trunkPage.clock.time);
  return trunkPage.tried();
}"""


def tried(tab):
    return tab.evaluate("trunkPage.tried()")


def loads_of(state):
    return Loads(**{name: state["loads"][name] for name in LOADS})


def agrees(trunk, states, Z):
    """Shapes that the page draws are those of `solve_statics`, solved again on a finer mesh."""
    controls = [np.array([state[name] for state in states]) for name in ("activation", "head")]
    loads = [loads_of(state) for state in states]
    fine = mesh_for(trunk, loads[0].contact_from, elements=40, degree=8)
    # One by one: of several equilibria, a batch may find others on its common mesh.
    each = [
        solve_statics(trunk, activation, head, load)
        for activation, head, load in zip(*controls, loads, strict=True)
    ]
    shapes = solve_statics(trunk, *controls, loads, near=Shape.stack(each, fine))
    drawn = np.array([state["position"] for state in states]).reshape(len(states), -1, 3)
    off = np.abs(drawn - shapes.position(Z)).max(axis=(1, 2))
    assert off.max() <= 1e-9, np.flatnonzero(off > 1e-9)


def refused(trunk, state):
    try:
        solve_statics(trunk, state["activation"], state["head"], loads_of(state))
    except (StaticsError, InputError):
        return True
    return False


SMALL_WINDOW = {"width": 500, "height": 400}  # because every setting is drawn, in software


@pytest.mark.parametrize("name", ["asymmetric", "elephant"])
def test_random_settings_are_drawn_as_solve_statics_has_them(visit, elephant, trunk, folder, name):
    if name == "elephant":
        tab = visit(elephant, SMALL_WINDOW)
    else:
        plan = planned("lift-log-asymmetric", "sequential")
        path = write_page([plan], folder / "asymmetric.html")
        tab = visit(path, SMALL_WINDOW)
        tab.evaluate("trunkPage.seek(2.1)")
    trying(tab)
    separate(tab)
    Z = np.array(tab.evaluate("trunkPage.trial.plan.trunk.tables.Z"))
    random = np.random.default_rng(17)
    states = []
    for _ in range(SETTINGS):
        sliders, shares = (
            random.integers(0, 1000, MOVED),
            random.random(MOVED) ** 3,
        )  # 0: contracted
        states.append(tab.evaluate(MOVE, np.stack([sliders, shares], axis=1).tolist()))
    found = [state for state in states if not state["stale"]]
    refusals = [state for state in states if state["stale"]]
    print(name, len(found), "found", len(refusals), "refused")
    assert len(found) > 10
    if name == "asymmetric":  # where sliders reach far enough
        assert refusals
    agrees(trunk, found, Z)
    assert all(refused(trunk, state) for state in refusals)


def slide(tab, name, value):
    """Set the slider of a name; returns what is tried then."""
    slider = tab.get_by_label(name, exact=True)
    slider.evaluate(
        "(one, value) => { one.value = value; one.dispatchEvent(new Event('input')); }", value
    )
    settled(tab)
    return tried(tab)


def message(tab):
    tab.wait_for_timeout(200)  # the panel is written several times a second
    return tab.locator("#try-message").inner_text()


def test_it_starts_from_the_instant_returns_to_it_and_plays_on(visit, pages):
    tab, plan = visit(pages["fruit"]), planned("pick-fruit", "sequential")
    t = float(plan.motion.times[10])
    tab.evaluate("t => trunkPage.seek(t)", t)
    before = picture(tab)
    trying(tab)
    first, sample = tried(tab), plan.sample(t)
    assert first["activation"] == pytest.approx(sample.activation, abs=1e-6)
    assert first["head"] == pytest.approx(sample.head, abs=1e-6)
    assert loads_of(first).tip_force == pytest.approx(sample.loads.tip_force, abs=1e-3)
    Z = np.array(tab.evaluate("trunkPage.trial.plan.trunk.tables.Z"))
    drawn = np.reshape(first["position"], (-1, 3))
    np.testing.assert_allclose(drawn, sample.shape.position(Z), atol=1e-5)
    assert "equilibrium" in message(tab)
    assert "solved" not in tab.locator("#labels").inner_text()  # said of the plan only
    moved = slide(tab, "activation of R1-dl", -1.5)
    assert moved["activation"][0] == -1.5
    assert np.abs(np.subtract(moved["position"], first["position"])).max() > 0.05
    tab.get_by_role("button", name="Reset", exact=True).click()
    settled(tab)
    assert tried(tab) == first
    tab.get_by_role("button", name="Play").click()
    until(tab, "trunkPage.clock.playing && trunkPage.trial === null")
    tab.evaluate("t => trunkPage.seek(t)", t)
    tab.set_viewport_size(
        {**LAPTOP, "height": LAPTOP["height"] + 1}
    )  # so that all is laid out again
    tab.set_viewport_size(LAPTOP)
    assert not tab.locator("#try-panel").is_visible()
    assert "solved and verified" in tab.locator("#labels").inner_text()
    assert picture(tab) == before


def test_one_slider_moves_both_sides_if_they_are_linked(visit, elephant):
    tab = visit(elephant)
    trying(tab)
    names = tab.evaluate("trunkPage.plans[0].trunk.muscles.map(({ name }) => name)")
    state = slide(tab, "activation of R2-dl and L2-dl", -0.4)
    assert {n for n, a in zip(names, state["activation"], strict=True) if a} == {"R2-dl", "L2-dl"}
    assert state["position"][-2] == pytest.approx(0, abs=1e-9)  # stays in its plane
    separate(tab)
    assert slide(tab, "activation of L2-dl", 0)["position"][-2] > 0.05  # to the right


def test_the_surface_is_that_of_the_tried_shape(visit, elephant, trunk):
    tab = visit(elephant)
    trying(tab)
    slide(tab, "activation of R1-dl and L1-dl", -0.5)
    state = slide(tab, "mass at the tip in kg", 8)
    assert state["loads"]["tip_force"][2] == pytest.approx(8 * 9.8)
    shape = solve_statics(trunk, state["activation"], state["head"], loads_of(state))
    for i in (0, 9, 20):
        rings, points = tab.evaluate(
            """(i) => {
              const mesh = trunkPage.stage.scenes[0].muscles[i];
              const { first, last } = mesh.userData.tube;
              return [last - first + 1, [...mesh.geometry.attributes.position.array]];
            }""",
            i,
        )
        exact = muscle_body(trunk, trunk.subdomains[i], Shape.stack([shape]), rings).vertices[0]
        off = np.linalg.norm(np.reshape(points, (-1, 3))[:, None] - exact, axis=-1).min(axis=1)
        assert off.max() < 1e-5


def test_without_an_equilibrium_the_last_shape_stays_and_is_gray(visit, folder):
    path = write_page([planned("lift-log", "horizon")], folder / "lift.html")
    tab = visit(path, SMALL_WINDOW)
    trying(tab)
    fill = "trunkPage.stage.scenes[0].muscles.map((mesh) => mesh.material.color.getHexString())"
    good = tried(tab)
    assert not good["stale"]
    groups = tab.locator("#try-muscles input").evaluate_all(
        "all => all.map((one) => one.getAttribute('aria-label'))"
    )
    for name in groups:
        last, state = good, slide(tab, name, -3.5)
        if state["stale"]:
            break
        good = state
    assert state["stale"]
    assert state["position"] == last["position"]
    assert set(tab.evaluate(fill)) == {"b9b4ae"}
    assert "Gray is the last shape" in message(tab)
    tab.get_by_role("button", name="Reset", exact=True).click()
    settled(tab)
    assert not tried(tab)["stale"]
    assert "b9b4ae" not in tab.evaluate(fill)


def test_it_warns_near_buckling_and_of_unstable_shapes(visit, tmp_path):
    """A post a little shorter than Greenhill's, 7.8373 E I / (rho g A) to the third root."""
    anatomy = load_anatomy(written(tmp_path, UPRIGHT, "post.toml"))
    tab = visit(write_page(anatomy, tmp_path / "post.html"))
    trying(tab)
    assert "Near buckling" in message(tab)
    assert not slide(tab, "mass at the tip in kg", 1.5)["stale"]
    assert "Unstable" in message(tab)


def pull(tab, Z, by, steps=12):
    """Drag a point of the trunk by (dx, dy) px; keeps the button pressed."""
    canvas = tab.locator("#canvas").bounding_box()
    x, y = tab.evaluate(
        """(Z) => {
          const { sections, plan } = trunkPage.trial;
          const j = plan.trunk.tables.Z.findIndex((z) => z >= Z - 1e-9);
          return trunkPage.stage.pointAt(0, sections.position.slice(3 * j, 3 * j + 3));
        }""",
        Z,
    )
    tab.mouse.move(canvas["x"] + x, canvas["y"] + y)
    tab.mouse.down()
    tab.mouse.move(canvas["x"] + x + by[0], canvas["y"] + y + by[1], steps=steps)
    until(tab, "trunkPage.trial.pull?.settled")
    settled(tab)


def type_tip(tab, x):
    field = tab.get_by_label("X of the tip, forward, in m")
    field.fill(x)
    field.press("Enter")
    until(
        tab,
        f"trunkPage.trial.pull?.settled && Math.abs(trunkPage.trial.pull.target[0] - {x}) < 1e-9",
    )
    settled(tab)


def test_the_trunk_follows_a_pull_within_bounds_and_limits(visit, elephant, trunk):
    tab = visit(elephant)
    trying(tab)
    pull(tab, 1.6, (60, -60))
    state, pulled = tried(tab), tab.evaluate("trunkPage.trial.pull")
    assert pulled["reached"]
    shape = solve_statics(trunk, state["activation"], state["head"], loads_of(state))
    at = shape.position([pulled["Z"]])[0]
    assert np.linalg.norm(at - pulled["target"]) < 2e-4 * trunk.length
    tab.mouse.up()
    view = tab.evaluate("trunkPage.stage.camera.position.toArray()")
    assert tab.evaluate("trunkPage.stage.fitted.toArray()") == view  # the camera did not turn
    type_tip(tab, "5")  # out of reach
    assert "cannot follow" in message(tab)
    state = tried(tab)
    activation, head = np.array(state["activation"]), np.array(state["head"])
    assert activation.min() >= -1
    assert activation.max() <= 0
    assert np.abs(head).max() <= np.pi / 2
    extension = strains(trunk, activation)[:, 0]
    assert extension == pytest.approx(state["extensions"], abs=1e-12)
    assert extension.min() >= 0.67 - 1e-9
    assert extension.max() <= 1.35 + 1e-9


def test_the_tip_goes_to_a_typed_position(visit, elephant):
    tab = visit(elephant)
    trying(tab)
    type_tip(tab, "0.8")
    assert tried(tab)["position"][-3] == pytest.approx(0.8, abs=2e-4)
    field = tab.get_by_label("X of the tip, forward, in m")
    field.fill("")
    field.press("Enter")
    assert field.input_value() == "0.800"


def test_a_pull_toward_a_point_far_away_goes_as_far_as_one_toward_a_near_point(visit, elephant):
    tab = visit(elephant)
    trying(tab)
    reached = []
    for x in ("5", "1e6"):
        tab.get_by_role("button", name="Reset", exact=True).click()
        type_tip(tab, x)
        reached.append(tried(tab)["position"][-3])
    assert reached[1] > reached[0] - 0.05


def test_extension_beyond_the_limits_is_said(visit, elephant):
    tab = visit(elephant)
    trying(tab)
    slide(tab, "activation of R1-dl and L1-dl", -1)
    state = slide(tab, "activation of R1-ovo and L1-ovo", -1)
    if state["extensions"][0] > 0.67:
        state = slide(tab, "activation of R1-ivo and L1-ivo", -1)
    assert state["extensions"][0] < 0.67
    assert "Segment 1 has" in message(tab)


def test_of_two_plans_one_is_tried_beside_the_other(visit, pages):
    tab = visit(pages["both"])
    tab.evaluate("trunkPage.seek(1.5)")
    trying(tab)
    separate(tab)
    tips = "trunkPage.stage.scenes.map(({ sections }) => [...sections.position.slice(-3)])"
    first = tab.evaluate(tips)
    slide(tab, "activation of R1-dl", -3)
    second = tab.evaluate(tips)
    assert second[0] == first[0]
    assert second[1] != pytest.approx(first[1], abs=0.02)
    tab.get_by_label("plan to try").select_option("Sequential")
    until(tab, "trunkPage.stage.scenes[0].tried && !trunkPage.stage.scenes[1].tried")
    settled(tab)
    assert tab.evaluate(tips)[1] == pytest.approx(first[1], abs=2e-3)  # between samples


def test_controls_go_out_and_come_in(visit, elephant):
    tab = visit(elephant)
    trying(tab)
    tab.evaluate(
        "() => { window.told = []; trunkPage.bridge.on('controls', (now) => told.push(now)); }"
    )
    slide(tab, "activation of R1-dl and L1-dl", -0.3)
    told = tab.evaluate("told.at(-1)")
    assert told["activation"] == tried(tab)["activation"]
    tab.evaluate("head => trunkPage.setControls({ head })", [0.1, -0.2])
    settled(tab)
    assert tried(tab)["head"] == [0.1, -0.2]
    assert tab.evaluate("told.at(-1).head") == [0.1, -0.2]


def test_on_a_phone_the_trunk_stays_in_view_above_the_sliders(visit, pages):
    tab = visit(pages["fruit"], PHONE, has_touch=True, is_mobile=True)
    trying(tab)
    assert tab.evaluate("document.documentElement.scrollWidth") <= PHONE["width"]
    tab.locator("#try-tip").scroll_into_view_if_needed()
    settled(tab)
    box = tab.locator("#canvas").bounding_box()
    assert box["y"] >= -1
    assert box["y"] + box["height"] < PHONE["height"]

"""The live page in a real browser: what is dragged there is planned, and the plan is drawn."""

import threading

import numpy as np
import pytest
from pages import LAPTOP, settled, until
from plans import POINT, written

from trunk_ocp.planning.planner import plan_motion
from trunk_ocp.problem.build import load_motion
from trunk_ocp.viewer.live_messages import Inbox
from trunk_ocp.viewer.live_server import LiveServer
from trunk_ocp.viewer.live_session import LiveSession

pytestmark = pytest.mark.slow

STATUS = "document.getElementById('live-status').dataset.state"


@pytest.fixture
def live(browser, tmp_path):
    """A page with its session, and what went wrong on the page."""
    inbox, faults = Inbox(), []
    session = LiveSession(plan_motion(load_motion(written(tmp_path, POINT))), inbox)
    with LiveServer(inbox) as server:
        server.start(session.page(server.socket_address), session.first_update())
        planner = threading.Thread(target=lambda: [server.send(update) for update in session.run()])
        planner.start()
        tab = browser.new_context(viewport=LAPTOP, reduced_motion="reduce").new_page()
        tab.on("pageerror", lambda error: faults.append(str(error)))
        tab.on("console", lambda message: faults.append(message.text))
        tab.goto(server.address)
        until(tab, f"{STATUS} === 'good' && trunkPage.plans[0].handles")
        yield tab, session, server
        tab.context.close()
        inbox.close()
        planner.join()
    assert not [fault for fault in faults if "ReadPixels" not in fault]


def on_screen(tab, name):
    """Where a handle is on the screen."""
    place = tab.evaluate(
        """(name) => {
          const { handles } = trunkPage.plans[0];
          const { position } = handles.find((handle) => handle.name === name);
          return trunkPage.stage.pointAt(0, position);
        }""",
        name,
    )
    box = tab.locator("#canvas").bounding_box()
    return place[0] + box["x"], place[1] + box["y"]


def place(tab, name):
    handles = tab.evaluate("trunkPage.plans[0].handles")
    return next(np.array(handle["position"]) for handle in handles if handle["name"] == name)


def test_a_target_that_is_dragged_moves_the_trunk(live):
    tab, session, _ = live
    before, start = place(tab, "3:0"), on_screen(tab, "3:0")
    tab.mouse.move(*start)
    tab.mouse.down()
    for k in range(1, 6):
        tab.mouse.move(start[0] - 3 * k, start[1] + 4 * k)
    until(tab, f"{STATUS} === 'open'")
    assert "let go" in tab.locator("#live-status").inner_text()
    tab.mouse.up()
    until(tab, f"{STATUS} === 'good' && trunkPage.plans[0].times.length > 10")
    assert tab.locator("#live-status").inner_text().startswith("verified, ")
    settled(tab)
    assert on_screen(tab, "3:0") == pytest.approx((start[0] - 15, start[1] + 20), abs=0.1)
    assert place(tab, "1:0") == pytest.approx([0.6, 0.1, 1.2])  # only the path's end moved
    moved = place(tab, "3:0")
    assert np.linalg.norm(moved - before) > 0.02
    assert session.plan.motion.steps[3].targets[0].position == pytest.approx(moved, abs=1e-12)
    assert tab.evaluate("trunkPage.clock.time") == pytest.approx(1.5)
    tip = tab.evaluate("[...trunkPage.stage.scenes[0].sections.position.slice(-3)]")
    assert tip == pytest.approx(session.plan.sample(1.5).shape.position([1.75])[0], abs=1e-6)
    assert tip == pytest.approx(moved, abs=5e-3)
    assert tab.evaluate("trunkPage.live.delays.length") > 0


def test_bounds_are_changed_refused_and_undone(live):
    tab, session, _ = live
    motion = session.plan.motion
    assert tab.locator("#live-hint").inner_text() == "Drag a target."  # no log here
    tab.locator("#live-muscles").select_option("*-dl")
    tab.locator("#live-lower").fill("-0.2")
    tab.locator("#live-lower").blur()
    until(tab, "trunkPage.live.planner.answered === 1")
    until(tab, f"{STATUS} === 'good'")
    dl = [i for i, name in enumerate(motion.trunk.muscles) if name.endswith("-dl")]
    assert session.plan.activations[:, dl].min() >= -0.2 - 1e-6
    tab.locator("#live-upper").fill("-0.5")
    tab.locator("#live-upper").blur()
    until(tab, "document.getElementById('live-fault').textContent")
    assert "the lower bound is above the upper" in tab.locator("#live-fault").inner_text()
    assert "live:" not in tab.locator("#live-fault").inner_text()
    tab.get_by_role("button", name="Undo all").click()
    until(tab, f"!document.getElementById('live-fault').textContent && {STATUS} === 'good'")
    assert session.plan.motion.spec == motion.spec


def test_a_page_says_when_its_planner_has_ended(live):
    tab, _, server = live
    server.__exit__()
    until(tab, f"{STATUS} === 'bad'")
    assert "has ended" in tab.locator("#live-status").inner_text()

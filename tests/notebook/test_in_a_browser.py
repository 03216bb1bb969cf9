"""The widget in real notebooks: the page moves, and what is moved on it comes back to Python."""

import json
import os
import re
from pathlib import Path

import notebooks
import numpy as np
import pytest
from pages import ARGS
from playwright.sync_api import sync_playwright
from programs import CHROMIUM, needs
from toys import TRUNK

from trunk_ocp.model.loads import Loads
from trunk_ocp.rod.statics import solve_statics

pytestmark = pytest.mark.slow

PLAN = """
import numpy as np
from toys import shortening
import trunk_ocp as to
plan = to.plan_motion(shortening([-0.2, -0.4]))
view = plan.view(height=420)
"""
LOGGED = """
import json
from pathlib import Path

def note(change):
    new = Path("new.json")
    new.write_text(json.dumps([view.time, view.activation, view.head, view.dragged]))
    new.replace("said.json")

view.observe(note, ["time", "activation", "head", "dragged"])
view
"""
SET = "view.time = 0.7"
SET_CONTROLS = "view.activation, view.head = np.array([-0.1, -0.3]), (0.1, 0.2)"
ANOTHER = "view.show(to.plan_motion(shortening([-0.3, -0.5, -0.5])))"

APP = f"""
import marimo
app = marimo.App()

@app.cell
def _():
    import marimo as mo
{PLAN.replace(chr(10), chr(10) + "    ")}
    widget = mo.ui.anywidget(view)
    button = mo.ui.button(label="to 0.7 s", on_click=lambda _: setattr(view, "time", 0.7))
    trunk = mo.ui.anywidget(plan.motion.trunk.view(height=420))
    return mo, widget, button, trunk

@app.cell
def _(mo, widget, button, trunk):
    mo.vstack([button, widget, trunk])

@app.cell
def _(mo, widget, trunk):
    both = [each.value["activation"][1] for each in (widget, trunk)]
    mo.md(f"shown: {{widget.value['time']:.2f}} s, {{both[0]:.2f}} and {{both[1]:.2f}}")
"""


@pytest.fixture(scope="module")
def browser():
    needs(CHROMIUM)
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=CHROMIUM, args=ARGS)
        yield chromium
        chromium.close()


@pytest.fixture
def tab(browser, request, tmp_path):
    context = browser.new_context(
        viewport={"width": 1200, "height": 900}, reduced_motion="reduce"
    )  # the page does not start by itself
    context.set_default_timeout(60_000)
    yield (page := context.new_page())
    shots = Path(os.environ.get("TRUNK_OCP_SCREENSHOTS", tmp_path))
    page.screenshot(path=shots / f"{request.node.name}.png")
    context.close()


def opened(tab, number=0):
    """A page of a trunk within a notebook, ready."""
    tab.locator("iframe[title=trunk]").nth(number).wait_for()
    frame = tab.locator("iframe[title=trunk]").nth(number).element_handle().content_frame()
    frame.wait_for_selector("body[data-ready]")
    return frame


def slide(frame, selector, value):
    """Move a slider of the page."""
    move = "(e, v) => { e.value = v; e.dispatchEvent(new Event('input', { bubbles: true })); }"
    frame.locator(selector).first.evaluate(move, value)


def test_in_jupyter_the_page_and_python_move_each_other(tab, tmp_path):
    said = tmp_path / "said.json"

    def python():
        return json.loads(said.read_text()) if said.exists() else [None] * 4

    cells = [PLAN + LOGGED, SET, SET_CONTROLS, ANOTHER]
    with notebooks.jupyter(tmp_path, cells) as address:
        tab.goto(address)
        notebooks.run_next_cell(tab)
        frame = opened(tab)
        # Of the page's two times, the one in Python is what was moved on the page.
        slide(frame, "#time", 1.5)
        notebooks.until(lambda: python()[0] == 1.5)
        # Another window than the page's is not believed.
        tab.evaluate("() => postMessage({ trunkPage: 'time', detail: { time: 0.3 } }, '*')")
        notebooks.run_next_cell(tab)
        notebooks.until(lambda: frame.evaluate("() => trunkPage.clock.time") == 0.7)
        assert python()[0] == 0.7
        notebooks.run_next_cell(tab)
        tried = "() => trunkPage.trial && [...trunkPage.trial.activation, ...trunkPage.trial.head]"
        notebooks.until(lambda: frame.evaluate(tried) == [-0.1, -0.3, 0.1, 0.2])
        tip = frame.evaluate("() => [...trunkPage.trial.sections.position.slice(-3)]")
        computed = solve_statics(TRUNK, [-0.1, -0.3], (0.1, 0.2), loads=Loads(0.0))
        np.testing.assert_allclose(tip, computed.position([1.0])[0], atol=1e-6)  # float32 there
        slide(frame, "#try-muscles input", -0.25)
        notebooks.until(lambda: python()[1] in ([-0.25, -0.25], [-0.25, -0.3]))
        assert python()[2] == [0.1, 0.2]
        pulled = {"what": "target", "name": "phases[1].targets[1]", "position": [0, 0, 0.9]}
        pulled["done"] = True
        frame.evaluate("(pulled) => trunkPage.bridge.emit('drag', pulled)", pulled)
        notebooks.until(lambda: python()[3] == pulled)
        notebooks.run_next_cell(tab)
        notebooks.until(lambda: frame.evaluate("() => trunkPage.clock.duration") == 3.0)


def test_in_marimo_the_page_and_python_move_each_other(tab, tmp_path):
    with notebooks.marimo(tmp_path, APP) as address:
        tab.goto(address)
        frame = opened(tab)
        slide(frame, "#time", 1.5)
        tab.get_by_text(re.compile(r"shown: 1\.50 s")).wait_for()
        tab.get_by_role("button", name="to 0.7 s").click()
        notebooks.until(lambda: frame.evaluate("() => trunkPage.clock.time") == 0.7)
        frame.locator("#try-button").click()
        slide(frame, "#try-muscles input", -0.25)
        tab.get_by_text(re.compile(r"-0\.25 and 0\.00")).wait_for()
        slide(opened(tab, 1), "#try-muscles input", -0.5)
        tab.get_by_text(re.compile(r"shown: 0\.70 s, -0\.25 and -0\.50")).wait_for()
        assert frame.evaluate("() => trunkPage.clock.time") == 0.7

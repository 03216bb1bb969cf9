"""A real browser for the page: headless Chromium, with WebGL in software.

Screenshots are kept in the folder that TRUNK_OCP_SCREENSHOTS names, or else in pytest's own.
"""

import os
import re
from pathlib import Path

import pytest
from pages import ARGS, LAPTOP
from plans import planned
from playwright.sync_api import sync_playwright
from programs import CHROMIUM, needs

from trunk_ocp.viewer import write_page


@pytest.fixture(scope="module")
def browser():
    needs(CHROMIUM)
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=CHROMIUM, args=ARGS)
        yield chromium
        chromium.close()


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("page")


@pytest.fixture(scope="module")
def pages(folder):
    """Pages by name."""
    both = [planned("lift-log", mode) for mode in ("sequential", "horizon")]
    return {
        "both": write_page(both, folder / "both" / "motion.html"),
        "fruit": write_page([planned("pick-fruit", "sequential")], folder / "motion.html"),
    }


@pytest.fixture
def visit(browser, request, tmp_path):
    """Open a page, which does not start by itself; it may print nothing and request nothing."""
    faults, tabs = [], []

    def console(message):
        if "GPU stall due to ReadPixels" not in message.text:  # said of screenshots
            faults.append(message.text)

    def requested(request):
        if not request.url.startswith("file://") or not request.url.endswith(".html"):
            faults.append(f"asked for {request.url}")

    def opened(path, size=LAPTOP, browser=browser, **options):
        options = {"reduced_motion": "reduce", **options}
        context = browser.new_context(viewport=size, offline=True, **options)
        tab = context.new_page()
        tab.on("console", console)
        tab.on("pageerror", lambda error: faults.append(str(error)))
        tab.on("request", requested)
        tab.goto(path.as_uri())
        tab.wait_for_selector("body[data-ready]")
        tabs.append(tab)
        return tab

    yield opened
    shots = Path(os.environ.get("TRUNK_OCP_SCREENSHOTS", tmp_path))
    shots.mkdir(parents=True, exist_ok=True)
    for number, tab in enumerate(tabs):
        name = re.sub(r"\W+", "-", request.node.name).strip("-")
        tab.screenshot(path=shots / f"{name}-{number}.png", full_page=True)
        tab.context.close()
    assert not faults

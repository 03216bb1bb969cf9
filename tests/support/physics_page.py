"""The page's physics alone, in a page of its own that a real browser opens from disk."""

import base64
import json
import re
from contextlib import contextmanager
from functools import cache
from importlib.resources import files

import toys
from playwright.sync_api import sync_playwright
from programs import CHROMIUM, needs

from trunk_ocp.model.anatomy import Trunk
from trunk_ocp.viewer.physics_tables import physics_tables
from trust.validation import rods

VIEWER = files("trunk_ocp.viewer") / "viewer"
WASM = (VIEWER / "physics.wasm").read_bytes()

# As in the page: scripts in it may run, and modules; nothing else is loaded.
PAGE = """<!doctype html><meta http-equiv="Content-Security-Policy"
content="default-src 'none'; script-src 'unsafe-inline' 'wasm-unsafe-eval'">
<script>
{modules}
const trunks = {{}};
const bytes = Uint8Array.from(atob("{bytes}"), (c) => c.charCodeAt(0));
const ready = loadPhysics(bytes).then((physics) => {{
  for (const [name, tables] of Object.entries({tables})) trunks[name] = physics.trunk(tables);
}});
const plain = (value) => JSON.parse(JSON.stringify(value, (key, x) =>
  key === "start" ? undefined : ArrayBuffer.isView(x) ? Array.from(x) : x));
</script>"""


@cache
def trunks() -> dict[str, Trunk]:
    """Anatomies of very different kinds."""
    return {
        "elephant": rods.elephant(),
        "bender": rods.bender(),
        "toy": toys.TRUNK,
        "bare": rods.rod(taper_deg=1.0),
        "wire": rods.wire(),
    }


@contextmanager
def physics_tab(folder):
    """A page in a folder with the physics of all trunks; it may print nothing, request nothing."""
    needs(CHROMIUM)
    modules = "\n".join(_script(name) for name in ("follow", "physics"))
    tables = json.dumps({name: physics_tables(trunk) for name, trunk in trunks().items()})
    path = folder / "physics.html"
    text = base64.b64encode(WASM).decode()
    path.write_text(PAGE.format(modules=modules, bytes=text, tables=tables))
    faults = []
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=CHROMIUM, args=["--headless", "--no-sandbox", "--disable-gpu"]
        )
        page = browser.new_context(offline=True).new_page()
        page.on("console", lambda message: faults.append(message.text))
        page.on("pageerror", lambda error: faults.append(str(error)))
        page.goto(path.as_uri())
        page.evaluate("() => ready")
        yield page
        browser.close()
    assert not faults


def _script(name: str) -> str:
    """A module of the viewer as a plain script."""
    text = (VIEWER / f"{name}.js").read_text(encoding="utf-8")
    return re.sub(r"^export |^import [^;]*;\n", "", text, flags=re.MULTILINE)

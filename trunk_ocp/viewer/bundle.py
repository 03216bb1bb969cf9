"""One HTML file from template, style, viewer modules, three.js and data.

The viewer is written as ES modules, which browsers do not load from disk. In the page each is a
function that returns what it exports, in the order of `MODULES`: each after those that it imports.
"""

from __future__ import annotations

import base64
import html
import json
import re
from importlib.resources import files
from typing import Any

MODULES = (
    "elements",
    "bridge",
    "data",
    "geometry",
    "colors",
    "clock",
    "materials",
    "symbols",
    "scene",
    "framing",
    "stage",
    "plots",
    "axes",
    "bar",
    "controls",
    "sliders",
    "trial",
    "drag",
    "follow",
    "physics",
    "tryit",
    "main",
)
LIVE_MODULES = ("targets_drag", "live_panel", "live")
IMPORT = re.compile(r'^import (\{[^}]*\}) from "\./(\w+)\.js";$', re.MULTILINE)
EXPORT = re.compile(r"^export ((?:async )?(?:function|class|const) (\w+))", re.MULTILINE)


def bundled(data: dict[str, Any], socket: str | None = None) -> str:
    """Text of the page for the data that `payload` returns.

    Parameters
    ----------
    socket : str, optional
        Address (ws://...) of the planner that a live page talks to. Other pages connect to nothing.
    """
    live = socket is not None
    parts = {
        "title": html.escape(data["title"]),
        "connect": html.escape(socket or "'none'"),
        "style": _read("viewer/style.css") + (_read("viewer/live.css") if live else ""),
        "license": _read("vendor/LICENSE"),
        "three": _read("vendor/three.min.js"),
        "data": embedded(data),
        "module": base64.b64encode(_bytes("viewer/physics.wasm")).decode("ascii"),
        "viewer": "\n".join(["const modules = {};", *map(_module, MODULES + LIVE_MODULES * live)]),
    }
    # In one pass, so that {{names}} inside a part are never replaced.
    return re.sub(r"\{\{(\w+)\}\}", lambda match: parts[match[1]], _read("viewer/page.html"))


def embedded(data: dict[str, Any]) -> str:
    """JSON that is safe inside a script element: nothing in it can end the element."""
    text = json.dumps(data, separators=(",", ":"), allow_nan=False)
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def _module(name: str) -> str:
    """A module of the viewer as a function with a scope of its own, called at once."""
    text = _read(f"viewer/{name}.js")
    exported = ", ".join(name for _, name in EXPORT.findall(text))
    body = EXPORT.sub(r"\1", IMPORT.sub(r"const \1 = modules.\2;", text))
    return f"modules.{name} = (() => {{\n{body}\nreturn {{ {exported} }};\n}})();"


def _read(name: str) -> str:
    return _bytes(name).decode("utf-8")


def _bytes(name: str) -> bytes:
    return (files(__package__) / name).read_bytes()

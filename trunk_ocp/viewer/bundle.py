"""One HTML file from template, style, viewer modules, three.js and data.

The viewer is written as ES modules, which browsers do not load from disk. In the page they share
one scope: in the order of `MODULES`, without import lines and export keywords.
"""

from __future__ import annotations

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
    "main",
)
LIVE_MODULES = ("targets_drag", "live_panel", "live")
IMPORT = re.compile(r"^import [^;]*;\n", re.MULTILINE)
EXPORT = re.compile(r"^export (?=function|class|const)", re.MULTILINE)


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
        "viewer": "\n".join(_module(name) for name in MODULES + LIVE_MODULES * live),
    }
    # In one pass, so that {{names}} inside a part are never replaced.
    return re.sub(r"\{\{(\w+)\}\}", lambda match: parts[match[1]], _read("viewer/page.html"))


def embedded(data: dict[str, Any]) -> str:
    """JSON that is safe inside a script element: nothing in it can end the element."""
    text = json.dumps(data, separators=(",", ":"), allow_nan=False)
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def _module(name: str) -> str:
    """A module of the viewer without imports and exports, to share one scope with the others."""
    return EXPORT.sub("", IMPORT.sub("", _read(f"viewer/{name}.js")))


def _read(name: str) -> str:
    return (files(__package__) / name).read_text(encoding="utf-8")

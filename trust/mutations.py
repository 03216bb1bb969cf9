"""Ways to damage a file: impossible values, wrong structure, random bytes."""

from __future__ import annotations

import copy
import math
from collections.abc import Iterable, Iterator
from itertools import islice
from typing import Any

from hypothesis import strategies as st

from .toml import Raw

HOSTILE: list[Any] = [
    math.nan, math.inf, -math.inf, 1e308, -1e308, 1e150, 1e-320, -0.0, 0.0, 0, -1, 1, 2**31, 2**63,
    10**9, 10**6, 10**400, -(10**400), 1e-9, 1e12, 1e-12, 1e30, True, "", "x", "x" * 10_000,
    "é\u202e\u0000\u001b[31m", "[/]", "[bold red]", "{0.__class__}", "%s%n", "../../../etc/passwd",
    "/dev/zero", ".", "__import__('os').system('touch ran')", [], [[]], [{}], {}, {"": 0},
    [0.0] * 3, [[0.0] * 3] * 1500, [1.0] * 3000, "*" * 2000, "[", "*a*a*a*a*a*a*a*a*a*a*b",
    Raw("1979-05-27T07:32:00Z"), Raw("07:32:00"), Raw("1" + "0" * 5000), Raw("0x" + "f" * 5000),
    Raw("[" * 3000 + "]" * 3000), Raw("{a=" * 3000 + "1" + "}" * 3000), Raw("nonsense"),
]  # fmt: skip
"""Values that may replace any other."""

Place = tuple[str | int, ...]


MAX_PLACES = 5000
"""Limit on the places considered; a long list that was repeated twice has millions."""


def places(value: Any, path: Place = ()) -> Iterator[Place]:
    """Paths of all entries of a table or list, nested ones included."""
    entries: Iterable[tuple[str | int, Any]] = value.items() if isinstance(value, dict) else []
    entries = enumerate(value) if isinstance(value, list) else entries
    for key, part in entries:
        yield (*path, key)
        yield from places(part, (*path, key))


def _changed(value: Any, how: str, draw: st.DrawFn) -> Any:
    """A replacement for a value."""
    if how == "scale" and isinstance(value, float):
        return value * draw(
            st.sampled_from([-1, 0, 1e-3, 1e3, 1e6, 1e-6, math.pi / 180, 180 / math.pi, 1e12])
        )
    if isinstance(value, list) and 0 < len(value) < 200:
        if how == "swap":
            return value[::-1]
        if how == "repeat":
            return value * draw(st.sampled_from([2, 20]))
        if how == "shorten":
            return value[:-1]
    if isinstance(value, dict) and how == "add":
        return value | {draw(st.sampled_from(["gravty", "", "a.b", "\u001b", "k" * 10_000])): 1}
    return copy.deepcopy(draw(st.sampled_from(HOSTILE)))  # a copy, as later changes may modify it


@st.composite
def mutated(draw: st.DrawFn, table: dict[str, Any]) -> dict[str, Any]:
    """A table with one to three changes anywhere."""
    result = copy.deepcopy(table)
    for _ in range(draw(st.integers(1, 3))):
        candidates = list(islice(places(result), MAX_PLACES))
        if not candidates:
            break
        *outer, last = draw(st.sampled_from(candidates))
        owner: Any = result
        for key in outer:
            owner = owner[key]
        how = draw(
            st.sampled_from(["drop", "scale", "scale", "swap", "repeat", "shorten", "add", "value"])
        )
        if how == "drop":
            del owner[last]
        else:
            owner[last] = _changed(owner[last], how, draw)
    return result


@st.composite
def damaged(draw: st.DrawFn, content: bytes) -> bytes:
    """Contents of a file with a few bytes changed, a part missing, or in another encoding."""
    how = draw(
        st.sampled_from(["edit", "edit", "edit", "cut", "double line", "bom", "crlf", "cr", "nul",
                         "utf-16", "latin", "binary", "empty"])
    )  # fmt: skip
    at = draw(st.integers(0, max(len(content) - 1, 0)))
    if how == "edit":
        edited = bytearray(content)
        for _ in range(draw(st.integers(1, 4))):
            if not edited:
                break
            at = draw(st.integers(0, len(edited) - 1))
            new = draw(st.one_of(st.binary(max_size=3), st.sampled_from([b'"', b"]", b"\n", b"9"])))
            edited[at : at + draw(st.integers(0, 3))] = new
        return bytes(edited)
    if how == "double line":
        lines = content.splitlines(keepends=True)
        return b"".join([*lines, draw(st.sampled_from(lines or [b""]))])
    return {
        "cut": content[:at],
        "bom": b"\xef\xbb\xbf" + content,
        "crlf": content.replace(b"\n", b"\r\n"),
        "cr": content.replace(b"\n", b"\r"),
        "nul": content[:at] + b"\x00" + content[at:],
        "utf-16": content.decode("utf-8", "replace").encode("utf-16"),
        "latin": content + b"# \xe9\n",
        "binary": bytes(range(256)) * 4,
        "empty": b"",
    }[how]

"""TOML text of plain values; the standard library only reads TOML."""

from __future__ import annotations

import json
from typing import Any


def toml_text(table: dict[str, Any]) -> str:
    """A TOML file of numbers, texts, lists and tables: sections as such, what is in them inline."""
    plain = {key: value for key, value in table.items() if not _is_section(value)}
    parts = [_lines(plain)]
    for key, value in table.items():
        if isinstance(value, dict):
            parts.append(f"[{_key(key)}]\n{_lines(value)}")
        elif _is_section(value):
            parts += [f"[[{_key(key)}]]\n{_lines(entry)}" for entry in value]
    return "\n".join(part for part in parts if part)


def _is_section(value: Any) -> bool:
    """Whether a value is a table, or a list of tables."""
    tables = isinstance(value, list) and value and all(isinstance(entry, dict) for entry in value)
    return isinstance(value, dict) or bool(tables)


def _lines(table: dict[str, Any]) -> str:
    return "".join(f"{_key(key)} = {_value(value)}\n" for key, value in table.items())


def _key(key: str) -> str:
    bare = key.isascii() and key.replace("_", "").replace("-", "").isalnum()
    return key if bare else _string(key)


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return _string(value)
    if isinstance(value, dict):
        pairs = ", ".join(f"{_key(k)} = {_value(v)}" for k, v in value.items())
        return f"{{ {pairs} }}" if pairs else "{}"
    if isinstance(value, list):
        return f"[{', '.join(map(_value, value))}]"
    return repr(value)


def _string(text: str) -> str:
    """A basic string; TOML escapes as JSON does, except for DEL."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")

"""Validated reading of TOML files: errors name file, key, value and what was expected."""

from __future__ import annotations

import contextlib
import difflib
import json
import tomllib
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError

from .errors import InputError


class Strict(BaseModel):
    """Base of every file section: immutable, finite numbers, no unknown keys, no coercion."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, strict=True)


Model = TypeVar("Model", bound=Strict)


def read_toml(path: Path, model: type[Model]) -> Model:
    """Read and validate a TOML file.

    Raises
    ------
    InputError
        If the file cannot be read, is not TOML, or does not fit `model`; the message
        lists every fault at once.
    """
    try:
        with path.open("rb") as stream:
            data = tomllib.load(stream)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}).") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: is not valid TOML: {error}.") from None
    try:
        # Through JSON, whose strict mode takes arrays as tuples but never "1.75" as a number.
        return model.model_validate_json(json.dumps(data, default=str))
    except ValidationError as error:
        told = _telling(error.errors(), data)
        faults = "\n".join(f"  {_describe(fault, model)}" for fault in told)
        raise InputError(f"{path}:\n{faults}") from None


def shipped(name_or_path: str, folder: Path) -> Path:
    """Path of a shipped file by its name, or of the user's own file.

    Raises
    ------
    InputError
        If there is neither; names the shipped ones and the closest match.
    """
    packaged = folder / f"{name_or_path}.toml"
    if packaged.is_file():
        return packaged
    path = Path(name_or_path)
    if path.is_file():
        return path
    names = sorted(entry.stem for entry in folder.glob("*.toml"))
    raise InputError(
        f"{name_or_path}: neither a file nor a shipped name; "
        f"expected a path to a TOML file or one of {', '.join(names)}."
        f"{_suggestion(name_or_path, names)}"
    )


def _telling(faults: list[Any], data: dict[str, Any]) -> list[Any]:
    """Faults without those that only follow from others.

    Of a value that may be a vector or a table, only the fault of what was written counts; a
    list whose entries are all at fault is not empty.
    """
    told = []
    for fault in faults:
        place: tuple[str | int, ...] = ()
        value: Any = data
        mistaken = False
        for part in fault["loc"]:
            if _is_choice(part):
                mistaken |= isinstance(value, dict) != str(part).endswith("Spec")
                continue
            place += (part,)
            with contextlib.suppress(LookupError, TypeError):
                value = value[part]
        depth = len(fault["loc"])
        inner = any(o["loc"][:depth] == fault["loc"] and len(o["loc"]) > depth for o in faults)
        if mistaken or (fault["type"] == "too_short" and inner):
            continue
        told.append({**fault, "loc": place})
    return told


def _is_choice(part: str | int) -> bool:
    """Whether a part of a location names an alternative of a type, not a key."""
    return isinstance(part, str) and ("[" in part or part.endswith("Spec"))


def _describe(fault: Any, model: type[BaseModel]) -> str:
    """One line for one pydantic fault: key, value, expectation."""
    key = _dotted(fault["loc"])
    if fault["type"] == "extra_forbidden":
        known = _known_keys(model, fault["loc"])
        hint = _suggestion(str(fault["loc"][-1]), known) or f" Known here: {', '.join(known)}."
        return f"{key}: unknown key.{hint}"
    if fault["type"] == "missing":
        return f"{key}: missing; this key is required."
    message = fault["msg"].removeprefix("Value error, ")
    value = fault["input"]
    shown = "" if isinstance(value, dict) else f" = {_short(value)}"
    where = f"{key}{shown}: " if key else ""
    return f"{where}{message[0].lower()}{message[1:]}."


def _dotted(location: tuple[str | int, ...]) -> str:
    """`("phases", 0, "loads")` as `phases[1].loads`, entries counted from one as a reader does."""
    text = ""
    for part in location:
        text += f"[{part + 1}]" if isinstance(part, int) else f".{part}"
    return text.lstrip(".")


def _known_keys(model: type[BaseModel], location: tuple[str | int, ...]) -> list[str]:
    """Keys allowed in the section in which an unknown key stands."""
    fields = model.model_fields
    for part in location[:-1]:
        if isinstance(part, int) or part not in fields:
            continue
        inner = _models_in(fields[part].annotation)
        if not inner:
            break
        fields = inner[0].model_fields
    return sorted(field.alias or name for name, field in fields.items())


def _models_in(annotation: Any) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [m for arg in getattr(annotation, "__args__", ()) for m in _models_in(arg)]


def _suggestion(word: str, known: list[str]) -> str:
    close = difflib.get_close_matches(word, known, n=1)
    return f" Did you mean {close[0]}?" if close else ""


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."

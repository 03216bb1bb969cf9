"""Validated reading of TOML files: errors name file, key, value and what was expected.

A file is data from anywhere: whatever is in it, reading ends soon, and either with a value
or with an `InputError`.
"""

from __future__ import annotations

import contextlib
import difflib
import json
import os
import re
import sys
import tomllib
import unicodedata
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, TypeVar

from annotated_types import Ge, Gt, MaxLen
from pydantic import AfterValidator, BaseModel, ConfigDict, ValidationError

from ..errors import InputError

LARGEST_FILE = 300_000
"""Bytes; a hundred times a shipped file, and still read in a fraction of a second."""
SMALLEST, LARGEST = 1e-24, 1e24
"""Sizes of a number other than 0; powers and products of such numbers stay far from overflow."""
MOST_FAULTS = 20
"""Faults of one file that are told."""
LONGEST_WORD = 60
"""Characters of a value that are shown, and of a key that may be a misspelt one."""


LONGEST_JSON, MOST_PARTS = 2_000_000, 100_000
"""Characters, and commas and brackets, of a problem or an anatomy in JSON: more than a file with
all that a trunk can do makes, and few enough for every one to be at fault."""


_OBEYED = ("Cc", "Cf", "Cs", "Zl", "Zp")  # categories of what a terminal obeys or hides


def printable(text: str, lines: bool = False) -> str:
    """A text from anywhere with what a terminal would obey written out as escapes.

    lines : whether it may have several lines.
    """
    if text.isprintable():
        return text
    return "".join(
        c if (lines and c == "\n") or unicodedata.category(c) not in _OBEYED else _escaped(c)
        for c in text
    )


def _escaped(character: str) -> str:
    return character.encode("unicode_escape").decode("ascii")


def _sized(value: float) -> float:
    if value and not SMALLEST <= abs(value) <= LARGEST:
        raise ValueError(f"expected 0 or a size from {SMALLEST:g} to {LARGEST:g}, in SI units")
    return value


def _printable(text: str) -> str:
    """A text without what a terminal would obey rather than show."""
    if any(unicodedata.category(c) in _OBEYED for c in text):
        raise ValueError("expected a line of text without control characters")
    return text


# No Field in a type that several keys share: pydantic before 2.11.5 keeps one key's default in it,
# which then makes every later key of the type optional.
Number = Annotated[float, AfterValidator(_sized)]
Positive = Annotated[float, Gt(0), AfterValidator(_sized)]
NonNegative = Annotated[float, Ge(0), AfterValidator(_sized)]
Pair = tuple[Number, Number]
Text = Annotated[str, MaxLen(200), AfterValidator(_printable)]


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
        lists its faults at once.
    """
    try:
        content = read_bytes(path, LARGEST_FILE)
        data = tomllib.loads(content.decode("utf-8-sig"))
        # Through JSON, whose strict mode takes arrays as tuples but never "1.75" as a number.
        text = json.dumps(data, default=str)
    except RecursionError:
        raise InputError(f"{path}: is nested too deeply; expected a few levels.") from None
    except UnicodeDecodeError:
        raise InputError(f"{path}: is not UTF-8 text, which TOML is; save it as UTF-8.") from None
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path}: is not valid TOML: {_toml_fault(error, content)}.") from None
    except ValueError:
        raise InputError(
            f"{path}: has a whole number of thousands of digits; expected at most "
            f"{sys.get_int_max_str_digits():,} digits."
        ) from None
    try:
        check_json(text)
        found = model.model_validate_json(text)
        check_json(found.model_dump_json())  # a plan of it has to be saved
        return found
    except InputError as error:
        raise InputError(f"{path}: {error}. Leave out what is not needed.") from None
    except ValidationError as error:
        faults = error.errors(include_url=False)
        told = _telling(faults[: 10 * MOST_FAULTS], data)[:MOST_FAULTS]
        lines = [f"  {_describe(fault, model)}" for fault in told]
        if len(faults) > 10 * MOST_FAULTS:
            lines.append("  and many more.")
        raise InputError("\n".join([f"{path}:", *lines])) from None


def _toml_fault(error: tomllib.TOMLDecodeError, content: bytes) -> str:
    """What is wrong with a TOML file; of a key that is there twice, which one and where."""
    told = str(error)
    if not told.startswith("Cannot overwrite a value"):
        return told
    lines = content.decode("utf-8-sig").rstrip().splitlines()
    found = re.search(r"at line ([0-9]+)", told)
    number = int(found[1]) if found else len(lines)  # none at the end of the file
    key, equals, _ = lines[number - 1].partition("=")
    which = f"{_clean(key.strip())}: this key" if equals else "the key of what ends here"
    return f"line {number}: {which} is there already; expected each key once"


def read_bytes(path: Path, most: int) -> bytes:
    """Content of a regular file of at most `most` bytes.

    Raises
    ------
    InputError
        For anything else: a missing file, a folder, a pipe or a device, which may have no end.
    """
    try:
        if path.exists() and not path.is_file():
            raise InputError(f"{path}: cannot be read (not a regular file).")
        with path.open("rb") as stream:
            size = os.fstat(stream.fileno()).st_size
            if size > most:
                raise InputError(f"{path}: is too large; expected at most {most:,} bytes.")
            return stream.read(size)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"{path}: cannot be read ({reason}).") from None


def parts_of(text: str) -> int:
    """Commas and brackets of a JSON text: no fewer than it has values."""
    return sum(map(text.count, ",[{"))


def check_json(text: str) -> None:
    """Raise InputError unless a problem or an anatomy in JSON is as short as one may be."""
    parts = parts_of(text)
    if len(text) > LONGEST_JSON or parts > MOST_PARTS:
        raise InputError(
            f"is too large, with {len(text):,} characters and {parts:,} parts in JSON; expected "
            f"at most {LONGEST_JSON:,} and {MOST_PARTS:,}"
        )


def is_file(path: Path) -> bool:
    """Whether there is a regular file; False for names that no file can have."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def shipped(name_or_path: str, *folders: Path) -> Path:
    """Path of a file shipped in one of some folders by its name, or of the user's own file.

    Raises
    ------
    InputError
        If there is neither; names the shipped ones and the closest match.
    """
    every = {path.stem: path for folder in folders for path in sorted(folder.glob("*.toml"))}
    if name_or_path in every:
        return every[name_or_path]
    path = Path(name_or_path)
    if is_file(path):
        return path
    raise InputError(
        f"{_clean(name_or_path)}: neither a file nor a shipped name; "
        f"expected a path to a TOML file or one of {', '.join(every)}."
        f"{_suggestion(name_or_path, [*every])}"
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
    if fault["type"] == "too_long" and isinstance(value, list):
        message = f"expected at most {fault['ctx']['max_length']} entries, got {len(value)}"
        message += _decimal_comma(value)
    shown = "" if isinstance(value, dict) else f" = {_short(value)}"
    where = f"{key}{shown}: " if key else ""
    return f"{where}{message[0].lower()}{message[1:]}."


def _decimal_comma(values: list[Any]) -> str:
    """A hint at two whole numbers in a row, which may be one with a comma for a point."""
    for one, two in pairwise(values):
        if type(one) is type(two) is int and abs(one) < 1000 and 0 <= two < 1000:
            return f"; is [{one}, {two}, ...] one number? Decimals have a point, {one}.{two}"
    return ""


def _dotted(location: tuple[str | int, ...]) -> str:
    """`("phases", 0, "loads")` as `phases[1].loads`, entries counted from one as a reader does."""
    text = ""
    for part in location:
        text += f"[{part + 1}]" if isinstance(part, int) else f".{_clean(part)}"
    return text.lstrip(".")


def _clean(word: str) -> str:
    """A word of the file as it can be shown: of one line, no longer than a reader wants."""
    return word if word.isprintable() and len(word) <= 4 * LONGEST_WORD else _short(word)


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
    close = difflib.get_close_matches(word[:LONGEST_WORD], known, n=1)
    return f" Did you mean {close[0]}?" if close else ""


def _short(value: object) -> str:
    if isinstance(value, int) and value.bit_length() > 200:
        return "a number of more than 60 digits"  # Python may refuse to write it
    value = value[: LONGEST_WORD + 1] if isinstance(value, str | list | tuple) else value
    text = repr(value)
    return text if len(text) <= LONGEST_WORD else text[: LONGEST_WORD - 3] + "..."

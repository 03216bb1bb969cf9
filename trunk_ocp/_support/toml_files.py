"""Validated reading of TOML files: errors name the file, key, value and expectation.

Files are untrusted: whatever they contain, reading ends quickly, with a value or an `InputError`.
"""

from __future__ import annotations

import contextlib
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
from .wording import MAX_WORD, suggestion

MAX_FILE_SIZE = 300_000
"""Bytes: a hundred times a shipped file, yet read in a fraction of a second."""
SMALLEST_NUMBER, LARGEST_NUMBER = 1e-24, 1e24
"""Magnitudes of nonzero numbers; powers and products of such numbers do not overflow."""
MAX_FAULTS = 20
"""Faults of one file that are reported."""
MAX_JSON, MAX_PARTS = 2_000_000, 100_000
"""Characters, and commas and brackets, of a problem or an anatomy in JSON: more than any sensible
file needs, and few enough for the case that every one is at fault."""

_CONTROL = ("Cc", "Cf", "Cs", "Zl", "Zp")  # categories that terminals interpret or hide


def printable(text: str, lines: bool = False) -> str:
    """An untrusted text with control characters escaped.

    Parameters
    ----------
    text : str
    lines : bool
        Whether line breaks stay.
    """
    if text.isprintable():
        return text
    return "".join(
        c if (lines and c == "\n") or unicodedata.category(c) not in _CONTROL else _escaped(c)
        for c in text
    )


def _escaped(character: str) -> str:
    return character.encode("unicode_escape").decode("ascii")


def _sized(value: float) -> float:
    if value and not SMALLEST_NUMBER <= abs(value) <= LARGEST_NUMBER:
        raise ValueError(
            f"expected 0 or a magnitude from {SMALLEST_NUMBER:g} to {LARGEST_NUMBER:g}, in SI units"
        )
    return value


def _printable(text: str) -> str:
    """A text without control characters; ValueError otherwise."""
    if any(unicodedata.category(c) in _CONTROL for c in text):
        raise ValueError("expected a line of text without control characters")
    return text


# No Field in a type that several keys share: pydantic before 2.11.5 stores the default of one key
# in it, which makes every later key of the type optional.
Number = Annotated[float, AfterValidator(_sized)]
Positive = Annotated[float, Gt(0), AfterValidator(_sized)]
NonNegative = Annotated[float, Ge(0), AfterValidator(_sized)]
Pair = tuple[Number, Number]
Vec3 = tuple[Number, Number, Number]
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
        If the file cannot be read, is not TOML, or does not fit `model`; the message lists all
        faults.
    """
    try:
        content = read_bytes(path, MAX_FILE_SIZE)
        data = tomllib.loads(content.decode("utf-8-sig"))
        # Through JSON, whose strict mode takes arrays as tuples but never "1.75" as a number.
        text = json.dumps(data, default=str)
    except RecursionError:
        raise InputError(f"{path}: is nested too deeply; expected a few levels.") from None
    except UnicodeDecodeError:
        raise InputError(
            f"{path}: is not UTF-8 text, as TOML requires; save it as UTF-8."
        ) from None
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path}: is not valid TOML: {_toml_fault(error, content)}.") from None
    except ValueError:
        raise InputError(
            f"{path}: has a whole number of thousands of digits; expected at most "
            f"{sys.get_int_max_str_digits():,} digits."
        ) from None
    return _validated(text, data, model, str(path))


def validated(data: dict[str, Any], model: type[Model], where: str) -> Model:
    """A section made in Python, of lists, tuples and arrays, checked as one of a file.

    Raises
    ------
    InputError
        If it does not fit `model`; the message begins with `where` and lists all faults.
    """
    try:
        text = json.dumps(data, default=_as_json)
    except (RecursionError, TypeError, ValueError) as error:
        raise InputError(f"{where}: cannot be written to a file ({error}).") from None
    return _validated(text, None, model, where)


def _as_json(value: Any) -> Any:
    """An array, a number of NumPy or a section as JSON types; anything else as a text."""
    if isinstance(value, BaseModel):
        return value.model_dump(mode="json")
    return value.tolist() if hasattr(value, "tolist") else str(value)


def _validated(text: str, data: dict[str, Any] | None, model: type[Model], where: str) -> Model:
    """A section from its JSON text, which is that of `data`."""
    try:
        check_json(text)
        content_model = model.model_validate_json(text)
        check_json(content_model.model_dump_json())  # must be small enough to be saved with a plan
        return content_model
    except InputError as error:
        raise InputError(f"{where}: {error}. Remove what is not needed.") from None
    except ValidationError as error:
        faults = error.errors(include_url=False)
        data = json.loads(text) if data is None else data
        primary = _primary_faults(faults[: 10 * MAX_FAULTS], data)[:MAX_FAULTS]
        lines = [f"  {_describe(fault, model)}" for fault in primary]
        if len(faults) > 10 * MAX_FAULTS:
            lines.append("  and many more.")
        raise InputError("\n".join([f"{where}:", *lines])) from None


def _toml_fault(error: tomllib.TOMLDecodeError, content: bytes) -> str:
    """The fault of a TOML file; for a repeated key, which one and where."""
    message = str(error)
    if message.startswith("Cannot declare"):
        return f"{message}; a section that may come several times takes two brackets, [[phases]]"
    if not message.startswith("Cannot overwrite a value"):
        return message
    lines = content.decode("utf-8-sig").rstrip().splitlines()
    match = re.search(r"at line ([0-9]+)", message)
    number = int(match[1]) if match else len(lines)  # no number at the end of the file
    key, equals, _ = lines[number - 1].partition("=")
    which = f"{_clean(key.strip())}: this key" if equals else "the key that ends here"
    return f"line {number}: {which} exists already; expected each key once"


def read_bytes(path: Path, most: int) -> bytes:
    """Content of a regular file of at most `most` bytes.

    Raises
    ------
    InputError
        For anything else: a missing file, a folder, a pipe or a device, which may be endless.
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
    """Commas and brackets of a JSON text, an upper bound on its values."""
    return sum(map(text.count, ",[{"))


def check_json(text: str) -> None:
    """Raise InputError if a problem or an anatomy in JSON is too large."""
    parts = parts_of(text)
    if len(text) > MAX_JSON or parts > MAX_PARTS:
        raise InputError(
            f"is too large, with {len(text):,} characters and {parts:,} parts in JSON; expected "
            f"at most {MAX_JSON:,} and {MAX_PARTS:,}"
        )


def is_file(path: Path) -> bool:
    """Whether there is a regular file; False for impossible names."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def shipped(name_or_path: str, *folders: Path) -> Path:
    """Path of a file: a shipped one in some folders by its name, or the user's own.

    Raises
    ------
    InputError
        If there is neither; lists the shipped names and the closest match.
    """
    shipped_files = {
        path.stem: path for folder in folders for path in sorted(folder.glob("*.toml"))
    }
    if name_or_path in shipped_files:
        return shipped_files[name_or_path]
    path = Path(name_or_path)
    if is_file(path):
        return path
    raise InputError(
        f"{_clean(name_or_path)}: neither a file nor a shipped name; "
        f"expected a path to a TOML file or one of {', '.join(shipped_files)}."
        f"{suggestion(name_or_path, shipped_files)}"
    )


def _primary_faults(faults: list[Any], data: dict[str, Any]) -> list[Any]:
    """Faults without those that only follow from others.

    A value may be of several types, such as a vector or a table: only the fault for the type that
    was written counts. A list whose entries are all at fault does not also count as too short.
    """
    primary = []
    for fault in faults:
        place: tuple[str | int, ...] = ()
        value: Any = data
        mistaken = False
        for part in fault["loc"]:
            if _is_choice(part):
                of_table = str(part).endswith("Spec") or str(part).startswith("dict[")
                mistaken |= isinstance(value, dict) != of_table
                continue
            place += (part,)
            with contextlib.suppress(LookupError, TypeError):
                value = value[part]
        depth = len(fault["loc"])
        inner = any(o["loc"][:depth] == fault["loc"] and len(o["loc"]) > depth for o in faults)
        if mistaken or (fault["type"] == "too_short" and inner):
            continue
        primary.append({**fault, "loc": place})
    return primary


def _is_choice(part: str | int) -> bool:
    """Whether a part of a location names an alternative type rather than a key."""
    return isinstance(part, str) and ("[" in part or part.endswith("Spec"))


MESSAGES = {
    "tuple_type": "expected a list in brackets, such as [-2.0, 0.0]",
    "string_pattern_mismatch": "expected letters, digits, '.', '_' and '-' only, without spaces",
}
"""For faults whose own message means little to users of files."""


def _describe(fault: Any, model: type[BaseModel]) -> str:
    """One line for a pydantic fault: key, value, expectation."""
    key = _dotted(fault["loc"])
    if fault["type"] == "extra_forbidden":
        known = _known_keys(model, fault["loc"])
        hint = suggestion(str(fault["loc"][-1]), known) or f" Known here: {', '.join(known)}."
        return f"{key}: unknown key.{hint}"
    if fault["type"] == "missing":
        if isinstance(fault["loc"][-1], int):
            return f"{key}: missing; expected more entries, such as both of [lower, upper]."
        return f"{key}: missing; this key is required."
    message = MESSAGES.get(fault["type"], fault["msg"].removeprefix("Value error, "))
    value = fault["input"]
    if fault["type"] == "too_long" and isinstance(value, list):
        message = f"expected at most {fault['ctx']['max_length']} entries, got {len(value)}"
        message += _decimal_comma(value)
    shown = "" if isinstance(value, dict) else f" = {_short(value)}"
    where = f"{key}{shown}: " if key else ""
    return f"{where}{message[0].lower()}{message[1:]}."


def _decimal_comma(values: list[Any]) -> str:
    """A hint if two whole numbers in a row may be one number with a decimal comma."""
    for one, two in pairwise(values):
        if type(one) is type(two) is int and abs(one) < 1000 and 0 <= two < 1000:
            return f"; is [{one}, {two}, ...] one number? Use a decimal point, {one}.{two}"
    return ""


def _dotted(location: tuple[str | int, ...]) -> str:
    """`("phases", 0, "loads")` as `phases[1].loads`; entries are counted from one."""
    text = ""
    for part in location:
        text += f"[{part + 1}]" if isinstance(part, int) else f".{_clean(part)}"
    return text.lstrip(".")


def _clean(word: str) -> str:
    """A word of the file made safe to show: short and on one line."""
    return word if word.isprintable() and len(word) <= 4 * MAX_WORD else _short(word)


def _known_keys(model: type[BaseModel], location: tuple[str | int, ...]) -> list[str]:
    """Keys allowed in the section of an unknown key."""
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


def _short(value: object) -> str:
    if isinstance(value, int) and value.bit_length() > 200:
        return "a number of more than 60 digits"  # Python may refuse to convert it
    value = value[: MAX_WORD + 1] if isinstance(value, str | list | tuple) else value
    text = repr(value)
    return text if len(text) <= MAX_WORD else text[: MAX_WORD - 3] + "..."

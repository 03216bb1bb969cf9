"""Checks of arguments of public functions: errors name the argument, its value, the expectation."""

from __future__ import annotations

import contextlib
import inspect
import math
from collections.abc import Callable, Iterable, Mapping, Sequence, Sized
from dataclasses import fields
from functools import cache, wraps
from numbers import Integral, Real
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, ParamSpec, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

from ..errors import InputError
from .ranges import shown

P = ParamSpec("P")
T = TypeVar("T")

WHERE_FROM = {
    "Motion": 'load_motion("lift-log") reads one',
    "Trunk": 'load_anatomy("asian-elephant") reads one',
    "Loads": "Loads(gravity=9.8) makes some",
    "Plan": "plan_motion and load_plan return one",
    "Shape": "solve_statics returns one",
    "PointShapes": "a ShapeMap returns one",
}
"""Where users get an object of each class."""
EXPECTED = {
    NoneType: "None",
    bool: "True or False",
    int: "a whole number",
    float: "a number",
    str: "a string",
    Path: "a path",
    np.ndarray: "an array of real numbers",
    Callable: "a function",
    Mapping: "a dict",
}
PLURALS = ("Loads", "PointShapes")
"""Names of classes that stand for several things."""
ITEMS: dict[Any, str] = {float: "numbers", int: "whole numbers", str: "strings"}
# At the first check, when every name in them is defined.
_hints: Callable[[Any], dict[str, Any]] = cache(get_type_hints)


def check_arguments(function: Callable[P, T]) -> Callable[P, T]:
    """Decorator that raises InputError for arguments whose type does not fit the annotation.

    Arrays must hold real numbers; their shapes and values are left to the function.
    """
    signature = inspect.signature(function)

    @wraps(function)
    def checked(*args: P.args, **kwargs: P.kwargs) -> T:
        hints = _hints(function)
        try:
            given = signature.bind(*args, **kwargs).arguments
        except TypeError:
            return function(*args, **kwargs)  # whose own error names the function
        for name, value in given.items():
            if name in hints:
                _check(name, value, hints[name])
        return function(*args, **kwargs)

    return checked


def check_fields(instance: Any) -> None:
    """Raise InputError for a field of a dataclass whose type does not fit the annotation."""
    for field in fields(instance):
        _check(field.name, getattr(instance, field.name), _hints(type(instance))[field.name])


def real_array(value: object, name: str) -> np.ndarray:
    """An argument as an array of floats.

    Raises
    ------
    InputError
        If it does not consist of real numbers.
    """
    if isinstance(value, Mapping):
        raise InputError(
            f"{name}: expected an array of real numbers, got a {type(value).__name__}; values of "
            "muscles come in the order of trunk.muscles."
        )
    try:
        array = np.asarray(value)
    except (TypeError, ValueError):  # rows of different lengths
        array = np.asarray(None)
    if array.dtype.kind == "O" and all(isinstance(item, Real) for item in array.flat):
        with contextlib.suppress(OverflowError):  # of whole numbers of hundreds of digits
            array = array.astype(float)  # such as a row of a table with texts in other columns
    if array.dtype.kind not in "biuf":
        raise InputError(f"{name} = {shown(value, repr)}: expected an array of real numbers.")
    return array.astype(float, copy=False)


def _check(name: str, value: object, hint: Any) -> None:
    if _fits(value, hint):
        return
    kinds = _alternatives(hint)
    if np.ndarray in kinds:
        real_array(value, name)  # has the better message
    expected = " or ".join(dict.fromkeys(_expected(kind) for kind in kinds))
    names = [getattr(kind, "__name__", "") for kind in kinds]
    source = "".join(f"; {WHERE_FROM[name]}" for name in names if name in WHERE_FROM)
    raise InputError(f"{name} = {shown(value, repr)}: expected {expected}{source}.")


def _alternatives(hint: Any) -> tuple[Any, ...]:
    return get_args(hint) if get_origin(hint) in (Union, UnionType) else (hint,)


def _expected(kind: Any) -> str:
    """A type in words."""
    origin = get_origin(kind) or kind
    if kind in EXPECTED or origin in EXPECTED:
        return EXPECTED.get(kind) or EXPECTED[origin]
    if issubclass(origin, Iterable):
        item = next(iter(get_args(kind)), object)
        name = getattr(item, "__name__", "")
        items = ITEMS.get(item, name if name in PLURALS else "")
        return f"a sequence of {items}" if items else "a sequence"
    name = origin.__name__
    return name if name in PLURALS else f"{'an' if name[0] in 'AEIOU' else 'a'} {name}"


def _fits(value: object, hint: Any) -> bool:
    """Whether a value is of an annotated type."""
    return any(_is_a(value, kind) for kind in _alternatives(hint))


def _is_number(value: Real) -> bool:
    with contextlib.suppress(OverflowError):
        return not math.isnan(float(value))
    return False


def _is_a(value: object, kind: Any) -> bool:
    if kind is Any:
        return True
    if isinstance(value, np.ndarray) and value.ndim == 0 and kind in (float, int):
        value = value.item()
    if kind is float:
        return isinstance(value, Real) and not isinstance(value, bool) and _is_number(value)
    if kind is int:
        return isinstance(value, Integral) and not isinstance(value, bool)
    if isinstance(value, str | Path) and "\0" in str(value):
        return False  # no file can have such a name
    if kind is bool:
        return isinstance(value, bool | np.bool_)
    if kind is np.ndarray:
        try:
            return real_array(value, "") is not None
        except InputError:
            return False
    origin = get_origin(kind) or kind
    if origin in (tuple, Sequence, Iterable):
        scalar = isinstance(value, np.ndarray) and value.ndim == 0
        if scalar or isinstance(value, str | Mapping) or not isinstance(value, Iterable):
            return False
        items = value if isinstance(value, Sized) else ()  # an iterator can be read only once
        return all(
            any(_fits(item, hint) for hint in get_args(kind) if hint is not ...) for item in items
        )
    return isinstance(value, origin)

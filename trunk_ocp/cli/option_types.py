"""Types of options of commands: numbers within their range, one or several."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from .._support.ranges import RANGES, shown

if TYPE_CHECKING:
    Type = click.ParamType[Any]
else:  # takes no subscript in older versions
    Type = click.ParamType


class Number(Type):
    """A number within one of `RANGES`."""

    def __init__(self, kind: str) -> None:
        self.range = RANGES[kind]
        self.name = "integer" if self.range.whole else "number"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float | int:
        """The number that a text says."""
        try:
            number = (int if self.range.whole else float)(value)
        except (ValueError, OverflowError):
            number = None
        if number is None or number not in self.range:
            self.fail(f"{shown(value)}: expected {self.range}.", param, ctx)
        return number


class Numbers(Type):
    """Numbers within one of `RANGES`, separated by commas.

    Parameters
    ----------
    none : str
        A word for no limit, if there may be none.
    most : int
        How many there may be.
    """

    name = "numbers"

    def __init__(self, kind: str, none: str = "", most: int = 1_000) -> None:
        self.one, self.none, self.most = Number(kind), none, most

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> list[float | int | None]:
        """The numbers that a text says."""
        if isinstance(value, list):  # a default
            return value
        words = str(value).split(",")
        if len(words) > self.most:
            self.fail(f"{len(words):,} values: expected at most {self.most:,}.", param, ctx)
        return [
            None if self.none and word.strip() == self.none else self.one.convert(word, param, ctx)
            for word in words
        ]

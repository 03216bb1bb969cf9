"""Command-line options that several commands share: numbers within a range, output folders."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from .._support.ranges import RANGES, shown

if TYPE_CHECKING:
    Type = click.ParamType[Any]
else:  # not generic in older versions of click
    Type = click.ParamType


def out_option(text: str) -> Callable[[Any], Any]:
    """The option --out DIR."""
    folder = click.Path(file_okay=False, path_type=Path)
    return click.option("--out", type=folder, metavar="DIR", help=text)


contact_option = click.option(
    "--contact",
    metavar="all|none|KIND,...",
    help="Keep the trunk out of itself (self), the head, the log and the obstacles; replaces the "
    "[contact] of the problem file.",
)


class Number(Type):
    """A number within the range that `RANGES` has for a kind of option."""

    def __init__(self, kind: str) -> None:
        self.range = RANGES[kind]
        self.name = "integer" if self.range.whole else "number"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float | int:
        """Parse and check the number."""
        try:
            number = (int if self.range.whole else float)(value)
        except (ValueError, OverflowError):
            number = None
        if number is None or number not in self.range:
            self.fail(f"{shown(value)}: expected {self.range}.", param, ctx)
        return number


def number_option(
    name: str, kind: str, metavar: str, text: str, default: float | None = None
) -> Callable[[Any], Any]:
    """An option for a number within the range of its kind; help shows the default, if any."""
    shown = default is not None
    return click.option(
        name, type=Number(kind), metavar=metavar, default=default, show_default=shown, help=text
    )


class Numbers(Type):
    """Numbers within one range, separated by commas.

    Parameters
    ----------
    none : str
        Word that stands for no limit, if that is allowed.
    max_count : int
        How many numbers are allowed.
    """

    name = "numbers"

    def __init__(self, kind: str, none: str = "", max_count: int = 1_000) -> None:
        self.number, self.none, self.max_count = Number(kind), none, max_count

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> list[float | int | None]:
        """Parse and check the numbers."""
        if isinstance(value, list):  # a default
            return value
        words = str(value).split(",")
        if len(words) > self.max_count:
            self.fail(f"{len(words):,} values: expected at most {self.max_count:,}.", param, ctx)
        return [
            None
            if self.none and word.strip() == self.none
            else self.number.convert(word, param, ctx)
            for word in words
        ]

"""Reading netCDF-3 files, the format of saved plans, when they may come from anybody.

The classic format (CDF-1, CDF-2) is a header with dimensions, attributes and variables, then the
variables' numbers one after the other, all big-endian (NetCDF Classic and 64-bit Offset File
Formats, Unidata). What the header claims is held against the size of the file before anything is
made of it, and arrays are views of its bytes: a file takes no more memory than it has bytes.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import InputError

MOST = 1000
"""Dimensions, attributes and variables, each; a plan has some twenty."""
KINDS = {1: ">i1", 2: "S1", 3: ">i2", 4: ">i4", 5: ">f4", 6: ">f8"}
TEXT, LONGEST_TEXTS = 2, 16_000_000  # all attributes together, characters
DIMENSIONS, VARIABLES, ATTRIBUTES = 10, 11, 12  # tags of the header's lists


@dataclass(frozen=True, eq=False)
class Contents:
    """Attributes of a file (texts and numbers) and its arrays, by name."""

    attributes: dict[str, Any]
    arrays: dict[str, np.ndarray]

    def texts(self, name: str) -> tuple[str, ...]:
        """An array of characters (n, length) as n texts."""
        rows = self.arrays[name]
        if rows.dtype.kind != "S" or rows.ndim != 2:
            raise InputError(f"{name}: expected texts")
        return tuple(row.tobytes().rstrip(b"\0").decode("utf-8") for row in rows)


def read_netcdf(content: bytes) -> Contents:
    """All attributes and arrays of a netCDF-3 file.

    Raises
    ------
    InputError
        If it is no such file, or claims what it does not have. Unlimited dimensions are refused.
    """
    if content[:3] != b"CDF" or content[3:4] not in (b"\x01", b"\x02"):
        raise InputError("it is no netCDF-3 file")
    header = _Header(content, wide=content[3] == 2)
    header.whole()  # number of records
    dimensions = [(header.name(), header.whole()) for _ in range(header.items(DIMENSIONS))]
    attributes = header.attributes()
    arrays: dict[str, np.ndarray] = {}
    for _ in range(header.items(VARIABLES)):
        name, array = header.variable(dimensions)
        if name in arrays:
            raise InputError(f"it has two arrays {name!r}")
        arrays[name] = array
    if sum(array.nbytes for array in arrays.values()) > len(content):
        raise InputError("its arrays share their numbers")
    return Contents(attributes, arrays)


class _Header:
    """A place in a header, from which its parts are read one after the other."""

    def __init__(self, content: bytes, wide: bool) -> None:
        self.content, self.at, self.wide = content, 4, wide
        self.texts = 0  # characters of attributes so far

    def take(self, size: int) -> bytes:
        """The next bytes, after which comes a multiple of four."""
        part = self.content[self.at : self.at + size]
        if len(part) != size:
            raise InputError("it is cut off")
        self.at += size + -size % 4
        return part

    def whole(self) -> int:
        """A number of four bytes."""
        value: int = struct.unpack(">I", self.take(4))[0]
        return value

    def name(self) -> str:
        """A name."""
        size = self.whole()
        if size > 256:
            raise InputError("a name in it is too long")
        return self.take(size).decode("utf-8")

    def items(self, tag: int) -> int:
        """Number of entries of a list."""
        found, size = self.whole(), self.whole()
        if found not in (tag, 0) or (found == 0 and size) or size > MOST:
            raise InputError("its header is damaged")
        return size

    def attributes(self) -> dict[str, Any]:
        """A list of attributes: texts, numbers and, rarely, tuples of numbers."""
        found = {}
        for _ in range(self.items(ATTRIBUTES)):
            name, kind, size = self.name(), self.whole(), self.whole()
            if kind not in KINDS:
                raise InputError(f"{name}: its type is unknown")
            self.texts += size
            if self.texts > LONGEST_TEXTS:
                raise InputError(f"{name}: its text is too large; expected that of one plan")
            content = self.take(size * np.dtype(KINDS[kind]).itemsize)
            values = np.frombuffer(content, KINDS[kind])
            found[name] = (
                content.decode("utf-8")
                if kind == TEXT
                else values[0].item()
                if values.size == 1
                else tuple(values[:MOST].tolist())
            )
        return found

    def variable(self, dimensions: list[tuple[str, int]]) -> tuple[str, np.ndarray]:
        """A variable: its name, and a view of its numbers."""
        name, rank = self.name(), self.whole()
        if rank > 8:
            raise InputError(f"{name}: it has too many dimensions")
        numbers = [self.whole() for _ in range(rank)]
        if any(number >= len(dimensions) for number in numbers):
            raise InputError(f"{name}: its dimensions are unknown")
        shape = [dimensions[number][1] for number in numbers]
        self.attributes()
        kind = self.whole()
        self.whole()  # its size, which follows from its shape
        begin = struct.unpack(">Q", self.take(8))[0] if self.wide else self.whole()
        if kind not in KINDS or 0 in shape:
            raise InputError(f"{name}: its type or shape is unknown")
        dtype, count = np.dtype(KINDS[kind]), math.prod(shape)
        if begin < 8 or begin + count * dtype.itemsize > len(self.content):
            raise InputError(f"{name}: its numbers are beyond the end of the file")
        values = np.frombuffer(self.content, dtype, count, begin)
        return name, values.reshape(shape)

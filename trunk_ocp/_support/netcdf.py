"""Safe reading of netCDF-3 files, the format of saved plans, from untrusted sources.

The classic format (CDF-1, CDF-2) is a header with dimensions, attributes and variables, followed by
the data of the variables, all big-endian (NetCDF Classic and 64-bit Offset File Formats, Unidata).
The claims of the header are checked against the size of the file before any memory is allocated,
and arrays are views of the file's bytes: reading takes no more memory than the file has bytes.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import InputError

MAX_ITEMS = 1000
"""Of dimensions, of attributes and of variables; a plan has about twenty."""
DTYPES = {1: ">i1", 2: "S1", 3: ">i2", 4: ">i4", 5: ">f4", 6: ">f8"}
TEXT, MAX_TEXT = 2, 16_000_000  # type of texts; characters of all attributes together
DIMENSIONS, VARIABLES, ATTRIBUTES = 10, 11, 12  # tags of the lists in the header


@dataclass(frozen=True, eq=False)
class Contents:
    """Attributes (texts and numbers) and arrays of a file, by name."""

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
        If it is not such a file, or claims more data than it has. Unlimited dimensions are refused.
    """
    if content[:3] != b"CDF" or content[3:4] not in (b"\x01", b"\x02"):
        raise InputError("it is not a netCDF-3 file")
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
        raise InputError("its arrays overlap")
    return Contents(attributes, arrays)


class _Header:
    """A position in a header, from which its parts are read in order."""

    def __init__(self, content: bytes, wide: bool) -> None:
        self.content, self.at, self.wide = content, 4, wide
        self.texts = 0  # characters of attributes so far

    def take(self, size: int) -> bytes:
        """The next bytes; the position moves on to a multiple of four."""
        part = self.content[self.at : self.at + size]
        if len(part) != size:
            raise InputError("it is truncated")
        self.at += size + -size % 4
        return part

    def whole(self) -> int:
        """A four-byte integer."""
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
        actual_tag, size = self.whole(), self.whole()
        if actual_tag not in (tag, 0) or (actual_tag == 0 and size) or size > MAX_ITEMS:
            raise InputError("its header is damaged")
        return size

    def attributes(self) -> dict[str, Any]:
        """A list of attributes: texts, numbers and, rarely, tuples of numbers."""
        values_by_name = {}
        for _ in range(self.items(ATTRIBUTES)):
            name, kind, size = self.name(), self.whole(), self.whole()
            if kind not in DTYPES:
                raise InputError(f"{name}: its type is unknown")
            self.texts += size
            if self.texts > MAX_TEXT:
                raise InputError(f"{name}: its text is too large for a plan")
            content = self.take(size * np.dtype(DTYPES[kind]).itemsize)
            values = np.frombuffer(content, DTYPES[kind])
            values_by_name[name] = (
                content.decode("utf-8")
                if kind == TEXT
                else values[0].item()
                if values.size == 1
                else tuple(values[:MAX_ITEMS].tolist())
            )
        return values_by_name

    def variable(self, dimensions: list[tuple[str, int]]) -> tuple[str, np.ndarray]:
        """The name of a variable and a view of its data."""
        name, rank = self.name(), self.whole()
        if rank > 8:
            raise InputError(f"{name}: it has too many dimensions")
        numbers = [self.whole() for _ in range(rank)]
        if any(number >= len(dimensions) for number in numbers):
            raise InputError(f"{name}: its dimensions are unknown")
        shape = [dimensions[number][1] for number in numbers]
        self.attributes()
        kind = self.whole()
        self.whole()  # the size, which also follows from the shape
        begin = struct.unpack(">Q", self.take(8))[0] if self.wide else self.whole()
        if kind not in DTYPES or 0 in shape:
            raise InputError(f"{name}: its type or shape is unknown")
        dtype, count = np.dtype(DTYPES[kind]), math.prod(shape)
        if begin < 8 or begin + count * dtype.itemsize > len(self.content):
            raise InputError(f"{name}: its data are beyond the end of the file")
        values = np.frombuffer(self.content, dtype, count, begin)
        return name, values.reshape(shape)

"""Arrays that record what is done to them as an ONNX graph.

They know the functions that templates/python/unloaded.py uses, so that the
NumPy module's own source becomes the ONNX model. Numbers among themselves are left to NumPy.
"""

from __future__ import annotations

from collections.abc import Sequence
from types import EllipsisType, ModuleType
from typing import Any

import numpy as np

OPSET = 17  # of 2022; nothing here needs a later one
IR = 8  # the file format of that time

Key = tuple[EllipsisType | int | slice | None, ...]


class Recorder:
    """An array library whose functions add nodes to a graph; `onnx` is the package."""

    def __init__(self, onnx: ModuleType, dtype: type[np.floating[Any]]) -> None:
        self.onnx, self.dtype = onnx, np.dtype(dtype)
        self.nodes: list[Any] = []
        self.constants: dict[tuple[bytes, str, tuple[int, ...]], Any] = {}
        self._known: dict[Any, str] = {}

    def add(self, kind: str, *inputs: Array | np.ndarray | float, **options: int) -> Array:
        """Output of a node; the same node is not added twice."""
        names = [x.name if isinstance(x, Array) else self.constant(x) for x in inputs]
        key = (kind, *names, *options.items())
        if key not in self._known:
            self._known[key] = f"t{len(self.nodes)}"
            node = self.onnx.helper.make_node(kind, names, [self._known[key]], **options)
            self.nodes.append(node)
        return Array(self, self._known[key])

    def constant(self, value: np.ndarray | float) -> str:
        """Name of a constant: arrays of integers are indices, all others of the graph's type."""
        index = isinstance(value, np.ndarray) and value.dtype.kind == "i"
        array = np.asarray(value) if index else np.asarray(value, dtype=self.dtype)
        key = (array.tobytes(), array.dtype.str, array.shape)
        if key not in self.constants:
            name = f"c{len(self.constants)}"
            self.constants[key] = self.onnx.numpy_helper.from_array(array, name)
        return str(self.constants[key].name)

    def needed(self, outputs: Sequence[Array]) -> tuple[list[Any], list[Any]]:
        """Nodes and constants on which outputs depend."""
        names, nodes = {output.name for output in outputs}, []
        for node in reversed(self.nodes):
            if node.output[0] in names:
                names |= {*node.input}
                nodes.append(node)
        return nodes[::-1], [c for c in self.constants.values() if c.name in names]

    def asarray(self, table: np.ndarray, dtype: np.dtype[Any]) -> np.ndarray:
        """A table, as numbers."""
        return np.asarray(table, dtype=dtype)

    def sin(self, x: Array) -> Array:
        """Sine."""
        return self.add("Sin", x)

    def cos(self, x: Array) -> Array:
        """Cosine."""
        # onnxruntime has no cosine in double precision.
        return self.add("Cos", x) if self.dtype == np.float32 else self.sin(x + np.pi / 2)

    def sqrt(self, x: Array) -> Array:
        """Square root."""
        return self.add("Sqrt", x)

    def logical_not(self, x: Array) -> Array:
        """Not."""
        return self.add("Not", x)

    def where(self, condition: Array, a: Array, b: Array) -> Array:
        """The one or the other, entry by entry."""
        return self.add("Where", condition, a, b)

    def zeros_like(self, x: Array) -> Array:
        """Zeros."""
        return 0.0 * x

    def concatenate(self, parts: Sequence[Array], axis: int) -> Array:
        """Arrays one after the other."""
        return self.add("Concat", *parts, axis=axis)

    def stack(self, parts: Sequence[Array], axis: int) -> Array:
        """Arrays side by side along a new axis."""
        where = np.array([axis])
        return self.concatenate([self.add("Unsqueeze", part, where) for part in parts], axis)


class Array:
    """An array of the graph, by its name there."""

    __array_ufunc__ = None  # NumPy leaves arithmetic with it to the methods below

    def __init__(self, recorder: Recorder, name: str) -> None:
        self.recorder, self.name = recorder, name

    @property
    def dtype(self) -> np.dtype[Any]:
        """Of the graph."""
        return self.recorder.dtype

    def __add__(self, other: Any) -> Array:
        return self.recorder.add("Add", self, other)

    def __radd__(self, other: Any) -> Array:
        return self.recorder.add("Add", other, self)

    def __sub__(self, other: Any) -> Array:
        return self.recorder.add("Sub", self, other)

    def __rsub__(self, other: Any) -> Array:
        return self.recorder.add("Sub", other, self)

    def __mul__(self, other: Any) -> Array:
        return self.recorder.add("Mul", self, other)

    def __rmul__(self, other: Any) -> Array:
        return self.recorder.add("Mul", other, self)

    def __truediv__(self, other: Any) -> Array:
        return self.recorder.add("Div", self, other)

    def __rtruediv__(self, other: Any) -> Array:
        return self.recorder.add("Div", other, self)

    def __matmul__(self, other: Any) -> Array:
        return self.recorder.add("MatMul", self, other)

    def __neg__(self) -> Array:
        return self.recorder.add("Neg", self)

    def __lt__(self, other: Any) -> Array:
        return self.recorder.add("Less", self, other)

    def __getitem__(self, key: Key) -> Array:
        """Entries by (..., keys of the last axes): slices, numbers, None for a new axis."""
        result, keys = self, key[1:]
        added = [i - len(keys) for i, k in enumerate(keys) if k is None]
        last = [k for k in keys if k is not None]
        for axis, k in zip(range(-len(last), 0), last, strict=True):
            if isinstance(k, slice) and k != slice(None):
                end = np.iinfo(np.int64).max if k.stop is None else k.stop
                bounds = (np.array([k.start or 0]), np.array([end]), np.array([axis]))
                result = self.recorder.add("Slice", result, *bounds)
        for axis, k in zip(range(-len(last), 0), last, strict=True):
            if isinstance(k, int):
                result = self.recorder.add("Gather", result, np.array([k]), axis=axis)
        gone = np.array([i - len(last) for i, k in enumerate(last) if isinstance(k, int)])
        result = self.recorder.add("Squeeze", result, gone) if gone.size else result
        return self.recorder.add("Unsqueeze", result, np.array(added)) if added else result

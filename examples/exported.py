"""The exported trunk behind two calls, in C (through ctypes) or in NumPy only.

Only the export itself needs trunk_ocp, by its command; nothing else here does.
"""

from __future__ import annotations

import ctypes
import importlib.util
import re
import subprocess
from pathlib import Path

import numpy as np

OUTPUTS = 19  # per point: position, directors, strain, moment


def export_trunk(folder: Path, to: str, at: list[float]) -> None:
    """Export the elephant's trunk to a folder, as from a shell."""
    points = ",".join(f"{Z:g}" for Z in at)
    command = ["trunk-ocp", "export", "asian-elephant", "--to", to, "--at", points]
    subprocess.run([*command, "--out", str(folder)], check=True, stdout=subprocess.DEVNULL)


class Compiled:
    """A trunk in C with its own memory: each shape is the initial guess of the next."""

    def __init__(self, folder: Path) -> None:
        library = folder / "libtrunk.so"
        if not library.exists():
            source = [str(folder / "trunk.c"), "-lm", "-o", str(library)]
            subprocess.run(["cc", "-O3", "-shared", "-fPIC", *source], check=True)
        self.c = ctypes.CDLL(str(library))
        self.c.trunk_work_size.restype = ctypes.c_size_t
        self.c.trunk_message.restype = ctypes.c_char_p
        header = (folder / "trunk.h").read_text()
        self.points, size = (self._size(header, name) for name in ("POINTS", "INPUTS"))
        self.rest = np.array((ctypes.c_double * size).in_dll(self.c, "trunk_default_input"))
        names = (ctypes.c_char_p * size).in_dll(self.c, "trunk_input_names")
        self.muscles = [name.decode() for name in names[: self._size(header, "MUSCLES")]]
        self.work = ctypes.create_string_buffer(self.c.trunk_work_size())
        self.c.trunk_reset(self.work)
        self.y = np.zeros((self.points, OUTPUTS))
        self.J = np.zeros((self.points, OUTPUTS, size))

    def shape(self, x: np.ndarray) -> np.ndarray:
        """Outputs of the shape at inputs x, (points, 19)."""
        self._call(self.c.trunk_loaded, _pointer(x), self.work, _pointer(self.y))
        return self.y.copy()

    def jacobian(self) -> np.ndarray:
        """Derivatives of the last shape with respect to x, (points, 19, inputs)."""
        self._call(self.c.trunk_jacobian, self.work, _pointer(self.J))
        return self.J

    @staticmethod
    def _size(header: str, name: str) -> int:
        return int(re.search(rf"#define TRUNK_{name} (\d+)", header)[1])

    def _call(self, function: ctypes._CFuncPtr, *arguments: object) -> None:
        status = function(*arguments)
        if status:
            raise RuntimeError(self.c.trunk_message(status).decode())


def _pointer(array: np.ndarray) -> ctypes._Pointer:
    return array.ctypes.data_as(ctypes.POINTER(ctypes.c_double))


class Interpreted:
    """The same without a compiler, and tens of times slower."""

    def __init__(self, folder: Path) -> None:
        spec = importlib.util.spec_from_file_location("trunk_numpy", folder / "trunk_numpy.py")
        self.module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(self.module)
        self.rest = self.module.pack(np.zeros(len(self.module.MUSCLES)))
        self.muscles = [*self.module.MUSCLES]
        self.x = self.rest

    def shape(self, x: np.ndarray) -> np.ndarray:
        """Outputs of the shape at inputs x, (points, 19)."""
        self.x = x.copy()
        return self.module.loaded(x)

    def jacobian(self) -> np.ndarray:
        """Derivatives of the last shape with respect to x, (points, 19, inputs)."""
        return self.module.jacobian(self.x)[1]

"""The loaded trunk of any anatomy as a WebAssembly module, for the browser page.

The C of the exports, compiled with the anatomy as its input instead of its constants: meshes and
their tables are made when it runs. `make module` runs this file as a program. Its result,
`viewer/viewer/physics.wasm`, is committed, and has in it a digest of what it was made from.
"""

from __future__ import annotations

import hashlib
import subprocess
import sys
import tempfile
from pathlib import Path

from .c import shape_kernels
from .headers import template
from .rod_space_axes import MOMENTS, base_of_any_head

COMPILER = "ziglang==0.17.1"
OPTIONS = (
    *("-target", "wasm32-wasi", "-mexec-model=reactor", "-std=c11", "-s"),
    *("-O2", "-fno-unroll-loops"),  # unrolled: 50 % larger, 17 % faster
    *("-Wall", "-Wextra", "-Wno-unused-function", "-Wno-array-parameter"),
    *("-Wl,--gc-sections", "-Wl,-z,stack-size=1048576"),
)
SIZES = {
    # Room for the largest anatomy file, and for the meshes that `solve_statics` tries.
    "MUSCLES": 5000,
    "SEGMENTS": 50,
    "ELEMENTS": 200,
    # Degree of the elements: positions to 1e-9 of the length need fewer than with degree 6.
    "NODES": 8,
    "POINTS": 1,
    "CONTACT": 1,
    "LOADS": 10,
    "HAS_JACOBIAN": 1,
    "HAS_SECOND": 0,
    # Known when it runs; only declarations that are not used have them.
    "CONTROLS": 0,
    "INPUTS": 0,
}
SECTION = b"recipe"


def module_source() -> str:
    """The C program, in one file."""
    sizes = {f"TRUNK_{name}": value for name, value in SIZES.items()} | {"MOMENTS": MOMENTS}
    defined = "\n".join(f"#define {name} {value}" for name, value in sizes.items())
    interface = template("c/trunk.h").replace("/* @title@ */", "")
    parts = {
        '#include "trunk.h"': interface.replace("/* @sizes@ */", defined),
        "/* @tables@ */": template("webassembly/tables.c"),
        "/* @kernels@ */": "\n".join(shape_kernels(base_of_any_head())),
    }
    head = template("c/head.c")
    for place, text in parts.items():
        head = head.replace(place, text)
    shared = [template(f"c/{name}.c") for name in ("elements", "solve", "shape", "jacobian")]
    own = [
        template(f"webassembly/{name}.c")
        for name in ("gauss", "mesh", "find", "stability", "module")
    ]
    return "\n".join([head, *shared, *own])


def digest(source: str) -> str:
    """SHA-256 of a source and of how it is compiled."""
    return hashlib.sha256("\n".join([source, COMPILER, *OPTIONS]).encode()).hexdigest()


def recorded_digest(module: bytes) -> str:
    """The digest in a module; empty if there is none."""
    return module.rpartition(SECTION)[2].decode("ascii") if SECTION in module else ""


def compiled(source: str, python: str) -> bytes:
    """The module with its digest, by the compiler of the `ziglang` wheel beside a Python.

    Raises
    ------
    CalledProcessError
        If it does not compile; the compiler has said why.
    """
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "physics.c").write_text(source, encoding="utf-8")
        command = [
            str(Path(python).absolute()),
            "-m",
            "ziglang",
            "cc",
            *OPTIONS,
            "-o",
            "physics.wasm",
            "physics.c",
        ]
        subprocess.run(command, cwd=folder, check=True)
        module = (Path(folder) / "physics.wasm").read_bytes()
    # A custom section, which engines skip: id 0, its size, and its name by its length; < 128 bytes.
    content = bytes([len(SECTION)]) + SECTION + digest(source).encode("ascii")
    return module + bytes([0, len(content)]) + content


if __name__ == "__main__":
    place, compiler = Path(sys.argv[1]), sys.argv[2]
    place.parent.mkdir(parents=True, exist_ok=True)
    place.write_bytes(compiled(module_source(), compiler))
    print(f"{place}: {place.stat().st_size} bytes")

"""The unloaded shape and its Jacobian as an ONNX model.

The loaded shape solves a boundary value problem by Newton's method, and ONNX has no operator that
solves linear equations; the unloaded one is closed form. A README.txt in the export says so.
"""

from __future__ import annotations

import importlib
import importlib.util
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from .foreign import in_comment
from .numpy_module import CHECK, check_text, module_text, run_check
from .request import Request, ToolMissingError

NAME = "trunk.onnx"
ASK = "pip install 'trunk_ocp[onnx]'"

README = """trunk.onnx: shape of the unloaded trunk <what>

The loaded trunk is not in here: its shape solves a boundary value problem by Newton's method, and
ONNX has no operator that solves linear equations. Any other format has the loaded shape.

Inputs, for any number B of shapes at once, in <precision> precision:
    activation (B, <muscles>): negative contracts; in this order:
<order>
    head (B, 2): psi_Z, psi_Y in rad
Outputs at the points Z = <Z> m:
<outputs>
python check.py compares the model with check_unloaded.csv; it needs numpy and onnxruntime.
"""


@dataclass(frozen=True)
class Output:
    """One output: where it is in y, its shape for each point, what it is."""

    at: slice
    shape: tuple[int, ...]
    text: str


OUTPUTS = {
    "position": Output(slice(0, 3), (3,), "in m, space axes"),
    "directors": Output(slice(3, 12), (3, 3), "row i is d_i in space axes"),
    "strain": Output(slice(12, 16), (4,), "extension zeta, curvature u_1, u_2, u_3 in 1/m"),
}


def write_onnx(request: Request) -> dict[str, str | bytes]:
    """Files of the export: trunk.onnx, what it is, and a program that checks it.

    The Jacobian is there if it is asked for; single precision too.

    Raises
    ------
    ToolMissingError
        If the package ndonnx is not installed.
    """
    try:
        ndonnx = importlib.import_module("ndonnx")
    except ImportError as error:
        raise ToolMissingError(f"Writing ONNX needs the package ndonnx: {ASK}") from error
    model = build_onnx(ndonnx, request)
    files: dict[str, str | bytes] = {NAME: model.SerializeToString()}
    return files | {"README.txt": _readme(request), CHECK: check_text("onnx")}


def check_onnx(folder: Path) -> str:
    """What the export's own check prints, run with onnxruntime.

    Raises
    ------
    ToolMissingError
        If onnxruntime is not installed.
    CheckError
        If the model does not give the numbers of the check file.
    """
    if importlib.util.find_spec("onnxruntime") is None:
        raise ToolMissingError(f"Checking ONNX needs the package onnxruntime: {ASK}")
    return run_check(folder)


def build_onnx(ndonnx: ModuleType, request: Request) -> Any:
    """The ModelProto: what the NumPy module's own source does to arrays of ndonnx."""
    kind = np.float32 if request.single else np.float64
    library = _Library(ndonnx, kind)
    module = ModuleType("trunk_numpy")
    exec(module_text(_nameless(request)), module.__dict__)
    sizes = {"activation": request.model.layout.controls - 2, "head": 2}
    inputs = {
        name: ndonnx.argument(shape=("B", size), dtype=library.dtype)
        for name, size in sizes.items()
    }
    slopes = request.what == "jacobian"
    y, J = module.unloaded_in(library, library.concatenate([*inputs.values()], -1), slopes)
    points, controls = len(request.model.Z), request.model.layout.controls

    parts = {name: (y[..., part.at], part.shape) for name, part in OUTPUTS.items()}
    if slopes:
        parts |= {
            f"{name}_jacobian": (J[..., part.at, :], (*part.shape, controls))
            for name, part in OUTPUTS.items()
        }
    outputs = {
        name: ndonnx.reshape(part, (-1, points, *shape)) for name, (part, shape) in parts.items()
    }
    return _described(ndonnx.build(inputs, outputs), request)


def _nameless(request: Request) -> Request:
    """The request with names of our own, so that what is run holds no text from a file."""
    trunk = request.model.trunk
    muscles = tuple(
        replace(muscle, name=f"muscle {number}", group="muscle")
        for number, muscle in enumerate(trunk.subdomains)
    )
    trunk = replace(trunk, name="trunk", subdomains=muscles)
    return replace(request, model=replace(request.model, trunk=trunk), name="trunk")


class _Library:
    """Ndonnx, an array library whose functions record an ONNX graph, as the module needs it."""

    def __init__(self, ndonnx: ModuleType, kind: type[np.floating[Any]]) -> None:
        self.ndonnx, self.kind = ndonnx, kind
        self.dtype = getattr(ndonnx, kind.__name__)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.ndonnx, name)

    def asarray(self, table: np.ndarray, dtype: object) -> Any:
        """A table, as numbers."""
        return self.ndonnx.asarray(np.asarray(table, dtype=self.kind))

    def cos(self, x: Any) -> Any:
        """Cosine, which onnxruntime does not have in double precision."""
        return self.ndonnx.sin(x + np.pi / 2)

    def concatenate(self, parts: Sequence[Any], axis: int) -> Any:
        """Arrays one after the other."""
        return self.ndonnx.concat([*parts], axis=axis)


def _outputs(request: Request) -> dict[str, tuple[tuple[int, ...], str]]:
    """Shape for each point and description of every output."""
    told = {name: (part.shape, part.text) for name, part in OUTPUTS.items()}
    if request.what == "jacobian":
        controls = request.model.layout.controls
        for name, part in OUTPUTS.items():
            text = f"derivatives of {name} by activation, then head"
            told[f"{name}_jacobian"] = ((*part.shape, controls), text)
    return told


def _described(model: Any, request: Request) -> Any:
    """The model with what a reader of the file should know."""
    model.producer_name, model.producer_version = "trunk_ocp", version("trunk_ocp")
    model.doc_string = _readme(request)
    told = {
        "trunk": request.name,
        "muscles": ", ".join(request.model.trunk.muscles),
        "Z": ", ".join(f"{Z!r}" for Z in request.model.Z),
        "units": "m, rad, 1/m",
    }
    for key, value in told.items():
        model.metadata_props.add(key=key, value=value)
    return model


def _readme(request: Request) -> str:
    model = request.model
    width = max(len(name) for name in _outputs(request))
    lines = [
        f"    {name:{width}} (B, {', '.join(map(str, (len(model.Z), *shape)))}): {text}"
        for name, (shape, text) in _outputs(request).items()
    ]
    return (
        README.replace(
            "<what>", f"for {in_comment(request.name)}, by trunk_ocp {version('trunk_ocp')}"
        )
        .replace("<precision>", "single" if request.single else "double")
        .replace("<muscles>", str(len(model.trunk.muscles)))
        .replace("<order>", _wrapped([in_comment(muscle) for muscle in model.trunk.muscles]))
        .replace("<Z>", ", ".join(f"{Z:g}" for Z in model.Z))
        .replace("<outputs>", "\n".join(lines) + "\n")
    )


def _wrapped(names: Sequence[str]) -> str:
    indent = 8 * " "
    return textwrap.fill(", ".join(names), 96, initial_indent=indent, subsequent_indent=indent)

"""The unloaded shape and its Jacobian as an ONNX model.

The loaded shape solves a boundary value problem by Newton's method, and ONNX has no operator that
solves linear equations; the unloaded one is closed form. A README.txt in the export says so.
"""

from __future__ import annotations

import importlib
import importlib.util
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from .model import Model
from .numpy_module import CHECK, check_text, module_text, run_check
from .onnx_graph import IR, OPSET, Array, Recorder
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
        If the package onnx is not installed.
    """
    try:
        onnx = importlib.import_module("onnx")
    except ImportError as error:
        raise ToolMissingError(f"Writing ONNX needs the package onnx: {ASK}") from error
    model = build_onnx(onnx, request)
    onnx.checker.check_model(model, full_check=True)
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


def build_onnx(onnx: ModuleType, request: Request) -> Any:
    """The ModelProto: what the NumPy module's own source does to recording arrays."""
    module = ModuleType("trunk_numpy")
    exec(module_text(request), module.__dict__)
    recorder = Recorder(onnx, np.float32 if request.single else np.float64)
    inputs = {name: Array(recorder, name) for name in ("activation", "head")}
    slopes = request.what == "jacobian"
    y, J = module.unloaded_in(recorder, recorder.concatenate([*inputs.values()], -1), slopes)
    outputs = {name: _named(y[..., part.at], name, part.shape) for name, part in OUTPUTS.items()}
    controls = request.model.layout.controls
    if slopes:
        for name, part in OUTPUTS.items():
            shape = (*part.shape, controls)
            outputs |= {f"{name}_jacobian": _named(J[..., part.at, :], f"{name}_jacobian", shape)}
    nodes, constants = recorder.needed([*outputs.values()])
    graph = onnx.helper.make_graph(
        nodes,
        "unloaded",
        [_info(onnx, recorder, name, ("B", size)) for name, size in _inputs(request.model).items()],
        [
            _info(onnx, recorder, name, ("B", len(request.model.Z), *shape))
            for name, (shape, _) in _outputs(request).items()
        ],
        constants,
    )
    return _model(onnx, graph, request)


def _named(array: Array, name: str, shape: tuple[int, ...]) -> Array:
    """An array (B, n, ...) of a shape for each point, under a name."""
    recorder = array.recorder
    target = np.array([0, 0, *shape])  # 0: as it is
    node = recorder.onnx.helper.make_node(
        "Reshape", [array.name, recorder.constant(target)], [name], name=name
    )
    recorder.nodes.append(node)
    return Array(recorder, name)


def _inputs(model: Model) -> dict[str, int]:
    return {"activation": len(model.trunk.muscles), "head": 2}


def _outputs(request: Request) -> dict[str, tuple[tuple[int, ...], str]]:
    """Shape for each point and description of every output."""
    told = {name: (part.shape, part.text) for name, part in OUTPUTS.items()}
    if request.what == "jacobian":
        controls = request.model.layout.controls
        for name, part in OUTPUTS.items():
            text = f"derivatives of {name} by activation, then head"
            told[f"{name}_jacobian"] = ((*part.shape, controls), text)
    return told


def _info(onnx: ModuleType, recorder: Recorder, name: str, shape: tuple[int | str, ...]) -> Any:
    kind = onnx.helper.np_dtype_to_tensor_dtype(recorder.dtype)
    return onnx.helper.make_tensor_value_info(name, kind, shape)


def _model(onnx: ModuleType, graph: Any, request: Request) -> Any:
    """The graph with what a reader of the file should know."""
    helper = onnx.helper
    model = helper.make_model(
        graph,
        opset_imports=[helper.make_opsetid("", OPSET)],
        ir_version=IR,
        producer_name="trunk_ocp",
        producer_version=version("trunk_ocp"),
        doc_string=_readme(request),
    )
    helper.set_model_props(
        model,
        {
            "trunk": request.name,
            "muscles": ", ".join(request.model.trunk.muscles),
            "Z": ", ".join(f"{Z!r}" for Z in request.model.Z),
            "units": "m, rad, 1/m",
        },
    )
    return model


def _readme(request: Request) -> str:
    model = request.model
    width = max(len(name) for name in _outputs(request))
    lines = [
        f"    {name:{width}} (B, {', '.join(map(str, (len(model.Z), *shape)))}): {text}"
        for name, (shape, text) in _outputs(request).items()
    ]
    return (
        README.replace("<what>", f"for {request.name}, by trunk_ocp {version('trunk_ocp')}")
        .replace("<precision>", "single" if request.single else "double")
        .replace("<muscles>", str(len(model.trunk.muscles)))
        .replace("<order>", _wrapped(model.trunk.muscles))
        .replace("<Z>", ", ".join(f"{Z:g}" for Z in model.Z))
        .replace("<outputs>", "\n".join(lines) + "\n")
    )


def _wrapped(names: Sequence[str]) -> str:
    indent = 8 * " "
    return textwrap.fill(", ".join(names), 96, initial_indent=indent, subsequent_indent=indent)

"""The shape and its derivatives in C99: one source file and one header, without dependencies.

Numbers and kernels are generated, the kernels by CasADi. The rest is fixed C in `templates/c`:
Newton's method on condensed elements, and the derivatives of its solution.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable, Sequence
from functools import cache
from pathlib import Path

import casadi as ca
import numpy as np

from ..errors import TrunkError
from ..model.activation import stiffness
from ..model.quaternions import directors, product
from .escaping import c_literal
from .headers import header, template
from .request import Request
from .rod_space_axes import MOMENTS, base, rates, report, second_along, spiral, turn, with_slopes
from .run_checks import run_c
from .shape_model import DEGREE, Model


def write_c(request: Request) -> dict[str, str | bytes]:
    """Files of the export: trunk.c, trunk.h, CMakeLists.txt, example.c and check.c.

    If `what` is "shape", there are no derivatives of the loaded shape.
    """
    title = _comment(header(request))
    interface = template("c/trunk.h").replace("/* @title@ */", title)
    interface = interface.replace("/* @sizes@ */", "\n".join(_sizes(request)))
    files: dict[str, str | bytes] = {
        "trunk.h": interface,
        "trunk.c": title + "\n" + _source(request),
    }
    for name in ("CMakeLists.txt", "example.c", "check.c"):
        files[name] = template(f"c/{name}")
    return files


def check_c(folder: Path) -> str:
    """Compile and run the self-check of an export; returns its output, and raises as `run_c`."""
    return run_c(folder, "trunk.c")


def _comment(text: str) -> str:
    return "\n".join(["/*", *(f" * {line}".rstrip() for line in text.splitlines()), " */"])


def _sizes(request: Request) -> Iterable[str]:
    """Sizes and offsets for the header."""
    model = request.model
    layout, tables = model.layout, model.tables
    loads = 10 if layout.contact else 4
    for name, value in {
        "MUSCLES": len(layout.muscles),
        "CONTROLS": layout.controls,
        "INPUTS": layout.size,
        "POINTS": layout.points,
        "CONTACT": int(layout.contact),
        "HAS_JACOBIAN": int(request.what == "jacobian" or request.second),
        "HAS_SECOND": int(request.second),
        "LOADS": loads,
        "SEGMENTS": len(tables.fractions),
        "ELEMENTS": len(tables.widths),
        "NODES": DEGREE,
    }.items():
        yield f"#define TRUNK_{name} {value}"
    if layout.contact:
        yield f"#define TRUNK_CONTACT_FROM {model.loads.contact_from!r} /* m */"
    offsets = [f"TRUNK_{name.upper()} = {part.start}" for name, part in layout.inputs.items()]
    yield "\nenum { " + ", ".join(offsets) + " };"


def _source(request: Request) -> str:
    """trunk.c: numbers, kernels, and the fixed text."""
    parts = ["head.c", "elements.c", "solve.c", "shape.c", "unloaded.c"]
    kernels = shape_kernels(base(request.model.trunk.head))
    if request.what == "jacobian" or request.second:
        parts.append("jacobian.c")
    if request.second:
        parts.append("second.c")
        kernels += _second_kernels(request.model)
    text = "\n".join(template(f"c/{part}") for part in parts)
    text = text.replace("/* @tables@ */", "\n".join(_tables(request.model)))
    return text.replace("/* @kernels@ */", "\n".join(kernels))


def _tables(model: Model) -> Iterable[str]:
    """Constants of the program; those of Gauss points are stored component by component."""
    tables, layout = model.tables, model.layout
    yield _array("const double trunk_Z", ["TRUNK_POINTS"], model.Z)
    names = [c_literal(name) for name in _input_names(model)]
    yield _array("const char *const trunk_input_names", ["TRUNK_INPUTS"], names)
    rest = layout.x(np.zeros(len(layout.muscles)), (0.0, 0.0), model.loads)
    yield _array("const double trunk_default_input", ["TRUNK_INPUTS"], rest)
    nodes, elements, points = "NODES", "ELEMENTS", "POINTS"
    derivative = np.linalg.inv(tables.A)
    yield _table("gauss_A", [nodes, nodes], tables.A.T)
    yield _table("gauss_D", [nodes, nodes], derivative.T)
    yield _table("gauss_b", [nodes], tables.b)
    yield _table("gauss_end", [nodes], tables.b @ derivative)
    yield _table("gauss_sum", [nodes], derivative.sum(axis=1))
    yield _table("width", [elements], tables.widths)
    section = tables.section.transpose(0, 2, 1).reshape(len(tables.widths), -1)
    yield _table("section", [elements, f"5 * TRUNK_{nodes}"], section)
    yield _table("point_mass", [elements, nodes], tables.force[..., 0])
    yield _table("point_share", [elements, nodes], tables.force[..., 1])
    if layout.contact:
        yield _table("couple_density", [elements], tables.force[:, 0, 2])
    yield _table("point_reach", [elements, nodes], tables.reach)
    yield _table("piece", [elements, str(4 + MOMENTS)], tables.piece)
    yield _table("element_segment", [elements], tables.segment, "int")
    yield _table("trunk_edge", [points], tables.edge, "int")
    yield _table("edge_segment", [points], tables.segment[tables.ends], "int")
    yield _table("edge_section", [points, "5"], tables.edge_section[tables.edge])
    yield _table("edge_mass", [points], tables.edge_force[tables.edge, 0])
    yield _table("edge_share", [points], tables.edge_force[tables.edge, 1])
    yield _table("fraction", ["SEGMENTS"], tables.fractions)
    segment, strain = _muscles(tables.strain)
    size = "TRUNK_MUSCLES + 1"  # C has no arrays of length zero; the last entry is unused
    yield _table("muscle_segment", [size], segment, "int")
    yield _table("muscle_strain", [size, "4"], strain)
    floor = 1e-3 * float(stiffness(model.trunk, 0.0)[1]) / model.trunk.length
    yield f"static const double small_moment = {floor!r};  /* N m, for tiny loads */"
    yield "#define head_numbers NULL  /* the head's kernels have its numbers */"


def _input_names(model: Model) -> list[str]:
    axes = {1: ("",), 3: ("_X", "_Y", "_Z")}
    names = [*model.layout.muscles, "psi_Z", "psi_Y"]
    for name, part in list(model.layout.inputs.items())[2:]:
        names += [name + axis for axis in axes[part.stop - part.start]]
    return names


def _muscles(strain: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Segment (muscles + 1,) of each muscle and its strains (muscles + 1, 4) there."""
    count = strain.shape[2]
    segment = np.abs(strain).sum(axis=1).argmax(axis=0) if count else np.zeros(0, dtype=int)
    strains = strain[segment, :, np.arange(count)]
    return np.append(segment, 0), np.vstack([strains, np.zeros(4)])


def _table(name: str, sizes: Sequence[str], values: np.ndarray, kind: str = "double") -> str:
    named = [f"TRUNK_{size}" if size.isalpha() else size for size in sizes]
    return _array(f"static const {kind} {name}", named, values)


def _array(declaration: str, sizes: Sequence[str], values: Sequence[object] | np.ndarray) -> str:
    shape = "".join(f"[{size}]" for size in sizes)
    rows = values.tolist() if isinstance(values, np.ndarray) else list(values)
    text = textwrap.wrap(_braces(rows), 96, break_long_words=False, break_on_hyphens=False)
    return f"{declaration}{shape} =\n" + textwrap.indent("\n".join(text), "    ") + ";"


def _braces(value: object) -> str:
    if isinstance(value, list):
        return "{" + ", ".join(map(_braces, value)) + "}"
    return value if isinstance(value, str) else repr(value)


def shape_kernels(head: ca.Function) -> list[str]:
    """Kernels of `elements.c`, `solve.c`, `shape.c`, `unloaded.c` and `jacobian.c`.

    head : pose of the base, as `rod_space_axes.base`
    """
    frame, force = _part(rates(), slice(0, 4)), _part(rates(), slice(4, 10))
    return [
        _kernel(frame, "frame_rates", lanes=True),
        _kernel(_slopes(frame, range(12)), "frame_slopes", lanes=True),
        _kernel(force, "force_rates", lanes=True),
        _kernel(_slopes(force, (0, 1, 2, 3, 7, 11, 12, 13, 14)), "force_slopes", lanes=True),
        _kernel(report(), "report_values"),
        _kernel(with_slopes(report()), "report_slopes"),
        _kernel(head, "base_values"),
        _kernel(with_slopes(head), "base_slopes"),
        _kernel(_turned(), "turned_values"),
        _kernel(_stepped(), "stepped_values"),
        _kernel(with_slopes(_stepped()), "stepped_slopes"),
    ]


def _second_kernels(model: Model) -> list[str]:
    """Further kernels of `second.c`."""
    return [
        _kernel(second_along(rates()), "rates_second", lanes=True),
        _kernel(second_along(report()), "report_second"),
        _kernel(second_along(base(model.trunk.head)), "base_second"),
    ]


def _part(kernel: ca.Function, rows: slice) -> ca.Function:
    """Some outputs of a kernel."""
    w, p = ca.SX.sym("w", kernel.size1_in(0)), ca.SX.sym("p", kernel.size1_in(1))
    return ca.Function(kernel.name(), [w, p], [kernel(w, p)[rows]])


def _slopes(kernel: ca.Function, columns: Iterable[int]) -> ca.Function:
    """A kernel with its derivatives with respect to some of w."""
    w, p = ca.SX.sym("w", kernel.size1_in(0)), ca.SX.sym("p", kernel.size1_in(1))
    value, slopes = with_slopes(kernel)(w, p)
    return ca.Function(kernel.name(), [w, p], [value, slopes[:, list(columns)]])


@cache
def _turned() -> ca.Function:
    """Orientation at a point of a segment: w is q (4) at its start, zeta_hat, c (3)."""
    w, p = ca.SX.sym("w", 8), ca.SX.sym("p", 1)
    q = product(ca.vertsplit(w[:4]), ca.vertsplit(turn()(w[4:], p)))
    return ca.Function("turned", [w, p], [ca.vertcat(*q)])


@cache
def _stepped() -> ca.Function:
    """Orientation (4) at the end of a piece, and its chord (3), in space axes; w of `_turned`."""
    w, p = ca.SX.sym("w", 8), ca.SX.sym("p", 4 + MOMENTS)
    q, rho = _turned()(w, p[0]), ca.vertsplit(spiral()(w[4:], p))
    d = directors(ca.vertsplit(w[:4]))
    chord = [sum(rho[i] * d[i][k] for i in range(3)) for k in range(3)]
    return ca.Function("stepped", [w, p], [ca.vertcat(q, *chord)])


_INPUT = re.compile(r"arg\[(\d+)\]\? arg\[\d+\]\[(\d+)\] : 0")
_OUTPUT = re.compile(r"if \(res\[(\d+)\]!=0\) res\[\d+\]\[(\d+)\]=")
_BODY = re.compile(r"static int casadi_f0\([^)]*\) \{\n(.*?)  return 0;\n\}", re.DOTALL)


def _kernel(function: ca.Function, name: str, lanes: bool = False) -> str:
    """C function name(inputs ..., outputs ...) from CasADi's generator; arrays are column-major.

    With `lanes` it evaluates all Gauss points of an element, component by component, so that a
    compiler can vectorize over them.

    Raises
    ------
    TrunkError
        If CasADi's output has an unknown form.
    """
    generator = ca.CodeGenerator("kernel.c", {"casadi_int": "int"})
    generator.add(function)
    match = _BODY.search(generator.dump())
    inputs = ("w", "p", "a", "b")[: function.n_in()]
    outputs = ("value", "slopes")[: function.n_out()]
    place = "[NODES * {} + lane]" if lanes else "[{}]"
    body = match[1] if match else "casadi_"
    body = _INPUT.sub(lambda m: inputs[int(m[1])] + place.format(m[2]), body)
    body = _OUTPUT.sub(lambda m: outputs[int(m[1])] + place.format(m[2]) + " = ", body)
    body = body.replace("casadi_real ", "double ").replace("casadi_sq(", "square(")
    if "casadi_" in body:
        raise TrunkError(f"{name}: this version of CasADi writes C code of an unknown form.")
    body = "".join(f"    {line.strip()}\n" for line in body.splitlines())
    unused = [f"    (void){x};\n" for x in inputs if f"{x}[" not in body]
    if lanes:
        body = f"    for (int lane = 0; lane < NODES; lane++) {{\n{body}    }}\n"
    arguments = [f"const double *restrict {x}" for x in inputs]
    arguments += [f"double *restrict {x}" for x in outputs]
    return f"static void {name}({', '.join(arguments)})\n{{\n{''.join(unused)}{body}}}\n"

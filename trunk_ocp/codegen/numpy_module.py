"""Export to a Python module that needs only NumPy: loaded and unloaded shape, derivatives."""

from __future__ import annotations

import re
from dataclasses import fields

import casadi as ca
import numpy as np

from .._support.casadi_to_python import python_source
from . import rod_space_axes as kernels
from .escaping import python_literal
from .headers import header, template
from .request import Request
from .run_checks import run_python
from .shape_model import OUTPUTS, Model

NAME = "trunk_numpy.py"
CHECK = "check.py"
WIDTH = 96


def write_numpy(request: Request) -> dict[str, str | bytes]:
    """Files of the export: the module and its self-check.

    The module always has the Jacobian, because Newton's method needs the same slopes.
    """
    return {NAME: module_text(request), CHECK: check_text("numpy")}


def module_text(request: Request) -> str:
    """Source of trunk_numpy.py: usage, numbers, the fixed driver, kernels."""
    parts = ["driver", "unloaded", *(["second"] if request.second else [])]
    texts = [_body(template(f"python/{name}.py")) for name in parts]
    start = template("python/driver.py").split("# <cut>")[0].replace("<about>\n", header(request))
    kernels = [_kernel_text(kernel) for kernel in _kernels(request)]
    numbers = _numbers(request.model)
    return "\n\n".join([start.strip(), numbers, *texts, *kernels]) + "\n"


def check_text(format_name: str) -> str:
    """Source of check.py for a format, with the maps of templates/python/check_FORMAT.py."""
    before, after = re.split(
        r"# <maps>.*?# </maps>\n", template("python/check.py"), flags=re.DOTALL
    )
    return f"{before}{_body(template(f'python/check_{format_name}.py'))}\n{after}"


check_numpy = run_python


def _body(text: str) -> str:
    """A template without its docstring and the imports that only linters need."""
    return text.split("# </cut>\n")[1].strip()


def _kernels(request: Request) -> list[ca.Function]:
    moving = [kernels.base(request.model.trunk.head), kernels.rates(), kernels.report()]
    closed = [kernels.turn(), kernels.spiral()]
    second = [kernels.second_along(kernel) for kernel in moving] if request.second else []
    return [*(kernels.with_slopes(kernel) for kernel in moving + closed), *second]


def _kernel_text(kernel: ca.Function) -> str:
    """Source of a kernel; its choices keep the type of the inputs, such as single precision."""
    lines: list[str] = []
    constants: set[str] = set()
    for line in python_source(kernel, kernel.name(), namespace=True).splitlines():
        name, _, value = line.strip().partition(" = ")
        choice = re.fullmatch(r"xp\.where\((\w+), (\w+), 0\.0\)", value)
        if choice:
            chosen = f"zero + {choice[2]}" if choice[2] in constants else choice[2]
            line = f"    {name} = xp.where({choice[1]}, {chosen}, zero)"
        (constants.add if re.fullmatch(r"-?[\d.]+(e-?\d+)?", value) else constants.discard)(name)
        lines.append(line)
    if any("zero" in line for line in lines):
        lines.insert(1, "    zero = 0.0 * i0[0]")
    return "\n".join(lines)


def _numbers(model: Model) -> str:
    """Constants of the module, with the names of `Tables` in capitals."""
    tables, layout, loads = model.tables, model.layout, model.loads
    defaults = {"gravity": (loads.gravity,), "tip_force": loads.tip_force}
    if layout.contact:
        defaults |= {"contact_force": loads.contact_force, "contact_couple": loads.contact_couple}
    lines = [
        "# Numbers of this trunk, in SI units.",
        f"MUSCLES = {_rows([python_literal(muscle) for muscle in layout.muscles], '(', ')', '')}",
        f"INPUTS = {_slices(layout.inputs)}",
        f"OUTPUTS = {_slices({name: layout.outputs[name] for name in OUTPUTS})}",
        f"DEFAULTS = {defaults!r}",
        _array("Z", np.array(model.Z)),
    ]
    names = {field.name: field.name.upper() for field in fields(tables)} | {"b": "WEIGHTS"}
    del names["reach"]  # only for a start from the unloaded shape in closed form
    lines += [_array(name, getattr(tables, field)) for field, name in names.items()]
    return "\n".join(lines)


def _slices(slices: dict[str, slice]) -> str:
    items = [f'    "{name}": slice({at.start}, {at.stop}),' for name, at in slices.items()]
    return "\n".join(["{", *items, "}"])


def _array(name: str, values: np.ndarray) -> str:
    numbers = [repr(value) for value in values.ravel().tolist()]
    shape = f".reshape{values.shape}" if values.ndim > 1 else ""
    return f"{name} = np.array({_rows(numbers, '[', ']')}){shape}"


def _rows(items: list[str], start: str, end: str, indent: str = "    ") -> str:
    """Items in brackets, as many on a line as fit."""
    one = f"{start}{', '.join(items)}{',' if len(items) == 1 else ''}{end}"
    if len(one) < WIDTH - 30:
        return one
    lines, line = [], "   "
    for item in items:
        if len(line) + len(item) + 2 > WIDTH:
            lines.append(line)
            line = "   "
        line += f" {item},"
    return "\n".join([start, *lines, line, end])

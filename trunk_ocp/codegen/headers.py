"""Templates, and the header that describes an export and the order of its numbers."""

from __future__ import annotations

from pathlib import Path

from .._support.provenance import versions
from .escaping import in_comment
from .request import Request
from .shape_model import OUTPUTS

TEMPLATES = Path(__file__).parent / "templates"

_PARTS = {
    "activation": "of the muscles in order; negative values contract",
    "head": "psi_Z, psi_Y in radians",
    "gravity": "in m/s^2, along +Z, which points down",
    "tip_force": "V at the tip in N, fixed in space",
    "contact_force": "W in N, distributed evenly over the contact region",
    "contact_couple": "L in N m, distributed in the same way",
    "position": "r of the centerline in m",
    "directors": "d_1, d_2, d_3 in space axes; d_3 points along the trunk",
    "strain": "extension zeta; curvature u_1, u_2, u_3 in 1/m, in the directors",
    "moment": "internal moment m in N m, in the directors; loaded shapes only",
}


def template(name: str) -> str:
    """Text of a file in the folder `templates`."""
    return (TEMPLATES / name).read_text(encoding="utf-8")


def header(request: Request) -> str:
    """Description of an export and the order of its numbers, in lines of at most 96 characters."""
    model, layout = request.model, request.model.layout
    contact = model.loads.contact_from
    name = in_comment(model.trunk.name)
    lines = [
        f"Shape of the trunk '{name}' at {layout.points} point(s) along it.",
        f"Made by trunk_ocp {versions()['trunk_ocp']} with {len(model.mesh.widths)} collocation "
        f"elements of degree {model.mesh.degree}.",
        "",
        *_wrapped("Z in m: ", [f"{Z:g}" for Z in model.Z]),
        f"Contact from Z = {contact:g} m." if contact is not None else "No contact region.",
        "",
        f"x, {layout.size} numbers, counted from 0:",
        *(f"  {_range(where)}  {name}: {_PARTS[name]}" for name, where in layout.inputs.items()),
        *_wrapped("Muscles: ", [in_comment(muscle) for muscle in layout.muscles]),
        "",
        f"y, {sum(OUTPUTS.values())} numbers for each point in turn:",
        *(f"  {_range(where)}  {name}: {_PARTS[name]}" for name, where in layout.outputs.items()),
    ]
    return "\n".join(line.rstrip() for line in lines) + "\n"


def _range(where: slice) -> str:
    return f"{where.start:3d} .. {where.stop - 1:3d}" if where.stop > where.start else "     none"


def _wrapped(start: str, words: list[str]) -> list[str]:
    lines = [start]
    for word in words:
        if len(lines[-1]) + len(word) > 90:
            lines.append("  ")
        lines[-1] += word + " "
    return lines


def commented(text: str, mark: str) -> str:
    """Lines of text as comments that start with `mark`."""
    return "".join(f"{mark} {line}".rstrip() + "\n" for line in text.splitlines())

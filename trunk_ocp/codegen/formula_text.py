"""The formulas of one muscle as text: a SymPy module and a LaTeX page, from the same expressions.

This module needs SymPy; `formulas` imports it on demand.
"""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Iterable, Sequence
from importlib.metadata import version

from ..model.anatomy import Muscle, Trunk
from . import closed_forms as forms
from .escaping import in_latex, python_literal
from .headers import template
from .notation import SCALARS, Formula, tex

MAX_ROW = 260
"""Characters of LaTeX in one row; a longer sum is broken."""

_NAMES_BY_UNIT = {
    "m": "R_0 R_1 R_2",
    "rad": "Theta_1 Theta_2 alpha_2",
    "m^{-1}": "k h c_1_gamma c_2_gamma c_3_gamma",
    "m^2": "delta_0",
    "m^3": "delta_1 delta_3",
}
_UNITS = {name: unit for unit, names in _NAMES_BY_UNIT.items() for name in names.split()}
_FIBER = {
    "radial": "Radial fibers stay across the axis in spite of the taper (eq.~(19)); their direction"
    r" $\mathbf{D}$ enters eq.~(6) by",
    "straight": r"Without taper the fiber direction $\mathbf{D}$ of eq.~(9) enters eq.~(6) by",
    "tapered": r"The fiber direction $\mathbf{D}$ follows the taper, $\tan\phi=kR$ (eq.~(22)), and"
    " enters eq.~(6) by",
    "helix": r"The helix has $\tan\tilde{\alpha}=hR$ (eq.~(21)), and the fiber direction"
    r" $\mathbf{D}$ of eq.~(9) enters eq.~(6) by",
}
_FIBER |= dict.fromkeys(
    ("steep", "gentle", "even"),
    r"The helix has $\tan\tilde{\alpha}=hR$ (eq.~(21)) and the taper $\tan\phi=kR$ (eq.~(22)), so"
    r" that the fiber direction $\mathbf{D}$ of eq.~(9) enters eq.~(6) by",
)
_HELIX = (
    r"Here $h=c_{\tilde{\alpha}}$ of eq.~(A.4); it and $\delta_3$ change sign with the hand of the"
    " helix."
)
_REMARK = {
    "radial": r"Radial fibers bend and lengthen the trunk by way of $\nu$ alone.",
    "steep": r"The helix is steeper than the taper, $|h|>k$, so that $A=\sqrt{k^2-h^2}=iq$ of"
    rf" eq.~(A.4) is imaginary; this is its $\delta_3$ in real form. {_HELIX}",
    "gentle": _HELIX,
    "helix": f"{_HELIX} These are the limits of eq.~(A.4) without taper.",
    "straight": "These are the limits of eq.~(A.4) without taper.",
    "even": f"{_HELIX} With $|h|=k$, $A$ of eq.~(A.4) is zero; these are the limits.",
}


def sympy_module(trunk: Trunk, muscle: Muscle) -> str:
    """Python source of `trunk_formulas.py`."""
    tapered, anatomy = trunk.taper_rate > 0, forms.anatomy_values(trunk, muscle)
    coefficients = forms.coefficient_formulas(forms.kind(trunk, muscle))
    v, a, v_gamma, a_gamma = (formula.python for formula in forms.axis())
    axis = [v, "kappa = sqrt(v.dot(v))", a]
    axis += [v_gamma, "kappa_gamma = a.dot(v_gamma)", a_gamma]
    stretched, spiral = forms.stretched(tapered), forms.spiral()
    director = [formula for formula in spiral if formula.name == "d_i"]
    others = [formula for formula in spiral if formula.name != "d_i"]
    start, end = trunk.edges[muscle.segment : muscle.segment + 2]
    words = _words(trunk, muscle) | {
        "anatomy": python_literal(trunk.name),
        "muscle": python_literal(muscle.name),
        "span": ", ".join(repr(float(Z)) for Z in (start, end, trunk.length)),
        "values": "\n".join(f'    "{name}": {float(value)!r},' for name, value in anatomy.items()),
        "given": ", ".join(anatomy),
        "given_names": " ".join(anatomy),
        "coefficients": _assignments(coefficients),
        "coefficient_names": "\n".join(f'        "{f.name}": {f.name},' for f in coefficients),
        "axis": "\n".join(f"    {line}" for line in axis),
        "spiral": _assignments([*stretched, *others]),
        "director": _assignments(director, 8),
        "slopes": _assignments(forms.spiral_slopes()),
        "straight": _assignments([*stretched, *forms.straight_slopes(tapered)]),
    }
    return _fill(template("formulas/trunk_formulas.py.txt"), words)


def _assignments(formulas: Iterable[Formula], indent: int = 4) -> str:
    """Lines of a function, with each source as a comment before its first formula."""
    lines, source = [], ""
    for formula in formulas:
        if formula.source != source:
            source = formula.source
            lines.append(f"# {source}")
        lines += _wrapped(formula.python)
    return "\n".join(" " * indent + line for line in lines)


def _wrapped(assignment: str) -> list[str]:
    """An assignment, in parentheses over several lines if it is long."""
    if len(assignment) <= 92:
        return [assignment]
    name, expression = assignment.split(" = ", 1)
    return [f"{name} = (", *(f"    {line}" for line in textwrap.wrap(expression, 86)), ")"]


def latex_page(trunk: Trunk, muscle: Muscle) -> str:
    """LaTeX source of `trunk_formulas.tex`."""
    tapered, kind = trunk.taper_rate > 0, forms.kind(trunk, muscle)
    parts = {formula.name: formula for formula in forms.coefficient_formulas(kind)}
    factors = [formula for name, formula in parts.items() if name.startswith("delta")]
    slopes = {formula.name: formula for formula in forms.spiral_slopes()}
    spiral = {formula.name: formula for formula in forms.spiral()}
    along = {formula.name: formula for formula in forms.stretched(tapered)}
    v, a, v_gamma, a_gamma = forms.axis()
    words = _words(trunk, muscle) | {
        "fiber": _FIBER[kind],
        "products": _gather([forms.fiber(kind)]),
        "factors": _lines(factors),
        "parts": _parts(parts),
        "remark": f"{_REMARK[kind]}\n" if kind in _REMARK else "",
        "coefficients": _pairs([parts[f"{n}_gamma"] for n in ("zeta", "c_3", "c_1", "c_2")]),
        "table": _table(trunk, muscle),
        "axis": _row(_equation(v), r"\kappa = |\mathbf{v}|", _equation(a)),
        "along": _gather([[along["s"], along["f"], along["f_1"]], [along["ell"], spiral["theta"]]]),
        "lengths": _pairs([spiral["P"], spiral["Q"]], ","),
        "spiral": _lines([spiral["d_i"], spiral["rho"]]),
        "axis_slopes": _row(
            _equation(v_gamma),
            r"\kappa_\gamma = \mathbf{a}\cdot\mathbf{v}_\gamma",
            _equation(a_gamma),
        ),
        "slopes": _lines([slopes["theta_gamma"], slopes["rho_gamma"]]),
        "length_slopes": _lines([slopes["P_kappa"], slopes["Q_kappa"]], ","),
        "straight": _gather([forms.straight_slopes(tapered)]),
        "rest": _rest(trunk, muscle),
    }
    words |= {name: in_latex(words[name]) for name in ("muscle", "anatomy")}
    return _fill(template("formulas/trunk_formulas.tex"), words)


def _equation(formula: Formula, equals: str = "=") -> str:
    return f"{formula.tex_name} {equals} {formula.tex}"


def _parts(formulas: dict[str, Formula]) -> str:
    """Formulas that the radial factors use, if any."""
    rows = ("h", "B_1", "B_2"), ("q", "A", "C_1", "C_2"), ("T_h", "T_k")
    present = [[formulas[name] for name in row if name in formulas] for row in rows]
    shown = _gather([row for row in present if row], ",")
    if not any(present):
        return "eq.~(A.4) follows:"
    return (
        f"eq.~(A.4) follows. With\n\\begin{{gather*}}\n{shown}\n\\end{{gather*}}\nits factors are"
    )


def _lines(formulas: Sequence[Formula], end: str = ".") -> str:
    """Rows of an align environment, one formula each; a long sum continues in the next row."""
    rows = []
    for formula in formulas:
        if len(formula.tex) <= MAX_ROW:
            rows.append(_equation(formula, "&="))
            continue
        *first, last = (tex(term) for term in formula.expression.args)
        rows.append(f"{formula.tex_name} &= {' + '.join(first)}\\\\\n&\\quad + {last}")
    return ",\\\\\n".join(rows) + end


def _pairs(formulas: Sequence[Formula], end: str = ".") -> str:
    """Rows of an align environment, two formulas each."""
    cells = [_equation(formula, "&=") for formula in formulas]
    rows = [", & ".join(cells[i : i + 2]) for i in range(0, len(cells), 2)]
    return ",\\\\\n".join(rows) + end


def _gather(rows: Sequence[Sequence[Formula]], end: str = ".") -> str:
    """Rows of a gather environment."""
    return ",\\\\\n".join(_row(*map(_equation, row))[:-1] for row in rows) + end


def _row(*equations: str) -> str:
    return ",\\qquad\n".join(equations) + "."


def _table(trunk: Trunk, muscle: Muscle) -> str:
    """Numbers of the muscle, in two columns: anatomy and coefficients."""
    start, end = trunk.edges[muscle.segment : muscle.segment + 2]
    values = forms.coefficient_values(trunk, muscle)
    left = [("Z_1", start, "m"), ("Z_2", end, "m")]
    left += [
        (SCALARS[n], x, _UNITS.get(n, "")) for n, x in forms.anatomy_values(trunk, muscle).items()
    ]
    derived = [n for n in values if n == "h" or n.startswith("delta") or n.endswith("_gamma")]
    right = [(SCALARS[n], float(values[n]), _UNITS.get(n, "")) for n in derived]
    empty = ("", math.nan, "")
    rows = max(len(left), len(right))
    left += [empty] * (rows - len(left))
    right += [empty] * (rows - len(right))
    pairs = zip(left, right, strict=True)
    return "\n".join(f"{_cells(*one)} & {_cells(*two)} \\\\" for one, two in pairs)


def _cells(symbol: str, value: float, unit: str) -> str:
    if not symbol:
        return "& &"
    shown = rf"$\mathrm{{{unit}}}$" if unit else ""
    return f"${symbol}$ & ${_number(value)}$ & {shown}"


def _number(value: float) -> str:
    """Six digits, with a power of ten if the number is very large or small."""
    text = f"{value:.6g}"
    if "e" in text:
        mantissa, exponent = text.split("e")
        return rf"{mantissa}\times 10^{{{int(exponent)}}}"
    return text


def _rest(trunk: Trunk, muscle: Muscle) -> str:
    slopes = forms.rest_slopes(trunk, muscle)
    end = trunk.edges[muscle.segment + 1]
    rows = [
        (r"\boldsymbol{\theta}_\gamma(Z_2)", "turn", "rad"),
        (r"\mathbf{r}_\gamma(Z_2)", "end", "m"),
    ]
    if end < trunk.length:
        rows.append((rf"\mathbf{{r}}_\gamma(L),\ L={trunk.length:g}\,\mathrm{{m}}", "tip", "m"))
    return "\n".join(
        f"${name}$ & {' & '.join(f'${_number(x + 0.0)}$' for x in slopes[key])} & {unit} \\\\"
        for name, key, unit in rows
    )


def _words(trunk: Trunk, muscle: Muscle) -> dict[str, str]:
    architecture: str = muscle.architecture
    if architecture == "helical":
        architecture = "right-handed helical" if muscle.helix > 0 else "left-handed helical"
    return {
        "muscle": muscle.name,
        "anatomy": trunk.name,
        "version": version("trunk_ocp"),
        "architecture": architecture,
        "side": {"R": "right", "L": "left"}[muscle.side],
        "segment": str(muscle.segment + 1),
    }


def _fill(text: str, words: dict[str, str]) -> str:
    """Template with each <<word>> replaced; in one pass, so that replacements are not expanded."""
    return re.sub(r"<<(\w+)>>", lambda match: words[match[1]], text)

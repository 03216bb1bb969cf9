"""Names in the formulas of one muscle, and printing of formulas as LaTeX and as Python.

Vectors are non-commutative symbols, so that they print after their factors; `a_x_e3` is the cross
product of `a` and `e_3`. Formulas are built without evaluation, so that terms print in the order
in which they were written and a reader recognizes them.
"""

from __future__ import annotations

import ast
import re
from dataclasses import dataclass

import sympy as sp

PLAIN = "R_0 R_1 R_2 k h q A B_1 B_2 C_1 C_2 T_h T_k R Z Z_1 s f f_1 c_1 c_2 c_3 P Q m a_i a_3"
"""Names that LaTeX shows as they are."""
SCALARS = {name: name for name in PLAIN.split()} | {
    "Theta_1": r"\Theta_1",
    "Theta_2": r"\Theta_2",
    "alpha_2": r"\tilde{\alpha}_2",
    "nu": r"\nu",
    "D_ZZ": "D_Z^2",
    "D_ThetaZ": r"D_\Theta D_Z",
    "delta_0": r"\delta_0",
    "delta_1": r"\delta_1",
    "delta_3": r"\delta_3",
    "zeta_gamma": r"\hat{\zeta}_\gamma",
    "c_1_gamma": r"c_{1,\gamma}",
    "c_2_gamma": r"c_{2,\gamma}",
    "c_3_gamma": r"c_{3,\gamma}",
    "ell": r"\ell",
    "zeta": r"\hat{\zeta}",
    "kappa": r"\kappa",
    "theta": r"\theta",
    "P_kappa": r"P_\kappa",
    "Q_kappa": r"Q_\kappa",
    "kappa_gamma": r"\kappa_\gamma",
    "a_3_gamma": r"a_{3,\gamma}",
}
VECTORS = {
    "c": r"\mathbf{c}",
    "c_gamma": r"\mathbf{c}_\gamma",
    "v": r"\mathbf{v}",
    "v_gamma": r"\mathbf{v}_\gamma",
    "a": r"\mathbf{a}",
    "a_gamma": r"\mathbf{a}_\gamma",
    "e_i": r"\mathbf{e}_i",
    "e_3": r"\mathbf{e}_3",
    "a_x_ei": r"\mathbf{a}\times\mathbf{e}_i",
    "a_x_e3": r"\mathbf{a}\times\mathbf{e}_3",
    "a_x_agamma": r"\mathbf{a}\times\mathbf{a}_\gamma",
    "agamma_x_e3": r"\mathbf{a}_\gamma\times\mathbf{e}_3",
    "vgamma_x_e3": r"\mathbf{v}_\gamma\times\mathbf{e}_3",
    "d_i": r"\mathbf{d}_i",
    "rho": r"\boldsymbol{\rho}",
    "theta_gamma": r"\boldsymbol{\theta}_\gamma",
    "rho_gamma": r"\boldsymbol{\rho}_\gamma",
    "theta_gamma_straight": r"\boldsymbol{\theta}_\gamma",
    "rho_gamma_straight": r"\boldsymbol{\rho}_\gamma",
}
SYMBOL = {name: sp.Symbol(name, real=True) for name in SCALARS}
SYMBOL |= {name: sp.Symbol(name, commutative=False) for name in VECTORS}
_TEX = {SYMBOL[name]: tex for name, tex in (SCALARS | VECTORS).items()}


@dataclass(frozen=True)
class Formula:
    """`name` = `expression`, an expression in the names of formulas before it.

    Attributes
    ----------
    source : str
        Equations of the paper that it comes from, or what it is.
    """

    name: str
    expression: sp.Expr
    source: str

    @property
    def tex_name(self) -> str:
        """Left side in LaTeX."""
        return (SCALARS | VECTORS)[self.name]

    @property
    def tex(self) -> str:
        """Right side in LaTeX."""
        return tex(self.expression)

    @property
    def python(self) -> str:
        """One assignment of Python, with SymPy's names."""
        text = re.sub(r"\*\*1\b", "", sp.sstr(self.expression, order="none"))
        plain = ast.unparse(ast.parse(f"{self.name} = {text}"))  # without redundant parentheses
        return plain.replace(" ** ", "**")


def tex(expression: sp.Expr) -> str:
    """LaTeX of an expression, printed by SymPy, without parentheses around single symbols."""
    text = sp.latex(
        expression,
        order="none",
        symbol_names=_TEX,
        inv_trig_style="full",
        ln_notation=True,
    )
    text = re.sub(r"\\(sin|cos|tan|ln)\{\\left\(([^ ]+) \\right\)\}", r"\\\1 \2", text)
    text = re.sub(r"(\\(?:sin|cos) \\theta) (?=\\mathbf)", r"\1\\, ", text)
    text = text.replace(r" 1 \frac{1}", r" \frac{1}")  # of `_alone`
    return text.replace(r"\operatorname{atanh}", r"\operatorname{artanh}")


def names(text: str) -> tuple[sp.Symbol, ...]:
    """Symbols of the names in `text`."""
    return tuple(SYMBOL[name] for name in text.split())


def total(*terms: sp.Expr) -> sp.Expr:
    """Sum whose terms print in the order given."""
    return sp.Add(*terms, evaluate=False)

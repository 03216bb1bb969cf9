"""Formulas of one muscle: LaTeX to paste into a paper, and a SymPy module with a self-check.

Both are printed from the expressions of `closed_forms`. SymPy is an optional dependency.
"""

from __future__ import annotations

import re
import shutil
import tempfile
from importlib import import_module, util
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from .._support.wording import suggestion
from ..errors import InputError
from ..model.activation import radial_integrals, strain_matrix, strains
from ..model.anatomy import Muscle, Trunk
from ..model.quaternions import directors
from ..rod.unloaded import unloaded_states
from .headers import template
from .request import CheckError, Request, ToolMissingError
from .run_checks import run, run_python

if TYPE_CHECKING:
    from types import ModuleType

SYMPY_MISSING = "Formulas need SymPy: pip install sympy"
LATEX_MISSING = (
    "trunk_formulas.tex was not compiled, as LaTeX is not installed; get it with: apt-get install "
    "texlive-latex-base"
)
LATEX = {
    "pdflatex": ("-interaction=nonstopmode", "-halt-on-error"),
    "lualatex": ("-interaction=nonstopmode", "-halt-on-error"),
    "tectonic": ("--keep-logs",),
}


def write_sympy(request: Request) -> dict[str, str | bytes]:
    """SymPy module of the muscle `request.muscle`, with its self-check and check file.

    Raises
    ------
    InputError
        If the muscle is not one of the trunk.
    ToolMissingError
        If SymPy is not installed.
    """
    trunk, muscle, text = request.model.trunk, _muscle(request), _text()
    return {
        "trunk_formulas.py": text.sympy_module(trunk, muscle),
        "check_formulas.py": template("formulas/check_formulas.py"),
        "check_formulas.csv": _check_rows(trunk, muscle),
    }


def write_latex(request: Request) -> dict[str, str | bytes]:
    """LaTeX page of the muscle `request.muscle`; raises as `write_sympy` does."""
    return {"trunk_formulas.tex": _text().latex_page(request.model.trunk, _muscle(request))}


def check_sympy(folder: Path) -> str:
    """Run the self-check of the SymPy module in `folder`; returns its output.

    Raises
    ------
    CheckError, ToolMissingError
    """
    if util.find_spec("sympy") is None:
        raise ToolMissingError(SYMPY_MISSING)
    return run_python(folder, "check_formulas.py")


def check_latex(folder: Path) -> str:
    """Compile `trunk_formulas.tex` of `folder` in a scratch folder; no line may be too wide.

    Raises
    ------
    CheckError, ToolMissingError
    """
    name = next((name for name in LATEX if shutil.which(name)), None)
    if name is None:
        raise ToolMissingError(LATEX_MISSING)
    with tempfile.TemporaryDirectory() as scratch:
        shutil.copy(folder / "trunk_formulas.tex", scratch)
        run([name, *LATEX[name], "trunk_formulas.tex"], Path(scratch))
        log = Path(scratch, "trunk_formulas.log").read_text(errors="replace")
    wide = re.findall(r"^Overfull.*$", log, re.MULTILINE)
    if wide:
        raise CheckError(f"trunk_formulas.tex: {wide[0]}")
    return f"formulas compile with {name}"


def _text() -> ModuleType:
    """Module `formula_text`, which needs SymPy."""
    try:
        import_module("sympy")
    except ImportError:
        raise ToolMissingError(SYMPY_MISSING) from None
    return import_module(".formula_text", __package__)


def _muscle(request: Request) -> Muscle:
    trunk = request.model.trunk
    for muscle in trunk.subdomains:
        if muscle.name == request.muscle:
            return muscle
    if request.muscle is None:
        raise InputError(f"--muscle: formulas are for one muscle; {trunk.name} has {_all(trunk)}.")
    hint = suggestion(request.muscle, trunk.muscles) or f" It has {_all(trunk)}."
    raise InputError(f"--muscle {request.muscle[:100]!r}: not a muscle of {trunk.name}.{hint}")


def _all(trunk: Trunk) -> str:
    """Names of the muscles in short: R1- and L1- dl, ovo; R2- dl."""
    groups: dict[tuple[int, str], list[str]] = {}
    for muscle in trunk.subdomains:
        groups.setdefault((muscle.segment, muscle.side), []).append(muscle.group)
    sides: dict[tuple[int, tuple[str, ...]], list[str]] = {}
    for (segment, side), names in groups.items():
        sides.setdefault((segment, tuple(names)), []).append(f"{side}{segment + 1}-")
    parts = [f"{' and '.join(at)} {', '.join(names)}" for (_, names), at in sorted(sides.items())]
    return "; ".join(parts) or "no muscles"


def _check_rows(trunk: Trunk, muscle: Muscle) -> str:
    """Check file, in the order that check_formulas.py documents."""
    column = trunk.subdomains.index(muscle)
    start, end = trunk.edges[muscle.segment : muscle.segment + 2]
    inside = start + (end - start) * np.array([0.2, 0.55, 0.85])
    Z = np.unique([start, *inside, end, (end + trunk.length) / 2, trunk.length])
    head, rng = np.array([0.3, -0.2]), np.random.default_rng(7)
    activations = rng.uniform(-1, 0.3, (5, len(trunk.subdomains)))
    activations[:2] = 0.0  # at rest
    activations[1, column] = -0.4  # alone
    change = np.abs(strains(trunk, activations)[..., 0] - 1).max()
    activations *= min(1.0, 0.4 / max(change, 0.4))  # keeps every extension positive
    coefficients = [
        *radial_integrals(trunk, muscle),
        *strain_matrix(trunk)[muscle.segment, :, column],
    ]
    lines = []
    for activation in activations:
        strain = strains(trunk, activation)[muscle.segment]
        pose = _pose(trunk, activation, head, np.append(Z, start))
        slope = _slope(trunk, activation, head, Z, column)
        for i, at in enumerate(Z):
            row = [at, *strain, *pose[-1], *pose[i], *slope[i], *coefficients]
            lines.append(",".join(f"{float(x):.17g}" for x in row))
    return "\n".join(lines) + "\n"


def _pose(trunk: Trunk, activation: np.ndarray, head: np.ndarray, Z: np.ndarray) -> np.ndarray:
    """Position and directors (..., n, 12) of the unloaded trunk."""
    r, q = unloaded_states(trunk, activation, head, Z)
    rows = directors(tuple(np.moveaxis(q, -1, 0)))
    return np.concatenate([r, *(np.stack(row, axis=-1) for row in rows)], axis=-1)


def _slope(
    trunk: Trunk, activation: np.ndarray, head: np.ndarray, Z: np.ndarray, column: int
) -> np.ndarray:
    """Derivative (n, 12) of `_pose` by one activation: central differences of order 8.

    The step rotates the segment by a few hundredths of a radian, so that the error is round-off.
    """
    segment = trunk.subdomains[column].segment
    extension, *c = strains(trunk, activation)[segment]
    slopes = strain_matrix(trunk)[segment, :, column]
    start, end = trunk.edges[segment : segment + 2]
    rate = np.linalg.norm(slopes[0] * np.array(c) + extension * slopes[1:])
    rate *= (end - start) / float(trunk.taper(end))
    step = 0.04 / max(float(rate), 0.5)
    steps = np.arange(1, 5)
    weights = np.array([4 / 5, -1 / 5, 4 / 105, -1 / 280])
    changes = np.zeros((8, len(trunk.subdomains)))
    changes[:, column] = step * np.concatenate([steps, -steps])
    poses = _pose(trunk, activation + changes, head, Z)
    return np.tensordot(weights, poses[:4] - poses[4:], axes=1) / step

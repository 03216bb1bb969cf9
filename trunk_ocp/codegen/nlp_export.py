"""Export of a motion's NLP for other solvers: objective, constraints, sparse derivatives.

Six functions with CasADi's names, so that CasADi's `nlpsol` takes the compiled library as it is:

    nlp         (x, p)                ->  f, g
    nlp_f       (x, p)                ->  f
    nlp_g       (x, p)                ->  g
    nlp_grad_f  (x, p)                ->  f, gradient of f
    nlp_jac_g   (x, p)                ->  g, sparse Jacobian of g
    nlp_hess_l  (x, p, lam_f, lam_g)  ->  upper triangle of the Hessian of lam_f f + lam_g . g

The functions contain the motion's parameters; p is a change of them, zero by default. Lengths are
in units of L, moments in E I(0) / L, as in `nlp.window`; `nlp_export_layout` names the indices.
"""

from __future__ import annotations

import json
import re
import tempfile
from dataclasses import dataclass
from functools import cached_property
from importlib.metadata import version
from pathlib import Path

import casadi as ca
import numpy as np

from ..errors import InputError
from ..nlp.ipopt import Optimizer
from ..nlp.window import Window
from ..planning.decided_steps import DecidedSteps
from ..planning.options import Options, first_mesh
from ..planning.planning_run import PlanningRun
from .casadi_files import saved
from .escaping import in_comment
from .headers import template
from .nlp_export_layout import layout
from .request import Request
from .run_checks import run_c, run_mex, run_python

CHECK = "nlp_check.csv"
PERTURBATION = 0.05
"""Standard deviation of the check file's random point from the start, in the NLP's units."""


@dataclass(frozen=True, eq=False)
class Exported:
    """A motion's NLP as the planner builds it for a horizon, with the passive trunk as start."""

    window: Window
    start: np.ndarray
    name: str

    @cached_property
    def functions(self) -> dict[str, ca.Function]:
        """The six functions by name."""
        nlp = self.window.nlp
        x, p = ca.MX.sym("x", nlp.size[0]), ca.MX.sym("p", self.window.parameters.size)
        lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", nlp.size[1])
        at, problem, first = [x, ca.DM(self.window.parameters) + p], nlp.as_casadi(), ["x", "p"]
        both = ca.Function("both", [problem["x"], problem["p"]], [problem["f"], problem["g"]])
        f, g = both.call(at, True, False)
        functions = [
            ca.Function("nlp", [x, p], [f, g], first, ["f", "g"]),
            ca.Function("nlp_f", [x, p], [f], first, ["f"]),
            ca.Function("nlp_g", [x, p], [g], first, ["g"]),
        ]
        for derivative in nlp.derivatives().values():
            more = [lam_f, lam_g] if derivative.n_in() == 4 else []
            outputs = derivative.call([*at, *more], True, False)
            names = derivative.name_in(), derivative.name_out()
            functions.append(ca.Function(derivative.name(), [x, p, *more], outputs, *names))
        return {function.name(): function for function in functions}

    @cached_property
    def bounds(self) -> dict[str, np.ndarray]:
        """Bounds of x and g: lbx, ubx, lbg, ubg."""
        return self.window.bounds

    def checks(self) -> str:
        """The check file: values of `SeparableNLP` itself at the start and at a random point.

        One line each: x, f, g, gradient, nonzeros of the Jacobian, lam_f, lam_g, nonzeros of
        the Hessian, column by column.
        """
        nlp, p = self.window.nlp, self.window.parameters
        derivatives, rng = nlp.derivatives(), np.random.default_rng(0)
        lines = []
        for x in (self.start, self.start + PERTURBATION * rng.normal(size=self.start.size)):
            lam = rng.normal(size=1 + nlp.size[1])
            f, gradient = derivatives["grad_f"](x, p)
            g, jacobian = derivatives["jac_g"](x, p)
            hessian = derivatives["hess_lag"](x, p, lam[0], lam[1:])
            parts = [x, f, g, gradient, jacobian.nonzeros(), lam, hessian.nonzeros()]
            lines.append(_row(np.concatenate([np.ravel(np.asarray(part)) for part in parts])))
        return "\n".join(lines) + "\n"

    def tables(self) -> dict[str, str]:
        """Files of every format: layout, bounds, start, parameters and the check file."""
        lower, upper, low, high = (self.bounds[name] for name in ("lbx", "ubx", "lbg", "ubg"))
        return {
            "layout.json": json.dumps(layout(self.window, self.name), indent=1) + "\n",
            "unknowns.csv": _table(np.stack([lower, upper, self.start], axis=1)),
            "rows.csv": _table(np.stack([low, high], axis=1)),
            "parameters.csv": _table(self.window.parameters[:, None]),
            CHECK: self.checks(),
        }


def export_nlp(request: Request) -> Exported:
    """The NLP of a request's motion.

    Raises
    ------
    InputError
        If the request has no motion, or one that has to keep clear of bodies.
    """
    motion = request.motion
    if motion is None:
        raise InputError(
            f"--what constraints: {request.name} is an anatomy; expected a problem, whose motion "
            "has constraints. Name one, such as pick-fruit."
        )
    if motion.contact:
        raise InputError(
            f"--what constraints: {request.name} has to keep clear of bodies, and which gaps "
            "matter is found only while it is planned; expected a problem without [contact]."
        )
    options = Options()
    planning = PlanningRun(
        motion, first_mesh(motion, options), "horizon", len(motion.steps), options, Optimizer()
    )
    window = planning.window(0, motion.steps, DecidedSteps())
    passive = np.zeros((len(motion.steps), planning.controls))
    return Exported(window, planning.packed(window, passive), request.name)


# --- formats -------------------------------------------------------------------------


def write_nlp_casadi(request: Request) -> dict[str, str | bytes]:
    """One CasADi file for each of nlp and its derivatives, and programs that load them."""
    exported = export_nlp(request)
    names = ("nlp", "nlp_grad_f", "nlp_jac_g", "nlp_hess_l")
    functions = {f"{name}.casadi": saved(exported.functions[name]) for name in names}
    return functions | _texts(exported, "solve.py", "check.py")


def write_nlp_c(request: Request) -> dict[str, str | bytes]:
    """C99 by CasADi's code generator, bounds and start as arrays, example, check, CMake file."""
    exported = export_nlp(request)
    return _c_files(exported) | _texts(exported, "example.c", "check.c", "CMakeLists.txt")


def write_nlp_mex(request: Request) -> dict[str, str | bytes]:
    """A MEX gateway to the C export, with help, example and self-check.

    CasADi's own gateway would need 3.4 MB of stack for pick-fruit, and a macro in Octave.
    """
    exported = export_nlp(request)
    return _c_files(exported) | _texts(exported, "nlp_mex.c", "nlp.m", "nlp_example.m", "check.m")


def _texts(exported: Exported, *names: str) -> dict[str, str | bytes]:
    """Files from templates, and those of every format."""
    return {**{name: _template(name, exported) for name in names}, **exported.tables()}


def _c_files(exported: Exported) -> dict[str, str | bytes]:
    """nlp.c, nlp.h and nlp_data.c."""
    with tempfile.TemporaryDirectory() as folder:
        # Canonical: full matrices list their nonzeros too, so that readers need no special case.
        generator = ca.CodeGenerator("nlp.c", {"with_header": True, "force_canonical": True})
        for function in exported.functions.values():
            generator.add(function)
        generator.generate(f"{folder}/")
        code, header = (Path(folder, f"nlp.{end}").read_text() for end in "ch")
    arrays = {
        "lower": exported.bounds["lbx"],
        "upper": exported.bounds["ubx"],
        "start": exported.start,
        "row_lower": exported.bounds["lbg"],
        "row_upper": exported.bounds["ubg"],
    }
    data = [f"const double nlp_{name}[] = {{{_c(v)}}};\n" for name, v in arrays.items()]
    return {
        "nlp.c": _template("nlp.c", exported) + code,
        "nlp.h": _template("nlp.h", exported).replace("/* CasADi's declarations */\n", header),
        "nlp_data.c": _template("nlp_data.c", exported) + "\n".join(data),
    }


def _template(name: str, exported: Exported) -> str:
    """A template, with the values of an NLP filled in."""
    text = template(f"nlp/{name}")
    window = exported.window
    values = {
        "NAME": in_comment(exported.name),
        "VERSION": version("trunk_ocp"),
        "STEPS": len(window.steps),
        "UNKNOWNS": window.nlp.size[0],
        "ROWS": window.nlp.size[1],
        "PARAMETERS": window.parameters.size,
        "LENGTH": repr(float(window.length)),
        "MOMENT": repr(float(window.moment)),
        "FORCE": repr(float(window.force)),
    }
    return re.sub(r"@([A-Z]+)@", lambda match: str(values[match[1]]), text)


def _row(values: np.ndarray) -> str:
    return ",".join(format(value, ".17g") for value in values.tolist())


def _table(values: np.ndarray) -> str:
    return "".join(_row(row) + "\n" for row in values)


def _c(values: np.ndarray) -> str:
    """Numbers of a C array, eight per line."""
    texts = [repr(value).replace("inf", "INFINITY") for value in values.tolist()]
    return ",\n".join(", ".join(texts[i : i + 8]) for i in range(0, len(texts), 8))


check_nlp_casadi = run_python


def check_nlp_c(folder: Path) -> str:
    """Compile and run the self-check of a C export; returns its output, and raises as `run_c`."""
    return run_c(folder, "nlp.c", "nlp_data.c")


def check_nlp_mex(folder: Path) -> str:
    """Compile and run the self-check of a MEX export; returns its output, raises as `run_mex`."""
    return run_mex(folder, "nlp", "nlp_mex.c", "nlp.c", "nlp_data.c")

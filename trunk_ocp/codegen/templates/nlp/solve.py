"""Solve the motion @NAME@ with Ipopt, using only the exported files: python solve.py.

Exported by trunk_ocp @VERSION@. Each .casadi file holds one casadi.Function, loaded by
casadi.Function.load("nlp.casadi") - in MATLAB casadi.Function.load, in C++ casadi::Function::load:

    nlp         (x, p)                ->  f, g
    nlp_grad_f  (x, p)                ->  f, gradient of f
    nlp_jac_g   (x, p)                ->  g, sparse Jacobian of g
    nlp_hess_l  (x, p, lam_f, lam_g)  ->  upper triangle of the Hessian of lam_f f + lam_g . g

@STEPS@ time steps: @UNKNOWNS@ unknowns x, @ROWS@ constraints g. Lengths are in units of
@LENGTH@ m, forces of @FORCE@ N and moments of @MOMENT@ N m; angles are in rad, f is in m^2.
layout.json names every unknown, row and parameter. p is a change of the motion's @PARAMETERS@
parameters (parameters.csv), for example to move a target; its default is 0. The solution is written
to solution.csv, one number for each unknown.
"""

import json
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

HERE = Path(__file__).parent


def solver() -> ca.Function:
    """Ipopt with the exported derivatives."""
    nlp, gradient, jacobian, hessian = (
        ca.Function.load(str(HERE / f"{name}.casadi"))
        for name in ("nlp", "nlp_grad_f", "nlp_jac_g", "nlp_hess_l")
    )
    options: dict[str, Any] = {
        "grad_f": gradient,
        "jac_g": jacobian,
        "hess_lag": hessian,
        # There are many local optima; Ipopt's default of 0.1 leaves the start for worse ones.
        "ipopt.mu_init": 1e-6,
        # Multipliers of p would need another function.
        "no_nlp_grad": True,
        "calc_lam_p": False,
    }
    return ca.nlpsol("solver", "ipopt", nlp, options)


def main() -> None:
    """Solve, print the objective and the activations of the last step."""
    lower, upper, start = np.loadtxt(HERE / "unknowns.csv", delimiter=",", unpack=True)
    low, high = np.loadtxt(HERE / "rows.csv", delimiter=",", unpack=True)
    solution = solver()(x0=start, lbx=lower, ubx=upper, lbg=low, ubg=high)
    x = np.asarray(solution["x"]).ravel()
    print(f"objective {float(solution['f']):.10g}")
    layout = json.loads((HERE / "layout.json").read_text())
    last = [part for part in layout["x"] if part["name"] == "activation"][-1]
    for i, muscle in enumerate(layout["components"]["activations"], last["first"]):
        print(f"step {last['step']}, {muscle['name']}: {x[i]:.4f}")
    np.savetxt(HERE / "solution.csv", x)


if __name__ == "__main__":
    main()

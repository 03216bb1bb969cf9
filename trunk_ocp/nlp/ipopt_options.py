"""Option sets for Ipopt, and whether it has a linear solver."""

from __future__ import annotations

import contextlib
import io
from functools import cache
from typing import Any

import casadi as ca

from ..errors import SolverMissingError
from .outcome import CONVERGED_STATUSES

# One set for all motions, chosen by measurement on the three shipped ones. Most solves start
# from a good guess. A small initial barrier parameter and a small push away from bounds stay near
# it; Ipopt's defaults (0.1, 0.01) leave it and may end in a worse optimum.
DEFAULT_OPTIONS: dict[str, Any] = {
    "mu_init": 1e-6,
    "bound_push": 1e-5,
    "bound_frac": 1e-5,
    "mumps_pivot_order": 0,
    "mumps_scaling": 0,
    "print_level": 0,
    "sb": "yes",
}
# A re-plan starts at an optimum of nearly the same problem, multipliers included: stay there.
WARM_OPTIONS: dict[str, Any] = DEFAULT_OPTIONS | {
    "mu_init": 1e-8,
    "tol": 1e-6,
    "warm_start_init_point": "yes",
    "warm_start_bound_push": 1e-9,
    "warm_start_bound_frac": 1e-9,
    "warm_start_slack_bound_push": 1e-9,
    "warm_start_slack_bound_frac": 1e-9,
    "warm_start_mult_bound_push": 1e-9,
}
# A plan that has to leave a body starts outside the bounds on its gaps. A larger barrier parameter
# and pushes take half the iterations of the small ones above, to the same optima.
CONTACT_OPTIONS: dict[str, Any] = DEFAULT_OPTIONS | {
    "mu_init": 1e-3,
    "bound_push": 1e-3,
    "bound_frac": 1e-3,
}
# A plan made again with a few more gaps, or wider ones, starts from the multipliers of the plan
# before. With pushes as small as those of a re-plan, new rows take up to twice the iterations.
AGAIN_OPTIONS: dict[str, Any] = DEFAULT_OPTIONS | {
    "warm_start_init_point": "yes",
    "warm_start_bound_push": 1e-5,
    "warm_start_bound_frac": 1e-5,
    "warm_start_slack_bound_push": 1e-5,
    "warm_start_slack_bound_frac": 1e-5,
    "warm_start_mult_bound_push": 1e-5,
}
# For a plan that only serves as the start of another solve. It must be feasible all the same,
# because candidates are compared by their objectives.
ROUGH_OPTIONS: dict[str, Any] = DEFAULT_OPTIONS | {"tol": 1e-5, "constr_viol_tol": 1e-7}


@cache
def check_linear_solver(name: str) -> None:
    """Raise SolverMissingError if Ipopt does not have a linear solver.

    Ipopt itself does not raise: it returns NaN with the status `Invalid_Option`.
    """
    if name == "mumps":  # comes with CasADi
        return
    x = ca.SX.sym("x")
    options: dict[str, Any] = {
        "ipopt.linear_solver": name,
        "ipopt.print_level": 0,
        "ipopt.sb": "yes",
    }
    message = "Invalid_Option"
    with contextlib.suppress(RuntimeError), contextlib.redirect_stdout(io.StringIO()):
        solver = ca.nlpsol("probe", "ipopt", {"x": x, "f": x**2}, options | {"print_time": False})
        solver(x0=1.0)
        message = str(solver.stats()["return_status"])
    if message not in CONVERGED_STATUSES:
        raise SolverMissingError(
            f"linear solver {name!r} is not available to Ipopt here ({message}); expected one "
            "that is installed. Use mumps, which comes with CasADi, or install the library."
        )

"""Compare the loaded functions with nlp_check.csv: python check.py.

A line of that file is: x, f, g, gradient, nonzeros of the Jacobian, lam_f, lam_g, nonzeros of
the Hessian.
"""

import sys
from pathlib import Path

import casadi as ca
import numpy as np

HERE = Path(__file__).parent
LIMIT = 1e-10  # relative to the largest expected value of a block
NAMES = ("objective", "constraints", "gradient", "jacobian", "hessian")


def main() -> int:
    """Print the largest relative error of each block; returns 0 if all are within the limit."""
    gradient, jacobian, hessian = (
        ca.Function.load(str(HERE / f"nlp_{name}.casadi")) for name in ("grad_f", "jac_g", "hess_l")
    )
    n, m = gradient.size1_in("x"), jacobian.size1_out("g")
    sizes = [n, 1, m, n, jacobian.nnz_out(1), 1, m, hessian.nnz_out(0)]
    errors, scales = np.zeros(5), np.zeros(5)
    for line in np.loadtxt(HERE / "nlp_check.csv", delimiter=",", ndmin=2):
        x, f, g, slope, J, lam_f, lam_g, H = np.split(line, np.cumsum(sizes)[:-1])
        first, second = gradient(x=x), jacobian(x=x)
        curved = hessian(x=x, lam_f=lam_f, lam_g=lam_g)["triu_hess_gamma_x_x"]
        ours = (first["f"], second["g"], first["grad_f_x"], second["jac_g_x"], curved)
        for i, (got, expected) in enumerate(zip(ours, (f, g, slope, J, H), strict=True)):
            errors[i] = np.maximum(errors[i], np.abs(np.array(got.nonzeros()) - expected).max())
            scales[i] = max(scales[i], np.abs(expected).max())
    shares = errors / np.where(scales > 0, scales, 1.0)
    for name, share in zip(NAMES, shares, strict=True):
        print(f"nlp {name} {share:.1e}")
    return 0 if np.all(shares <= LIMIT) else 1


if __name__ == "__main__":
    sys.exit(main())

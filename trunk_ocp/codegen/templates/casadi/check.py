"""Compares the CasADi functions beside this file with their check files."""

import casadi as ca
from compare import HERE, columns, compare, end


def function(name):
    """The function of a file, or None if the export has none."""
    path = HERE / f"{name}.casadi"
    return ca.Function.load(str(path)) if path.exists() else None


def check(name, file, numbers):
    """Whether the functions of a kind of shape agree with a check file."""
    value, slopes, along = (function(f"{name}{end}") for end in ("", "_jacobian", "_second"))
    n, m = value.size1_in(0), value.size1_out(0)
    x, y, *rest = columns(file, n, m, n * m, n, n * m)
    good = [compare(name, [value(row).full() for row in x], y, 1, numbers)]
    if slopes is not None:
        J = [slopes(row)[1].full() for row in x]
        good.append(compare(f"{name} jacobian", J, rest[0], n, numbers))
    if along is not None:
        dJ = [along(*pair).full() for pair in zip(x, rest[1], strict=True)]
        good.append(compare(f"{name} second", dJ, rest[2], n, numbers))
    return all(good)


end(check("loaded", "check.csv", 19), check("unloaded", "check_unloaded.csv", 16))

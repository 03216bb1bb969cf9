"""One integration step of four rods in vector registers, as Python source for numba.

All numbers of a step are in one array, by component and lane: LLVM then sees that nothing overlaps,
and makes vector instructions of the loops over lanes. What one lane holds never depends on the
others. The rod's equations and their derivatives are translated from the instructions of
`equations.rates`, so that they are written once.
"""

from __future__ import annotations

import re

import casadi as ca

from .._support.casadi_to_python import python_source
from .dormand_prince import STAGES, A, B
from .equations import ARGUMENTS, PARAMETERS, RATES, STATES, STRAINS, rate_arguments, rates

LANES = 4
COLUMNS = 4  # tangents marched together
VARIED = STATES + STRAINS  # the arguments that tangents vary
PATH = RATES  # q, m, r at a step's edge
NUMBERS = PATH * (1 + COLUMNS)  # at an edge: the path, then its tangents

# Places in the array of a step, in numbers of LANES each.
STAGE = 0  # the path and its tangents at a stage
STRAIN = STAGE + NUMBERS  # arguments of `rates` beside the state: strains, mean, tip force
POINT = STRAIN + ARGUMENTS - STATES  # its parameters
TURNED = POINT + PARAMETERS  # derivatives of strains and mean, by columns
RATE = TURNED + COLUMNS * STRAINS  # rates of the path and of its tangents
START = RATE + NUMBERS  # the path and its tangents where the step starts
KEPT = START + NUMBERS  # rates at all stages
SIZE = KEPT + STAGES * NUMBERS


def python() -> str:
    """Source of `directional_rates` and `combine`, whose argument is the array of a step.

    The first sets the rates and their derivatives along the tangents, from all else at a stage. The
    second sets stage s, the start plus h times a weighted sum of the rates before; s = STAGES is
    the end of the step.
    """
    (w, p), D = rate_arguments(), ca.SX.sym("D", VARIED, COLUMNS)
    value = rates()(w, p)
    along = ca.densify(ca.mtimes(ca.jacobian(value, w)[:, :VARIED], D))
    function = ca.Function("directional_rates", [w, p, D], [value, along])
    _, *body = python_source(function, "directional_rates").splitlines()
    lines = ["def directional_rates(b):", f"    for lane in range({LANES}):"]
    lines += ["    " + re.sub(r"([io])(\d)\[(\d+)\]", _place, line) for line in body]
    lines += ["def combine(b, s, h):"]
    for s, weights in enumerate((*A, B)):
        terms = [
            f"{float(weight)!r} * b[{LANES * (KEPT + j * NUMBERS)} + i]"
            for j, weight in enumerate(weights)
            if weight
        ]
        lines += [
            f"    if s == {s}:",
            f"        for i in range({LANES * NUMBERS}):",
            f"            b[{LANES * STAGE} + i] = b[{LANES * START} + i]"
            + (f" + h * ({' + '.join(terms)})" if terms else ""),
        ]
    return "\n".join(lines)


def _place(match: re.Match[str]) -> str:
    """Where the array of a step has an argument (i) or result (o) of `directional_rates`."""
    kind, entry = match[1] + match[2], int(match[3])
    column, row = divmod(entry, VARIED)
    place = {
        "i0": STAGE + entry if entry < STATES else STRAIN + entry - STATES,
        "i1": POINT + entry,
        "i2": STAGE + PATH * (1 + column) + row
        if row < STATES
        else TURNED + STRAINS * column + row - STATES,
        "o0": RATE + entry,
        "o1": RATE + PATH + entry,
    }[kind]
    return f"b[{LANES * place} + lane]"

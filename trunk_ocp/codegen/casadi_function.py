"""The map as CasADi functions: an export format, and the reference for the others.

The collocation equations become the residual of one sparse `rootfinder`; CasADi differentiates
through it by the implicit function theorem, as often as asked.
"""

from __future__ import annotations

from functools import cache, lru_cache
from typing import Any

import casadi as ca
import numpy as np

from ..model.quaternions import directors, product
from ..rod.collocation import gauss
from ..rod.statics import MAX_DEFECT
from .rod_space_axes import base, rates, report, spiral, turn
from .shape_model import OUTPUTS, Model

TOO_COARSE = (
    "The shape bends too sharply for this mesh: reduce the load, or export with --elements."
)
POINT = sum(OUTPUTS.values())  # numbers of one point


@lru_cache(maxsize=4)
def loaded(model: Model) -> ca.Function:
    """Function x (size) -> y (19 n), the equilibrium shape; see `Layout` for both.

    Newton's method starts from the unloaded shape. Evaluation raises if it does not converge, or
    if the mesh does not resolve the shape by the criterion of `solve_statics`.
    """
    tables, layout = model.tables, model.layout
    E, d = tables.reach.shape
    x = ca.MX.sym("x", layout.size)
    strain, mean, loads = _strains(model, x), _mean(model, x), _loads(model, x)
    pose = base(model.trunk.head)(x[layout.inputs["head"]], ca.MX(0, 1))
    constants = ca.vertcat(
        _of_segments(strain, tables.segment),
        ca.repmat(ca.vertcat(mean, loads), 1, E),
        ca.DM(_element_numbers(model)),
    )
    element = _element(d, layout.contact).map(E)

    # Unknowns: M at each element's start, q at each but the first one's, q at Gauss points.
    starts, corners = ca.MX.sym("M", 3, E), ca.MX.sym("q", 4, E - 1)
    inner = ca.MX.sym("Q", 4 * d, E)
    known = ca.MX.sym("base", 4)
    numbers = ca.MX.sym("constants", *constants.shape)
    left = ca.vertcat(ca.horzcat(known, corners), starts)
    residual, end, _ = element(left, inner, numbers)
    gaps = ca.vec(end[:, :-1] - left[:, 1:])
    equations = ca.vertcat(ca.vec(residual), gaps, end[4:, -1])  # the last: M(L) = 0
    unknown = ca.vertcat(ca.vec(inner), ca.vec(corners), ca.vec(starts))
    parameters = ca.vertcat(known, ca.vec(numbers))
    options: Any = {"abstol": 1e-12, "abstolStep": 1e-12, "max_iter": 50, "linear_solver": "qr"}
    problem: dict[str, Any] = {"x": unknown, "p": parameters, "g": equations}
    root = ca.rootfinder("equilibrium", "newton", problem, options)

    guess = _unloaded_guess(model, strain, pose[:4])
    solution = root(guess, ca.vertcat(pose[:4], ca.vec(constants)))
    Q, q, M = ca.vertsplit(solution, [0, 4 * d * E, 4 * d * E + 4 * (E - 1), solution.size1()])
    left = ca.vertcat(ca.horzcat(pose[:4], ca.reshape(q, 4, E - 1)), ca.reshape(M, 3, E))
    _, end, steps = element(left, ca.reshape(Q, 4 * d, E), constants)
    coarse = ca.fabs(ca.sum1(ca.reshape(Q, 4, d * E) ** 2) - 1)
    end = end.attachAssert(ca.mmax(coarse) <= MAX_DEFECT, TOO_COARSE)
    states = ca.horzcat(left, end[:, -1])
    line = ca.cumsum(ca.horzcat(pose[4:], steps), 1)
    y = _reported(model, states, line, strain, mean, loads)
    return ca.Function("loaded", [x], [y], ["x"], ["y"])


@lru_cache(maxsize=4)
def unloaded(model: Model) -> ca.Function:
    """Function of activations and head (muscles + 2) -> y (16 n), the unloaded shape."""
    tables, layout = model.tables, model.layout
    x = ca.MX.sym("controls", layout.controls)
    strain, E = _strains(model, x), len(tables.widths)
    pose = base(model.trunk.head)(x[layout.inputs["head"]], ca.MX(0, 1))
    strains = _of_segments(strain, tables.segment)
    turns = turn().map(E)(strains, ca.DM(tables.piece[:, :1].T))
    rho = spiral().map(E)(strains, ca.DM(tables.piece.T))
    q, r = [pose[:4]], [pose[4:]]
    for e in range(E):
        r.append(r[-1] + _rotated()(q[-1], rho[:, e]))
        q.append(_product()(q[-1], turns[:, e]))
    states = ca.vertcat(ca.horzcat(*q), ca.DM.zeros(3, E + 1))
    none = ca.MX(ca.DM.zeros(layout.size - layout.controls))
    y = _reported(model, states, ca.horzcat(*r), strain, _mean(model, x), none)
    y = ca.reshape(y, POINT, layout.points)[: layout.outputs["moment"].start, :]
    return ca.Function("unloaded", [x], [ca.vec(y)], ["controls"], ["y"])


@lru_cache(maxsize=4)
def jacobian(function: ca.Function) -> ca.Function:
    """(x) -> y and its Jacobian, dense."""
    x = ca.MX.sym("x", function.size1_in(0))
    y = function(x)
    return ca.Function(
        f"{function.name()}_jacobian",
        [x],
        [y, ca.densify(ca.jacobian(y, x))],
        function.name_in(),
        ["y", "J"],
    )


@lru_cache(maxsize=4)
def second(function: ca.Function) -> ca.Function:
    """(x, v) -> derivative of the Jacobian along v, dense."""
    x, v = ca.MX.sym("x", function.size1_in(0)), ca.MX.sym("v", function.size1_in(0))
    along = ca.jtimes(function(x), x, v)
    return ca.Function(
        f"{function.name()}_second", [x, v], [ca.densify(ca.jacobian(along, x))], ["x", "v"], ["dJ"]
    )


# --- pieces ------------------------------------------------------------------------------


def _strains(model: Model, x: ca.MX) -> ca.MX:
    """Strains (4, S) of the segments."""
    A = model.tables.strain
    S, _, muscles = A.shape
    flat = ca.mtimes(ca.DM(A.reshape(4 * S, muscles)), x[model.layout.inputs["activation"]])
    return ca.DM(np.outer([1.0, 0, 0, 0], np.ones(S))) + ca.reshape(flat, 4, S)


def _mean(model: Model, x: ca.MX) -> ca.MX:
    return ca.dot(ca.DM(model.tables.fractions), _strains(model, x)[0, :].T)


def _loads(model: Model, x: ca.MX) -> ca.MX:
    """Gravity, V and, with contact, W and L."""
    return x[model.layout.controls :]


def _of_segments(strain: ca.MX, segment: np.ndarray) -> ca.MX:
    return ca.horzcat(*(strain[:, int(s)] for s in segment))


def _element_numbers(model: Model) -> np.ndarray:
    """Width; f, K (5) and mass, share, density (3) at the Gauss points; (1 + 8 d, E)."""
    tables = model.tables
    places = np.concatenate([tables.section, tables.force], axis=-1)
    return np.vstack([tables.widths, places.reshape(len(tables.widths), -1).T])


def _force(loads: ca.SX, place: ca.SX) -> tuple[ca.SX, ca.SX]:
    """N and l, by eqs. (13), (15), from loads (4 or 10) and (mass, share, density)."""
    N = loads[1:4] + ca.vertcat(0, 0, loads[0] * place[0])
    if loads.size1() == 4:
        return N, ca.SX.zeros(3)
    return N + place[1] * loads[4:7], place[2] * loads[7:10]


@cache
def _element(d: int, contact: bool) -> ca.Function:
    """One collocation element of the Gauss method with d stages.

    (left (7), Q (4 d), constants) -> residual (4 d), state at the end (7), step of r (3).
    Constants: zeta_hat, c; mean; loads (4 or 10); width; 8 numbers of each Gauss point.
    """
    rule = gauss(d)
    A, b, loads = rule.integral(rule.nodes), rule.integral(1.0), 10 if contact else 4
    left, Q = ca.SX.sym("left", 7), ca.SX.sym("Q", 4, d)
    constants = ca.SX.sym("constants", 4 + 1 + loads + 1 + 8 * d)
    strain, load, width = constants[:5], constants[5 : 5 + loads], constants[5 + loads]
    places = ca.reshape(constants[6 + loads :], 8, d)

    def rate(j: int, M: ca.SX) -> ca.SX:
        N, couple = _force(load, places[5:, j])
        return rates()(ca.vertcat(Q[:, j], M, strain, N, couple), places[:5, j])

    by_force = ca.horzcat(*(rate(j, ca.SX.zeros(3))[4:] for j in range(d)))  # M', r'
    M = [left[4:] + width * ca.mtimes(by_force[:3, :], ca.DM(A[i])) for i in range(d)]
    turning = ca.horzcat(*(rate(j, M[j])[:4] for j in range(d)))
    residual = [left[:4] + width * ca.mtimes(turning, ca.DM(A[i])) - Q[:, i] for i in range(d)]
    step = width * ca.mtimes(ca.vertcat(turning, by_force), ca.DM(b))
    return ca.Function(
        "element",
        [left, ca.vec(Q), constants],
        [ca.vertcat(*residual), left + step[:7], step[7:]],
    )


def _unloaded_guess(model: Model, strain: ca.MX, q0: ca.MX) -> ca.MX:
    """Unknowns of `loaded` at the unloaded shape."""
    tables = model.tables
    E, d = tables.reach.shape
    strains = _of_segments(strain, tables.segment)
    ends = turn().map(E)(strains, ca.DM(tables.piece[:, :1].T))
    repeated = ca.horzcat(*(ca.repmat(strains[:, e], 1, d) for e in range(E)))
    inside = turn().map(E * d)(repeated, ca.DM(tables.reach.reshape(1, -1)))
    q = [q0]
    for e in range(E):
        q.append(_product()(q[-1], ends[:, e]))
    Q = [_product()(q[i // d], inside[:, i]) for i in range(E * d)]
    return ca.vertcat(*Q, *q[1:-1], ca.DM.zeros(3 * E))


def _reported(
    model: Model, states: ca.MX, line: ca.MX, strain: ca.MX, mean: ca.MX, loads: ca.MX
) -> ca.MX:
    """Y (19 n) from states (7, E + 1) and the centerline (3, E + 1) at element edges."""
    tables, columns = model.tables, []
    load = ca.SX.sym("loads", loads.size1())
    place = ca.SX.sym("place", 3)
    N = ca.Function("force", [load, place], [_force(load, place)[0]])
    for edge, element in zip(tables.edge.tolist(), tables.ends.tolist(), strict=True):
        local = strain[:, int(tables.segment[element])]
        force = N(loads, ca.DM(tables.edge_force[edge]))
        w = ca.vertcat(states[:, edge], local, mean, force)
        columns += [line[:, edge], report()(w, ca.DM(tables.edge_section[edge]))]
    return ca.vertcat(*columns)


@cache
def _product() -> ca.Function:
    p, q = ca.SX.sym("p", 4), ca.SX.sym("q", 4)
    return ca.Function("product", [p, q], [ca.vertcat(*product(ca.vertsplit(p), ca.vertsplit(q)))])


@cache
def _rotated() -> ca.Function:
    """Body components v (3) in space axes, by the frame q (4)."""
    q, v = ca.SX.sym("q", 4), ca.SX.sym("v", 3)
    d = directors(ca.vertsplit(q))
    return ca.Function(
        "rotated", [q, v], [ca.vertcat(*(sum(v[i] * d[i][j] for i in range(3)) for j in range(3)))]
    )

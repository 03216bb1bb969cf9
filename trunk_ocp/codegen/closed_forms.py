"""Closed forms of one muscle in SymPy: strain coefficients, unloaded shape, its derivatives.

Each `Formula` has a name, an expression in the names before it, and its source.
"""

from __future__ import annotations

import math

import sympy as sp

from ..model.anatomy import Muscle, Trunk, unknown_architecture
from .notation import SYMBOL, Formula, names, total

DIGITS = 50
"""Digits of all evaluations; some are lost to cancellation where taper or helix vanish."""


def kind(trunk: Trunk, muscle: Muscle) -> str:
    """Which closed form of eq. (A.4) a muscle needs."""
    k, h = trunk.taper_rate, abs(math.tan(muscle.helix)) / muscle.radii[1]
    if muscle.architecture == "radial":
        return "radial"
    if muscle.architecture == "longitudinal":
        return "tapered" if k > 0 else "straight"
    if muscle.architecture != "helical":
        raise unknown_architecture(muscle)
    if k == 0:
        return "helix"
    return "steep" if h > k else "gentle" if h < k else "even"


def fiber(kind: str) -> list[Formula]:
    """Products of the fiber direction D that eq. (6) needs, as functions of R at Z = 0."""
    R, k, h = names("R k h")
    with sp.evaluate(False):
        tapered, wound = 1 + k**2 * R**2, 1 + h**2 * R**2
        along, around = {
            "radial": (sp.Integer(0), sp.Integer(0)),
            "straight": (sp.Integer(1), sp.Integer(0)),
            "tapered": (1 / tapered, sp.Integer(0)),
            "helix": (1 / wound, h * R / wound),
        }.get(kind, (1 / (wound * tapered), h * R / (wound * sp.sqrt(tapered))))
    source = "eqs. (9), (19)-(22)"
    return [Formula("D_ZZ", along, source), Formula("D_ThetaZ", around, source)]


def radial_factors(kind: str) -> list[Formula]:
    """Factors delta_0, delta_1, delta_3 of eq. (A.4) at Z = 0, after the formulas that they use.

    They are the integrals of ((1 + nu) D_Z^2 - nu) R, ((1 + nu) D_Z^2 - nu) R^2 and
    D_Theta D_Z R^2 from R_1 to R_2. All are real.
    """
    return {
        "radial": _radial,
        "straight": _straight_fibers,
        "tapered": _tapered_fibers,
        "helix": _helix,
        "steep": _steep_helix,
        "gentle": _gentle_helix,
        "even": _even_helix,
    }[kind]()


def _factors(even: sp.Expr, first: sp.Expr, twist: sp.Expr) -> list[Formula]:
    """Factors from the integrals of (1 + nu) D_Z^2 times R and R^2, and D_Theta D_Z R^2."""
    R_1, R_2, nu = names("R_1 R_2 nu")
    with sp.evaluate(False):
        delta_0 = even - nu / 2 * (R_2**2 - R_1**2)
        delta_1 = first - nu / 3 * (R_2**3 - R_1**3)
    return _deltas(delta_0, delta_1, twist)


def _deltas(delta_0: sp.Expr, delta_1: sp.Expr, delta_3: sp.Expr) -> list[Formula]:
    values = {"delta_0": delta_0, "delta_1": delta_1, "delta_3": delta_3}
    return [Formula(name, value, "eq. (A.4)") for name, value in values.items()]


def _radial() -> list[Formula]:
    R_1, R_2, nu = names("R_1 R_2 nu")
    with sp.evaluate(False):
        delta_0, delta_1 = nu / 2 * (R_1**2 - R_2**2), nu / 3 * (R_1**3 - R_2**3)
    return _deltas(delta_0, delta_1, sp.Integer(0))


def _straight_fibers() -> list[Formula]:
    R_1, R_2 = names("R_1 R_2")
    with sp.evaluate(False):
        delta_0, delta_1 = (R_2**2 - R_1**2) / 2, (R_2**3 - R_1**3) / 3
    return _deltas(delta_0, delta_1, sp.Integer(0))


def _of_one_rate(rate: sp.Symbol) -> tuple[sp.Expr, sp.Expr]:
    """Integrals of (1 + nu) R^n / (1 + rate^2 R^2), n = 1 and 2."""
    R_1, R_2, nu = names("R_1 R_2 nu")
    with sp.evaluate(False):
        logarithm = sp.log((1 + rate**2 * R_2**2) / (1 + rate**2 * R_1**2))
        angle = (sp.atan(rate * R_2) - sp.atan(rate * R_1)) / rate
        even = (1 + nu) / (2 * rate**2) * logarithm
        first = (1 + nu) / rate**2 * total(R_2, -R_1, -angle)
    return even, first


def _tapered_fibers() -> list[Formula]:
    return _factors(*_of_one_rate(names("k")[0]), sp.Integer(0))


def _helix() -> list[Formula]:
    R_1, R_2, h = names("R_1 R_2 h")
    with sp.evaluate(False):
        logarithm = sp.log((1 + h**2 * R_2**2) / (1 + h**2 * R_1**2))
        twist = (R_2**2 - R_1**2) / (2 * h) - logarithm / (2 * h**3)
    return _factors(*_of_one_rate(h), twist)


def _two_rates() -> list[Formula]:
    """Parts of the factors of a helix with taper."""
    R_1, R_2, k, h = names("R_1 R_2 k h")
    with sp.evaluate(False):
        parts = {
            "B_1": sp.sqrt(1 + k**2 * R_1**2),
            "B_2": sp.sqrt(1 + k**2 * R_2**2),
            "C_1": 1 + h**2 * R_1**2,
            "C_2": 1 + h**2 * R_2**2,
            "T_h": (sp.atan(h * R_2) - sp.atan(h * R_1)) / h,
            "T_k": (sp.atan(k * R_2) - sp.atan(k * R_1)) / k,
        }
    return [Formula(name, value, "eq. (A.4)") for name, value in parts.items()]


def _of_two_rates() -> tuple[sp.Expr, sp.Expr]:
    """Integrals of (1 + nu) R^n / ((1 + h^2 R^2) (1 + k^2 R^2)), n = 1 and 2, |h| != k."""
    nu, k, h, B_1, B_2, C_1, C_2, T_h, T_k = names("nu k h B_1 B_2 C_1 C_2 T_h T_k")
    with sp.evaluate(False):
        even = (1 + nu) / (2 * (k**2 - h**2)) * sp.log(B_2**2 * C_1 / (B_1**2 * C_2))
        first = (1 + nu) / (k**2 - h**2) * (T_h - T_k)
    return even, first


def _steep_helix() -> list[Formula]:
    B_1, B_2, k, h, q = names("B_1 B_2 k h q")
    with sp.evaluate(False):
        root = sp.sqrt(h**2 - k**2)
        turned = sp.atanh(q / (h * B_2)) - sp.atanh(q / (h * B_1))
        twist = (B_2 - B_1) / (h * k**2) + _alone(1 / (h**2 * q)) * turned
    known = [*_two_rates(), Formula("q", root, "eq. (A.4), where A = i q is imaginary")]
    return [*known, *_factors(*_of_two_rates(), twist)]


def _gentle_helix() -> list[Formula]:
    B_1, B_2, k, h, A = names("B_1 B_2 k h A")
    with sp.evaluate(False):
        root = sp.sqrt(k**2 - h**2)
        turned = sp.atan(h * B_1 / A) - sp.atan(h * B_2 / A)
        twist = (B_2 - B_1) / (h * k**2) + _alone(1 / (h**2 * A)) * turned
    known = [*_two_rates(), Formula("A", root, "eq. (A.4)")]
    return [*known, *_factors(*_of_two_rates(), twist)]


def _alone(factor: sp.Expr) -> sp.Expr:
    """A fraction that SymPy prints in front of a product, not as its denominator."""
    return sp.Mul(sp.Integer(1), factor, evaluate=False)


def _even_helix() -> list[Formula]:
    """The limit |h| = k, where A of eq. (A.4) is zero."""
    R_1, R_2, B_1, B_2, T_k, nu, k, h = names("R_1 R_2 B_1 B_2 T_k nu k h")
    with sp.evaluate(False):
        even = (1 + nu) / (2 * k**2) * (1 / B_1**2 - 1 / B_2**2)
        first = (1 + nu) / (2 * k**2) * total(T_k, R_1 / B_1**2 - R_2 / B_2**2)
        twist = h / k**4 * total(B_2, 1 / B_2, -B_1, -1 / B_1)
    used = [formula for formula in _two_rates() if formula.name in ("B_1", "B_2", "T_k")]
    return [*used, *_factors(even, first, twist)]


def strain_coefficients() -> list[Formula]:
    """Derivatives with respect to gamma of zeta_hat and of c, where c / f(Z) is the curvature."""
    first, second, R_0, nu, d_0, d_1, d_3 = names("Theta_1 Theta_2 R_0 nu delta_0 delta_1 delta_3")
    with sp.evaluate(False):
        bend = 4 * d_1 / (sp.pi * R_0**4)
        coefficients = {
            "zeta_gamma": d_0 / (sp.pi * R_0**2) * (second - first),
            "c_1_gamma": bend * (sp.cos(first) - sp.cos(second)),
            "c_2_gamma": bend * (sp.sin(first) - sp.sin(second)),
            "c_3_gamma": 4 * (1 + nu) * d_3 / (sp.pi * R_0**4) * (second - first),
        }
    source = "eqs. (5)-(7), (A.1)-(A.3)"
    return [Formula(name, value, source) for name, value in coefficients.items()]


def stretched(tapered: bool) -> list[Formula]:
    """Coordinates along the segment, from its start Z_1."""
    Z, Z_1, k, s, f, f_1 = names("Z Z_1 k s f f_1")
    with sp.evaluate(False):
        lines = {
            "s": Z - Z_1,
            "f": 1 - k * Z,
            "f_1": 1 - k * Z_1,
            "ell": (sp.log(f_1) - sp.log(f)) / k,
        }
    if not tapered:
        lines = {"s": lines["s"], "f": sp.Integer(1), "f_1": sp.Integer(1), "ell": s}
    sources = ("from the start of the segment", "eqs. (26), (29)", "at its start", "int dZ / f")
    return [
        Formula(name, value, source)
        for (name, value), source in zip(lines.items(), sources, strict=True)
    ]


def axis() -> list[Formula]:
    """Axis a and rate kappa = |v| of the rotation, and derivatives; kappa_gamma = a . v_gamma."""
    zeta, zeta_gamma, kappa, kappa_gamma = names("zeta zeta_gamma kappa kappa_gamma")
    c, c_gamma, v, v_gamma, a = names("c c_gamma v v_gamma a")
    with sp.evaluate(False):
        return [
            Formula("v", zeta * c, "eq. (14)"),
            Formula("a", v / kappa, "fixed in the segment"),
            Formula("v_gamma", zeta_gamma * c + zeta * c_gamma, "derivative of v"),
            Formula("a_gamma", (v_gamma - kappa_gamma * a) / kappa, "derivative of a"),
        ]


def spiral() -> list[Formula]:
    """Directors and centerline of the unloaded shape, from the start of the segment."""
    k, kappa, theta, ell, f, f_1, s, P, Q = names("k kappa theta ell f f_1 s P Q")
    zeta, a_i, a_3, a, e_i, e_3 = names("zeta a_i a_3 a e_i e_3")
    a_x_ei, a_x_e3 = names("a_x_ei a_x_e3")
    sin, cos = sp.sin(theta), sp.cos(theta)
    with sp.evaluate(False):
        rest, size = f_1 - f * cos, k**2 + kappa**2
        return [
            Formula("theta", kappa * ell, "angle of rotation about a"),
            Formula("P", (k * rest + sp.Mul(kappa, f, sin)) / size, "int cos(theta) dZ"),
            Formula("Q", (kappa * rest - sp.Mul(k, f, sin)) / size, "int sin(theta) dZ"),
            Formula(
                "d_i",
                total(cos * e_i, sp.Mul(1 - cos, a_i, a), sin * a_x_ei),
                "eq. (14): d_i' = v / f x d_i",
            ),
            Formula(
                "rho",
                zeta * total(P * e_3, sp.Mul(s - P, a_3, a), Q * a_x_e3),
                "eq. (14): rho' = zeta d_3",
            ),
        ]


def spiral_slopes() -> list[Formula]:
    """Derivatives of `spiral` with respect to gamma, for a curved segment.

    theta_gamma is the rotation in d_i_gamma = theta_gamma x d_i.
    """
    k, kappa, theta, ell, f, s, P, Q = names("k kappa theta ell f s P Q")
    zeta, zeta_gamma, kappa_gamma, a_3, a_3_gamma = names(
        "zeta zeta_gamma kappa_gamma a_3 a_3_gamma"
    )
    P_kappa, Q_kappa, rho, a, a_gamma, e_3 = names("P_kappa Q_kappa rho a a_gamma e_3")
    a_x_e3, a_x_agamma, agamma_x_e3 = names("a_x_e3 a_x_agamma agamma_x_e3")
    sin, cos = sp.sin(theta), sp.cos(theta)
    with sp.evaluate(False):
        p, q, size = sp.Mul(ell, f, cos) - P, sp.Mul(ell, f, sin) - Q, k**2 + kappa**2
        turn = total(sp.Mul(ell, kappa_gamma, a), sin * a_gamma, (1 - cos) * a_x_agamma)
        longer = kappa_gamma * total(P_kappa * (e_3 - a_3 * a), Q_kappa * a_x_e3)
        tilted = total((s - P) * (a_3_gamma * a + a_3 * a_gamma), Q * agamma_x_e3)
        move = total(zeta_gamma / zeta * rho, zeta * longer, zeta * tilted)
        return [
            Formula("theta_gamma", turn, "derivative of exp(l [v]x)"),
            Formula("P_kappa", (kappa * p + k * q) / size, "derivative of P with respect to kappa"),
            Formula("Q_kappa", (kappa * q - k * p) / size, "derivative of Q with respect to kappa"),
            Formula("rho_gamma", move, "derivative of rho"),
        ]


def straight_slopes(tapered: bool) -> list[Formula]:
    """Limit of `spiral_slopes` for a straight segment, c = 0, as at rest."""
    k, ell, f, s, m = names("k ell f s m")
    zeta, zeta_gamma, e_3, v_gamma, vgamma_x_e3 = names("zeta zeta_gamma e_3 v_gamma vgamma_x_e3")
    with sp.evaluate(False):
        lever = (s - f * ell) / k if tapered else s**2 / 2
        move = sp.Mul(zeta_gamma, s, e_3) + sp.Mul(zeta, m, vgamma_x_e3)
        return [
            Formula("m", lever, "int l dZ"),
            Formula("theta_gamma_straight", ell * v_gamma, "kappa -> 0"),
            Formula("rho_gamma_straight", move, "kappa -> 0"),
        ]


def coefficient_formulas(kind: str) -> list[Formula]:
    """Formulas from the `anatomy_values` to the strain coefficients, in order."""
    alpha_2, R_2 = names("alpha_2 R_2")
    with sp.evaluate(False):
        helix = [Formula("h", sp.tan(alpha_2) / R_2, "eq. (21), c_alpha of eq. (A.4)")]
    wound = kind in ("helix", "steep", "gentle", "even")
    return [*(helix if wound else ()), *radial_factors(kind), *strain_coefficients()]


def anatomy_values(trunk: Trunk, muscle: Muscle) -> dict[str, float]:
    """Values of the anatomy in the formulas: R in m at Z = 0, angles in rad."""
    values = {
        "R_0": trunk.base_radius,
        "k": trunk.taper_rate,
        "nu": trunk.poisson_ratio,
        "R_1": muscle.radii[0],
        "R_2": muscle.radii[1],
        "Theta_1": muscle.sector[0],
        "Theta_2": muscle.sector[1],
    }
    return values | ({"alpha_2": muscle.helix} if muscle.architecture == "helical" else {})


def coefficient_values(trunk: Trunk, muscle: Muscle) -> dict[str, sp.Expr]:
    """Value of each of `coefficient_formulas`, to `DIGITS` digits less cancellation."""
    values = {
        SYMBOL[name]: sp.Float(x, DIGITS) for name, x in anatomy_values(trunk, muscle).items()
    }
    formulas = coefficient_formulas(kind(trunk, muscle))
    for formula in formulas:
        values[SYMBOL[formula.name]] = sp.N(formula.expression.doit().subs(values), DIGITS)
    return {formula.name: values[SYMBOL[formula.name]] for formula in formulas}


def rest_slopes(trunk: Trunk, muscle: Muscle) -> dict[str, list[float]]:
    """Derivatives with respect to gamma at rest, in the directors, at Z_2 and at the tip L.

    "turn" in rad, "end" and "tip" in m.
    """
    start, end = trunk.edges[muscle.segment : muscle.segment + 2]
    tapered = trunk.taper_rate > 0
    values: dict[sp.Symbol, sp.Expr] = {
        SYMBOL[name]: sp.Float(x, DIGITS)
        for name, x in {"k": trunk.taper_rate, "Z": end, "Z_1": start, "zeta": 1.0}.items()
    }
    slopes = coefficient_values(trunk, muscle)
    values[SYMBOL["zeta_gamma"]] = slopes["zeta_gamma"]
    for formula in [*stretched(tapered), *straight_slopes(tapered)[:1]]:
        values[SYMBOL[formula.name]] = sp.N(formula.expression.doit().subs(values), DIGITS)
    ell, s, m = (values[x] for x in names("ell s m"))
    c_1, c_2, c_3 = (slopes[f"c_{i}_gamma"] for i in (1, 2, 3))
    turn = [ell * c_1, ell * c_2, ell * c_3]
    move = [m * c_2, -m * c_1, slopes["zeta_gamma"] * s]  # v_gamma x e_3 = (c_2, -c_1, 0)
    beyond = trunk.length - end
    tip = [move[0] + turn[1] * beyond, move[1] - turn[0] * beyond, move[2]]
    vectors = {"turn": turn, "end": move, "tip": tip}
    return {name: [float(x) for x in vector] for name, vector in vectors.items()}

"""Compare trunk_formulas.py with the numbers in check_formulas.csv; exits 1 if they disagree.

A row is one point Z of the trunk under one activation: Z, then zeta and c (4) of the muscle's
segment, r(Z_1) and d_i(Z_1) (12), then the expected r(Z), d_i(Z) (12), their derivatives with
respect to gamma (12), and delta_0, delta_1, delta_3, zeta_gamma, c_gamma (7). Vectors are in
space axes.
"""

import csv
import sys
from pathlib import Path
from typing import Any

import mpmath as mp
import sympy as sp
import trunk_formulas as formulas

LIMIT = 1e-10
SIZES = {"position": 3, "directors": 9, "d_position": 3, "d_directors": 9, "coefficients": 7}


def evaluator(forms: dict[str, Any], known: dict[str, Any]) -> Any:
    """(Z, zeta, c_1, c_2, c_3) -> rho, d_1, d_2, d_3, theta_gamma, rho_gamma, flat."""
    values = {sp.Symbol(name, real=True): value for name, value in known.items()}
    vectors = [forms["rho"], *forms["d"], forms["theta_gamma"], forms["rho_gamma"]]
    flat = [x.subs(values) for vector in vectors for x in vector]
    arguments = sp.symbols("Z zeta c_1 c_2 c_3", real=True)
    return sp.lambdify(arguments, flat, "mpmath", cse=True)


def cross(a: list[Any], b: list[Any]) -> list[Any]:
    """Vector product of two triples."""
    return [a[i - 2] * b[i - 1] - a[i - 1] * b[i - 2] for i in range(3)]


def triples(flat: list[Any]) -> list[list[Any]]:
    """Split a list into vectors of three."""
    return [flat[i : i + 3] for i in range(0, len(flat), 3)]


def pose(row: list[Any], forms: tuple[Any, Any]) -> dict[str, list[Any]]:
    """Position, directors and their derivatives in space axes at Z."""
    Z, strain, start, frame = row[0], row[1:5], row[5:8], triples(row[8:17])
    spiral, straight = forms
    form = spiral if any(strain[1:]) else straight
    inside = min(Z, mp.mpf(formulas.Z_END))

    def space(v: list[Any]) -> list[Any]:
        return [sum(v[i] * frame[i][j] for i in range(3)) for j in range(3)]

    rho, *d, turn, move = (space(v) for v in triples(form(inside, *strain)))
    r = [start[i] + rho[i] for i in range(3)]
    if Z > inside:  # position and directors depend on other segments: use the expected ones
        lever = [row[17 + i] - r[i] for i in range(3)]
        move = [x + y for x, y in zip(move, cross(turn, lever), strict=True)]
        r, d = row[17:20], triples(row[20:29])
    return {
        "position": r,
        "directors": [x for d_i in d for x in d_i],
        "d_position": move,
        "d_directors": [x for d_i in d for x in cross(turn, d_i)],
    }


def main() -> int:
    """Print one line for each kind of numbers; 0 if all are within `LIMIT`."""
    mp.mp.dps = 50
    numbers = formulas.numbers()
    known = {name: x for name, x in numbers.items() if name.endswith("_gamma")}
    known |= {"k": sp.Float(formulas.VALUES["k"], 50), "Z_1": sp.Float(formulas.Z_START, 50)}
    if formulas.VALUES["k"] == 0:
        known["k"] = sp.Integer(0)
    forms = evaluator(formulas.spiral(), known), evaluator(formulas.straight(), known)
    coefficients = [name for name in numbers if name.startswith("delta") or "_gamma" in name]
    error, size = dict.fromkeys(SIZES, 0.0), dict.fromkeys(SIZES, 0.0)
    with open(Path(__file__).with_name("check_formulas.csv"), newline="") as file:
        rows = [[mp.mpf(cell) for cell in row] for row in csv.reader(file)]
    for row in rows:
        computed = pose(row, forms)
        computed["coefficients"] = [mp.mpf(numbers[name]) for name in coefficients]
        at = 17
        for name, count in SIZES.items():
            for got, wanted in zip(computed[name], row[at : at + count], strict=True):
                error[name] = max(error[name], float(abs(got - wanted)))
                size[name] = max(size[name], float(abs(wanted)))
            at += count
    relative = {name: error[name] / (size[name] or 1.0) for name in SIZES}
    for name, value in relative.items():
        print(f"formulas {name} {value:.1e}")
    return 0 if rows and all(value <= LIMIT for value in relative.values()) else 1


if __name__ == "__main__":
    sys.exit(main())

"""Orders of convergence on an activated, loaded, tapered rod."""

from __future__ import annotations

from functools import cache

import numpy as np

from trunk_ocp.model.anatomy import Trunk
from trunk_ocp.model.loads import Loads
from trunk_ocp.rod.collocation import Mesh
from trunk_ocp.rod.shape import Shape
from trunk_ocp.rod.statics import solve_statics
from trust import reference

from .case import Case, Values, flat
from .rods import rod

SUBJECT = "Convergence"
DEGREES = range(1, 9)
ELEMENTS = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96)
FLOOR = 1e-12  # below this, errors are round-off and errors of the reference
PLACES = ("edges", "inside")
HEAD, LOAD = (0.2, 0.7), Loads(tip_force=(6.0, 8.0, -4.0))
GAMMA = np.array([-1.5])  # shortens by 40 % and turns by 13 rad
INSIDE = np.linspace(0, 1, 961)


@cache
def oblique() -> Trunk:
    """A tapered rod with one oblique muscle, without jumps."""
    muscle = {
        "group": "ob",
        "architecture": "helical",
        "radii_over_length": (0.01, 0.05),
        "sector": (0.0, 2.0),
        "helix_deg": 25.0,
        "sides": ("R",),
    }
    segments = ({"Z_over_length": (0.0, 1.0), "muscles": (muscle,)},)
    return rod(segments, {"density": 500.0}, taper_deg=1.0)


def on_mesh(elements: int, degree: int) -> Shape:
    """The rod's shape on equal elements."""
    mesh = Mesh(tuple(np.linspace(0, 1, elements + 1)), degree)
    return solve_statics(oblique(), GAMMA, HEAD, LOAD, mesh)


@cache
def finest() -> Shape:
    """Reference for the errors: 24 elements of degree 12."""
    return on_mesh(24, 12)


@cache
def error(elements: int, degree: int, place: str) -> float:
    """Largest error of positions in m, directors, and moments in 5 N m, at edges or anywhere."""
    Z = np.linspace(0, 1, elements + 1)[1:] if place == "edges" else INSIDE
    shape = on_mesh(elements, degree)
    r = np.linalg.norm(shape.position(Z) - finest().position(Z), axis=1)
    d = np.abs(shape.directors(Z) - finest().directors(Z))
    m = np.abs(shape.moment(Z) - finest().moment(Z)) / 5
    return float(max(r.max(), d.max(), m.max()))


def order(degree: int, place: str) -> float:
    """Slope through the three finest meshes whose error is above the floor."""
    sizes = [n for n in ELEMENTS if error(n, degree, place) > FLOOR][-3:]
    errors = [error(n, degree, place) for n in sizes]
    return float(-np.polyfit(np.log(sizes), np.log(errors), 1)[0])


def theory(degree: int, place: str) -> int:
    """Order of the Gauss method: 2 d at the edges, d + 1 inside."""
    return 2 * degree if place == "edges" else degree + 1


def orders(place: str) -> Values:
    """Measured orders divided by theoretical ones."""
    ratios = [order(degree, place) / theory(degree, place) for degree in DEGREES]
    return np.array(ratios), np.ones(len(ratios))


def independent() -> Values:
    """The finest mesh and shooting with DOP853: positions, directors, moments over 5 N m."""
    start = finest().moment(np.zeros(1))[0]
    moment = reference.shoot(oblique(), GAMMA, HEAD, LOAD, start)
    Z = np.linspace(0, 1, 41)
    r, d, m = reference.march(oblique(), GAMMA, HEAD, [LOAD], moment, Z, rtol=3e-14, atol=1e-14)
    found = [finest().position(Z), finest().directors(Z), finest().moment(Z) / 5]
    return flat(found, [r[0], d[0], m[0] / 5])


CASES = (
    Case(
        SUBJECT,
        "Order at element edges divided by 2 d, degrees 1 to 8",
        "superconvergence of Gauss methods (Hairer, Norsett & Wanner, II.7)",
        lambda: orders("edges"),
        0.1,
        "meshes not yet asymptotic",
    ),
    Case(
        SUBJECT,
        "Order inside elements divided by d + 1, degrees 1 to 8",
        "collocation polynomials (the same)",
        lambda: orders("inside"),
        0.1,
        "meshes not yet asymptotic",
    ),
    Case(
        SUBJECT,
        "Reference for these errors, 24 elements of degree 12",
        "eqs. (14), (15) implemented independently, shooting with DOP853 at 3e-14",
        independent,
        1e-11,
        "3e-14 per step; shooting to 1e-12",
        "m, 1, 5 N m",
    ),
)

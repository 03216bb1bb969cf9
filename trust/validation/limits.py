"""The strain map where taper, helix or thickness vanish, and the critical helix angle."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from scipy.integrate import quad
from scipy.optimize import brentq

from trunk_ocp.model.activation import radial_integrals, strain_matrix
from trunk_ocp.model.anatomy import Muscle, Trunk
from trunk_ocp.rod.statics import solve_statics

from .case import Case, CoveredByTest, Values
from .rods import EVERYTHING, contractions, elephant, heads, rod, untapered

SUBJECT = "Limiting cases of the anatomy"
SPECIAL = math.acos(1 / math.sqrt(3))  # 54.7356 degrees


def layer(thickness: float, helix: float, trunk: Trunk) -> Muscle:
    """A helical layer under a trunk's surface; thickness over its radius, helix in radians."""
    R = trunk.base_radius
    return Muscle("R1-x", "x", "R", 0, "helical", ((1 - thickness) * R, R), (0, 1), helix)


def critical_angle(trunk: Trunk, muscle: Muscle, measure: int = 0) -> float:
    """Helix in radians at which a muscle's delta_0 (extension) or delta_1 (bending) vanishes."""

    def response(helix: float) -> float:
        return radial_integrals(trunk, replace(muscle, helix=helix))[measure]

    return float(brentq(response, 0.1, 1.5, xtol=1e-14))


def thin_angle(taper: float, poisson: float = 0.5) -> float:
    """Critical angle of a thin layer: cos^2(helix) cos^2(taper) = nu / (1 + nu)."""
    return math.acos(math.sqrt(poisson / (1 + poisson)) / math.cos(taper))


def deltas_untapered(trunk: Trunk, muscle: Muscle) -> tuple[float, float, float]:
    """delta_0, delta_1, delta_3 of eq. (6) without taper: elementary integrals."""
    (a, b), nu = muscle.radii, trunk.poisson_ratio
    square, cube = (b**2 - a**2) / 2, (b**3 - a**3) / 3
    if muscle.architecture == "radial":
        return -nu * square, -nu * cube, 0.0
    if muscle.architecture == "longitudinal":
        return square, cube, 0.0
    t = math.tan(muscle.helix) / b  # tan alpha = t R, and 1 / (1 + t^2 R^2) is D_Z^2
    log = math.log1p((t * b) ** 2) - math.log1p((t * a) ** 2)
    arc = math.atan(t * b) - math.atan(t * a)
    return (
        (1 + nu) * log / (2 * t**2) - nu * square,
        (1 + nu) * ((b - a) / t**2 - arc / t**3) - nu * cube,
        square / t - log / (2 * t**3),
    )


def scale(trunk: Trunk, muscle: Muscle) -> np.ndarray:
    """Scales of delta_0, delta_1 and delta_3 of a muscle."""
    a, b = muscle.radii
    return np.array([(b**2 - a**2) / 2, (b**3 - a**3) / 3, (b**3 - a**3) / 3])


def all_muscles(trunk: Trunk) -> np.ndarray:
    """Scaled radial integrals (28, 3) of every muscle."""
    return np.array([radial_integrals(trunk, m) / scale(trunk, m) for m in trunk.subdomains])


def untapered_forms() -> Values:
    """All 28 muscles of the trunk without taper."""
    trunk = untapered(elephant())
    exact = [deltas_untapered(trunk, m) / scale(trunk, m) for m in trunk.subdomains]
    return all_muscles(trunk), np.array(exact)


def vanishing_taper() -> Values:
    """Strain matrices for 1e-6 rad of taper and for none, divided by each row's largest entry."""
    nearly, none = (strain_matrix(untapered(elephant(), taper)) for taper in (1e-6, 0.0))
    size = np.abs(none).max(axis=2, keepdims=True)
    return nearly / size, none / size


def taper_order() -> Values:
    """Order at which the strain matrix approaches that without taper."""
    none = strain_matrix(untapered(elephant()))
    gaps = [
        np.abs(strain_matrix(untapered(elephant(), taper)) - none).max() for taper in (4e-3, 2e-3)
    ]
    return np.array([math.log2(gaps[0] / gaps[1])]), np.array([2.0])


def vanishing_taper_of_shapes() -> Values:
    """Loaded and unloaded shapes for 1e-10 rad of taper and for none, in m."""
    activation, psi = contractions(elephant(), 3, seed=60), heads(3, 61)
    Z = np.linspace(0, 1.75, 9)
    nearly, none = (
        np.stack(
            [
                solve_statics(trunk, activation, psi, load).position(Z)
                for load in (EVERYTHING, EVERYTHING.scaled(0.0))
            ]
        )
        for trunk in (untapered(elephant(), 1e-10), untapered(elephant()))
    )
    return nearly, none


def vanishing_helix() -> Values:
    """Oblique muscles at 1e-7 rad beside longitudinal ones, and their twist over its slope."""
    trunk, found, expected = elephant(), [], []
    k = trunk.taper_rate
    for muscle in trunk.subdomains:
        if muscle.architecture != "helical":
            continue
        slight = replace(muscle, helix=1e-7)
        straight = replace(muscle, helix=0.0, architecture="longitudinal")
        d0, d1, d3 = radial_integrals(trunk, slight) / scale(trunk, muscle)
        slope = quad(
            lambda R, b=muscle.radii[1]: R**3 / (b * math.hypot(1, k * R)),
            *muscle.radii,
            epsabs=0,
            epsrel=1e-13,
        )[0]
        found.append((d0, d1, d3 / 1e-7))
        expected.append(
            (*(radial_integrals(trunk, straight) / scale(trunk, muscle))[:2],
             slope / scale(trunk, muscle)[2])
        )  # fmt: skip
    return np.array(found), np.array(expected)


THICKNESS = 0.4 / 2.0 ** np.arange(10)


def approach(measure: int, taper: float = 0.0) -> np.ndarray:
    """Critical angles minus that of a thin layer, in radians, for every THICKNESS."""
    trunk = untapered(rod(), taper)
    angles = [critical_angle(trunk, layer(t, 0.5, trunk), measure) for t in THICKNESS]
    return np.array(angles) - thin_angle(taper)


def thin_limit() -> Values:
    """Critical angles in degrees by extension and bending, extrapolated to zero thickness."""
    found = []
    for measure in (0, 1):
        last, end = approach(measure)[-2:]
        found.append(math.degrees(SPECIAL + 2 * end - last))
    return np.array(found), np.full(2, math.degrees(SPECIAL))


def thin_slope() -> Values:
    """Growth of the critical angle with thickness, by both measures, in radians."""
    slopes = [2 * approach(m)[-1] / THICKNESS[-1] - approach(m)[-2] / THICKNESS[-2] for m in (0, 1)]
    # Half way through the layer tan(helix) is sqrt(2): sqrt(2) (1 + t / 2) on its surface.
    return np.array(slopes), np.full(2, math.sqrt(2) / 6)


def tapered_thin_limit() -> Values:
    """Critical angles in degrees of a layer of 1e-7 R, tapers to 20 degrees, three nu."""
    found, expected = [], []
    for taper in np.radians([0.0, 4.81, 10.0, 20.0]):
        for poisson in (0.5, 0.4, 0.3):
            trunk = replace(untapered(rod(), taper), poisson_ratio=poisson)
            found.append(critical_angle(trunk, layer(1e-7, 0.5, trunk)))
            expected.append(thin_angle(taper, poisson))
    return np.degrees(found), np.degrees(expected)


def oblique_angles() -> list[tuple[str, float, float]]:
    """Critical angles in degrees of the trunk's right oblique muscles, by delta_0 and delta_1."""
    trunk = elephant()
    return [
        (
            muscle.name[1:],
            math.degrees(critical_angle(trunk, replace(muscle, helix=0.5), 0)),
            math.degrees(critical_angle(trunk, replace(muscle, helix=0.5), 1)),
        )
        for muscle in trunk.subdomains
        if muscle.architecture == "helical" and muscle.side == "R"
    ]


def printed_deltas(trunk: Trunk, muscle: Muscle) -> np.ndarray:
    """delta_0, delta_1, delta_3 of a helical muscle as eq. (A.4) prints them, in doubles."""
    (R1, R2), nu = muscle.radii, trunk.poisson_ratio
    phi, alpha = trunk.taper_rate, math.tan(muscle.helix) / R2
    A = np.sqrt(complex(phi**2 - alpha**2))
    B1, B2 = (np.sqrt(1 + phi**2 * R**2) for R in (R1, R2))
    C1, C2 = (1 + alpha**2 * R**2 for R in (R1, R2))
    first = nu * (R1**2 - R2**2) - (1 + nu) / A**2 * np.log(B1**2 * C2 / (B2**2 * C1))
    bracket = (
        phi * np.arctan(alpha * R1)
        - alpha * np.arctan(phi * R1)
        - phi * np.arctan(alpha * R2)
        + alpha * np.arctan(phi * R2)
    )
    second = (R1**3 - R2**3) * nu / 3 - (1 + nu) / (alpha * phi * A**2) * bracket
    turns = np.arctan(alpha * B1 / A) - np.arctan(alpha * B2 / A)
    third = (B2 - B1) / (alpha * phi**2) + turns / (alpha**2 * A)
    return np.real([first / 2, second, third])


def printed_loss(taper: float, helix: float) -> np.ndarray:
    """Relative errors (3,) of eq. (A.4) in double precision for a layer of 0.15 R, by quadrature.

    The quadrature itself is right to round-off at any taper and helix: see the cases.
    """
    trunk = untapered(rod(), taper)
    muscle = layer(0.15, helix, trunk)
    return np.abs(printed_deltas(trunk, muscle) / radial_integrals(trunk, muscle) - 1)


def printed_forms() -> Values:
    """Eq. (A.4) in double precision, for the trunk's own oblique muscles, over ours."""
    trunk = elephant()
    oblique = [muscle for muscle in trunk.subdomains if muscle.architecture == "helical"]
    ratios = [printed_deltas(trunk, m) / radial_integrals(trunk, m) for m in oblique]
    return np.array(ratios), np.ones((len(oblique), 3))


CASES = (
    Case(
        SUBJECT,
        "Radial factors of all 28 muscles, no taper",
        "elementary integrals of eq. (6), derived",
        untapered_forms,
        5e-13,
        "the elementary forms cancel; round-off",
    ),
    Case(
        SUBJECT,
        "Taper of 1e-6 rad vs. none: strain map of all 28 muscles",
        "continuity",
        vanishing_taper,
        1e-11,
        "taper squared times a factor",
    ),
    Case(
        SUBJECT,
        "Order at which the strain map approaches that without taper",
        "cos^2(taper): 2",
        taper_order,
        1e-3,
        "next term: taper squared",
    ),
    Case(
        SUBJECT,
        "Taper of 1e-10 rad vs. none: shapes, with all loads and without",
        "continuity",
        vanishing_taper_of_shapes,
        1e-8,
        "the trunk is 8 radii long and thins by 1e-9; up to 10 times as much at the tip",
        "m",
    ),
    Case(
        SUBJECT,
        "Helix of 1e-7 rad: as a longitudinal muscle, with proportional twist",
        "continuity; integral of R^3 cos(taper) / R_2",
        vanishing_helix,
        1e-12,
        "helix squared (1e-14) and round-off",
    ),
    Case(
        SUBJECT,
        "Critical helix of a thin layer, no taper, by extension and by bending",
        "acos(1 / sqrt 3) = 54.7356 degrees (the paper, section 4: McKibben's angle)",
        thin_limit,
        1e-4,
        "extrapolated from thickness R / 640 and R / 1280",
        "degrees",
    ),
    Case(
        SUBJECT,
        "Slope of that angle with thickness / R",
        "sqrt(2) / 6, derived: the middle of the layer is at the special angle",
        thin_slope,
        1e-5,
        "extrapolated in the same way",
        "rad",
    ),
    Case(
        SUBJECT,
        "Critical helix of a thin layer, tapers to 20 degrees, nu = 0.3, 0.4, 0.5",
        "cos^2(helix) cos^2(taper) = nu / (1 + nu), derived",
        tapered_thin_limit,
        1e-5,
        "thickness 1e-7 R",
        "degrees",
    ),
    Case(
        SUBJECT,
        "Radial factors of the 10 oblique muscles as in the paper, double precision",
        "eq. (A.4), with imaginary A",
        printed_forms,
        1e-9,
        "cancellation in (A.4) at this taper",
    ),
    CoveredByTest(
        SUBJECT,
        "The same for all 28 muscles, 40 digits",
        "eq. (A.4) by mpmath",
        "tests/model/test_strain_integrals.py::test_radial_integrals_are_the_closed_forms_a_4",
    ),
    CoveredByTest(
        SUBJECT,
        "Where (A.4) is 0/0: taper or helix 0, A = 0, helices to 89 degrees",
        "quadrature by mpmath, 30 digits",
        "tests/model/test_strain_integrals.py::test_helical_integrals_hold_where_a_4_is_indefinite",
    ),
    CoveredByTest(
        SUBJECT,
        "Extension, curvature and twist of all 28 muscles anywhere along the trunk",
        "eqs. (5), (6), (10), (19)-(23), adaptive quadrature over the section",
        "tests/model/test_strain_integrals.py::"
        "test_extension_and_curvature_are_the_integrals_of_eq_6_anywhere_in_the_segment",
    ),
    CoveredByTest(
        SUBJECT,
        "Volume of the activated trunk",
        "frustum of eq. (30), with the missing 1/L",
        "tests/model/test_activation.py::test_volume_is_preserved_by_eq_30",
    ),
)

"""Buckling loads and the stability of shapes, covered by tests/rod/test_buckling.py."""

from __future__ import annotations

from .case import CoveredByTest

SUBJECT = "Stability"

TESTS = {
    "Euler load of a clamped-free column, where the margin vanishes": (
        "pi^2 E I / (4 L^2)",
        "a_column_buckles_under_eulers_load",
    ),
    "Euler load of a thick column, which shortens first": (
        "P (1 - P / E A) = pi^2 E I / (4 L^2)",
        "a_thick_column_buckles_a_little_later_as_it_shortens",
    ),
    "Margin and unstable directions below and above the first three buckling loads": (
        "1 - P / P_Euler; 0, 2, 4, 6 directions",
        "the_margin_of_a_column_is_what_euler_leaves",
    ),
    "Euler load of an activated, twisted column": (
        "Euler load for its length and thickness from eq. (30)",
        "an_active_column_buckles_by_its_own_length_and_thickness_however_twisted",
    ),
    "Self-buckling of an upright rod": (
        "Greenhill 1881, q L^3 / E I = 7.8373 from the zero of J_{-1/3}",
        "an_upright_rod_buckles_under_its_weight_where_greenhill_says",
    ),
    "Self-buckling of an upright cone": (
        "Greenhill 1881, the zero of J_3",
        "an_upright_cone_buckles_under_its_weight_where_greenhill_says",
    ),
    "Buckling load of a tapered column": (
        "Euler's equation with E I ~ (1 - k Z)^4, in closed form",
        "a_tapered_column_buckles_where_its_closed_form_says",
    ),
    "Post-buckled, first mode: stable except for rotation about the thrust": (
        "elastica, elliptic functions; the plane of buckling is arbitrary",
        "a_buckled_column_is_neutral_about_its_axis_and_stable_otherwise",
    ),
    "Post-buckled, second mode: unstable": (
        "elastica, elliptic functions",
        "a_column_bent_in_its_second_mode_is_unstable",
    ),
    "Unstable directions of 20 active, loaded trunks": (
        "focal points of the Jacobi equation integrated from the free end",
        "the_index_is_the_number_of_focal_points",
    ),
    "Margin of active, loaded trunks": (
        "Hessian of the energy of a discrete chain of rotations",
        "a_chain_of_rotations_is_as_stable",
    ),
}

CASES = tuple(
    CoveredByTest(SUBJECT, name, source, f"tests/rod/test_buckling.py::test_{test}")
    for name, (source, test) in TESTS.items()
)

"""Vibrations and flutter, covered by tests/rod/test_flutter.py."""

from __future__ import annotations

from .case import CoveredByTest

SUBJECT = "Vibrations and flutter"

TESTS = {
    "Bending frequencies of a clamped-free beam, with and without a mass at its tip": (
        "1 + cos b cosh b = b m (sin b cosh b - cos b sinh b), Rayleigh",
        "bending_frequencies_of_a_clamped_free_beam_with_a_mass_at_its_tip",
    ),
    "Twisting and stretching frequencies of a thick rod": (
        "odd quarters of waves",
        "a_thick_rod_twists_and_stretches_as_fast_as_its_waves_run",
    ),
    "Flutter of a column under a couple fixed in space": (
        "Nicolai 1928; its boundary value problem by shooting, complex frequencies",
        "nicolais_column_flutters_under_any_couple",
    ),
    "Flutter under a small couple": (
        "first-order perturbation of the double frequency, in closed form",
        "a_small_couple_makes_the_growth_of_first_order",
    ),
    "Vibrations of active, loaded trunks that carry masses": (
        "discrete chain of rotations with masses",
        "a_chain_of_rotations_with_masses_vibrates_alike",
    ),
}

CASES = tuple(
    CoveredByTest(SUBJECT, name, source, f"tests/rod/test_flutter.py::test_{test}")
    for name, (source, test) in TESTS.items()
)

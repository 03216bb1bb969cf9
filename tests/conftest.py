"""Fixtures that every test of the model layer shares."""

import pytest

from trunk_ocp.model.anatomy import load_anatomy
from trust.validation import rods


@pytest.fixture(scope="session")
def trunk():
    """The Asian elephant of the paper."""
    return load_anatomy("asian-elephant")


@pytest.fixture(scope="session")
def draw():
    """Sampler of contractions (count, muscles) within the paper's 0.67 <= extension <= 1.35."""
    return rods.contractions


@pytest.fixture(scope="session")
def build():
    """Builder of small trunks: `build()` is an untapered rod without muscles, clamped along +Z."""
    return rods.rod

"""Fixtures that every test of the model layer shares."""

import numpy as np
import pytest

from trunk_ocp.activation import strain_matrix
from trunk_ocp.anatomy import AnatomySpec, build_trunk, load_anatomy


@pytest.fixture(scope="session")
def trunk():
    """The Asian elephant of the paper."""
    return load_anatomy("asian-elephant")


@pytest.fixture(scope="session")
def draw():
    """Sampler of contractions (count, muscles) within the paper's 0.67 <= extension <= 1.35."""

    def sample(trunk, count, seed, strongest=1.0):
        rng = np.random.default_rng(seed)
        activation = -strongest * rng.random((count, len(trunk.muscles)))
        change = np.einsum("sm,bm->bs", strain_matrix(trunk)[:, 0], activation)
        room = np.where(change < 0, -0.33, 0.35) / np.where(change == 0, 1e-9, change)
        return activation * np.minimum(1.0, room.min(axis=1))[:, None]

    return sample


@pytest.fixture(scope="session")
def build():
    """Builder of small trunks: `build()` is an untapered rod without muscles, clamped along +Z."""

    def make(segments=None, material=None, **changes):
        spec = {
            "name": "rod",
            "length": 1.0,
            "base_radius_over_length": 0.05,
            "material": {"youngs_modulus": 1e6, "poisson_ratio": 0.5, "density": 1000.0}
            | (material or {}),
            "segments": segments or ({"Z_over_length": (0.0, 1.0)},),
        }
        return build_trunk(AnatomySpec.model_validate(spec | changes))

    return make

"""Caches do not grow in a loop over many trunks, such as an identification's."""

import dataclasses
import functools
import gc
import importlib
import inspect
import pkgutil

import numpy as np
import pytest

import trunk_ocp
from trunk_ocp.model.activation import strains
from trunk_ocp.model.loads import Loads
from trunk_ocp.nlp.point_functions import base, scaled_rates
from trunk_ocp.nlp.quantities import quantities, units_of
from trunk_ocp.rod.collocation import mesh_for
from trunk_ocp.rod.statics import solve_statics
from trunk_ocp.rod.tip_jacobian import tip_jacobian

FEW = {"int", "bool", "str", "ca.Function"}
"""Types of the keys of caches without bound: few values of each occur, whatever the trunks."""


@pytest.fixture(scope="module")
def caches():
    """All caches of the package."""
    for module in pkgutil.walk_packages(trunk_ocp.__path__, "trunk_ocp."):
        if "templates" not in module.name and "__main__" not in module.name:
            importlib.import_module(module.name)
    kind = functools._lru_cache_wrapper
    every = [x for x in gc.get_objects() if type(x) is kind]  # isinstance asks dead proxies
    found = [x for x in every if (x.__module__ or "").startswith("trunk_ocp")]
    assert len(found) > 20
    return found


def test_caches_by_trunk_load_or_number_are_bounded(caches):
    for cached in caches:
        if cached.cache_info().maxsize is None:
            parameters = inspect.signature(cached).parameters.values()
            assert {p.annotation for p in parameters} <= FEW, cached.__qualname__


def candidates(trunk, count, first):
    """Trunks that differ in their stiffness."""
    for i in range(first, first + count):
        yield dataclasses.replace(trunk, youngs_modulus=1e6 * (1 + i / 1000))


def test_a_loop_over_a_thousand_trunks_fills_no_cache(build, caches):
    trunk, load, none = build(taper_deg=1.0), Loads(), np.zeros(0)
    mesh = mesh_for(trunk, None, 2, 3)

    def sizes_after(count, first, solve):
        for candidate in candidates(trunk, count, first):
            strains(candidate, none), quantities(candidate)
            units = units_of(candidate)
            if solve:
                scaled_rates(units.length, units.moment), base(candidate)
                shape = solve_statics(candidate, none, (0.0, 0.3), load, mesh)
                tip_jacobian(shape, none, (0.0, 0.3), load)
        return sum(cached.cache_info().currsize for cached in caches)

    before = sizes_after(70, 0, solve=True)
    assert sizes_after(70, 70, solve=True) == before
    assert sizes_after(1000, 140, solve=False) == before


def test_candidates_of_an_identification_have_different_hashes(build):
    hashes = {hash(candidate) for candidate in candidates(build(), 100, 0)}
    assert len(hashes) == 100

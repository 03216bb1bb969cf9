"""Fixtures of the tests of exports."""

import pytest


@pytest.fixture
def unoptimized(monkeypatch):
    """Compile MEX files without optimization, which takes longer than it would save."""
    monkeypatch.setenv("CFLAGS", "-O0")

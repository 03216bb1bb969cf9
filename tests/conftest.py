"""Fixtures that many tests share, and what skipped tests mean for the whole run."""

import contextlib
import os
import shutil
import signal

import pytest
from programs import PACKAGES, needs

from trunk_ocp.codegen.request import ToolMissingError
from trunk_ocp.model.anatomy import load_anatomy
from trust.validation import rods

OPTIONAL = "make frameworks"
"""In the reason of skips that are no failure even where every test should run."""


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


def pytest_configure(config):
    """What every process that tests start inherits."""
    # Compiled kernels are kept with the tests, not in the user's cache folder.
    if cache := getattr(config, "cache", None):
        os.environ["NUMBA_CACHE_DIR"] = str(cache.mkdir("numba"))
    # A shell's background jobs ignore Ctrl-C.
    if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_setup():
    with skipped_without_its_program():
        return (yield)


@pytest.hookimpl(wrapper=True)
def pytest_pyfunc_call():
    with skipped_without_its_program():
        return (yield)


@contextlib.contextmanager
def skipped_without_its_program():
    """Skip a test that fails because a program, such as a compiler, is not installed."""
    try:
        yield
    except FileNotFoundError as error:
        if error.filename in PACKAGES:
            needs(error.filename)
        raise
    except ToolMissingError as error:
        if not all(map(shutil.which, PACKAGES)):
            pytest.skip(str(error))
        raise


def pytest_sessionfinish(session):
    """Where every test should run (TRUNK_OCP_RUN_ALL=1), a skipped one is a failure."""
    reporter = session.config.pluginmanager.get_plugin("terminalreporter")
    if reporter is None or not os.environ.get("TRUNK_OCP_RUN_ALL"):
        return
    skipped = [r for r in reporter.stats.get("skipped", []) if OPTIONAL not in str(r.longrepr)]
    if skipped and not session.exitstatus:
        session.exitstatus = pytest.ExitCode.TESTS_FAILED

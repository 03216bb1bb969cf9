"""Compiled functions are kept on the machine, and nothing in the cache folder can do harm."""

import os
import subprocess
import sys
from pathlib import Path

import numba
import pytest

from trunk_ocp._support import compiled
from trunk_ocp._support.compiled import CompiledFunction, cache_folder, source_file

OPTIONS = {"nogil": True}
TEXT = "def double(x): ..."


def double(x):
    return 2 * x


def outcome(text=TEXT):
    """Where the function comes from that a new process would call."""
    function = CompiledFunction(double, text, OPTIONS)
    assert function(3) == 6
    assert function(4) == 8
    stats = function.compiled.stats
    if not stats.cache_path:
        return "compiled in memory"
    return "loaded" if stats.cache_hits else "compiled"


@pytest.fixture(autouse=True)
def home(tmp_path, monkeypatch):
    """A user's empty home."""
    monkeypatch.setattr(numba.config, "CACHE_DIR", "")
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    for name in ("HOME", "LOCALAPPDATA"):
        monkeypatch.setenv(name, str(tmp_path))
    return tmp_path


def kept():
    """Numba's files."""
    return sorted(cache_folder().glob("*/__pycache__/*.nb?"))


def test_a_function_is_compiled_once_and_then_loaded(home):
    assert outcome() == "compiled"
    assert outcome() == "loaded"
    assert cache_folder().is_relative_to(home)
    assert [file.suffix for file in kept()] == [".nbc", ".nbi"]


@pytest.mark.parametrize("change", ["text", "numba", "processor"])
def test_it_is_compiled_again_if_anything_that_it_depends_on_changes(monkeypatch, change):
    assert outcome() == "compiled"
    if change == "text":
        assert outcome(TEXT + "\n") == "compiled"
    else:
        place, name, value = {
            "numba": (numba, "__version__", "0.0"),
            "processor": (compiled.llvmlite.binding, "get_host_cpu_name", lambda: "new"),
        }[change]
        before = source_file(TEXT)
        monkeypatch.setattr(place, name, value)
        assert source_file(TEXT) != before


@pytest.mark.parametrize("suffix", [".nbi", ".nbc"])
@pytest.mark.parametrize("content", [b"", b"damaged", "half"])
def test_damaged_files_are_replaced(suffix, content):
    assert outcome() == "compiled"
    (file,) = (file for file in kept() if file.suffix == suffix)
    whole = file.read_bytes()
    file.write_bytes(whole[: len(whole) // 2] if content == "half" else content)
    assert outcome() == "compiled"
    assert outcome() == "loaded"


def test_what_is_missing_is_compiled_again():
    assert outcome() == "compiled"
    for file in kept():
        file.unlink()
        assert outcome() == "compiled"
    source_file(TEXT).unlink()
    outcome()
    assert outcome() == "loaded"


def nowhere(home, monkeypatch):
    (home / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(home / "file"))


def no_home(home, monkeypatch):
    def fails():
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr(Path, "home", fails)


def open_to_others(home, monkeypatch):
    assert outcome() == "compiled"
    source_file(TEXT).parent.chmod(0o770)


def of_another(home, monkeypatch):
    assert outcome() == "compiled"
    monkeypatch.setattr(os, "geteuid", lambda: 12345)


def full(home, monkeypatch):
    def fails(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(numba.core.caching.IndexDataCacheFile, "save", fails)


@pytest.mark.skipif(os.name != "posix", reason="the places of Linux")
@pytest.mark.parametrize("case", [nowhere, no_home, open_to_others, of_another, full])
def test_where_nothing_can_be_kept_it_is_compiled_in_memory(home, monkeypatch, case):
    case(home, monkeypatch)
    assert outcome() == "compiled in memory"


@pytest.mark.skipif(sys.platform != "linux", reason="the places of Linux")
def test_the_folder_is_where_users_expect_it(home, monkeypatch):
    assert cache_folder() == home / ".cache" / "trunk_ocp"
    monkeypatch.setenv("XDG_CACHE_HOME", "relative, which counts as none")
    assert cache_folder() == home / ".cache" / "trunk_ocp"
    monkeypatch.setenv("XDG_CACHE_HOME", str(home / "xdg"))
    assert cache_folder() == home / "xdg" / "trunk_ocp"
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(home / "numba"))
    assert cache_folder() == home / "numba" / "trunk_ocp"
    assert outcome() == "compiled"
    assert outcome() == "loaded"


def test_two_processes_may_compile_at_once(home):
    script = (
        "from tests._support.test_compiled import TEXT, OPTIONS, CompiledFunction, double\n"
        "print(CompiledFunction(double, TEXT, OPTIONS)(3))"
    )
    environment = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"}
    start = lambda: subprocess.Popen(
        [sys.executable, "-c", script],
        env=environment,
        cwd=Path(__file__).parents[2],
        stdout=subprocess.PIPE,
        text=True,
    )
    for process in [start(), start()]:
        assert process.communicate()[0] == "6\n"
    assert len(kept()) == 2

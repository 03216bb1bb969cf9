"""Functions that numba compiles once per machine: kept in the user's cache folder.

Numba keeps compiled functions in files beside their source file, named by its path, and notices
changes of that file only. Here the source file is a copy in a folder named by a hash of everything
that the result depends on, so that nothing outdated can be loaded: the text of all functions, and
the versions of numba, LLVM, Python and the processor. Where the folder cannot be used, functions
are compiled in memory, in each process.

The files are pickles, which can run code when they are loaded. So the folder must belong to the
user and be closed to all others.
"""

from __future__ import annotations

import hashlib
import logging
import os
import sys
from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from types import FunctionType
from typing import Any

import llvmlite.binding
import numba

_log = logging.getLogger(__name__)
_config: Any = numba.config


class CompiledFunction:
    """A function that is loaded from the user's cache folder, or compiled, at its first call.

    Parameters
    ----------
    function : function
        Must not raise: an exception counts as a failure to load or to compile it.
    text : str
        Source of the function and of all that it calls.
    options : dict
        For `numba.njit`.
    """

    def __init__(self, function: FunctionType, text: str, options: dict[str, Any]) -> None:
        self._function, self._text, self._options = function, text, options

    def __call__(self, *arguments: Any) -> Any:
        try:
            return self.compiled(*arguments)
        except Exception as error:  # damaged files: whatever pickle and LLVM may raise
            _log.info("%s is compiled again: %s", self._function.__name__, error)
        self._discard()
        try:
            self.compiled = self._cached()
            return self.compiled(*arguments)
        except Exception as error:  # such as a full disk
            _log.info("%s is compiled in memory: %s", self._function.__name__, error)
        self.compiled = numba.njit(**self._options)(self._function)
        return self.compiled(*arguments)

    @cached_property
    def compiled(self) -> Any:
        """Numba's function."""
        try:
            return self._cached()
        except (OSError, RuntimeError) as error:  # no home, a read-only one, none for numba
            _log.info("%s is compiled in memory: %s", self._function.__name__, error)
            return numba.njit(**self._options)(self._function)

    def _cached(self) -> Any:
        file = source_file(self._text)
        code = self._function.__code__.replace(co_filename=str(file))
        moved = FunctionType(code, self._function.__globals__, self._function.__name__)
        return numba.njit(cache=True, **self._options)(moved)

    def _discard(self) -> None:
        """Remove the files of this function."""
        folder = self.compiled.stats.cache_path
        for file in Path(folder).glob(f"*.{self._function.__name__}-*") if folder else ():
            file.unlink(missing_ok=True)


def compiler(text: str, options: dict[str, Any]) -> Callable[[FunctionType], CompiledFunction]:
    """Decorator that makes a `CompiledFunction` of a function."""
    return lambda function: CompiledFunction(function, text, options)


def source_file(text: str) -> Path:
    """A copy of `text` in its own folder, beside which numba may keep what it compiles of it.

    Raises
    ------
    OSError, RuntimeError
        If there is no such folder, nor can it be created, or if it is not the user's own.
    """
    folder = cache_folder() / _hash(text)
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    status = folder.stat()
    if hasattr(os, "geteuid") and (status.st_uid != os.geteuid() or status.st_mode & 0o077):
        raise PermissionError(f"{folder} is open to other users")
    file = folder / "kernels.py"
    if not file.exists():  # written by two processes at once, it has the same content
        file.write_text(text, encoding="utf-8")
    return file


def cache_folder() -> Path:
    """The folder of trunk_ocp in the user's cache folder, or in NUMBA_CACHE_DIR.

    Raises
    ------
    RuntimeError
        If the user has no home.
    """
    place = _config.CACHE_DIR
    if not place and sys.platform == "win32":
        place = os.environ.get("LOCALAPPDATA") or Path.home() / "AppData/Local"
    elif not place and sys.platform == "darwin":
        place = Path.home() / "Library/Caches"
    elif not place:
        place = os.environ.get("XDG_CACHE_HOME", "")
        place = place if os.path.isabs(place) else Path.home() / ".cache"
    return Path(place) / "trunk_ocp"


def _hash(text: str) -> str:
    llvm = llvmlite.binding
    parts = [
        text, numba.__version__, llvmlite.__version__, sys.version,
        llvm.get_process_triple(), llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten(),
    ]  # fmt: skip
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()[:24]

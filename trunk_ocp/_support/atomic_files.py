"""Atomic writing of files, and folders that only one run at a time writes to.

A file is first written under a temporary name in its folder. That name has random digits and a
checksum of them, and the writer holds a lock on the file while it writes. This distinguishes files
that a killed process left behind from users' files and from files that another process is still
writing; only the former are removed.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import re
import secrets
from collections.abc import Iterator
from pathlib import Path

from filelock import FileLock, Timeout

from ..errors import InputError

try:
    import fcntl
except ImportError:  # Windows: no such locks, so leftover files are not removed
    fcntl = None  # type: ignore[assignment]

UNFINISHED = ".part"
LOCK = ".trunk-ocp.lock"
MAX_DEPTH = 2
"""Levels of folders below a run's own that it writes to: a plan's folder and its figures."""
MAX_STEM = 100
"""Characters of a name that are repeated in its temporary name; names have at most 255 bytes."""
_NAME = re.compile(
    r"\.(?P<stem>.*)\.trunk-ocp-(?P<random>[0-9a-f]{16})(?P<check>[0-9a-f]{16})\.part"
)

_unfinished: set[Path] = set()  # files that this process is writing


@contextlib.contextmanager
def replacing(path: str | Path, lasting: bool = True) -> Iterator[Path]:
    """Temporary name under which to write a file, in the folder of `path`, created if needed.

    At the end of the block the file replaces `path` atomically, or is removed if the block failed:
    at every moment there is either the old file or the new one. Any number of processes and threads
    may write the same file concurrently; the last one to finish wins.

    Parameters
    ----------
    lasting : bool
        Whether to flush the file to disk, so that it survives a power failure. This takes
        milliseconds; killing the process loses nothing in either case.

    Raises
    ------
    InputError
        If it cannot be written: no such folder, no permission, a full disk.
    """
    path = Path(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with _own_file(path) as unfinished:
            yield unfinished
            if lasting:
                _to_disk(unfinished)
            os.replace(unfinished, path)
    except OSError as error:
        raise InputError(
            f"{path}: cannot be written ({error.strerror or error}); free some space or name "
            "another folder."
        ) from error


@contextlib.contextmanager
def _own_file(path: Path) -> Iterator[Path]:
    """A new empty file beside `path`, locked within the block and removed after it."""
    unfinished, descriptor = _created(path)
    try:
        yield unfinished
    finally:
        unfinished.unlink(missing_ok=True)
        _unfinished.discard(unfinished)
        if descriptor is not None:
            os.close(descriptor)


def _created(path: Path) -> tuple[Path, int | None]:
    """Create a file beside `path`; its name, and the descriptor that holds its lock."""
    stem = path.stem[:MAX_STEM]
    while True:
        random = secrets.token_hex(8)
        # Keep the suffix, from which some writers infer the format.
        mark = f"trunk-ocp-{random}{_check(stem, random)}"
        unfinished = path.with_name(f".{stem}.{mark}{UNFINISHED}{path.suffix}")
        descriptor = os.open(unfinished, os.O_CREAT | os.O_EXCL | os.O_RDWR, 0o666)
        _unfinished.add(unfinished)
        if fcntl is None:
            os.close(descriptor)  # an open file cannot be renamed there
            return unfinished, None
        with contextlib.suppress(OSError):  # a file system without locks
            fcntl.flock(descriptor, fcntl.LOCK_EX)
        if unfinished.exists():
            return unfinished, descriptor
        # Another process removed it as a leftover file before it was locked.
        os.close(descriptor)
        _unfinished.discard(unfinished)


def _check(stem: str, random: str) -> str:
    return hashlib.sha256(f"trunk-ocp {stem} {random}".encode(errors="replace")).hexdigest()[:16]


def write(path: str | Path, content: bytes | str, lasting: bool = True) -> Path:
    """Write a file atomically, text as UTF-8, and return its path; see `replacing`.

    Raises
    ------
    InputError
        If it cannot be written.
    """
    with replacing(path, lasting) as unfinished:
        unfinished.write_bytes(content.encode() if isinstance(content, str) else content)
    return Path(path)


def discard_unfinished() -> None:
    """Remove the unfinished files of this process, before it exits."""
    for path in list(_unfinished):
        with contextlib.suppress(OSError):
            path.unlink(missing_ok=True)


def _to_disk(path: Path) -> None:
    descriptor = os.open(path, os.O_RDWR)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


@contextlib.contextmanager
def alone(folder: Path) -> Iterator[None]:
    """Lock a folder, created if needed, until the end of the block.

    The lock belongs to the process, not to the file: a killed run leaves no lock behind. Its
    unfinished files are removed.

    Raises
    ------
    InputError
        If another run is writing to the folder, or if it is not writable.
    """
    path = folder / LOCK
    lock = FileLock(path)
    try:
        _make(folder)
        if path.is_symlink() or (path.exists() and (not path.is_file() or path.stat().st_size)):
            raise InputError(
                f"{path}: is not a lock file of this program, which would be empty. Move it away "
                "or name another folder with --out."
            )
        lock.acquire(timeout=0)
    except Timeout:
        raise InputError(
            f"{folder}: another run is writing to this folder; wait until it has finished, or "
            "name another folder with --out."
        ) from None
    except OSError as error:
        raise InputError(
            f"{folder}: cannot be written to ({error.strerror or error}); name another folder "
            "with --out."
        ) from None
    try:
        _remove_left_behind(folder)
        yield
    finally:
        with contextlib.suppress(OSError):  # while it is still locked
            path.unlink(missing_ok=True)
        lock.release()


def _make(folder: Path) -> None:
    """Create a folder; InputError where that is impossible, such as in /proc."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except FileNotFoundError:
        above = next((place for place in folder.parents if place.exists()), folder)
        raise InputError(
            f"{folder}: no folder can be created in {above}; name another folder with --out."
        ) from None


def _remove_left_behind(folder: Path, depth: int = 0) -> None:
    """Remove unfinished files of killed processes from a folder and a run's folders in it."""
    with contextlib.suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            if entry.is_dir(follow_symlinks=False) and depth < MAX_DEPTH:
                _remove_left_behind(Path(entry.path), depth + 1)
            elif entry.is_file(follow_symlinks=False) and _is_ours(entry.name):
                _remove_if_ended(Path(entry.path))


def _is_ours(name: str) -> bool:
    """Whether a file name has the form of the temporary names of `replacing`."""
    match = _NAME.match(name)
    return match is not None and match["check"] == _check(match["stem"], match["random"])


def _remove_if_ended(path: Path) -> None:
    """Remove an unfinished file unless its writer still holds the lock on it."""
    if fcntl is None:
        return
    with contextlib.suppress(OSError):
        descriptor = os.open(path, os.O_RDWR | os.O_NOFOLLOW)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            path.unlink()
        finally:
            os.close(descriptor)

"""Writing so that nobody ever sees half a file, and so that two runs never share a folder.

A file is written under another name in its folder first. That name is no one else's: it has random
digits and a check of them, and its writer holds a lock on the file for as long as it writes. So
what a killed process left behind can be told from all that users may have, and from what another
process is writing at the moment, and only that is ever removed.
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
except ImportError:  # Windows: no such locks, and nothing that was left behind is removed
    fcntl = None  # type: ignore[assignment]

UNFINISHED = ".part"
LOCK = ".trunk-ocp.lock"
DEEPEST = 2
"""Folders below a run's own to which it writes: a plan's folder and the figures in that."""
LONGEST_STEM = 100
"""Characters of a name that its unfinished file repeats, as names may be 255 bytes long."""
_NAME = re.compile(
    r"\.(?P<stem>.*)\.trunk-ocp-(?P<random>[0-9a-f]{16})(?P<check>[0-9a-f]{16})\.part"
)

_unfinished: set[Path] = set()  # what this process is writing at the moment


@contextlib.contextmanager
def replacing(path: str | Path, lasting: bool = True) -> Iterator[Path]:
    """Name under which to write a file, in the folder of `path`, which is made if need be.

    At the end of the block the file takes its place at once, or is removed if the block failed:
    there is the old file or the new one, at every moment. Any number of processes and threads may
    write the same file at once; the last one to end wins.

    Parameters
    ----------
    lasting : bool
        Whether the file is on the disk itself at the end, and so survives a power cut. That takes
        milliseconds, and a process that is killed loses nothing either way.

    Raises
    ------
    InputError
        If it cannot be written there: no such place, no permission, a full disk.
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
            f"{path}: cannot be written ({error.strerror or error}); make room there or name "
            "another place."
        ) from error


@contextlib.contextmanager
def _own_file(path: Path) -> Iterator[Path]:
    """A new empty file beside `path` that is locked within the block, and gone after it."""
    unfinished, descriptor = _created(path)
    try:
        yield unfinished
    finally:
        unfinished.unlink(missing_ok=True)
        _unfinished.discard(unfinished)
        if descriptor is not None:
            os.close(descriptor)


def _created(path: Path) -> tuple[Path, int | None]:
    """A new file beside `path`, and the descriptor that holds its lock."""
    stem = path.stem[:LONGEST_STEM]
    while True:
        random = secrets.token_hex(8)
        # The end stays as it is: some writers tell the format from it.
        mark = f"trunk-ocp-{random}{_check(stem, random)}"
        unfinished = path.with_name(f".{stem}.{mark}{UNFINISHED}{path.suffix}")
        descriptor = os.open(unfinished, os.O_CREAT | os.O_EXCL | os.O_RDWR, 0o666)
        _unfinished.add(unfinished)
        if fcntl is None:
            os.close(descriptor)  # an open file could not be moved to its place
            return unfinished, None
        with contextlib.suppress(OSError):  # no locks on this file system: nothing is removed
            fcntl.flock(descriptor, fcntl.LOCK_EX)
        if unfinished.exists():
            return unfinished, descriptor
        # Another process took it for one that was left behind, before it was locked.
        os.close(descriptor)
        _unfinished.discard(unfinished)


def _check(stem: str, random: str) -> str:
    return hashlib.sha256(f"trunk-ocp {stem} {random}".encode(errors="replace")).hexdigest()[:16]


def write(path: str | Path, content: bytes | str, lasting: bool = True) -> Path:
    """Write a file whole, text as UTF-8; see `replacing`. Returns its path.

    Raises
    ------
    InputError
        If it cannot be written there.
    """
    with replacing(path, lasting) as unfinished:
        unfinished.write_bytes(content.encode() if isinstance(content, str) else content)
    return Path(path)


def discard_unfinished() -> None:
    """Remove what this process is writing, before it ends in the middle of it."""
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
    """Have a folder to oneself, which is made if need be, until the end of the block.

    The lock belongs to the process, not to the file: a run that is killed leaves no lock behind.
    What a killed run was writing is removed.

    Raises
    ------
    InputError
        If another run writes to the folder, or if it cannot be written to.
    """
    path = folder / LOCK
    lock = FileLock(path)
    try:
        _make(folder)
        if path.is_symlink() or (path.exists() and (not path.is_file() or path.stat().st_size)):
            raise InputError(
                f"{path}: is not a lock of this program, which has no content; expected no other "
                "file of this name. Move it away, or name another folder with --out."
            )
        lock.acquire(timeout=0)
    except Timeout:
        raise InputError(
            f"{folder}: another run is writing to this folder; wait until it has ended, or name "
            "another folder with --out."
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
        with contextlib.suppress(OSError):  # still locked, so that nobody can have it in between
            path.unlink(missing_ok=True)
        lock.release()


def _make(folder: Path) -> None:
    """Make a folder; InputError where there can be none, such as in /proc."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except FileNotFoundError:
        above = next((place for place in folder.parents if place.exists()), folder)
        raise InputError(
            f"{folder}: no folder can be made in {above}; name another folder with --out."
        ) from None


def _remove_left_behind(folder: Path, depth: int = 0) -> None:
    """Remove what killed processes were writing in a folder and those that a run makes in it."""
    with contextlib.suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            if entry.is_dir(follow_symlinks=False) and depth < DEEPEST:
                _remove_left_behind(Path(entry.path), depth + 1)
            elif entry.is_file(follow_symlinks=False) and _is_ours(entry.name):
                _remove_if_ended(Path(entry.path))


def _is_ours(name: str) -> bool:
    """Whether a file name is one that `replacing` makes up."""
    found = _NAME.match(name)
    return found is not None and found["check"] == _check(found["stem"], found["random"])


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

"""Writing so that nobody ever sees half a file, and so that two runs never share a folder."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

from filelock import FileLock, Timeout

from .errors import InputError

UNFINISHED = ".part"
LOCK = ".lock"

_unfinished: set[Path] = set()  # what this process is writing at the moment


@contextlib.contextmanager
def replacing(path: str | Path, lasting: bool = True) -> Iterator[Path]:
    """Name under which to write a file, in the folder of `path`, which is made if need be.

    At the end of the block the file takes its place at once, or is removed if the block failed:
    there is the old file or the new one, at every moment.

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
    # The end stays as it is: some writers tell the format from it.
    unfinished = path.with_name(f".{path.stem}.{os.getpid()}{UNFINISHED}{path.suffix}")
    try:
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            _unfinished.add(unfinished)
            yield unfinished
            if lasting:
                _to_disk(unfinished)
            os.replace(unfinished, path)
        finally:
            unfinished.unlink(missing_ok=True)
            _unfinished.discard(unfinished)
    except OSError as error:
        raise InputError(
            f"{path}: cannot be written ({error.strerror or error}); make room there or name "
            "another place."
        ) from error


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
    lock = FileLock(folder / LOCK)
    try:
        folder.mkdir(parents=True, exist_ok=True)
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
        for path in folder.rglob(f".*{UNFINISHED}*"):
            path.unlink(missing_ok=True)
        yield
    finally:
        with contextlib.suppress(OSError):  # still locked, so that nobody can have it in between
            (folder / LOCK).unlink(missing_ok=True)
        lock.release()

# SPDX-License-Identifier: MIT
"""Writes files atomically. Only replaced() overwrites existing files."""
from __future__ import annotations

import contextlib
import errno
import os
import pathlib
import secrets
import shutil
import signal
import socket
import zlib
from collections.abc import Iterator
from typing import Any, NoReturn

try:
    import fcntl
except ImportError:  # Windows
    pass

__all__ = ["locked", "replaced", "staged", "stop_by_signal", "sync"]


def stop_by_signal() -> list[int]:
    """Makes SIGINT, SIGTERM and SIGHUP raise KeyboardInterrupt. Returns a list to which received
    signals are appended. The list is needed because SQLite replaces an exception in its progress
    handler with an SQLite error."""
    stopped: list[int] = []

    def stop(number: int, _: Any) -> NoReturn:
        stopped.append(number)
        raise KeyboardInterrupt

    for number in signal.SIGINT, signal.SIGTERM, signal.SIGHUP:
        signal.signal(number, stop)
    return stopped


def refuse_existing(place: pathlib.Path) -> None:
    if os.path.lexists(place):
        raise FileExistsError(f"{place}: exists already; choose another name")


def locked(lock: pathlib.Path) -> int:
    """Creates a lock file, locks it, and returns its descriptor. Does not follow links. Raises
    BlockingIOError if another process holds the lock, and OSError for other errors."""
    while True:
        descriptor = os.open(lock, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o666)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if os.path.samestat(os.fstat(descriptor), os.lstat(lock)):
                return descriptor
        except FileNotFoundError:
            pass  # the previous owner removed the file, so the loop tries again
        except BaseException:
            os.close(descriptor)
            raise
        os.close(descriptor)


def sync(path: pathlib.Path) -> None:
    """Waits until the contents of a file or folder are on the disk."""
    descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    try:
        os.fsync(descriptor)
    except OSError as error:
        # some file systems cannot sync folders
        if error.errno not in (errno.EINVAL, errno.ENOTSUP):
            raise
    finally:
        os.close(descriptor)


def publish(source: pathlib.Path, place: pathlib.Path) -> None:
    """Renames a file, and syncs the file and its folder. Raises FileExistsError if `place`
    exists."""
    sync(source)
    try:
        os.link(source, place)
    except OSError:  # `place` exists, or the file system has no hard links
        refuse_existing(place)
        source.rename(place)
    sync(place.parent)


@contextlib.contextmanager
def replaced(place: pathlib.Path) -> Iterator[pathlib.Path]:
    """Yields the path of a new file, which atomically replaces `place` when the context exits.
    Raises OSError if the file cannot be written."""
    new = place.with_name(f"{place.name}.{secrets.token_hex(8)}.part")
    try:
        new.open("xb").close()
        yield new
        sync(new)
        new.replace(place)
        sync(place.parent)
    finally:
        new.unlink(missing_ok=True)


@contextlib.contextmanager
def staged(place: pathlib.Path) -> Iterator[pathlib.Path]:
    """Yields the path of a new temporary file (in $TMPDIR, or hidden next to `place`), which is
    moved to `place` when the context exits. Does not follow links that others create. A lock
    excludes other processes. Files left by killed processes are replaced. Raises FileExistsError
    if `place` exists, BlockingIOError if another process is creating it, and OSError for other
    errors."""
    refuse_existing(place)
    key = zlib.crc32(os.fsencode(place.absolute()))
    name = f".{place.name}.{socket.gethostname()}-{key:08x}.unfinished"
    temporary = pathlib.Path(os.environ.get("TMPDIR") or place.parent) / name
    final = place.parent / name  # on the same file system as `place`
    lock = temporary.with_name(f"{name}.lock")
    try:
        descriptor = locked(lock)
    except BlockingIOError:
        raise BlockingIOError(f"{place}: another process is creating this file") from None
    try:
        for path in (temporary, final):
            path.unlink(missing_ok=True)
        temporary.open("xb").close()
        yield temporary
        if temporary.parent.resolve() != final.parent.resolve():
            with temporary.open("rb") as source, final.open("xb") as copy:
                shutil.copyfileobj(source, copy)
        publish(final, place)
    finally:
        for path in (temporary, final, lock):
            path.unlink(missing_ok=True)
        os.close(descriptor)

# SPDX-License-Identifier: MIT
"""A file that appears at its place only when it is whole, and never over another one."""
from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import pathlib
import secrets
import shutil
import signal
import socket
import zlib
from collections.abc import Iterator
from typing import Any, NoReturn


def stop_by_signal() -> list[int]:
    """SIGINT, SIGTERM and SIGHUP raise KeyboardInterrupt from now on. Returns where their numbers
    come, because SQLite makes an error of its own of one that its progress handler raises."""
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
    """Descriptor of the lock file, made and held: the one that is at this path, and no link. Raises
    BlockingIOError, OSError."""
    while True:
        held = os.open(lock, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o666)
        try:
            fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if os.path.samestat(os.fstat(held), os.lstat(lock)):
                return held
        except FileNotFoundError:
            pass  # removed by the process that held it
        except BaseException:
            os.close(held)
            raise
        os.close(held)


def sync(path: pathlib.Path) -> None:
    """Waits until this file or folder is on the disk."""
    descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno not in (errno.EINVAL, errno.ENOTSUP):  # the file system syncs no folders
            raise
    finally:
        os.close(descriptor)


def publish(beside: pathlib.Path, place: pathlib.Path) -> None:
    """Gives the file its name: fsync of file, rename, fsync of folder. Raises FileExistsError."""
    sync(beside)
    try:
        os.link(beside, place)
    except OSError:  # exists already, or there are no links on this disk
        refuse_existing(place)
        beside.rename(place)
    sync(place.parent)


@contextlib.contextmanager
def replaced(place: pathlib.Path) -> Iterator[pathlib.Path]:
    """Yields the path of a new file, which then replaces the one at `place`: fsync of file, rename,
    fsync of folder. Raises OSError."""
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
    """Yields the path where the file grows: in $TMPDIR, or hidden beside its place. Nobody else
    makes it meanwhile, and the rest that a process left when it died is made anew. Raises
    FileExistsError, BlockingIOError, OSError."""
    refuse_existing(place)
    key = zlib.crc32(os.fsencode(place.absolute()))
    name = f".{place.name}.{socket.gethostname()}-{key:08x}.unfinished"
    grown, beside = pathlib.Path(os.environ.get("TMPDIR")
                                 or place.parent) / name, place.parent / name
    lock = grown.with_name(f"{name}.lock")
    try:
        held = locked(lock)
    except BlockingIOError:
        raise BlockingIOError(f"{place}: another process is creating this file") from None
    try:
        for path in (grown, beside):
            path.unlink(missing_ok=True)
        yield grown
        if grown.parent.resolve() != beside.parent.resolve():
            shutil.copyfile(grown, beside)
        publish(beside, place)
    finally:
        for path in (grown, beside, lock):
            path.unlink(missing_ok=True)
        os.close(held)

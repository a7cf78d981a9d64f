# SPDX-License-Identifier: MIT
"""A file that appears at its place only when it is whole, and never over another one."""
from __future__ import annotations

import contextlib
import fcntl
import os
import pathlib
import shutil
import socket
import zlib
from collections.abc import Iterator


def refuse_existing(place: pathlib.Path) -> None:
    if os.path.lexists(place):
        raise FileExistsError(f"{place}: exists already; choose another name")


@contextlib.contextmanager
def staged(place: pathlib.Path) -> Iterator[pathlib.Path]:
    """Yields the path where the file grows: in $TMPDIR, or hidden beside its place. Nobody else makes it meanwhile, and the
    rest that a process left when it died is made anew. Raises FileExistsError, BlockingIOError, OSError."""
    refuse_existing(place)
    name = f".{place.name}.{socket.gethostname()}-{zlib.crc32(os.fsencode(place.absolute())):08x}.unfinished"
    grown, beside = pathlib.Path(os.environ.get("TMPDIR") or place.parent) / name, place.parent / name
    lock = grown.with_name(f"{name}.lock")
    with open(lock, "w") as held:
        try:
            fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise BlockingIOError(f"{place}: another process is making it") from None
        try:
            grown.unlink(missing_ok=True)
            yield grown
            if grown.parent.resolve() != beside.parent.resolve():
                shutil.copyfile(grown, beside)
            with open(beside, "rb") as file:
                os.fsync(file.fileno())
            refuse_existing(place)
            beside.rename(place)
        finally:
            for path in (grown, beside, lock):
                path.unlink(missing_ok=True)

# SPDX-License-Identifier: MIT
"""Computes CRC-32C checksums and packs tags with the C library of drivers/bridge/bridge_pack.cpp, which releases
Python's global lock. If the library is missing, the Python package crc32c computes the checksums."""
import collections
import ctypes
import os
import pathlib

try:
    import numpy as np
except ImportError as error:  # bridge.py reports the missing package
    np, MISSING = None, str(error)
else:
    MISSING = None

NAME, VERSION = "libechofuse_bridge_pack.so", 3
RECORD = {"names": ["type", "missed_events", "channel", "time"],
          "formats": ["u1", "<u2", "<i4", "<i8"], "offsets": [0, 2, 4, 8], "itemsize": 16}
BLOCK_TAGS = 32768  # 512 KiB, which fit into the L2 cache

# A block of packed tags: payload, number of items, laser starts and overflow markers.
Packed = collections.namedtuple("Packed", "payload items starts overflows")


def open_library():
    """Loads the library from $ECHOFUSE_BRIDGE_LIBRARY, this folder or the build folder. Returns (library, ""), or
    (None, reason) if it cannot be loaded."""
    here = pathlib.Path(__file__).resolve().parent
    named = os.environ.get("ECHOFUSE_BRIDGE_LIBRARY")
    places = [here / NAME, *(top / "build/release/lib" / NAME for top in here.parents[1:2])]
    if named is not None:
        places = [pathlib.Path(named)]
    path = next((place for place in places if place.is_file()), None)
    if path is None:
        return None, f"{NAME} is missing"
    pointer, u32, i32 = ctypes.c_void_p, ctypes.c_uint32, ctypes.c_int32
    try:
        found = ctypes.CDLL(str(path))
        if found.echofuse_bridge_pack_version() != VERSION:
            return None, f"{path} was built for another version of the bridges"
        found.echofuse_pack_tags.argtypes = [pointer, pointer, u32, i32, i32, pointer]
        found.echofuse_crc32c.argtypes = [pointer, ctypes.c_size_t, u32]
        found.echofuse_pack_tags.restype, found.echofuse_crc32c.restype = None, u32
    except (OSError, AttributeError) as error:
        return None, f"{path} cannot be used: {error}"
    return found, None


library, failure = open_library()
if library is None:
    try:
        from crc32c import crc32c
    except ImportError as error:
        MISSING = MISSING or str(error)
else:
    def crc32c(buffer, crc=0):
        """Continues a CRC-32C checksum: returns the checksum of the earlier bytes followed by these
        bytes."""
        place = buffer if isinstance(buffer, bytes) else np.frombuffer(buffer, "u1").ctypes.data
        return library.echofuse_crc32c(place, len(buffer), crc)


def keep_freed_memory():
    """Makes glibc keep freed memory, because mapping new pages takes as long as packing the tags."""
    trim_threshold, mmap_threshold = -1, -3
    try:
        libc = ctypes.CDLL(None)
        libc.mallopt(mmap_threshold, 32 << 20)
        libc.mallopt(trim_threshold, 128 << 20)
    except (OSError, AttributeError):
        pass  # not glibc


def pack(tags, channels):
    """Packs the tags of the start and click channels and the error and overflow markers of all channels into blocks.
    Tags of other channels are dropped, because a measurement also receives tags that other measurements requested. Copies the
    structured array."""
    ours, fields = np.dtype(RECORD), tags.dtype.fields
    if tags.itemsize != 16 or any(
            (fields or {}).get(name, ())[:2] != ours.fields[name][:2] for name in ours.names):
        raise RuntimeError(f"the library's tags have the format {tags.dtype}; expected {ours}")
    tags = np.ascontiguousarray(tags)
    blocks = (pack_block(tags[first:first + BLOCK_TAGS], channels)
              for first in range(0, len(tags), BLOCK_TAGS))
    return [packed for packed in blocks if packed.items]


def pack_block(tags, channels):
    payload, counts = np.empty(tags.nbytes, "u1"), np.zeros(3, "u4")
    library.echofuse_pack_tags(tags.ctypes.data, payload.ctypes.data, len(tags), *channels,
                               counts.ctypes.data)
    kept, starts, overflows = map(int, counts)
    return Packed(payload[:16 * kept].data, kept, starts, overflows)

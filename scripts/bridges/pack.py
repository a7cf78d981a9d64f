# SPDX-License-Identifier: MIT
"""CRC-32C and the packing of tags: in our C library (drivers/bridge_pack), which is built with the
product and works without Python's lock; where it is absent, with the Python package crc32c."""
import collections
import ctypes
import os
import pathlib

try:
    import numpy as np
except ImportError as error:  # bridge.require_packages() tells
    np, MISSING = None, str(error)
else:
    MISSING = None

NAME, VERSION = "libechofuse_bridge_pack.so", 2
RECORD = {"names": ["type", "missed_events", "channel", "time"], "formats": ["u1", "<u2", "<i4", "<i8"],
          "offsets": [0, 2, 4, 8], "itemsize": 16}
BLOCK_TAGS = 32768  # 512 KiB, which stay in a processor's second cache
OVERFLOW_BEGIN = 2  # type of the tag at which a device starts to lose events
MISSED = 4          # the first type of marks that belong to a channel, as tags (0) do

# The tags of a block: its payload with its CRC (None: not known yet), and what Losses wants to know.
Packed = collections.namedtuple("Packed", "payload items crc starts overflows")


class Result(ctypes.Structure):
    _fields_ = [("crc", ctypes.c_uint32), ("overflows", ctypes.c_uint32), ("starts", ctypes.c_uint64),
                ("kept", ctypes.c_uint64)]


def open_library():
    """ECHOFUSE_BRIDGE_LIBRARY, or beside this file, or where the build puts it. None, and why not."""
    here = pathlib.Path(__file__).resolve().parent
    named = os.environ.get("ECHOFUSE_BRIDGE_LIBRARY")
    places = [here / NAME, *(top / "build/release/lib" / NAME for top in here.parents[1:2])]
    if named is not None:
        places = [pathlib.Path(named)]
    path = next((place for place in places if place.is_file()), None)
    if path is None:
        return None, f"{NAME} is not there"
    try:
        found = ctypes.CDLL(str(path))
        if found.echofuse_bridge_pack_version() != VERSION:
            return None, f"{path} is of another version"
        for name, result, arguments in (
                ("echofuse_pack_tags", None, "pointer pointer size int32 int32 pointer"),
                ("echofuse_crc32c", ctypes.c_uint32, "pointer size uint32"),
                ("echofuse_crc32c_join", ctypes.c_uint32, "uint32 uint32 uint64")):
            function = getattr(found, name)
            function.restype = result
            function.argtypes = [{"pointer": ctypes.c_void_p, "size": ctypes.c_size_t}.get(a)
                                 or getattr(ctypes, f"c_{a}") for a in arguments.split()]
    except (OSError, AttributeError) as error:
        return None, f"{path} does not serve: {error}"
    return found, None


library, why_not = open_library()
NO_CRC = None
if library is None:
    try:
        import crc32c
    except ImportError as error:
        NO_CRC = str(error)
        MISSING = MISSING or NO_CRC


def keep_freed_memory():
    """glibc gives a freed block back to the system and gets the next one page by page, which costs as
    much as the packing."""
    trim_threshold, mmap_threshold = -1, -3
    try:
        libc = ctypes.CDLL(None)
        libc.mallopt(mmap_threshold, 32 << 20)
        libc.mallopt(trim_threshold, 128 << 20)
    except (OSError, AttributeError):
        pass  # another C library


def address(buffer):
    """Of bytes as they are, of what else holds bytes by numpy."""
    return buffer if isinstance(buffer, bytes) else np.frombuffer(buffer, np.uint8).ctypes.data


def crc_of_block(header, payload, payload_crc=None):
    """CRC-32C of both; that of the payload may be known."""
    if library is None:
        return crc32c.crc32c(payload, crc32c.crc32c(header))
    crc = library.echofuse_crc32c(header, len(header), 0)
    if payload_crc is None:
        return library.echofuse_crc32c(address(payload), len(payload), crc)
    return library.echofuse_crc32c_join(crc, payload_crc, len(payload))


def pack(tags, channels):
    """The blocks of a structured array of tags, which may change afterwards: those of the start and the click
    channel, and marks of all channels. A measurement gets the tags that others asked the device for, too."""
    tags = np.ascontiguousarray(tags) if library and is_record(tags.dtype) else records(tags)
    blocks = (pack_block(tags[first:first + BLOCK_TAGS], *channels) for first in range(0, len(tags), BLOCK_TAGS))
    return [packed for packed in blocks if packed.items]


def pack_block(tags, start_channel, click_channel):
    if library is None:
        channel, kind = tags["channel"], tags["type"]
        ours = (channel == start_channel) | (channel == click_channel) | ((kind > 0) & (kind < MISSED))
        tags = tags.view(np.uint8).reshape(-1, 16)[ours].reshape(-1).view(tags.dtype)  # the reserved byte as well
        return Packed(tags.view(np.uint8).data, len(tags), None, np.count_nonzero(tags["channel"] == start_channel),
                      np.count_nonzero(tags["type"] == OVERFLOW_BEGIN))
    payload, result = np.empty(tags.nbytes, np.uint8), Result()
    library.echofuse_pack_tags(tags.ctypes.data, payload.ctypes.data, len(tags), start_channel, click_channel,
                               ctypes.addressof(result))
    return Packed(payload[:16 * result.kept].data, result.kept, result.crc, result.starts, result.overflows)


def is_record(kind):
    ours = np.dtype(RECORD)
    return kind.itemsize == ours.itemsize and all(
        name in kind.names and kind.fields[name][:2] == ours.fields[name][:2] for name in ours.names)


def records(tags):
    """A copy as RECORD."""
    if is_record(tags.dtype):
        copy = np.frombuffer(bytearray(np.ascontiguousarray(tags)), np.uint8)
        copy[1::16] = 0
        return copy.view(RECORD)
    copy = np.zeros(len(tags), RECORD)
    for name in copy.dtype.names:
        copy[name] = tags[name]
    return copy

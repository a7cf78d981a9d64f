#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Writes the golden bytes in this folder with its own encoders, from the published layouts, independently of the
parsers and the simulator. Run it only when a layout changes, and give the reason in the commit."""
import json
import pathlib
import struct

here = pathlib.Path(__file__).resolve().parent


def crc32c(data):  # CRC-32C of RFC 3720, computed bit by bit
    crc = 0xFFFFFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = (crc >> 1) ^ (0x82F63B78 if crc & 1 else 0)
    return crc ^ 0xFFFFFFFF


def block(kind, sequence, payload, dropped=0):
    header = struct.pack("<4sHHIIQI", b"EFBR", 1, kind, sequence, len(payload), dropped, 0)
    return header + struct.pack("<I", crc32c(header + payload)) + payload


def tag(kind, missed, channel, time_ps):
    return struct.pack("<BBHiq", kind, 0, missed, channel, time_ps)


def write(name, provenance, pieces):
    lines = [f"# {line}" for line in provenance]
    for title, data in pieces:
        lines.append(f"# {title}")
        lines += [data[i : i + 32].hex(" ") for i in range(0, len(data), 32)]
    (here / name).write_text("\n".join(lines) + "\n", encoding="utf-8")


hello = json.dumps({"model": "Time Tagger Ultra", "serial": "1808000BBV", "firmware": "2.10", "extra": [1]}).encode()
tags = tag(0, 0, 1, 1_000_000) + tag(0, 0, 2, 1_013_443) + tag(4, 7, 2, 0) + tag(2, 0, 0, 1_100_000)
depth = struct.pack("<IIQI4f", 3, 2, 123_456_789_012, 42, -0.5, 0.5, 0.25, -0.5)
depth += struct.pack("<6H", 0, 1000, 2000, 3000, 4000, 65535)
write("bridge.hex", ["Bridge protocol, version 1. Made by make_golden.py (Python struct, bitwise CRC-32C)."], [
    ("hello, sequence 0", block(0, 0, hello)),
    ("tags, sequence 1: start, click 13443 ps later, 7 missed on 2, overflow begins", block(1, 1, tags)),
    ("depth 3 x 2, sequence 2, 5 items dropped before", block(2, 2, depth, 5)),
    ("bye, sequence 3", block(3, 3, b"")),
])
counts = struct.pack("<IIQQddI5I", 1, 5, 123_456_789_012, 5000, 13343.0, 92.5, 50_000, 3, 1, 4, 0, 4_000_000_000)
power = struct.pack("<IIQff4f", 4, 42, 123_456_789_012, 0.25, 0.5, 1, 0, 2.5, 1e9)
hello = json.dumps({"model": "Board", "serial": "B7", "firmware": "1", "sends": "histograms"}).encode()
by = "Made by make_golden.py (Python struct, bitwise CRC-32C)."
write("bridge_sensors.hex", [f"Bridge protocol: blocks of other sensors. {by}"], [
    ("hello, sequence 0", block(0, 0, hello)),
    ("histogram of one zone and 5 bins, sequence 1", block(4, 1, counts)),
    ("range profile of 4 bins, frame 42, sequence 2", block(5, 2, power)),
])


def tlv(kind, payload):
    return struct.pack("<II", kind, len(payload)) + payload


def radar_frame(number, cycles, tlvs, padding):
    body = b"".join(tlvs)
    size = -(-(40 + len(body)) // 32) * 32
    header = struct.pack("<4H8I", 0x0102, 0x0304, 0x0506, 0x0708, 0x03030002, size, 0xA6843, number, cycles, 0, len(tlvs), 0)
    return header + body + padding[: size - 40 - len(body)]


profile = struct.pack("<8H", 5000, 6000, 65535, 0, 1, 258, 772, 4097)
stats = struct.pack("<6I", 4000, 8591, 87000, 12, 13, 2)
celsius = struct.pack("<iI10h", 0, 123456, 40, 41, 42, 43, 50, 51, 52, -3, 60, 61)
stale = bytes([2, 1, 4, 3, 6, 5, 8, 7, 2, 0, 3, 3]) + bytes(range(64))
write("radar.hex", [
    "TI mmWave demo, data port, layout of SDK 3.x mmw_output.h. Made by make_golden.py (Python struct).",
    "The padding holds what real padding may hold: a stale magic.",
], [
    ("frame 209: no objects (TLV 1, empty), range profile, stats",
     radar_frame(209, 20_000_000, [tlv(1, b""), tlv(2, profile), tlv(6, stats)], stale)),
    ("frame 210: range profile, stats, temperature",
     radar_frame(210, 40_000_000, [tlv(2, profile), tlv(6, stats), tlv(9, celsius)], stale)),
    ("frame 213: range profile only", radar_frame(213, 100_000_000, [tlv(2, profile)], stale)),
])


def sample(bin_, antenna):  # returns the imaginary part, then the real part
    if (bin_, antenna) == (0, 0):
        return struct.pack("<hh", -32768, 32767)
    return struct.pack("<hh", 100 * bin_ + antenna, -1000 - 100 * bin_ - antenna)


def heat_map(antennas):
    return b"".join(sample(bin_, antenna) for bin_ in range(4) for antenna in range(antennas))


codes = struct.pack("<4H", 3000, 5000, 4000, 3000)
write("radar_array.hex", [
    "TI mmWave demo, data port: heat maps of 4 bins. Made by make_golden.py (Python struct). The sample of",
    "bin b and antenna a has the imaginary part 100 b + a and the real part -1000 - 100 b - a, but the",
    "first is -32768, 32767.",
], [(title, radar_frame(number, 20_000_000 * (number - 276), [tlv(2, codes), *maps], stale)) for number, title, maps in (
    (301, "frame 301: range profile, azimuth heat map of 8 antennas, stats", [tlv(4, heat_map(8)), tlv(6, stats)]),
    (302, "frame 302: range profile, heat map of 12 antennas of a planar array", [tlv(8, heat_map(12))]),
    (303, "frame 303: azimuth heat map, and a second one", [tlv(4, heat_map(8)), tlv(8, heat_map(12))]),
    (304, "frame 304: a heat map of 30 bytes", [tlv(4, heat_map(8)[:30])]))])

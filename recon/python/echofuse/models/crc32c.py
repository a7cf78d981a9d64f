# SPDX-License-Identifier: MIT
"""Computes CRC-32C checksums (RFC 3720) with NumPy."""
from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["crc32c"]

POLYNOMIAL, ROWS = 0x82F63B78, 4096
Words = NDArray[np.uint32]


def _stepped(states: Words, bits: int) -> Words:
    """Returns the CRC states after `bits` zero bits have been processed."""
    for _ in range(bits):
        states = (states >> 1) ^ np.where(states & 1, np.uint32(POLYNOMIAL), np.uint32(0))
    return states


TABLE: Words = _stepped(np.arange(256, dtype=np.uint32), 8)


def _applied(matrix: Words, states: Words) -> Words:
    """Multiplies CRC states by a matrix over GF(2)."""
    bits = (states[:, None] >> np.arange(32, dtype=np.uint32)) & 1
    return np.asarray(np.bitwise_xor.reduce(np.where(bits, matrix, np.uint32(0)), 1))


def crc32c(data: bytes) -> int:
    """Returns the checksum of four or more bytes. The data are split into equal parts, which are
    processed in parallel; their states are then combined in pairs."""
    values = np.frombuffer(data, np.uint8)
    length = 1 << (len(values) // ROWS).bit_length()  # of a part; a power of two
    # Leading zero bytes pad the data, because they do not change a CRC state of 0.
    padded = np.zeros(ROWS * length, np.uint8)
    padded[len(padded) - len(values):] = values
    # XORs the initial state of RFC 3720, which is not 0, into the first four bytes of the data.
    padded[len(padded) - len(values):][:4] ^= 0xFF
    columns, states = padded.reshape(ROWS, length).T.copy(), np.zeros(ROWS, np.uint32)
    for column in columns:
        states = TABLE[(states ^ column) & 0xFF] ^ (states >> 8)
    # Matrix over GF(2) that advances a state by a zero byte. Row k is the state after bit k.
    shift = _stepped(np.uint32(1) << np.arange(32, dtype=np.uint32), 8)
    for _ in range(length.bit_length() - 1):
        shift = _applied(shift, shift)
    while len(states) > 1:
        states, shift = _applied(shift, states[::2]) ^ states[1::2], _applied(shift, shift)
    return int(states[0]) ^ 0xFFFFFFFF

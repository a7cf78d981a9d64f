# SPDX-License-Identifier: MIT
"""The program's split of a run: the same rows as `echofuse-recon train` holds out (recon/data/split.cpp)."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Rows = NDArray[np.int64]
WORD = (1 << 64) - 1


@dataclass(frozen=True)
class Split:
    train: Rows
    validation: Rows
    test: Rows


class Twister:
    """std::mt19937_64 (Nishimura 2000)."""

    def __init__(self, seed: int) -> None:
        self.state = [seed & WORD]
        for i in range(1, 312):
            last = self.state[-1]
            self.state.append((6364136223846793005 * (last ^ last >> 62) + i) & WORD)
        self.at = 312

    def __call__(self) -> int:
        if self.at == 312:
            s = self.state
            for i in range(312):
                x = (s[i] & 0xFFFFFFFF80000000) | (s[(i + 1) % 312] & 0x7FFFFFFF)
                s[i] = s[(i + 156) % 312] ^ x >> 1 ^ (0xB5026F5AA96619E9 if x & 1 else 0)
            self.at = 0
        x = self.state[self.at]
        self.at += 1
        x ^= x >> 29 & 0x5555555555555555
        x ^= x << 17 & 0x71D67FFFEDA60000
        x ^= x << 37 & 0xFFF7EEE000000000
        return x & WORD ^ (x & WORD) >> 43

    def below(self, bound: int) -> int:
        """std::uniform_int_distribution from 0 on: Lemire's method, as libstdc++ has it."""
        product = self() * bound
        if product & WORD < bound:
            least = -bound % (1 << 64) % bound
            while product & WORD < least:
                product = self() * bound
        return product >> 64


def mix(x: int) -> int:
    """One step of SplitMix64."""
    x = (x + 0x9E3779B97F4A7C15) & WORD
    x = (x ^ x >> 30) * 0xBF58476D1CE4E5B9 & WORD
    x = (x ^ x >> 27) * 0x94D049BB133111EB & WORD
    return x ^ x >> 31


def shuffled(rows: ArrayLike, seed: int, stream: int) -> list[int]:
    """std::shuffle as libstdc++ has it: two swaps a random number."""
    out: list[int] = np.asarray(rows).tolist()
    twister, n = Twister(mix(seed ^ mix(stream))), len(out)
    if n < 2:
        return out
    i = 1
    if n % 2 == 0:
        j = twister.below(2)
        out[i], out[j] = out[j], out[i]
        i += 1
    while i < n:
        both = twister.below((i + 1) * (i + 2))
        for j in divmod(both, i + 2):
            out[i], out[j] = out[j], out[i]
            i += 1
    return out


def split_rows(rows: ArrayLike, kind: str = "random", seed: int = 1, *, test_share: float = 0.1,
               validation_share: float = 0.05, gap: int = 0) -> Split:
    """Rows to train on, to stop early by, and to judge by; kind: "random", or "blocked" for sequences. Raises ValueError."""
    if kind not in ("random", "blocked"):
        raise ValueError(f'split "{kind}": expected "random" or "blocked"')
    rest = shuffled(rows, seed, 0x73706C6974) if kind == "random" else np.asarray(rows).tolist()

    def cut(share: float) -> Rows:
        nonlocal rest
        count = int(np.floor(share * len(rest) + 0.5))
        part, rest = rest[len(rest) - count:], rest[:len(rest) - count]
        if kind == "blocked" and part:
            rest = rest[:max(0, len(rest) - gap)]
        return np.array(sorted(part), np.int64)

    test = cut(test_share)
    validation = cut(validation_share)
    return Split(np.array(sorted(rest), np.int64), validation, test)

"""A second implementation of the random numbers of `crates/random/src/lib.rs` and `crates/models/src/randomness.rs`: ChaCha with
12 rounds (Bernstein 2008), keyed by purpose."""

import math
import struct
from collections.abc import Iterator

import numpy as np

TRAINING = 1
"""The value of `Purpose::Training`, keyed by (step, trajectory of the batch)."""
CUT = 5
"""The value of `Purpose::Cut`, keyed by (step, 0)."""
ROUNDS = 12
QUARTERS = [(0, 4, 8, 12), (1, 5, 9, 13), (2, 6, 10, 14), (3, 7, 11, 15)]
QUARTERS += [(0, 5, 10, 15), (1, 6, 11, 12), (2, 7, 8, 13), (3, 4, 9, 14)]


def words(key: tuple[int, int, int, int]) -> Iterator[int]:
    """The 32-bit words of a key of four numbers."""
    head = list(struct.unpack("<4I", b"expand 32-byte k")) + list(struct.unpack("<8I", struct.pack("<4Q", *key)))
    block = 0
    while True:
        state = [*head, block & 0xFFFFFFFF, block >> 32, 0, 0]
        mixed = list(state)
        for _ in range(ROUNDS // 2):
            for a, b, c, d in QUARTERS:
                for first, second, last, bits in [(a, b, d, 16), (c, d, b, 12), (a, b, d, 8), (c, d, b, 7)]:
                    mixed[first] = (mixed[first] + mixed[second]) & 0xFFFFFFFF
                    turned = mixed[last] ^ mixed[first]
                    mixed[last] = (turned << bits | turned >> 32 - bits) & 0xFFFFFFFF
        yield from ((word + first) & 0xFFFFFFFF for word, first in zip(mixed, state, strict=True))
        block += 1


def below(source: Iterator[int], end: int) -> int:
    """Whole numbers like those of `Noise::below`."""
    return next(source) * end >> 32


def normals(source: Iterator[int], count: int) -> list[float]:
    """Normal numbers like those of `fill_normal`, with both branches of Box and Muller, in single precision."""
    found = []
    while len(found) < count:
        unit, turn = (np.float32(next(source) >> 8) / np.float32(1 << 24) for _ in range(2))
        radius = math.sqrt(-2.0 * math.log(1.0 - unit))
        angle = float(np.float32(math.tau) * turn)
        found += [radius * math.cos(angle), radius * math.sin(angle)]
    return found[:count]

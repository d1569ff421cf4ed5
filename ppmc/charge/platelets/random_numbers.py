"""A random number generator for kernels: the same numbers on every machine, thread count and numba version.

SplitMix64 (Steele, Lea, Flood, OOPSLA 2014, doi:10.1145/2660193.2660195); the state is an array of one uint64.
"""

from __future__ import annotations

import numpy as np

from ppmc.compile_cache import njit

GAMMA = np.uint64(0x9E3779B97F4A7C15)
MIX_1 = np.uint64(0xBF58476D1CE4E5B9)
MIX_2 = np.uint64(0x94D049BB133111EB)
S30, S27, S31, S11 = np.uint64(30), np.uint64(27), np.uint64(31), np.uint64(11)


@njit
def next_bits(state):  # type: ignore[no-untyped-def]
    """Return 64 random bits and advance the state, shape (1,), uint64."""
    state[0] += GAMMA
    z = state[0]
    z = (z ^ (z >> S30)) * MIX_1
    z = (z ^ (z >> S27)) * MIX_2
    return z ^ (z >> S31)


@njit
def next_uniform(state):  # type: ignore[no-untyped-def]
    """Return a number in [0, 1) of 53 random bits."""
    return float(next_bits(state) >> S11) * (1.0 / 9007199254740992.0)


@njit
def next_below(state, n):  # type: ignore[no-untyped-def]
    """Return an integer from 0 to n - 1; its bias of n/2^53 is far below what any count here can show."""
    return min(int(next_uniform(state) * n), n - 1)

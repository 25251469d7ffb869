"""The standard normals of `numpy.random.Generator`, to the last bit, drawn in compiled code.

PCG64 (O'Neill 2014, XSL-RR 128/64) and the ziggurat of numpy's `standard_normal`, with the tables
that numba keeps of it. Drawn by numpy they would be a ninth of a flight's time.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba.np.random._constants import (
    fi_double,
    ki_double,
    wi_double,
    ziggurat_nor_inv_r,
    ziggurat_nor_r,
)

from tombo_dynamics.arrays import Array
from tombo_dynamics.jit import compiled

Word = Any
"""np.uint64, which mypy does not know from int."""
_MULTIPLIER = (0x2360ED051FC65DA4 << 64) + 0x4385DF649FCCF645
_HIGH, _LOW = np.uint64(_MULTIPLIER >> 64), np.uint64(_MULTIPLIER & (2**64 - 1))
_58, _11, _9, _8, _1 = (np.uint64(bits) for bits in (58, 11, 9, 8, 1))
_32, _63, _64 = np.uint64(32), np.uint64(63), np.uint64(64)
_HALF = np.uint64(0xFFFFFFFF)
_LAYER, _SHARE = np.uint64(0xFF), np.uint64(0x000FFFFFFFFFFFFF)
_MASK = 2**64 - 1


def stream_of(generator: np.random.Generator) -> Any:
    """Return where a PCG64 generator stands: (4) uint64, high and low of state and increment."""
    state = generator.bit_generator.state["state"]
    words = [part >> shift & _MASK for part in (state["state"], state["inc"]) for shift in (64, 0)]
    return np.array(words, np.uint64)


@compiled
def _high_product(a: Word, b: Word) -> Word:
    """Return the upper half of a product of two words."""
    a_high, a_low, b_high, b_low = a >> _32, a & _HALF, b >> _32, b & _HALF
    middle = a_high * b_low + (a_low * b_low >> _32)
    other = a_low * b_high + (middle & _HALF)
    return a_high * b_high + (middle >> _32) + (other >> _32)


@compiled
def _next(high: Word, low: Word, add_high: Word, add_low: Word) -> tuple[Word, Word, Word]:
    """Return the state after one step, and 64 random bits."""
    next_low = low * _LOW + add_low
    carry = np.uint64(next_low < add_low)
    next_high = high * _LOW + low * _HIGH + _high_product(low, _LOW) + add_high + carry
    turn, bits = next_high >> _58, next_high ^ next_low
    return next_high, next_low, (bits >> turn) | (bits << ((_64 - turn) & _63))


@compiled(inline=False)
def draw_normals(stream: Any, out: Array) -> None:
    """Write the next standard normals of a stream.

    Args:
        stream: (4), of `stream_of`; it goes on.
        out: (N, K), written row by row.
    """
    high, low, add_high, add_low = stream[0], stream[1], stream[2], stream[3]
    for row in range(out.shape[0]):
        for column in range(out.shape[1]):
            while True:
                high, low, bits = _next(high, low, add_high, add_low)
                layer = bits & _LAYER
                bits >>= _8
                negative = bits & _1
                share = (bits >> _1) & _SHARE
                x = share * wi_double[layer]
                if negative:
                    x = -x
                if share < ki_double[layer]:
                    break  # 99.3 % of all
                if layer == 0:
                    while True:
                        high, low, bits = _next(high, low, add_high, add_low)
                        beyond = -ziggurat_nor_inv_r * math.log1p(-_uniform(bits))
                        high, low, bits = _next(high, low, add_high, add_low)
                        if -2.0 * math.log1p(-_uniform(bits)) > beyond * beyond:
                            break
                    x = ziggurat_nor_r + beyond
                    if (share >> _8) & _1:
                        x = -x
                    break
                high, low, bits = _next(high, low, add_high, add_low)
                above, below = fi_double[layer - _1], fi_double[layer]
                if (above - below) * _uniform(bits) + below < math.exp(-0.5 * x * x):
                    break
            out[row, column] = x
    stream[0], stream[1] = high, low


@compiled
def _uniform(bits: Word) -> float:
    """Return a number from 0 to 1, without 1."""
    return float((bits >> _11) * (1.0 / 9007199254740992.0))

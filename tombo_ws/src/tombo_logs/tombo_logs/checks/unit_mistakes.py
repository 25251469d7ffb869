"""Mistakes of units, by the factor that they make between values and expectation."""

from __future__ import annotations

import math

from tombo_dynamics.vehicle import GRAVITY

_MISTAKES = {
    "angle": {
        57.29578: "degrees declared as radians",
        1.0 / 57.29578: "radians declared as degrees",
    },
    "turning": {9.549297: "rpm declared as rad/s", 1.0 / 9.549297: "rad/s declared as rpm"},
    "rotor": {
        7.0: "electrical speed, of 7 pole pairs, declared as the rotor's",
        2.0: "counted per blade or per pulse, declared as turns",
        0.5: "half the turns: a divider of two",
    },
    "force": {GRAVITY: "m/s^2 declared as g", 1.0 / GRAVITY: "g declared as m/s^2"},
    "length": {
        3.28084: "ft declared as m",
        1000.0: "mm declared as m",
        0.001: "m declared as mm",
        100.0: "cm declared as m",
        0.01: "m declared as cm",
    },
}
"""Quantity → by how much a mistake makes it too large."""
_MAX_LOG_RATIO = 0.35
"""Largest logarithm of a ratio to the factor of its mistake."""


def guess(ratio: float, *quantities: str) -> str:
    """Return the mistake of units that makes quantities `ratio` times too large, or nothing."""
    close = {
        abs(math.log(ratio / factor)): text
        for quantity in quantities
        for factor, text in _MISTAKES[quantity].items()
        if ratio > 0.0
    }
    nearest = min(close, default=math.inf)
    return f": {close[nearest]}?" if nearest < _MAX_LOG_RATIO else ""

"""Which mistake of units makes values so much larger or smaller than they should be."""

from __future__ import annotations

import math

from tombo_dynamics.vehicle import GRAVITY

_FACTORS = {
    57.29578: "degrees declared as radians",
    1.0 / 57.29578: "radians declared as degrees",
    9.549297: "rpm declared as rad/s",
    1.0 / 9.549297: "rad/s declared as rpm",
    GRAVITY: "m/s^2 declared as g",
    1.0 / GRAVITY: "g declared as m/s^2",
    7.0: "electrical speed, of 7 pole pairs, declared as the rotor's",
    2.0: "counted per blade or per pulse, declared as turns",
    0.5: "half the turns: a divider of two",
    3.28084: "ft declared as m",
    1000.0: "mm declared as m",
    0.001: "m declared as mm",
    100.0: "cm declared as m",
    0.01: "m declared as cm",
}
_NEAR = 0.35
"""Largest logarithm of a ratio to the factor of its mistake."""


def guess(ratio: float, among: tuple[str, ...] = ()) -> str:
    """Return the mistake of units that makes values `ratio` times too large, or nothing."""
    close = {
        abs(math.log(ratio / factor)): text
        for factor, text in _FACTORS.items()
        if ratio > 0.0 and (not among or any(a in text for a in among))
    }
    nearest = min(close, default=math.inf)
    return f": {close[nearest]}?" if nearest < _NEAR else ""

"""Which mistake of units makes values so much larger or smaller than they should be."""

from __future__ import annotations

from tombo_dynamics.vehicle import GRAVITY

_FACTORS = {
    57.29578: "degrees declared as radians",
    1.0 / 57.29578: "radians declared as degrees",
    9.549297: "rpm declared as rad/s",
    1.0 / 9.549297: "rad/s declared as rpm",
    GRAVITY: "m/s^2 declared as g",
    1.0 / GRAVITY: "g declared as m/s^2",
    1000.0: "mm declared as m",
    0.001: "m declared as mm",
    100.0: "cm declared as m",
    0.01: "m declared as cm",
}


def guess(ratio: float, among: tuple[str, ...] = ()) -> str:
    """Return the mistake of units that makes values `ratio` times too large, or nothing."""
    for factor, text in _FACTORS.items():
        if 0.7 < ratio / factor < 1.4 and (not among or any(a in text for a in among)):
            return f": {text}?"
    return ""

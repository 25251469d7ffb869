"""Units of tables and logs, their factors to those of the channels, and mistakes of them."""

from __future__ import annotations

import math
from collections.abc import Mapping

from tombo_dynamics.errors import unknown_name
from tombo_dynamics.vehicle import GRAVITY

DEGREE = math.pi / 180.0

UNITS: Mapping[str, Mapping[str, float]] = {
    "m": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "ft": 0.3048},
    "rad": {"rad": 1.0, "deg": DEGREE},
    "rad/s": {
        "rad/s": 1.0,
        "deg/s": DEGREE,
        "mrad/s": 1e-3,
        "rpm": math.pi / 30.0,
        "krpm": 1e3 * math.pi / 30.0,
        "rev/s": 2.0 * math.pi,
    },
    "m/s": {"m/s": 1.0, "cm/s": 1e-2, "mm/s": 1e-3},
    "m/s^2": {"m/s^2": 1.0, "g": GRAVITY, "mg": 1e-3 * GRAVITY, "cm/s^2": 1e-2},
    "N": {
        "N": 1.0,
        "mN": 1e-3,
        "kN": 1e3,
        "g": 1e-3 * GRAVITY,
        "gf": 1e-3 * GRAVITY,
        "kg": GRAVITY,
        "kgf": GRAVITY,
        "lbf": 4.4482216,
        "ozf": 0.27801385,
    },
    "N m": {
        "N m": 1.0,
        "mN m": 1e-3,
        "N mm": 1e-3,
        "N cm": 1e-2,
        "g cm": 1e-5 * GRAVITY,
        "kg cm": 1e-2 * GRAVITY,
        "lbf in": 0.11298483,
    },
    "V": {"V": 1.0, "mV": 1e-3},
    "A": {"A": 1.0, "mA": 1e-3},
    "W": {"W": 1.0, "mW": 1e-3},
    "s": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0},
    "1": {"1": 1.0, "%": 1e-2},
}
"""Unit of a channel → what may be declared in its place, with the factor to it."""

SPELLINGS = {
    **{unit.replace(" ", ""): unit for unit in UNITS["N m"]},
    "N·m": "N m",
    "N⋅m": "N m",
    "N.m": "N m",
    "N-m": "N m",
    "N*m": "N m",
    **dict.fromkeys(("rad_s", "rad s^-1", "rads", "radps"), "rad/s"),
    **dict.fromkeys(("m_s", "m s^-1", "mps"), "m/s"),
    **dict.fromkeys(("m_s2", "m_s_2", "m s^-2", "mps2", "m/s2", "m/s²"), "m/s^2"),
    "degrees": "deg",
    "degree": "deg",
    "°": "deg",
    **dict.fromkeys(("deg_s", "deg s^-1", "degps", "dps", "°/s"), "deg/s"),
    "radians": "rad",
    "rps": "rev/s",
    "hz": "rev/s",
    **dict.fromkeys(("µs", "usec"), "us"),
    **dict.fromkeys(("sec", "secs", "seconds"), "s"),
    **dict.fromkeys(("percent", "pct"), "%"),
    "v": "V",
    "mv": "mV",
    "a": "A",
    "ma": "mA",
}
"""Other ways to write a unit → as in `UNITS`."""
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


def factor(unit: str, wanted: str, what: str) -> float:
    """Return by what to multiply values in `unit` to have them in `wanted`, a key of `UNITS`.

    `unit` is as declared, in any usual spelling; `what` is converted, for the error.

    Raises:
        InputError: no such unit for such a channel.
    """
    accepted = UNITS[wanted]
    text = unit.strip()
    for name in (text, text.lower()):
        name = SPELLINGS.get(name, name)
        if name in accepted:
            return accepted[name]
    raise unknown_name(f"unit of {what}", unit, accepted)


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
